"""Time of a record: counted from its first sample or from a stated start, and limited to a window."""

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from edhas_jax.config.tables.table import TableError
from edhas_jax.core.remark import Remark, Severity
from edhas_jax.core.units import format_quantity
from edhas_jax.machine.rigs import Rig

START_TOLERANCE = 1.5  # sample intervals; a clock that starts within it of zero is not changed
MIN_SAMPLES = 2  # within a window
MAX_GAP_IN_RECORDS = 10.0  # lengths of the record without gaps; a longer gap is a jump of the clock
CLOCK_ROUNDING = 2.0  # units in the last place of a time stamp, by which rounding moves it at most
RUN_IN_CYCLES = 10  # after the ramp, until a machine that was running when its record began is periodic
INTERVAL_DIGITS = 6  # to which the interval of evenly sampled records is rounded


@dataclasses.dataclass(frozen=True)
class RecordTiming:
    """Which part of a record is used, and where its time is zero.

    Args:
        start: time stamp [s] at which the run begins, with the machine at rest; None for the first time stamp.
        window: first and last time [s] that are used, counted from the start.
        run_in: time [s] that the machine has been running at the start, whole cycles of its set point; 0 at rest.
    """

    start: float | None = None
    window: tuple[float, float] = (0.0, math.inf)
    run_in: float = 0.0

    def zero(self, time: np.ndarray) -> float:
        """The time stamp [s] from which the times of a record are counted, from its increasing time stamps (samples,).

        Raises:
            TableError: there are fewer than `MIN_SAMPLES`.
        """
        if len(time) < MIN_SAMPLES:
            raise TableError(0, f"it has {len(time)} samples with a valid time; at least {MIN_SAMPLES} are needed")
        if self.start is not None:
            return self.start
        interval = float(np.median(np.diff(time)))
        part, _ = _longest_part(time, MAX_GAP_IN_RECORDS * len(time) * interval)
        first = float(time[part][0])
        return 0.0 if abs(first) <= START_TOLERANCE * interval else first

    def apply(
        self, file: Path, time: np.ndarray, zero: float | None = None
    ) -> tuple[slice, np.ndarray, np.ndarray, list[Remark]]:
        """Count time from the start of the run.

        Args:
            file: the file of the record, for messages.
            time: increasing time stamps (samples,) [s].
            zero: the time stamp [s] from which to count, where another record of the run has told it.

        Returns:
            The longest part of the record without a jump of its clock; its times (samples,) [s] from rest, below
            `run_in` before the start; a mask (samples,) of its samples that are used; remarks on the clock.

        Raises:
            TableError: fewer than `MIN_SAMPLES` samples are used.
        """
        start = self.zero(time) if zero is None else zero
        remarks, seconds = [], lambda value: format_quantity(value, "s")
        interval = float(np.median(np.diff(time)))
        part, jumps = _longest_part(time, MAX_GAP_IN_RECORDS * len(time) * interval)
        for k in jumps:
            sentence = f"time jumps from {seconds(time[k])} to {seconds(time[k + 1])}; only the longest part is used"
            remarks.append(Remark(Severity.ERROR, file, 0, sentence))
        first, tolerance = float(time[part][0]), START_TOLERANCE * interval
        if zero is None and self.start is None:
            if start:
                sentence = f"its clock starts at {seconds(first)}; time is counted from there"
                if first < 0.0 < time[part][-1]:
                    sentence += "; if the run begins at 0 s, write `start: 0 s` in its entry"
                remarks.append(Remark(Severity.NOTE, file, 0, sentence))
        elif zero is None and first > start + tolerance:
            sentence = f"the first sample comes {seconds(first - start)} after the stated start of the run"
            remarks.append(Remark(Severity.WARNING, file, 0, sentence))
        relative = _without_rounding(time[part] - start, float(np.spacing(np.abs(time[part]).max())), interval)
        low, high = self.window
        # half a sample interval: a bound that names a time stamp includes it in spite of rounding
        used = (relative >= low - 0.5 * interval) & (relative <= high + 0.5 * interval)
        if used.sum() < MIN_SAMPLES:
            record = f"the record lasts from {seconds(relative[0])} to {seconds(relative[-1])}"
            window = f"from {seconds(low)}" + (f" to {seconds(high)}" if math.isfinite(high) else "")
            raise TableError(0, f"the window {window} holds {used.sum()} samples; counted from its start, {record}")
        return part, relative + self.run_in, used, remarks


def _longest_part(time: np.ndarray, longest_gap: float) -> tuple[slice, np.ndarray]:
    """The part with most samples between two jumps of the clock, and the samples before the jumps."""
    jumps = np.flatnonzero(np.diff(time) > longest_gap)
    edges = np.concatenate([[0], jumps + 1, [len(time)]])
    k = int(np.argmax(np.diff(edges)))
    return slice(int(edges[k]), int(edges[k + 1])), jumps


def _without_rounding(time: np.ndarray, last_place: float, interval: float) -> np.ndarray:
    """Times (samples,) moved to an even grid where they lie on it but for the rounding of the time stamps."""
    if interval <= 0.0 or last_place < 1e-9 * interval:
        return time
    index = np.round((time - time[0]) / interval)
    exact = (time[-1] - time[0]) / index[-1] if index[-1] > 0.0 else interval
    index = np.round((time - time[0]) / exact)
    for step in (float(f"{exact:.{INTERVAL_DIGITS}g}"), exact):
        grid = time[0] + step * index
        if np.abs(grid - time).max() <= CLOCK_ROUNDING * last_place:
            return grid
    return time


def running_before(machine: Rig, conditions: Mapping[str, float]) -> float:
    """The time [s] that a machine has been running when its record begins: whole cycles of its sine, after the ramp.

    Args:
        machine: the machine of the campaign.
        conditions: parameters that the run sets (SI).
    """
    own = {name.rpartition(".")[2]: value for name, value in conditions.items()}
    frequency = own.get("frequency", float(machine.reference.frequency))
    ramp = own.get("ramp_time", float(machine.reference.ramp_time))
    return math.ceil(ramp * frequency + RUN_IN_CYCLES) / frequency
