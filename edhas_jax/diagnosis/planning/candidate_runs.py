"""The runs that a bench could do next: conditions in and around those of a campaign, kept where simulation allows."""


import dataclasses
import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from edhas_jax.config.yaml_with_lines import YamlError, key_text, line_of, parse_yaml
from edhas_jax.core.units import format_quantity
from edhas_jax.machine.components.set_points import Sine
from edhas_jax.machine.parameters import find_parameter, get_parameter
from edhas_jax.machine.rigs import ActuatorSystem, Rig
from edhas_jax.measurements.campaign import BenchRun, Campaign, CampaignError, Use
from edhas_jax.measurements.campaign_reader import FILE, CampaignReader, read_campaign
from edhas_jax.measurements.predicted_signals import Case, Model
from edhas_jax.measurements.replay import has_parameter

CYCLES = 4.0  # length of a run with a periodic set point, beyond its soft start
# values tried of a condition, and how far beyond those of the campaign to either side
LEVELS = {"frequency": (5, 1.5, 1.5), "amplitude": (2, 1.75, 1.0)}
OTHERS = (3, 1.5, 1.5)
WIDE = {"frequency": 5.25}  # ratio that a menu spans at least: one frequency says nothing of the others
USUAL = ("frequency", "amplitude", "load_orifice_area")
WITHIN = 0.99  # share of a limit that a run may use
# signals that must stay within a parameter of the machine, times a factor, to either side
LIMITS = {"piston_position": ("pump_stroke", 0.5), "voltage": ("supply_voltage", 1.0),
          "cylinder_position": ("cylinder_stroke", 1.0)}  # fmt: skip


def feasible_runs(campaign: Campaign, machine: Rig, per_sample: int) -> tuple[BenchRun, ...]:
    """The runs of the menu in which `machine` stays off its end stops and, on a bench, below the limit of its supply.

    Frequency, amplitude, load orifice and whatever else the campaign's runs set are varied on a grid; the other
    conditions are those of its first run. Runs carry no signals. Empty where the set point is a recording.
    """
    runs = menu(campaign)
    if not runs:
        return ()
    most = {
        signal: share * WITHIN * float(get_parameter(machine, limit))
        for signal, (limit, share) in LIMITS.items() if has_parameter(machine, limit)
    }  # fmt: skip
    if isinstance(machine, ActuatorSystem):  # far from its target the pump is meant to give all that it can
        del most["voltage"]
    model = Model(campaign, machine, (), runs, watch=tuple(most))
    found = model.outcomes([Case(np.zeros(0), tuple(range(len(runs))))], per_sample, derive=False)[0]
    inside = [all(np.abs(found[r].values[n]).max() <= most[n] for n in most) for r in range(len(runs))]
    return tuple(run for run, ok in zip(runs, inside, strict=True) if ok)


def menu(campaign: Campaign) -> list[BenchRun]:
    """Every run of the grid, feasible or not."""
    machine, usual = campaign.machine, campaign.runs[0]
    if any(run.reference is not None for run in campaign.runs):
        return []
    names = dict.fromkeys(n for run in campaign.runs for n in run.conditions)
    if some_cycles(machine, {}):
        names |= dict.fromkeys(n for n in USUAL if has_parameter(machine, n))
    axes = {name: _levels(campaign, name) for name in names}
    interval, runs = min(run.interval for run in campaign.runs), []
    for values in itertools.product(*axes.values()):
        conditions = usual.conditions | dict(zip(axes, values, strict=True))
        length = some_cycles(machine, conditions) or usual.time[-1]
        time = interval * np.arange(round(length / interval) + 1)
        name = ", ".join(texts(campaign, conditions).values())
        runs.append(BenchRun(name, Path(name), Use.FIT, conditions, time, {}, np.arange(len(time)) + 2))
    return runs


def some_cycles(machine: Rig, conditions: dict[str, float]) -> float | None:
    """The length [s] of a run of a bench that a sine drives; None for any other."""
    if not isinstance(machine.reference, Sine) or isinstance(machine, ActuatorSystem):
        return None
    frequency = conditions.get("frequency", float(machine.reference.frequency))
    return float(machine.reference.ramp_time) + CYCLES / frequency


