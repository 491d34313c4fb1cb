"""Write the campaign of the demo: a simulated bench with the imperfections of a real one.

    python -m studies.demo.bench_as_it_is [--out DIR]

The inverter of the bench has a dead time whose law is not that of the library: the voltage lost follows the current
by an arctangent. Small disturbances that are not in the library act as well, parameters differ from their prior means,
and the sheet does not state the noise. The integrator and the sensor models are those of the benchmark of hidden
effects, which no diagnosis uses. The last line: `runs=… hidden=… disturbances=… left_by_disturbances=…`, what they
leave being in units of the noise.
"""

import argparse
import dataclasses
import math
import sys
from pathlib import Path

import numpy as np

from edhas_jax.machine.effects import InverterDeadTime
from edhas_jax.measurements.campaign_reader import read_campaign
from studies.campaign_writer import write_campaign
from studies.demo import CAMPAIGN
from studies.demo.disturbances import DISTURBANCES
from studies.hidden_effects.generators.disturbances import draw_disturbances
from studies.hidden_effects.generators.functions import arctan
from studies.hidden_effects.generators.laws import law
from studies.hidden_effects.generators.records import recorded
from studies.hidden_effects.generators.settings import usual_deviations, with_deviations
from studies.hidden_effects.generators.visibility import VisibilityTest

DEAD_TIME = law(
    InverterDeadTime, "ArctanDeadTime", "Dead time with a wide transition: −V (2/π) atan(i/0.1 A). "
    "Source: clamping of the current around zero; Jeong, Park, IEEE Trans. Ind. Electron. 38 (1991) 108.",
    {"lost_voltage": ("V", 0.2, 3.0)},
    coil_voltage_change=lambda e, s, z: -e.lost_voltage * (2.0 / math.pi) * arctan(s.current / 0.1),
).kind  # fmt: skip
LOST_VOLTAGE = 0.9  # V
NOISE = {
    "voltage": 0.02, "current": 0.02, "piston_position": 5e-6, "outlet_pressure": 1.5e3, "outlet_flow": 2e-7
}  # fmt: skip
SEED = 3


def main(arguments: list[str] | None = None) -> int:
    """Write the campaign into a new folder."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("runs/bench_as_it_is"))
    options = parser.parse_args(arguments)
    rng, plan = np.random.default_rng(SEED), read_campaign(CAMPAIGN)
    channels = {n: dataclasses.replace(c, noise=NOISE[n]) for n, c in plan.channels.items()}
    runs = tuple(dataclasses.replace(run, signals={}) for run in plan.runs)
    plan = dataclasses.replace(plan, channels=channels, runs=runs)
    truth = with_deviations(plan, plan.machine, usual_deviations(rng, len(plan.uncertain_in(plan.machine))))
    disturbances = draw_disturbances(VisibilityTest(plan, truth, ()), DISTURBANCES, rng)
    if disturbances is None:
        print("no disturbances of this seed; choose another one", file=sys.stderr)
        return 1
    effects = (*disturbances.machine.effects, DEAD_TIME(lost_voltage=LOST_VOLTAGE))
    measured = recorded(plan, dataclasses.replace(disturbances.machine, effects=effects), rng)
    unstated = {n: dataclasses.replace(c, noise=math.nan, stated_noise=None) for n, c in measured.channels.items()}
    write_campaign(dataclasses.replace(measured, channels=unstated), options.out)
    print(f"runs={len(runs)} hidden=inverter_dead_time disturbances={','.join(disturbances.sizes)} "
          f"left_by_disturbances={disturbances.left_over:.3f}")  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
