"""Data model of a measurement campaign: the runs of a test bench, the sensors, and the engineer's present model."""

import dataclasses
import enum
import functools
import math
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from edhas_jax.core.remark import Remark, Severity
from edhas_jax.core.structs import replace
from edhas_jax.core.units import exact_quantity, format_quantity
from edhas_jax.core.wording import counted, listed
from edhas_jax.machine.components.set_points import Recorded
from edhas_jax.machine.parameters import get_parameter, has_parameter, set_parameters
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.accuracy import OFFSET_OVER_RANGE, BenchAccuracy, with_defaults

CAMPAIGN_FILE = "campaign.yaml"
SignalsByRun = Mapping[str, Mapping[str, np.ndarray]]  # by run and signal (samples,)
MAX_LINES = 10  # of a short list of remarks
MAX_FILES = 3  # that are named beside the first one


class CampaignError(ValueError):
    """A campaign cannot be used; the text has one line per problem."""


class Use(enum.Enum):
    """What a run is used for: to estimate parameters, or to validate the estimated model."""

    FIT = "fit"
    HOLDOUT = "holdout"


class Removal(NamedTuple):
    """Samples of a signal of a run that the checks left out, and their share of all samples of the run."""

    run: str
    signal: str
    samples: int
    share: float


@dataclasses.dataclass(frozen=True)
class Channel:
    """A measured signal.

    Args:
        unit: its unit in the files.
        noise: standard deviation of its noise as used (SI).
        stated_noise: the one that the campaign states (SI); None before the data are checked.
        measured_noise: the one measured in the records (SI); None if not measured.
        fitted_noise: the one that a fit leaves (SI), where that refutes a larger one; else None.
        sensor_noise: the part of `noise` that is the sensor's (SI): stated, measured or fitted; None before the check.
        is_noise_seen: whether it was measured in full, from repeated cycles or where the signal rests.
        correlation: coefficients a_1 … a_p of the autoregressive model of the noise from sample to sample,
            e_t = Σ a_k e_{t−k} + innovation; empty for white noise. `noise` is the standard deviation of e.
        resolution: step between two neighbouring values of the recorder (SI); 0 if it is too fine to be seen.
        model_error: standard deviation (SI) of what the model may leave beside the noise; part of `noise` once the data
            are checked.
        limits: ends of the range of the sensor (SI), at which it says only that the signal is there or beyond.
    """

    unit: str
    noise: float
    stated_noise: float | None = None
    measured_noise: float | None = None
    fitted_noise: float | None = None
    sensor_noise: float | None = None
    is_noise_seen: bool = False
    correlation: tuple[float, ...] = ()
    resolution: float = 0.0
    model_error: float = 0.0
    limits: tuple[float, float] = (-math.inf, math.inf)


@dataclasses.dataclass(frozen=True)
class Spread:
    """How well the value of a parameter is known: the standard deviation of its true value.

    Args:
        size: of the value (SI) if it is absolute, true = known + size n with n standard normal; else relative,
            true = known · exp(size n).
        is_absolute: whether it is absolute.
    """

    size: float
    is_absolute: bool = False

    def carried_over(self, value, present, known):
        """What a run sets (`value`), when the parameter is estimated as `present` where `known` was stated (all SI).

        The common error of all runs is a factor, or a difference where the spread is absolute.
        """
        return value + (present - known) if self.is_absolute or known == 0.0 else value * (present / known)


def spread_entry(spread: Spread, unit: str) -> str:
    """A spread as an entry of `uncertain`, without its braces: "relative: 0.1", "absolute: 5 mV"."""
    if not spread.is_absolute:
        return f"relative: {spread.size:g}"
    return f"absolute: {exact_quantity(spread.size, unit)}"


