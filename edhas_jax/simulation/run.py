"""Simulate one machine from rest: settings of a run, choice of the step, and the finished run with its results."""

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import jax
import numpy as np
import pandas as pd

from edhas_jax.core.units import format_quantity
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation import energy_balance
from edhas_jax.simulation.metrics import MetricValue, run_metrics
from edhas_jax.simulation.run_checks import Record, check_run, step_change
from edhas_jax.simulation.run_figure import plot_run
from edhas_jax.simulation.run_settings import Simulation
from edhas_jax.simulation.step_choice import search_accuracy, search_step, step_status
from edhas_jax.simulation.time_loop import check_names, initial_loop_state, integrate
from edhas_jax.simulation.validity import Status, departure

SAMPLES_PER_CALL = 256  # samples between two reports of progress; fixed, so that a longer run compiles nothing anew
INTERRUPTED = "interrupted; "  # note on the step of an interrupted run
UNCONFIRMED = "no step was found that half of it confirms; valves or contacts may move differently in every cycle"


class SimulationError(RuntimeError):
    """A run left the physical range or is not finite; `run` holds the samples before the failure."""

    def __init__(self, message: str, run: "Run"):
        super().__init__(message)
        self.run = run


class Failure(NamedTuple):
    """The end of a run that left the finite numbers or a range in which a signal is physical.

    Attributes:
        time: when [s].
        name: the state or signal.
        what: what it does then.
        more: what this means and helps, or empty.
        step: the time step, as text.
    """

    time: float
    name: str
    what: str
    more: str
    step: str

    def __str__(self) -> str:
        text = f"at {self.time:.6g} s {self.name} {self.what} (step {self.step})"
        return f"{text}; {self.more}" if self.more else text

    def advice(self, finer: "Failure | None") -> str:
        """What the run with a quarter of the step, which ended as `finer`, says of the cause."""
        if finer is None:
            return f"try a smaller step: a quarter of {self.step} does not fail"
        if finer.name == self.name:
            return f"the step is not the cause: with {finer.step} it does so at {finer.time:.6g} s"
        return f"with a step of {finer.step} {finer.name} {finer.what} at {finer.time:.6g} s: the step may be the cause"


@dataclasses.dataclass(frozen=True)
class Run:
    """A finished run.

    Attributes:
        machine: the machine.
        simulation: the settings.
        signals: SI arrays (samples,) by name, over `signals["time"]` [s].
        energy: energy since the start [J] by row of the energy balance, each (samples,).
        volume: volume since the start [m³] by row of the volume balance, each (samples,); empty without a pump.
        step: the step taken [s].
        step_note: how the step was chosen.
        groups: the group of each row of the energy balance; None if the machine tells it.
        status: whether the numbers are those of the model, and the machine moves as it should.
        reason: why the run has this status.
    """

    machine: Rig
    simulation: Simulation
    signals: dict[str, np.ndarray]
    energy: dict[str, np.ndarray]
    volume: dict[str, np.ndarray]
    step: float
    step_note: str
    groups: Mapping[str, str] | None = None
    status: Status = Status.OK
    reason: str = ""

    @property
    def valid(self) -> bool:
        """Whether the numbers are those of the model: a machine on its stops is valid, a step too large is not."""
        return self.status.is_valid

    @property
    def interrupted(self) -> bool:
        """Whether the user has interrupted the run; it then holds the samples until that moment."""
        return self.step_note.startswith(INTERRUPTED)

    @property
    def duration(self) -> float:
        """The simulated time that was asked for [s]."""
        return self.simulation.length(self.machine)

    @property
    def record(self) -> Record:
        """What the run has recorded."""
        return Record(self.machine, self.signals, self.energy, self.volume)

    @property
    def metrics(self) -> dict[str, MetricValue]:
        """The metrics of the run by name, over whole cycles where the run has cycles; see `run_metrics`."""
        found = run_metrics(self.machine, self.signals, self.energy, self.volume)
        about = self.machine.metrics
        return {n: MetricValue(float(v), about[n].unit, about[n].display_unit, about[n].doc) for n, v in found.items()}

    def frame(self) -> pd.DataFrame:
        """The signals as a table in SI, one row per sample, indexed by time [s]; units in `frame.attrs["units"]`."""
        table = pd.DataFrame({n: v for n, v in self.signals.items() if n != "time"}, index=self.signals["time"])
        table.index.name = "time"
        table.attrs["units"] = {n: self.machine.signals[n].unit for n in self.signals}
        return table

    def row_groups(self) -> Mapping[str, str]:
        """The group of each row of the energy balance, see `energy_balance.row_groups`."""
        return energy_balance.row_groups(self.machine) if self.groups is None else self.groups

    def ledger(self) -> pd.DataFrame:
        """The energy balance of the whole run: group, energy [J] and share of the input, by row."""
        groups = self.row_groups()
        table = pd.DataFrame(
            {"group": pd.Series(groups), "energy": pd.Series({n: float(v[-1]) for n, v in self.energy.items()})}
        )
        table["share"] = table["energy"] / table.loc[table["group"] == "input", "energy"].sum()
        table.index.name = "row"
        return table.sort_values("energy", ascending=False)

    def energy_residual(self) -> float:
        """The energy that the balance does not account for, as a share of all energy converted."""
        groups = self.row_groups()
        total = {n: float(v[-1]) for n, v in self.energy.items()}
        if "input" not in groups.values():
            return 0.0
        missing = sum(v if groups[n] == "input" else -v for n, v in total.items())
        return missing / max(sum(abs(v) for n, v in total.items() if groups[n] != "stored") / 2, 1e-300)

    def volume_residual(self) -> float:
        """The oil that the balance does not account for, as a share of the oil delivered; 0 if nothing is delivered."""
        if self.record.delivers_nothing:
            return 0.0
        total = {n: float(v[-1]) for n, v in self.volume.items()}
        stored = sum(v for n, v in total.items() if n.startswith("oil, "))
        delivered = total["delivery_flow_a"] + total["delivery_flow_b"]
        return (stored - total["accumulator gas"]) / abs(delivered)

    def plot(self, signals: list[str] | None = None):
        """A matplotlib figure of the run: a default choice of signals, or those named, and the energy balance.

        Raises:
            ValueError: a name is no signal of this run.
        """
        return plot_run(self.machine, self.signals, self.ledger(), signals)


