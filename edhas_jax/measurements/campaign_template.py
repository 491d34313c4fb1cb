"""Write a commented example campaign to start from: `campaign.yaml` and one simulated run."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from edhas_jax.core.literal_text import one_line, yaml_text
from edhas_jax.core.units import from_si
from edhas_jax.machine.effects import EntrainedAir, LugreFriction, PistonLeakage
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.machine.rigs import PumpBench
from edhas_jax.measurements.campaign import CampaignError
from edhas_jax.simulation.run import Simulation, simulate

# standard deviation and unit by signal
SENSOR_NOISE = {
    "voltage": (0.02, "V"), "current": (0.02, "A"), "piston_position": (0.005, "mm"),
    "outlet_pressure": (0.0015, "MPa"), "outlet_flow": (0.012, "L/min"),
}  # fmt: skip

TEMPLATE = """\
# A measurement campaign: the runs, the measured signals, and the parameters that are not known exactly.
# Put your run files beside this file, adapt what follows, then run: edhas campaign check {folder}
name: {name}
rig: pump_bench          # actuator_bench | pump_bench | actuator_system
parameters:              # known values that differ from nominal, with units (edhas parameters lists all)
  coil_resistance: 1.41 ohm
# without: [lugre_friction]    # refined effects that your present model lacks; it has all others
uncertain:               # relative standard deviation of the true value: 0.1 is 10 %
  coil_resistance: 0.02
  force_constant: 0.02
  mover_damping: 0.25
  piston_clearance: 0.1
  load_orifice_area: 0.03
# amplifier: {{kind: current, gain: 1 A/V}}                     # where it differs from the nominal machine
# controller: {{kind: cascade, kp: 160 1/s, kv: 240 V*s/m}}     # position (kp, ki, kd, kaw, kff) | cascade (kp, kv)
# reference: {{column: xref, unit: mm}}    # the recorded set point, if none of the built-in ones was used
# time: {{column: t, unit: ms}}  # if the time column is not called `time [ms]`
signals:                 # unit in the files; `noise` (standard deviation in that unit) is measured where it is left out
{signals}  # if the column has another name: current: {{unit: A, noise: 0.02, column: i_coil}}
# accuracy:              # standard deviations, where they differ from these; 0 is exact
#   trigger: 0.2 ms      # of the start of each record
#   settings: {{load_orifice_area: 0.5 %, coil_resistance: 0.5 %}}                  # of each run
#   signals: {{outlet_pressure: {{gain: 0.3 %, offset: 2 kPa, shift: 20 us}}}}      # of each sensor, for all runs
runs:                    # fit: to estimate parameters; holdout: to validate. Conditions are parameters of the machine
  - {{file: run1.csv, use: fit, frequency: 10 Hz, amplitude: 3.5 mm, load_orifice_area: 4.2 mm^2}}
# `running: yes` in a run: the machine was running already when the record began
# - {{file: run2.csv, use: holdout, frequency: 15 Hz, amplitude: 3.5 mm, load_orifice_area: 2 mm^2}}
"""


def write_template(folder: Path, on_progress: Callable[[float], None] | None = None) -> list[Path]:
    """Write `campaign.yaml` and `run1.csv` into a new or empty folder; the run is simulated, with noise added.

    Args:
        folder: the folder to create.
        on_progress: called with the completed share of the simulation, 0 … 1.

    Returns:
        The paths of the files.

    Raises:
        CampaignError: the folder is not empty, or cannot be written.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise CampaignError(f"{folder}: exists already; nothing was written. Name another folder")
    machine = PumpBench(effects=(LugreFriction(), PistonLeakage(), EntrainedAir()))
    signals = simulate(machine, Simulation(duration=0.35, sample_rate=2000.0), on_progress).signals
    rng = np.random.default_rng(0)
    columns = {"time [ms]": 1e3 * signals["time"]}
    for name, (noise, unit) in SENSOR_NOISE.items():
        exact = from_si(signals[name], SIGNALS[name].unit, unit)
        columns[f"{name} [{unit}]"] = exact + rng.normal(0.0, noise, len(exact))
    rows = "".join(f"  {name}: {{unit: {unit}, noise: {noise}}}\n" for name, (noise, unit) in SENSOR_NOISE.items())
    yaml, run = folder / "campaign.yaml", folder / "run1.csv"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        name = yaml_text(folder.resolve().name)
        yaml.write_text(TEMPLATE.format(name=name, folder=one_line(str(folder)), signals=rows), encoding="utf-8")
        table = np.stack(list(columns.values()), axis=1)
        np.savetxt(run, table, fmt="%.6g", delimiter=",", header=",".join(columns), comments="", encoding="utf-8")
    except OSError as error:
        raise CampaignError(f"{folder}: cannot be written: {error.strerror}") from None
    return [yaml, run]
