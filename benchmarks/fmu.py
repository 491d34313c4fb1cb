"""Exported units in FMPy against the package's own simulation: largest difference of any signal, and speed.

    python benchmarks/fmu.py [--effects]

Each unit is stepped over a whole run and compared at every communication point; a difference is a share of the range of
its signal. `--effects` adds every effect of the library, a unit each. The speed is that of one core at steps of 20 µs
within communication steps of 1 ms. The last line sums up as key=value.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

import fmpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import edhas_jax as edhas  # noqa: E402
from edhas_jax.config.machine_config import Config, build_config, read_config  # noqa: E402
from edhas_jax.machine.effects import LIBRARY  # noqa: E402
from tests.support import CONFIGS  # noqa: E402
from tests.support.fmu_unit import Unit  # noqa: E402

CONFIGURATIONS = ("actuator", "paper", "paper_step")
INTERVAL, QUICK_DURATION, COMMUNICATION_STEP = 5e-4, 0.06, 1e-3  # s
QUICK = {"duration": f"{QUICK_DURATION} s", "sample_rate": "2 kHz"}
SINE = {"kind": "sine", "frequency": "30 Hz", "ramp_time": "20 ms"}
PUMP = {"rig": "pump_bench", "reference": SINE, "simulation": QUICK}
ACTUATOR = PUMP | {"rig": "actuator_bench"}
DRIVES = {
    "cascade, current amplifier": {"controller": {"kind": "cascade"}, "amplifier": {"kind": "current"}},
    "antsmc": {"controller": {"kind": "antsmc"}},
    "open_loop": {"reference": {"kind": "chirp", "amplitude": "2 V"}, "controller": {"kind": "open_loop"}},
}


def main() -> None:
    """Print the tables; the last line sums them up."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--effects", action="store_true", help="every effect of the library too")
    options = options.parse_args()
    found = {name: compared(f"configs/{name}.yaml", read_config(CONFIGS / f"{name}.yaml"), True)
             for name in CONFIGURATIONS}  # fmt: skip
    plain = compared("pump_bench without effects", build_config(PUMP), False)
    drives = max(compared(name, build_config(ACTUATOR | change), False) for name, change in DRIVES.items())
    effects = max(compared(kind.id, build_config(mapping(kind)), False) for kind in LIBRARY) if options.effects else 0.0
    print(" ".join(f"{name}={difference:.1e}" for name, difference in found.items())
          + f" without_effects={plain:.1e} drives={drives:.1e} effects={effects:.1e}")  # fmt: skip


def mapping(kind: type) -> dict:
    """The configuration of a refined rig with one effect more."""
    rig = "actuator_system" if all(slot.location == "cylinder" for slot in kind.slots) else "pump_bench"
    effects = list(dict.fromkeys(("lugre_friction", "piston_leakage", "entrained_air", kind.id)))
    base = {"rig": rig, "effects": effects, "simulation": QUICK}
    return base if rig == "actuator_system" else base | {"reference": SINE}


def compared(title: str, config: Config, timed: bool) -> float:
    """Print the largest difference of a unit from the simulation, and its speed; the difference."""
    with tempfile.TemporaryDirectory() as folder:
        unit = Unit(Path(folder) / "machine.fmu", config)
        run = edhas.simulate(config.machine, config.simulation)
        interval = 1.0 / config.simulation.sample_rate
        columns = fmpy.simulate_fmu(
            str(unit.path), stop_time=config.simulation.duration, output_interval=interval, output=unit.outputs
        )
        shares = {n: share(columns[n], np.asarray(run.signals[n])) for n in unit.outputs}
        worst = max(shares, key=shares.get)
        text = f"{title:<32}{worst:<22}{shares[worst]:9.1e}"
        if timed:
            instance, count, begin = unit.instance(), 1000, time.perf_counter()
            for k in range(count):
                instance.doStep(k * COMMUNICATION_STEP, COMMUNICATION_STEP)
            text += f"{count * COMMUNICATION_STEP / (time.perf_counter() - begin):8.0f} machine-seconds per second"
        print(text, flush=True)
    return shares[worst]


def share(got: np.ndarray, expected: np.ndarray) -> float:
    """The largest difference of two signals as a share of the range; of the value where the signal is constant."""
    span = max(np.ptp(expected), 1e-9 * np.abs(expected).max()) or 1.0
    return float(np.abs(got - expected).max() / span)


if __name__ == "__main__":
    main()