@np.errstate(over="ignore", invalid="ignore")  # what is not finite is told by the status
def simulate(
    machine: Rig, simulation: Simulation = Simulation(), on_progress: Callable[[float], None] | None = None
) -> Run:
    """Simulate one machine from rest, and check the result.

    The run is made once more with half the step. Where flow, power or stroke then change by more than 1 %, the default
    step is halved further; a step that was asked for is kept, and the status is STEP_TOO_LARGE.

    Args:
        machine: the machine.
        simulation: settings of the run.
        on_progress: called with the share done, 0 … 1.

    Returns:
        The run, with its status.

    Raises:
        SimulationError: the run is not finite or left the physical range; the message names the time and the state.
        ValueError: the step is not above 0 and at most 100 µs.
        TypeError: a parameter is traced by JAX: inside `jit`, `grad` or `vmap` belongs `edhas_jax.model`.
    """
    if any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(machine)):
        raise TypeError("simulate chooses its step by the result, so JAX cannot trace it; in jit, vmap and grad call "
                        "`metrics` and `trajectory` of `edhas_jax.model(machine)`")  # fmt: skip
    if simulation.accuracy is not None:
        return _simulate_to_accuracy(machine, simulation, on_progress)
    report, asked = on_progress or (lambda share: None), simulation.step is not None
    largest_step = simulation.step if asked else machine.time_step

    def attempt(step: float) -> tuple[Run, Failure | None]:
        return _simulate_with_step(machine, simulation, step, lambda share: report((1.0 + 2.0 * share) / 3.0))

    # half the step takes twice as long
    run, failure = _simulate_with_step(machine, simulation, largest_step, lambda share: report(share / 3.0))
    if failure:
        finer = attempt(0.25 * largest_step)[1]
        if asked or finer:
            raise SimulationError(f"{failure}; {failure.advice(finer)}", run)
    if run.interrupted:
        return _finished(run, f"{INTERRUPTED}step {{}}", remark="the run was interrupted and its step is not checked")
    found, (name, change) = search_step(run, bool(failure), attempt), ("", 0.0)
    if found.interrupted:
        return _finished(found.finest or run, "step {}", remark="the check of the step was interrupted")
    if asked:
        remedy = f"use step: {_step_text(found.confirmed.step)}" if found.confirmed else UNCONFIRMED
        return _finished(run, "step {} (as asked)", *step_status(found.first_change, run.step, remedy))
    name, change = found.last_change
    if found.confirmed is None:
        kept = found.finest or run
        status = step_status(found.last_change, 2.0 * kept.step, UNCONFIRMED)
        return _finished(kept, "step {} (the smallest of those tried)", *status)
    chosen = "default" if found.confirmed is run else f"chosen, since {_step_text(run.step)} is too large"
    return _finished(found.confirmed, f"step {{}} ({chosen}; half of it changes {name} by {100 * change:.1g} %)")