def _levels(campaign: Campaign, name: str) -> Sequence[float]:
    """Values of a condition to try, of two digits: even in their ratio where all are positive."""
    nominal = float(get_parameter(campaign.machine, name))
    seen = [run.conditions.get(name, nominal) for run in campaign.runs]
    count, below, above = LEVELS.get(name, OTHERS)
    low, high = min(seen), max(seen)
    if low > 0.0:
        above = max(above, WIDE.get(name, 1.0) * low / (below * high))
        tried = np.geomspace(low / below, high * above, count)
    elif low < high:
        tried = np.linspace(low, high, count)
    else:
        return [low]
    span = find_parameter(campaign.machine, name)[0].span
    return list(dict.fromkeys(float(f"{v:.2g}") for v in tried if span[0] <= v <= span[1]))


def texts(campaign: Campaign, conditions: dict[str, float]) -> dict[str, str]:
    """Conditions as text with units."""
    return {n: format_quantity(v, find_parameter(campaign.machine, n)[0].unit) for n, v in conditions.items()}



STEP_LENGTH = 0.6  # s; a run without a period
FEWEST = 100  # samples of a run


class PlanReader(CampaignReader):
    """A campaign's mapping with runs that need not have been made."""

    def planned_runs(self, rate: float) -> tuple[BenchRun, ...]:
        """Runs sampled at `rate` [Hz] for some cycles of their set point, without signals."""
        if self._set_point:
            raise CampaignError(
                f"{self._folder / FILE}: `reference: {self._set_point}` is recorded with the runs, so nothing can be "
                "planned before they are made; describe the set point instead"
            )
        return tuple(self._planned(*row, rate) for row in self._runs)

    def _planned(self, name, file, use, conditions, rate: float) -> BenchRun:
        length = some_cycles(self.machine, conditions) or STEP_LENGTH
        if length * rate < FEWEST:
            what = f"has {length * rate:.0f} samples at {format_quantity(rate, 'Hz')}, at least {FEWEST} are needed"
            raise CampaignError(f"{file}: {what}; sample it faster")
        time = np.arange(round(length * rate) + 1) / rate
        return BenchRun(name, file, use, conditions, time, {}, np.arange(len(time)) + 2)


def read_planned(path: Path | str, rate: float) -> Campaign:
    """The campaign in a folder, its runs as they are planned: sampled at `rate` [Hz] where a run has no file yet.

    Raises:
        CampaignError: `campaign.yaml` is wrong (every problem, one line each), its set point is a recording, or `rate`
            leaves a run with next to no samples.
    """
    path = Path(path)
    file = path / FILE if path.is_dir() else path
    try:
        data, lines, problems = parse_yaml(file.read_text(encoding="utf-8-sig"))
    except YamlError as error:
        raise CampaignError(f"{file}:{error.line}: {error}" if error.line else f"{file}: {error}") from None
    except (OSError, UnicodeDecodeError):
        return read_campaign(path)  # which says what is wrong
    reader = PlanReader(data, file.parent)
    problems += [(line_of(lines, key), f"{key_text(key)}: {what}") for key, what in reader.problems]
    if problems:
        problems.sort(key=lambda problem: problem[0])
        raise CampaignError("\n".join(dict.fromkeys(f"{file}:{line}: {what}" for line, what in problems)))
    planned = reader.planned_runs(rate)
    made = {run.name: run for run in (read_campaign(path).runs if all(r.file.exists() for r in planned) else ())}
    runs = tuple(made.get(run.name, run) for run in planned)
    return Campaign(reader.name, file.parent, reader.machine, reader.uncertain, reader.channels, runs, ())


def as_modelled(campaign: Campaign, per_sample: int) -> Campaign:
    """The campaign with the signals of its own model in place of what was measured, in every run that has them.

    A run that was not made yet has all of them.
    """
    model = Model(campaign, campaign.machine, (), campaign.runs)
    found = model.outcomes([Case(np.zeros(0), tuple(range(len(campaign.runs))))], per_sample, derive=False)[0]
    runs = tuple(
        dataclasses.replace(run, signals={n: found[r].values[n] for n in run.signals or campaign.channels})
        for r, run in enumerate(campaign.runs)
    )
    return dataclasses.replace(campaign, runs=runs)
