"""One run of one machine: how long, at which step, in which precision, and what came of it."""

import dataclasses
import enum
import math
from collections.abc import Callable

import jax
import numpy as np
import pandas as pd

from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.machine.rigs import ActuatorSystem, Rig
from edhas_jax.simulation import energy_balance
from edhas_jax.simulation.integrator import DEFAULT_STEP, LARGEST_STEP, checks, march, start
from edhas_jax.simulation.metrics import Metric, measure
from edhas_jax.simulation.run_figure import plot_run

STRETCH = 256  # samples between two reports of progress; a fixed number, so that a longer run compiles nothing


class Precision(enum.Enum):
    """The floating-point numbers of a run."""

    FLOAT64 = "float64"
    FLOAT32 = "float32"


@dataclasses.dataclass(frozen=True)
class Simulation:
    """How a run is made, in SI.

    Give `step`, or give `accuracy` (largest error of any signal as a share of its range) and the step is chosen and
    checked; with neither the step is 20 µs. `duration` None means 0.5 s on a bench and 0.6 s for the system.
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
    """A run left the physical range or is not finite; `run` holds what came before."""

    def __init__(self, message: str, run: "Run"):
        super().__init__(message)
        self.run = run


@dataclasses.dataclass(frozen=True)
class Run:
    """A finished run: the machine, how it was run, and its signals as SI arrays over `signals["time"]`.

    `energy` [J] and `volume` [m³] are cumulated since the start; `step` [s] is the one taken and `step_note` says how
    it was chosen. `metrics` maps names to `Metric(value, unit, doc)`.
    """

    machine: Rig
    simulation: Simulation
    signals: dict[str, np.ndarray]
    energy: dict[str, np.ndarray]
    volume: dict[str, np.ndarray]
    step: float
    step_note: str

    @property
    def metrics(self) -> dict[str, Metric]:
        """The quantities people ask for, over whole cycles where the run has cycles."""
        return measure(self.machine, self.signals, self.energy, self.volume)

    def frame(self) -> pd.DataFrame:
        """The signals as a table in SI, one row per sample, indexed by time [s]; units in `frame.attrs["units"]`."""
        table = pd.DataFrame({n: v for n, v in self.signals.items() if n != "time"}, index=self.signals["time"])
        table.index.name = "time"
        table.attrs["units"] = {n: SIGNALS[n].unit for n in self.signals}
        return table

    def ledger(self) -> pd.DataFrame:
        """Where the energy of the whole run went: group, energy [J] and share of the electrical input, by row."""
        groups = energy_balance.rows(self.machine)
        table = pd.DataFrame(
            {"group": pd.Series(groups), "energy": pd.Series({n: float(v[-1]) for n, v in self.energy.items()})}
        )
        table["share"] = table["energy"] / table.loc["electrical input", "energy"]
        table.index.name = "row"
        return table.sort_values("energy", ascending=False)

    def energy_residual(self) -> float:
        """What the energy ledger does not account for, as a share of all energy turned over."""
        groups = energy_balance.rows(self.machine)
        last = {n: float(v[-1]) for n, v in self.energy.items()}
        missing = sum(v if groups[n] == "input" else -v for n, v in last.items())
        return missing / max(sum(abs(v) for n, v in last.items() if groups[n] != "stored") / 2, 1e-300)

    def volume_residual(self) -> float:
        """What the balance of the oil does not account for, as a share of the oil delivered; 0 without a pump."""
        if not self.volume:
            return 0.0
        last = {n: float(v[-1]) for n, v in self.volume.items()}
        stored = sum(v for n, v in last.items() if n.startswith("oil, "))
        moved = last["delivery_flow_a"] + last["delivery_flow_b"]
        return (stored - last["accumulator gas"]) / max(abs(moved), 1e-300)

    def plot(self, signals: list[str] | None = None):
        """A matplotlib figure of the run: its most telling signals, or those named."""
        return plot_run(self.machine, self.signals, self.ledger(), signals)


def simulate(
    machine: Rig, simulation: Simulation = Simulation(), on_progress: Callable[[float], None] | None = None
) -> Run:
    """Run one machine from rest.

    `on_progress` is called with the share done, 0 … 1.

    Raises:
        SimulationError: the run is not finite or left the physical range; the message names the time and the state.
    """
    if simulation.accuracy is None:
        wanted = DEFAULT_STEP if simulation.step is None else simulation.step
        run, failure = _march(machine, simulation, wanted, on_progress)
        if failure:
            raise SimulationError(failure, run)
        chosen = "default; give an accuracy to have it chosen and checked" if simulation.step is None else "as asked"
        return dataclasses.replace(run, step_note=f"{run.step_note}step {run.step * 1e6:.4g} µs ({chosen})")
    return _to_accuracy(machine, simulation, on_progress)


def _to_accuracy(machine: Rig, simulation: Simulation, on_progress) -> Run:
    """Halve the step until halving it once more changes no signal by more than the accuracy wanted."""
    wanted, tried = 2.0 * DEFAULT_STEP, []
    coarse = None
    for _ in range(8):
        run, failure = _march(machine, simulation, wanted, on_progress)
        if failure:
            coarse = None
        else:
            if coarse is not None:
                name, change = _largest_change(coarse, run)
                tried.append((run.step, name, change))
                # the error of a second-order rule falls to a quarter: what remains is a third of the change
                if change / 3.0 <= simulation.accuracy:
                    note = (
                        f"step {run.step * 1e6:.4g} µs: halved until the estimated error of the worst signal "
                        f"({name}) is {100 * change / 3.0:.2g} % of its range, asked: {100 * simulation.accuracy:.2g} %"
                    )
                    return dataclasses.replace(run, step_note=note)
            coarse = run
        wanted *= 0.5
    if coarse is None:
        raise SimulationError(failure, run)
    step, name, change = tried[-1]
    note = (
        f"step {step * 1e6:.4g} µs: the accuracy asked, {100 * simulation.accuracy:.2g} %, was not reached; the last "
        f"halving still changed {name} by {100 * change:.2g} % of its range (stick-slip or a switch near its threshold)"
    )
    return dataclasses.replace(coarse, step_note=note)


def _largest_change(coarse: Run, fine: Run) -> tuple[str, float]:
    changes = {}
    for name, values in fine.signals.items():
        span = np.ptp(values)
        if span > 1e-9 * (1.0 + np.abs(values).max()) or span > 0 and SIGNALS[name].unit != "Pa":
            changes[name] = math.sqrt(np.mean((values - coarse.signals[name]) ** 2)) / span
    name = max(changes, key=changes.__getitem__)
    return name, changes[name]


def _march(machine: Rig, simulation: Simulation, wanted: float, on_progress) -> tuple[Run, str]:
    """March and cut off at a failure; the second value is the sentence that says what broke, or empty."""
    if not 0.0 < wanted <= LARGEST_STEP:
        raise ValueError(f"step {wanted * 1e6:.4g} µs: must lie above 0 and at most {LARGEST_STEP * 1e6:.0f} µs")
    interval = 1.0 / simulation.sample_rate
    per_sample = max(1, math.ceil(interval / wanted - 1e-9))
    dtype = np.dtype(simulation.precision.value)
    h = dtype.type(interval / per_sample)
    samples = int(math.floor(simulation.length(machine) * simulation.sample_rate + 1e-9)) + 1
    numbers = jax.tree.map(lambda leaf: np.asarray(leaf, dtype), machine)
    here, stretches, note = jax.jit(start)(numbers, h), [], ""
    try:
        while len(stretches) * STRETCH < samples and int(here.broken_step) < 0:
            here, stretch = march(numbers, here, h, per_sample, STRETCH)
            stretches.append(jax.device_get(stretch))
            if on_progress is not None:
                on_progress(min(1.0, len(stretches) * STRETCH / samples))
    except KeyboardInterrupt:
        note = "interrupted; "
        if not stretches:
            raise
    broken_step = int(here.broken_step)
    keep = min(samples, len(stretches) * STRETCH)
    if broken_step >= 0:
        keep = min(keep, -(-broken_step // per_sample))

    def joined(columns):
        return {n: np.concatenate(parts)[:keep].astype(float) for n, parts in columns.items()}

    signals = joined({n: [s.signals[n] for s in stretches] for n in stretches[0].signals})
    signals["time"] = np.arange(keep) / simulation.sample_rate
    energy = joined({n: [s.book.energy[n] for s in stretches] for n in stretches[0].book.energy})
    volume = joined({n: [s.book.volume[n] for s in stretches] for n in stretches[0].book.volume})
    run = Run(machine, simulation, signals, energy, volume, float(h), note)
    if broken_step < 0 or broken_step > (samples - 1) * per_sample:
        return run, ""
    name = checks(machine)[int(here.broken_check)]
    what = "left its physical range" if name in SIGNALS else "is not a finite number"
    return run, (
        f"at {broken_step * float(h):.6g} s {name} {what} (step {float(h) * 1e6:.4g} µs); "
        "the machine is outside what the model describes, or the step is too large for it: try a smaller step"
    )