def _finished(run: Run, note: str, status: Status = Status.OK, reason: str = "", remark: str = "") -> Run:
    """The run with its status and a note on its step, which stands for {}; the `status` of the step comes first."""
    if status is Status.OK:
        status, reason = check_run(run.record, run.energy_residual(), run.volume_residual(), run.step)
    reason = "; ".join(filter(None, (reason, remark)))
    note = note.format(_step_text(run.step))
    return dataclasses.replace(run, step_note=note, status=status, reason=reason)


def _step_text(step: float) -> str:
    return format_quantity(step, "s")


def _simulate_to_accuracy(machine: Rig, simulation: Simulation, on_progress) -> Run:
    """Halve the step until the estimated error of every signal is within the accuracy."""
    asked = f"{100 * simulation.accuracy:.2g} %"
    found = search_accuracy(
        simulation.accuracy, 2.0 * machine.time_step, lambda h: _simulate_with_step(machine, simulation, h, on_progress)
    )
    if found.failure:
        raise SimulationError(f"{found.failure}; no larger step does better", found.run)
    if found.run.interrupted or found.before is None:
        return _finished(found.run, f"{found.run.step_note}step {{}}", remark="the accuracy has not been checked")
    name, change = found.worst
    if found.reached:
        return _finished(
            found.run, f"step {{}}: halved until the estimated error of the worst signal ({name}) is "
            f"{100 * change / 3.0:.2g} % of its range, asked: {asked}",
        )  # fmt: skip
    status = step_status(step_change(found.before.record, found.run.record), 2.0 * found.run.step, UNCONFIRMED)
    return _finished(
        found.run, f"step {{}}: the accuracy asked, {asked}, was not reached; the last halving still changed {name} by "
        f"{100 * change:.2g} % of its range (stick-slip or a switch near its threshold)", *status,
    )  # fmt: skip


def _simulate_with_step(
    machine: Rig, simulation: Simulation, largest_step: float, on_progress
) -> tuple[Run, "Failure | None"]:
    """Simulate with a fixed step, up to a failure if there is one."""
    if not 0.0 < largest_step <= machine.largest_step() * (1.0 + 1e-9):
        limit = _step_text(machine.largest_step())
        raise ValueError(f"step {_step_text(largest_step)}: must lie above 0 and at most {limit}")
    rate = simulation.rate(machine)
    interval = 1.0 / rate
    per_sample = max(1, math.ceil(interval / largest_step - 1e-9))
    dtype = np.dtype(simulation.precision.value)
    h = dtype.type(interval / per_sample)
    samples = int(math.floor(simulation.length(machine) * rate + 1e-9)) + 1
    numbers = jax.tree.map(lambda leaf: np.asarray(leaf, dtype), machine)
    loop, blocks, note = initial_loop_state(numbers, h), [], ""
    try:
        while len(blocks) * SAMPLES_PER_CALL < samples and int(loop.failed_step) < 0:
            loop, block = integrate(numbers, loop, h, per_sample, SAMPLES_PER_CALL)
            blocks.append(block)
            if on_progress is not None:
                on_progress(min(1.0, len(blocks) * SAMPLES_PER_CALL / samples))
    except KeyboardInterrupt:
        note = INTERRUPTED
        if not blocks:
            raise
    failed_step = int(loop.failed_step)
    valid = min(samples, len(blocks) * SAMPLES_PER_CALL)
    if failed_step >= 0:
        valid = min(valid, -(-failed_step // per_sample))

    def joined(columns):
        return {n: np.concatenate(arrays)[:valid].astype(float) for n, arrays in columns.items()}

    signals = joined({n: [b.signals[n] for b in blocks] for n in blocks[0].signals})
    signals["time"] = np.arange(valid) / rate
    energy = joined({n: [b.balance.energy[n] for b in blocks] for n in blocks[0].balance.energy})
    volume = joined({n: [b.balance.volume[n] for b in blocks] for n in blocks[0].balance.volume})
    run = Run(machine, simulation, signals, energy, volume, float(h), note)
    if failed_step < 0 or failed_step > (samples - 1) * per_sample:
        return run, None
    check, name = int(loop.failed_check), check_names(machine)[int(loop.failed_check)]
    what, more = "is not a finite number", ""
    if check >= len(loop.y):
        what, more = departure(machine, name, np.concatenate([b.signals[name] for b in blocks])[: valid + 1])
    return run, Failure(failed_step * float(h), name, what, more, _step_text(float(h)))
