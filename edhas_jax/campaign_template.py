"""A commented campaign to start from: `campaign.yaml` and one run, made by the model so that everything fits."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from edhas_jax.campaign import CampaignError
from edhas_jax.effects import EntrainedAir, LugreFriction, PistonLeakage
from edhas_jax.run import Simulation, simulate
from edhas_jax.signals import SIGNALS
from edhas_jax.system import PumpBench
from edhas_jax.units import from_si

NOISE = {
    "voltage": (0.02, "V"), "current": (0.02, "A"), "piston_position": (0.005, "mm"),
    "outlet_pressure": (0.0015, "MPa"), "outlet_flow": (0.012, "L/min"),
}  # fmt: skip

TEXT = """\
# A measurement campaign: what was run, what was measured, what is not known exactly.
# Put your run files beside this file, change what follows, and ask: edhas campaign check {folder}
name: {name}
rig: pump_bench          # actuator_bench | pump_bench | actuator_system
parameters:              # what you know to differ from nominal (edhas parameters lists all), with units
  coil_resistance: 1.41 ohm
# without: [lugre_friction]    # refined effects that your present model lacks; all others are in it
uncertain:               # relative standard deviation of what you know only roughly: 0.1 is 10 %
  coil_resistance: 0.02
  force_constant: 0.02
  mover_damping: 0.25
  piston_clearance: 0.1
  load_orifice_area: 0.03
# amplifier: {{kind: current, gain: 1 A/V}}                     # where they differ from the nominal machine
# controller: {{kind: cascade, kp: 160 1/s, kv: 240 V*s/m}}     # position (kp, ki, kd, kaw, kff) | cascade (kp, kv)
# reference: set_point         # the column with the recorded set point, where none of the built-in ones was used
# time: {{column: t, unit: ms}}  # where the files call it otherwise than `time [ms]`
signals:                 # unit in the files, and the standard deviation of the sensor's noise in that unit
{signals}  # another name in the files: current: {{unit: A, noise: 0.02, column: i_coil}}
runs:                    # fit: to calibrate with; holdout: to judge by. The conditions are parameters of the machine
  - {{file: run1.csv, use: fit, frequency: 10 Hz, amplitude: 3.5 mm, load_orifice_area: 4.2 mm^2}}
# - {{file: run2.csv, use: holdout, frequency: 15 Hz, amplitude: 3.5 mm, load_orifice_area: 2 mm^2}}
"""


def write_template(folder: Path, on_progress: Callable[[float], None] | None = None) -> list[Path]:
    """Write `campaign.yaml` and `run1.csv` into a new folder; the run is simulated, with noise added.

    Raises:
        CampaignError: the folder holds something already, or cannot be written.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise CampaignError(f"{folder}: exists already; nothing was written. Name another folder")
    machine = PumpBench(effects=(LugreFriction(), PistonLeakage(), EntrainedAir()))
    signals = simulate(machine, Simulation(duration=0.35, sample_rate=2000.0), on_progress).signals
    draw = np.random.default_rng(0)
    columns = {"time [ms]": 1e3 * signals["time"]}
    for name, (noise, unit) in NOISE.items():
        exact = from_si(signals[name], SIGNALS[name].unit, unit)
        columns[f"{name} [{unit}]"] = exact + draw.normal(0.0, noise, len(exact))
    rows = "".join(f"  {name}: {{unit: {unit}, noise: {noise}}}\n" for name, (noise, unit) in NOISE.items())
    yaml, run = folder / "campaign.yaml", folder / "run1.csv"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yaml.write_text(TEXT.format(name=folder.resolve().name, folder=folder, signals=rows), encoding="utf-8")
        table = np.stack(list(columns.values()), axis=1)
        np.savetxt(run, table, fmt="%.6g", delimiter=",", header=",".join(columns), comments="", encoding="utf-8")
    except OSError as error:
        raise CampaignError(f"{folder}: cannot be written: {error.strerror}") from None
    return [yaml, run]