@dataclasses.dataclass(frozen=True, repr=False)
class BenchRun:
    """A run of the test bench in SI units, starting from rest at time 0.

    Args:
        name: unique name of the run.
        file: the file that it was read from.
        use: fit or holdout.
        conditions: parameters of the machine that hold in this run, by name (SI).
        time: time stamps (samples,) [s], strictly increasing.
        signals: measured signals (samples,) by name (SI); NaN where a sample is missing, absent if not measured.
        lines: line (or row) of the file for each sample (samples,).
        reference: the recorded set point, where the campaign has one.
        drives: the recorded drives of a rig of one's own, by name.
        uncertain: the parameters whose value in this run is an unknown of its own, around its condition or, where it
            sets none, the value of the campaign's machine.
        part_of: name of the run of which this is a part, which has the same unknowns; empty for a whole run.
        keep: the signals of which no sample is left out by the checks.
    """

    name: str
    file: Path
    use: Use
    conditions: dict[str, float]
    time: np.ndarray
    signals: dict[str, np.ndarray]
    lines: np.ndarray
    reference: Recorded | None = None
    drives: Mapping[str, Recorded] = dataclasses.field(default_factory=dict)
    uncertain: Mapping[str, Spread] = dataclasses.field(default_factory=dict)
    part_of: str = ""
    keep: frozenset[str] = frozenset()

    @property
    def whole(self) -> str:
        """The name of the run, or of the one of which it is a part."""
        return self.part_of or self.name

    @property
    def recordings(self) -> dict[str, Recorded]:
        """What was recorded of the drives, by the name of the drive."""
        return dict(self.drives) | ({} if self.reference is None else {"reference": self.reference})

    @functools.cached_property
    def interval(self) -> float:
        """The sample interval [s]: the median difference of the time stamps."""
        return float(np.median(np.diff(self.time)))

    @property
    def valid_samples(self) -> int:
        """Number of samples of all signals that are not missing."""
        return sum(int(np.isfinite(values).sum()) for values in self.signals.values())

    def remark(self, severity: Severity, sentence: str, sample: int | None = None) -> Remark:
        """A remark on the file of the run, with the line of a sample."""
        return Remark(severity, self.file, 0 if sample is None else int(self.lines[sample]), sentence)

    def warning(self, sentence: str, sample: int | None = None) -> Remark:
        """A warning on the file of the run, with the line of a sample."""
        return self.remark(Severity.WARNING, sentence, sample)

    def __repr__(self) -> str:
        size = f"{len(self.time):,} samples in {format_quantity(self.time[-1] - self.time[0], 's')}"
        return f"<BenchRun: {self.name}, {self.use.value}, {size}; {', '.join(self.signals)}>"

    def without_signals(self, names: Collection[str]) -> "BenchRun":
        """The run without some of its signals."""
        return dataclasses.replace(self, signals={n: v for n, v in self.signals.items() if n not in names})


