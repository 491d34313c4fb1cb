"""Simulate one machine from rest: settings of a run, choice of the step, and the finished run with its results."""

import dataclasses
import enum
import math
from collections.abc import Callable, Mapping

import jax
import numpy as np
import pandas as pd

from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.machine.rigs import ActuatorSystem, Rig
from edhas_jax.simulation import energy_balance
from edhas_jax.simulation.integrator import DEFAULT_STEP, LARGEST_STEP
from edhas_jax.simulation.metrics import Metric, compute_metrics
from edhas_jax.simulation.run_figure import plot_run
from edhas_jax.simulation.time_loop import check_names, initial_loop_state, integrate

SAMPLES_PER_CALL = 256  # samples between two reports of progress; fixed, so that a longer run compiles nothing anew
MAX_STEP_TRIALS = 8  # steps that are tried for an accuracy, each half of the one before


class Precision(enum.Enum):
    """The floating-point type of a run."""

    FLOAT64 = "float64"
    FLOAT32 = "float32"


@dataclasses.dataclass(frozen=True)
class Simulation:
    """Settings of a run, in SI.

    Give `step`, or give `accuracy` to have the step chosen and checked; with neither the step is 20 µs.

    Attributes:
        duration: simulated time [s]; None is 0.5 s on a bench and 0.6 s for the system.
        step: largest time step [s]; the step taken divides the sample interval.
        accuracy: largest estimated error of any signal, as a share of its range.
        sample_rate: samples per second [Hz].
        precision: floating-point type.
    """

    duration: float | None = None
    step: float | None = None
    accuracy: float | None = None
    sample_rate: float = 5000.0
    precision: Precision = Precision.FLOAT64

    def length(self, machine: Rig) -> float:
        """The duration [s] for this machine."""
        if self.duration is not None:
            return self.duration
        return 0.6 if isinstance(machine, ActuatorSystem) else 0.5


