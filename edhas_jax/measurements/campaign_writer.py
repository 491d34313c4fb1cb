"""A commented campaign to start from: `campaign.yaml` and one run, made by the model so that everything fits."""


from collections.abc import Callable
from pathlib import Path

import numpy as np

from edhas_jax.core.units import exact_quantity, from_si
from edhas_jax.machine.effects import EntrainedAir, LugreFriction, PistonLeakage
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.machine.parameters import KINDS, find_parameter, list_parameters, short_names
from edhas_jax.machine.rigs import PumpBench
from edhas_jax.measurements.campaign import Campaign, CampaignError
from edhas_jax.measurements.campaign_reader import FILE, REFINED
from edhas_jax.simulation.run import Simulation, simulate

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



DIGITS = "%.6g"


def write_campaign(campaign: Campaign, folder: Path) -> list[Path]:
    """Write a campaign into a new or empty folder; the paths of its files.

    The machine may differ from the nominal one by its parameters and by refined effects that it lacks.

    Raises:
        CampaignError: another amplifier, controller or reference than nominal, which would be lost; the folder holds
            something already, or cannot be written.
    """
    nominal = type(campaign.machine)()
    for section in (name for name in KINDS if hasattr(nominal, name)):
        if type(getattr(campaign.machine, section)) is not type(getattr(nominal, section)):
            raise CampaignError(f"{campaign.name}: a campaign with another {section} than nominal cannot be written")
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise CampaignError(f"{folder}: exists already; nothing was written. Name another folder")
    paths = [folder / FILE]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        paths[0].write_text(campaign_text(campaign), encoding="utf-8")
        for run in campaign.runs:
            columns = {"time [ms]": 1e3 * run.time}
            for name, values in run.signals.items():
                unit = campaign.channels[name].unit
                columns[f"{name} [{unit}]"] = from_si(values, SIGNALS[name].unit, unit)
            path = folder / f"{run.name}.csv"
            table = np.stack(list(columns.values()), axis=1)
            np.savetxt(path, table, DIGITS, ",", header=",".join(columns), comments="", encoding="utf-8")
            paths.append(path)
    except OSError as error:
        raise CampaignError(f"{folder}: cannot be written: {error.strerror}") from None
    return paths


def campaign_text(campaign: Campaign) -> str:
    """The text of `campaign.yaml`."""
    machine = campaign.machine
    lines = [f"name: {campaign.name}", f"rig: {machine.name}"]
    mounted = {effect.id for effect in machine.effects}
    without = [e.id for e in REFINED if e.id not in mounted and set(e.slots) <= set(machine.slots)]
    lines += [f"without: [{', '.join(without)}]"] if without else []
    rows = list_parameters(machine)
    names = short_names(machine)
    changed = [(p, value, path) for p, value, path in rows if float(value) != p.default]
    lines += ["parameters:"] if changed else []
    for p, value, path in changed:
        lines.append(f"  {names[path, p.name]}: {exact_quantity(value, p.unit)}")
    lines += ["uncertain:   # relative standard deviation"] if campaign.uncertain else []
    lines += [f"  {name}: {spread:g}" for name, spread in campaign.uncertain.items()]
    lines.append("signals:   # unit in the files, standard deviation of the noise in that unit")
    for name, channel in campaign.channels.items():
        size = from_si(channel.noise, SIGNALS[name].unit, channel.unit)
        lines.append(f"  {name}: {{unit: {channel.unit}, noise: {size:.6g}}}")
    lines.append("runs:")
    for run in campaign.runs:
        words = [f"file: {run.name}.csv", f"use: {run.use.value}"]
        for name, value in run.conditions.items():
            words.append(f"{name}: {exact_quantity(value, find_parameter(machine, name)[0].unit)}")
        lines.append(f"  - {{{', '.join(words)}}}")
    return "\n".join([*lines, ""])
