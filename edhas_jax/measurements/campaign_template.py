"""Write a commented example campaign to start from: `campaign.yaml` and one simulated run."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from edhas_jax.config.templates import filled
from edhas_jax.core import structs
from edhas_jax.core.literal_text import one_line, yaml_text
from edhas_jax.core.units import from_si
from edhas_jax.machine.effects import EntrainedAir, LugreFriction, PistonLeakage
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.machine.rig_base import Rig
from edhas_jax.machine.rigs import PumpBench
from edhas_jax.measurements.campaign import CampaignError
from edhas_jax.measurements.campaign_draft import uncertainty_lines
from edhas_jax.simulation.run import Simulation, simulate

# standard deviation and unit by signal
SENSOR_NOISE = {
    "voltage": (0.02, "V"), "current": (0.02, "A"), "piston_position": (0.005, "mm"),
    "outlet_pressure": (0.0015, "MPa"), "outlet_flow": (0.012, "L/min"),
}  # fmt: skip
RIG_SAMPLES, RIG_NOISE = 500, 2e-3  # of the simulated run; standard deviation of its noise over the range of a signal
RIG_SPREAD, SMALLEST_NOISE = 0.1, 1e-9


def write_rig_campaign(
    folder: Path, rig: type[Rig], spec: str, on_progress: Callable[[float], None] | None = None
) -> list[Path]:
    """Write `campaign.yaml` and `run1.csv` of a rig of one's own into a new or empty folder.

    The run is simulated with the drives at their usual values, with noise added; it shows the names of the columns.

    Args:
        folder: the folder to create.
        rig: the rig.
        spec: how the campaign names it: "FILE.py:Class", the file relative to the folder or absolute.
        on_progress: called with the completed share of the simulation, 0 … 1.

    Returns:
        The paths of the files.

    Raises:
        CampaignError: the folder is not empty, or cannot be written.
        SimulationError: the rig cannot be simulated with its default numbers.
    """
    _refuse_full(folder)
    machine = rig()
    rate = min(RIG_SAMPLES / rig.duration, 1.0 / rig.time_step)
    signals = simulate(machine, Simulation(duration=rig.duration, sample_rate=rate), on_progress).signals
    rng, columns, rows = np.random.default_rng(0), {"time [s]": signals["time"]}, []
    for name, about in rig.signals.items():
        if name == "time":
            continue
        unit = "-" if about.display_unit == "1" else about.display_unit
        values = from_si(signals[name], about.unit, unit)
        if name not in rig.drives:
            noise = float(f"{max(RIG_NOISE * float(np.ptp(values)), SMALLEST_NOISE):.1g}")
            values = values + rng.normal(0.0, noise, len(values))
            rows.append(f"  {name}: {{unit: {yaml_text(unit)}, noise: {noise:g}}}   # {one_line(about.doc)}\n")
        columns[f"{name} [{unit}]"] = values
    own = [p.name for p in structs.parameters(type(getattr(machine, rig.name)))] if hasattr(machine, rig.name) else []
    texts = {
        "drives": "".join(f"  {name}: {name}\n" for name in rig.drives) or "  {}\n",
        "uncertain": "".join(f"  {name}: {RIG_SPREAD:g}\n" for name in own) or "  {}\n",
        "signals": "".join(rows), "name": yaml_text(folder.resolve().name), "folder": one_line(str(folder)),
        "spec": one_line(spec),
    }  # fmt: skip
    return _write(folder, filled("rig_campaign.yaml", **texts), columns)


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
    _refuse_full(folder)
    machine = PumpBench(effects=(LugreFriction(), PistonLeakage(), EntrainedAir()))
    signals = simulate(machine, Simulation(duration=0.35, sample_rate=2000.0), on_progress).signals
    rng = np.random.default_rng(0)
    columns = {"time [ms]": 1e3 * signals["time"]}
    for name, (noise, unit) in SENSOR_NOISE.items():
        exact = from_si(signals[name], SIGNALS[name].unit, unit)
        columns[f"{name} [{unit}]"] = exact + rng.normal(0.0, noise, len(exact))
    rows = "".join(f"  {name}: {{unit: {unit}, noise: {noise}}}\n" for name, (noise, unit) in SENSOR_NOISE.items())
    texts = {"name": yaml_text(folder.resolve().name), "folder": one_line(str(folder)), "signals": rows}
    text = filled("campaign.yaml", uncertain="\n".join(uncertainty_lines(PumpBench)), **texts)
    return _write(folder, text, columns)


def _refuse_full(folder: Path) -> None:
    """Raise a CampaignError for anything but a new or empty folder."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise CampaignError(f"{folder}: exists already; nothing was written. Name another folder")


def _write(folder: Path, text: str, columns: Mapping[str, np.ndarray]) -> list[Path]:
    """Write `campaign.yaml` and `run1.csv`, whose columns are given by their headers."""
    yaml, run = folder / "campaign.yaml", folder / "run1.csv"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yaml.write_text(text, encoding="utf-8")
        table = np.stack(list(columns.values()), axis=1)
        np.savetxt(run, table, fmt="%.6g", delimiter=",", header=",".join(columns), comments="", encoding="utf-8")
    except OSError as error:
        raise CampaignError(f"{folder}: cannot be written: {error.strerror}") from None
    return [yaml, run]