class SimulationError(RuntimeError):
    """A run left the physical range or is not finite; `run` holds the samples before the failure."""

    def __init__(self, message: str, run: "Run"):
        super().__init__(message)
        self.run = run


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
    """

    machine: Rig
    simulation: Simulation
    signals: dict[str, np.ndarray]
    energy: dict[str, np.ndarray]
    volume: dict[str, np.ndarray]
    step: float
    step_note: str
    groups: Mapping[str, str] | None = None

    @property
    def metrics(self) -> dict[str, Metric]:
        """The metrics of the run by name, over whole cycles where the run has cycles; see `compute_metrics`."""
        return compute_metrics(self.machine, self.signals, self.energy, self.volume)

    def frame(self) -> pd.DataFrame:
        """The signals as a table in SI, one row per sample, indexed by time [s]; units in `frame.attrs["units"]`."""
        table = pd.DataFrame({n: v for n, v in self.signals.items() if n != "time"}, index=self.signals["time"])
        table.index.name = "time"
        table.attrs["units"] = {n: SIGNALS[n].unit for n in self.signals}
        return table

    def row_groups(self) -> Mapping[str, str]:
        """The group of each row of the energy balance, see `energy_balance.row_groups`."""
        return energy_balance.row_groups(self.machine) if self.groups is None else self.groups

    def ledger(self) -> pd.DataFrame:
        """The energy balance of the whole run: group, energy [J] and share of the electrical input, by row."""
        groups = self.row_groups()
        table = pd.DataFrame(
            {"group": pd.Series(groups), "energy": pd.Series({n: float(v[-1]) for n, v in self.energy.items()})}
        )
        table["share"] = table["energy"] / table.loc["electrical input", "energy"]
        table.index.name = "row"
        return table.sort_values("energy", ascending=False)

    def energy_residual(self) -> float:
        """The energy that the balance does not account for, as a share of all energy converted."""
        groups = self.row_groups()
        total = {n: float(v[-1]) for n, v in self.energy.items()}
        missing = sum(v if groups[n] == "input" else -v for n, v in total.items())
        return missing / max(sum(abs(v) for n, v in total.items() if groups[n] != "stored") / 2, 1e-300)

    def volume_residual(self) -> float:
        """The oil that the balance does not account for, as a share of the oil delivered; 0 without a pump."""
        if not self.volume:
            return 0.0
        total = {n: float(v[-1]) for n, v in self.volume.items()}
        stored = sum(v for n, v in total.items() if n.startswith("oil, "))
        delivered = total["delivery_flow_a"] + total["delivery_flow_b"]
        return (stored - total["accumulator gas"]) / max(abs(delivered), 1e-300)

    def plot(self, signals: list[str] | None = None):
        """A matplotlib figure of the run: a default choice of signals, or those named, and the energy balance.

        Raises:
            ValueError: a name is no signal of this run.
        """
        return plot_run(self.machine, self.signals, self.ledger(), signals)


def simulate(
    machine: Rig, simulation: Simulation = Simulation(), on_progress: Callable[[float], None] | None = None
) -> Run:
    """Simulate one machine from rest.

    Args:
        machine: the machine.
        simulation: settings of the run.
        on_progress: called with the share done, 0 … 1.

    Returns:
        The run.

    Raises:
        SimulationError: the run is not finite or left the physical range; the message names the time and the state.
        ValueError: the step is not above 0 and at most 100 µs.
    """
    if simulation.accuracy is not None:
        return _simulate_to_accuracy(machine, simulation, on_progress)
    largest_step = DEFAULT_STEP if simulation.step is None else simulation.step
    run, failure = _simulate_with_step(machine, simulation, largest_step, on_progress)
    if failure:
        raise SimulationError(failure, run)
    chosen = "default; give an accuracy to have it chosen and checked" if simulation.step is None else "as asked"
    return dataclasses.replace(run, step_note=f"{run.step_note}step {run.step * 1e6:.4g} µs ({chosen})")


def _simulate_to_accuracy(machine: Rig, simulation: Simulation, on_progress) -> Run:
    """Halve the step until the estimated error of every signal is within the accuracy."""
    largest_step, trials = 2.0 * DEFAULT_STEP, []
    coarse = None
    for _ in range(MAX_STEP_TRIALS):
        run, failure = _simulate_with_step(machine, simulation, largest_step, on_progress)
        if failure:
            coarse = None
        else:
            if coarse is not None:
                name, change = _largest_change(coarse, run)
                trials.append((run.step, name, change))
                # the error of a second-order rule falls to a quarter: a third of the change remains
                if change / 3.0 <= simulation.accuracy:
                    note = (
                        f"step {run.step * 1e6:.4g} µs: halved until the estimated error of the worst signal "
                        f"({name}) is {100 * change / 3.0:.2g} % of its range, asked: {100 * simulation.accuracy:.2g} %"
                    )
                    return dataclasses.replace(run, step_note=note)
            coarse = run
        largest_step *= 0.5
    if coarse is None:
        raise SimulationError(failure, run)
    step, name, change = trials[-1]
    note = (
        f"step {step * 1e6:.4g} µs: the accuracy asked, {100 * simulation.accuracy:.2g} %, was not reached; the last "
        f"halving still changed {name} by {100 * change:.2g} % of its range (stick-slip or a switch near its threshold)"
    )
    return dataclasses.replace(coarse, step_note=note)


def _largest_change(coarse: Run, fine: Run) -> tuple[str, float]:
    """The signal that differs most between two runs, and its rms difference as a share of its range."""
    changes = {}
    for name, values in fine.signals.items():
        span = np.ptp(values)
        if span > 1e-9 * (1.0 + np.abs(values).max()) or span > 0 and SIGNALS[name].unit != "Pa":
            changes[name] = math.sqrt(np.mean((values - coarse.signals[name]) ** 2)) / span
    name = max(changes, key=changes.__getitem__)
    return name, changes[name]


def _simulate_with_step(machine: Rig, simulation: Simulation, largest_step: float, on_progress) -> tuple[Run, str]:
    """Simulate with a fixed step, up to a failure if there is one; the second value describes it, or is empty."""
    if not 0.0 < largest_step <= LARGEST_STEP:
        raise ValueError(f"step {largest_step * 1e6:.4g} µs: must lie above 0 and at most {LARGEST_STEP * 1e6:.0f} µs")
    interval = 1.0 / simulation.sample_rate
    per_sample = max(1, math.ceil(interval / largest_step - 1e-9))
    dtype = np.dtype(simulation.precision.value)
    h = dtype.type(interval / per_sample)
    samples = int(math.floor(simulation.length(machine) * simulation.sample_rate + 1e-9)) + 1
    numbers = jax.tree.map(lambda leaf: np.asarray(leaf, dtype), machine)
    loop, blocks, note = initial_loop_state(numbers, h), [], ""
    try:
        while len(blocks) * SAMPLES_PER_CALL < samples and int(loop.failed_step) < 0:
            loop, block = integrate(numbers, loop, h, per_sample, SAMPLES_PER_CALL)
            blocks.append(block)
            if on_progress is not None:
                on_progress(min(1.0, len(blocks) * SAMPLES_PER_CALL / samples))
    except KeyboardInterrupt:
        note = "interrupted; "
        if not blocks:
            raise
    failed_step = int(loop.failed_step)
    valid = min(samples, len(blocks) * SAMPLES_PER_CALL)
    if failed_step >= 0:
        valid = min(valid, -(-failed_step // per_sample))

    def joined(columns):
        return {n: np.concatenate(arrays)[:valid].astype(float) for n, arrays in columns.items()}

    signals = joined({n: [b.signals[n] for b in blocks] for n in blocks[0].signals})
    signals["time"] = np.arange(valid) / simulation.sample_rate
    energy = joined({n: [b.balance.energy[n] for b in blocks] for n in blocks[0].balance.energy})
    volume = joined({n: [b.balance.volume[n] for b in blocks] for n in blocks[0].balance.volume})
    run = Run(machine, simulation, signals, energy, volume, float(h), note)
    if failed_step < 0 or failed_step > (samples - 1) * per_sample:
        return run, ""
    name = check_names(machine)[int(loop.failed_check)]
    what = "left its physical range" if name in SIGNALS else "is not a finite number"
    return run, (
        f"at {failed_step * float(h):.6g} s {name} {what} (step {float(h) * 1e6:.4g} µs); "
        "the machine is outside what the model describes, or the step is too large for it: try a smaller step"
    )