@dataclasses.dataclass(frozen=True, repr=False)
class Campaign:
    """Runs of a test bench, and the engineer's present model of it.

    Args:
        name: name of the campaign.
        folder: the folder that it was read from.
        machine: the present model, before the conditions of a run are set.
        uncertain: how well the parameters that are the same in all runs are known; a number is a relative standard
            deviation. It may name parameters of effects that `machine` lacks.
        channels: the measured signals by name.
        runs: the runs that can be used.
        remarks: what the reader and the checks noticed in the files, and what they left out.
        removed: what of the signals the checks left out.
        is_checked: whether the data are checked, impossible samples left out, and the noise measured.
        stated_accuracy: what the campaign states about the accuracy of the bench; see `accuracy`.
        tightening: divides the deviations of settings and sensors that a fit allows; above 1 where much is left.
        unpredictable: by signal, standard deviation (SI) of what the model cannot predict because its signals depend
            irregularly on its parameters; part of `noise` of the channels. Empty where they depend smoothly.
        file: the description that it was read from; None for a campaign that was made in memory.
    """

    name: str
    folder: Path
    machine: Rig
    uncertain: Mapping[str, Spread | float]
    channels: dict[str, Channel]
    runs: tuple[BenchRun, ...]
    remarks: tuple[Remark, ...]
    removed: tuple[Removal, ...] = ()
    is_checked: bool = False
    stated_accuracy: BenchAccuracy = dataclasses.field(default_factory=BenchAccuracy)
    tightening: float = 1.0
    unpredictable: dict[str, float] = dataclasses.field(default_factory=dict)
    file: Path | None = None

    def __post_init__(self):
        spreads = {n: s if isinstance(s, Spread) else Spread(s) for n, s in self.uncertain.items()}
        object.__setattr__(self, "uncertain", spreads)

    def __repr__(self) -> str:
        uses = (f"{count_runs(self.runs_for(use))} {use.value}" for use in Use)
        counted = f"{runs_text(self.runs)} ({', '.join(uses)}), {len(self.channels)} signals"
        return f"<Campaign: {self.name}, {self.machine.name}, {counted}, {len(self.uncertain)} uncertain parameters>"

    def remark(self, severity: Severity, sentence: str) -> Remark:
        """A remark on the description of the campaign."""
        return Remark(severity, self.folder / CAMPAIGN_FILE, 0, sentence)

    @functools.cached_property
    def accuracy(self) -> BenchAccuracy:
        """The accuracy of the bench, completed by defaults for every signal and every parameter that a run sets."""
        conditions = dict.fromkeys(name for run in self.runs for name in run.conditions)
        offsets = {name: self._usual_offset(name) for name in self.channels}
        return with_defaults(self.stated_accuracy, self.machine, conditions, offsets)

    def _usual_offset(self, name: str) -> float:
        """A thousandth of the range of a signal in all runs, without the outermost 1 %; its noise if no run has it."""
        parts = [run.signals[name] for run in self.runs if name in run.signals]
        values = np.concatenate(parts) if parts else np.zeros(0)
        values = values[np.isfinite(values)]
        if not len(values):
            return self.channels[name].noise
        low, high = np.percentile(values, [0.5, 99.5])
        return OFFSET_OVER_RANGE * float(high - low)

    def machine_of(self, run: BenchRun, machine: Rig | None = None) -> Rig:
        """A machine under the conditions of a run.

        Where a run sets a parameter that is uncertain in all runs, the deviation of `machine` from the campaign's
        machine is common to them, see `Spread.carried_over`. Traced values pass.

        Args:
            run: gives the conditions and the recorded set point.
            machine: the campaign's machine by default.

        Raises:
            ParameterError: the machine lacks a parameter that the run sets, or a value lies outside its span.
        """
        machine = self.machine if machine is None else machine
        values = {name: get_parameter(self.machine, name) for name in run.uncertain} | run.conditions
        for name in run.conditions.keys() & self.uncertain.keys() - run.uncertain.keys():
            known = get_parameter(self.machine, name)
            values[name] = self.uncertain[name].carried_over(values[name], get_parameter(machine, name), known)
        if run.recordings:
            machine = replace(machine, **run.recordings)
        return set_parameters(machine, values)

    def uncertain_in(self, machine: Rig) -> dict[str, Spread]:
        """How well the uncertain parameters that a machine has are known, by name."""
        return {name: spread for name, spread in self.uncertain.items() if has_parameter(machine, name)}

    def matching(self, runs: tuple[BenchRun, ...] | None) -> tuple[BenchRun, ...] | None:
        """The runs of this campaign that have the names of given runs; None for None."""
        names = None if runs is None else {run.name for run in runs}
        return None if names is None else tuple(run for run in self.runs if run.name in names)

    def runs_for(self, use: Use) -> tuple[BenchRun, ...]:
        """The runs of one use, in the order of the campaign."""
        return tuple(run for run in self.runs if run.use is use)


def runs_text(runs: Iterable[BenchRun]) -> str:
    """The number of runs in words, "1 run" or "3 runs"; the parts of one that was divided count as one."""
    return counted(count_runs(runs), "run")


def count_runs(runs: Iterable[BenchRun]) -> int:
    """The number of runs; the parts of one count once."""
    return len({run.whole for run in runs})


def brief_lines(remarks: Iterable[Remark]) -> list[str]:
    """At most `MAX_LINES` lines of text.

    Args:
        remarks: the remarks on the files of a campaign.

    Returns:
        Errors first, then warnings, then notes; the last line says how many more there are and where to find them.
    """
    together: dict[tuple[Severity, str], list[Remark]] = {}
    for remark in remarks:
        together.setdefault((remark.severity, remark.sentence), []).append(remark)
    order = list(Severity)
    groups = sorted(together.values(), key=lambda group: order.index(group[0].severity))
    shown = groups if len(groups) <= MAX_LINES else groups[: MAX_LINES - 1]
    lines = [_line(group) for group in shown]
    if len(shown) < len(groups):
        lines.append(f"and {len(groups) - len(shown)} more remarks; `edhas campaign check` lists all")
    return lines


def _line(group: list[Remark]) -> str:
    """A remark, and the other files that it applies to."""
    first = group[0]
    files = list(dict.fromkeys(remark.file.name for remark in group if remark.file != first.file))
    return f"{first} (also {listed(files, MAX_FILES)})" if files else str(first)
