"""A campaign of measurements: what was run on a bench, what was measured, and what the engineer is unsure of."""

import dataclasses
import enum
from pathlib import Path

import numpy as np

from edhas_jax.core.structs import replace
from edhas_jax.machine.components.set_points import Recorded
from edhas_jax.machine.parameters import ParameterError, find_parameter, get_parameter, set_parameters
from edhas_jax.machine.rigs import Rig


class CampaignError(ValueError):
    """A campaign cannot be used; the text has one line per problem."""


class Use(enum.Enum):
    """What a run is for: to calibrate with, or to judge by."""

    FIT = "fit"
    HOLDOUT = "holdout"


class Severity(enum.Enum):
    """How much a remark matters."""

    ERROR = "error"  # something is left out
    WARNING = "warning"  # it is used as it is, but looks wrong
    NOTE = "note"  # worth knowing, nothing is wrong


@dataclasses.dataclass(frozen=True)
class Remark:
    """What was noticed in a file: `line` is 0 when no single line is to blame, and the row where there are no lines."""

    severity: Severity
    file: Path
    line: int
    sentence: str

    def __str__(self):
        place = f"{self.file}:{self.line}" if self.line else str(self.file)
        return f"{place}: {self.sentence}"


@dataclasses.dataclass(frozen=True)
class Channel:
    """A measured signal: its unit in the files, and the standard deviation of its noise in SI."""

    unit: str
    noise: float


@dataclasses.dataclass(frozen=True)
class BenchRun:
    """A run of the bench in SI: `time` (n,) strictly increasing, from the start at rest; `signals` (n,) each.

    A hole in a signal is NaN; a signal that the run lacks is not in `signals`. `conditions` are parameters of the
    machine by name; `reference` is the recorded set point where the campaign has one. `lines` (n,) says in which line
    (or row) of the file each sample stands.
    """

    name: str
    file: Path
    use: Use
    conditions: dict[str, float]
    time: np.ndarray
    signals: dict[str, np.ndarray]
    lines: np.ndarray
    reference: Recorded | None = None

    @property
    def interval(self) -> float:
        """The usual time from sample to sample [s]."""
        return float(np.median(np.diff(self.time)))


@dataclasses.dataclass(frozen=True)
class Campaign:
    """Runs of a bench beside the engineer's present model of it.

    `machine` is that model before any run's conditions are set. `uncertain` gives, by parameter, the relative standard
    deviation σ of the true value: true = known · exp(σ n), n standard normal; it may name parameters of effects that
    `machine` lacks. `remarks` say what the reader noticed and what it left out.
    """

    name: str
    folder: Path
    machine: Rig
    uncertain: dict[str, float]
    channels: dict[str, Channel]
    runs: tuple[BenchRun, ...]
    remarks: tuple[Remark, ...]

    def machine_of(self, run: BenchRun, machine: Rig | None = None) -> Rig:
        """`machine` (default: the campaign's) under the conditions of a run.

        Where a run sets an uncertain parameter itself, what `machine` has is taken as a factor on all runs:
        value = condition × machine's value / campaign's value. Traced values pass through.

        Raises:
            ParameterError: the machine lacks a parameter that the run sets, or a value lies outside its span.
        """
        machine = self.machine if machine is None else machine
        values = {}
        for name, value in run.conditions.items():
            if name in self.uncertain:
                value = value * (get_parameter(machine, name) / get_parameter(self.machine, name))
            values[name] = value
        if run.reference is not None:
            machine = replace(machine, reference=run.reference)
        return set_parameters(machine, values)

    def uncertain_in(self, machine: Rig) -> dict[str, float]:
        """The uncertain parameters that a machine has, with their relative standard deviations."""
        return {name: spread for name, spread in self.uncertain.items() if _has(machine, name)}

    def runs_for(self, use: Use) -> tuple[BenchRun, ...]:
        """The runs that serve one purpose."""
        return tuple(run for run in self.runs if run.use is use)


def _has(machine: Rig, name: str) -> bool:
    try:
        find_parameter(machine, name)
    except ParameterError:
        return False
    return True
