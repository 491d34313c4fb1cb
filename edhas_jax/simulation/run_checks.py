"""Checks of a finished run: its status, and how far its main results depend on the step."""

import dataclasses
import math
import operator

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax.compiler.derivative_graph import defer_partials, linearize
from edhas_jax.compiler.sparse_elimination import jacobian
from edhas_jax.core import runtime
from edhas_jax.core.units import format_number, format_quantity
from edhas_jax.machine.components.set_points import Chirp, Recorded, Sine, Step
from edhas_jax.machine.rigs import ActuatorParts, Rig
from edhas_jax.simulation.metrics import RunTooShortError, mean_rate, metric_window, run_metrics
from edhas_jax.simulation.validity import REASONS, Status, failed_tests

ONLY_WITH_STEP = "mean leakage", "delivered power"  # results that say nothing more of the period than the others
PERIODIC_TOLERANCE = 0.01  # change of flow, power or stroke over the last two cycles above which a run still changes
FEWEST_SAMPLES = 16  # per cycle: a peak between two samples is missed by 2 % at most
LARGEST_RESIDUAL = 0.01  # of the energy and the oil balance
NEGLIGIBLE = 0.01  # share of the swept flow and of the travel to a stop; less is not compared by its own size
BURST_PRESSURE = 140e6  # Pa, four times the 35 MPa for which hoses, pipes and valves are usually made
SET_POINTS = ("reference", "target")  # of the rigs of the package
BEYOND_RECORD = 0.01  # of a run, that may lie before or after the record that drives it
SMALLEST = {  # m³/s, W, m
    "mean flow": 1e-12, "mean leakage": 1e-12, "mean electrical power": 1e-9, "delivered power": 1e-9,
    "peak stroke": 1e-12,
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Record:
    """What a run has recorded, in SI: signals, energies and volumes by name, each (samples,)."""

    machine: Rig
    signals: dict[str, np.ndarray]
    energy: dict[str, np.ndarray]
    volume: dict[str, np.ndarray]

    @property
    def window(self) -> tuple[float, float]:
        """The time [s] from which and to which results are taken; the whole run if it has no whole cycle."""
        end = float(self.signals["time"][-1])
        try:
            return metric_window(self.machine, end)
        except RunTooShortError:
            return 0.0, end

    @property
    def delivers_nothing(self) -> bool:
        """Whether the pump, if there is one, delivers so little that the error of the oil balance has no scale."""
        if "delivery_flow_a" not in self.volume:
            return True
        delivered = float(self.volume["delivery_flow_a"][-1] + self.volume["delivery_flow_b"][-1])
        time = self.signals["time"]
        travel = float(np.abs(self.signals["piston_velocity"]).mean()) * float(time[-1] - time[0])
        return abs(delivered) <= NEGLIGIBLE * float(self.machine.pump.area()) * travel

    def results(self, first: float, last: float) -> dict[str, tuple[float, float]]:
        """Flow, power and stroke between two times [s], each with the size to which its changes are compared."""
        t = self.signals["time"]
        inside = (t >= first - 1e-12) & (t <= last + 1e-12)
        power = mean_rate(t, self.energy["electrical input"], first, last)
        stroke = float(np.abs(self.signals["piston_position"][inside]).max())
        largest = max(stroke, NEGLIGIBLE * 0.5 * float(self.machine.stops.pump_stroke))
        sizes = {"mean electrical power": (power, abs(power)), "peak stroke": (stroke, largest)}
        if "outlet_flow" in self.volume:
            flow = mean_rate(t, self.volume["outlet_flow"], first, last)
            speed = np.abs(self.signals["piston_velocity"][inside]).mean()
            swept = float(self.machine.pump.area()) * float(speed)
            sizes["mean flow"] = flow, max(abs(flow), NEGLIGIBLE * swept)
            leakage = mean_rate(t, self.volume["leakage_a"] + self.volume["leakage_b"], first, last)
            sizes["mean leakage"] = leakage, max(abs(leakage), NEGLIGIBLE**2 * swept)
            load = "load orifice" if "load orifice" in self.energy else "load"
            delivered = mean_rate(t, self.energy[load], first, last)
            sizes["delivered power"] = delivered, max(abs(delivered), NEGLIGIBLE * abs(power))
        return {name: (value, max(size, SMALLEST[name])) for name, (value, size) in sizes.items()}


def step_change(coarse: Record, fine: Record) -> tuple[str, float]:
    """The main result that differs most between two runs of one machine with different steps, and by which share."""
    if not isinstance(fine.machine, ActuatorParts):
        return largest_change(fine.machine, coarse.signals, fine.signals)
    first, last = fine.window
    changes = _changes(coarse.results(first, last), fine.results(first, last))
    if "cylinder_position" in fine.signals:
        x, span = fine.signals["cylinder_position"], np.ptp(fine.signals["cylinder_position"])
        rms = math.sqrt(np.mean((x - coarse.signals["cylinder_position"]) ** 2))
        changes["cylinder position"] = rms / max(span, 1e-9)
        changes.pop("mean flow")  # of a cylinder that has arrived it is the difference of large numbers
    return _largest(changes)


def _largest(changes: dict[str, float]) -> tuple[str, float]:
    """The largest change and its name; one that is not a number exceeds all others."""
    changes = {name: math.inf if math.isnan(change) else change for name, change in changes.items()}
    return max(changes.items(), key=operator.itemgetter(1))


def _changes(old: dict[str, tuple[float, float]], new: dict[str, tuple[float, float]]) -> dict[str, float]:
    return {n: abs(value - old[n][0]) / size for n, (value, size) in new.items()}


@np.errstate(over="ignore", invalid="ignore")  # what is not finite is what it looks for
def check_run(record: Record, energy_residual: float, volume_residual: float, step: float = 0.0) -> tuple[Status, str]:
    """The status of a run and its reason, apart from how far it depends on the step.

    Args:
        record: the run.
        energy_residual: error of the energy balance, a share of the energy converted.
        volume_residual: error of the oil balance, a share of the oil delivered.
        step: time step of the run [s]; 0 where it is not known.
    """
    m, reasons = record.machine, dict(REASONS)
    if not isinstance(m, ActuatorParts):
        return _check_signals(record, energy_residual, step)
    try:
        values = run_metrics(m, record.signals, record.energy, record.volume)
    except RunTooShortError:
        values = {"peak_stroke": float(np.abs(record.signals["piston_position"]).max())}
    changing, change = _change_of_last_cycles(record)
    found = [status for status, applies in failed_tests(m, values, change <= PERIODIC_TOLERANCE, np) if applies]
    status = found[-1] if found else Status.OK
    if changing:
        reasons[Status.NOT_PERIODIC] = (
            f"{changing} still changes by {100 * change:.2g} % from cycle to cycle at the end of the run; a longer "
            "duration shows whether it settles"
        )
    else:
        reasons[Status.OK] = "within the model's validity"
    if status < Status.HIT_STOPS and _cylinder_at_stop(record):
        status, reasons[Status.HIT_STOPS] = Status.HIT_STOPS, "the cylinder ran onto an end stop"
    if status.is_valid and m.cycle is not None:
        time, frequency = record.signals["time"], float(m.reference.frequency)
        if len(time) > 1 and (time[1] - time[0]) * frequency * FEWEST_SAMPLES > 1.0 + 1e-9:
            status = Status.FEW_SAMPLES
            reasons[status] += f" to at least {FEWEST_SAMPLES * frequency / 1e3:.4g} kHz"
    wrong = _wrong_balance("oil", volume_residual) or _wrong_balance("energy", energy_residual)
    return wrong or (status, reasons[status] + _remarks(record))


def _sampling_remark(record: Record) -> str:
    """What is said of a rig of one's own with few samples in a cycle of a drive; those of the package have a status."""
    m, time = record.machine, record.signals["time"]
    interval = float(time[1] - time[0]) if len(time) > 1 else 0.0
    for name in m.drives:
        drive = getattr(m, name)
        if not isinstance(drive, Sine) or not float(drive.amplitude):
            continue
        cycles = interval * float(drive.frequency)  # from sample to sample
        if cycles * FEWEST_SAMPLES > 1.0 + 1e-9:
            count = format_number(1.0 / cycles, 2)
            return f"; but a cycle of {name} has {count} samples, which miss peaks: raise `sample_rate`"
    return ""


def _remarks(record: Record) -> str:
    """What is said beside the status of a run."""
    return _pressure_remark(record) + _drive_remark(record)


def _drive_remark(record: Record) -> str:
    """What is said of a run that ends before its drives have done what they should, or goes on after their records."""
    m, end = record.machine, float(record.signals["time"][-1])
    for name in m.drives or SET_POINTS:
        drive, what = getattr(m, name, None), "set point" if name in SET_POINTS else name
        if isinstance(drive, Step) and float(drive.step_size) and float(drive.step_time) >= end:
            return f"; but the run ends before the step of the {what} at {format_quantity(float(drive.step_time), 's')}"
        if isinstance(drive, Chirp) and float(drive.sweep_time) > (1.0 + BEYOND_RECORD) * end:
            sweep = format_quantity(float(drive.sweep_time), "s")
            return f"; but the run ends within the sweep of the {what}, which takes {sweep}"
        if isinstance(drive, Recorded) and (beyond := _beyond_record(drive, end)):
            return f"; the recorded {what} {beyond} and is taken as constant beyond that"
    return ""


def _beyond_record(drive: Recorded, end: float) -> str:
    """Where a record begins after 0 or ends before a time [s]; empty where it does not."""
    first = float(drive.start)
    last = first + float(drive.interval) * (len(drive.values) - 1)
    parts = [f"begins at {format_quantity(first, 's')}"] if first > BEYOND_RECORD * end else []
    # one that is held, which is flat between its steps, does not tell when its record ends
    if last + float(drive.interval) < (1.0 - BEYOND_RECORD) * end and np.ptp(drive.values) > 0.0:
        parts.append(f"ends at {format_quantity(last, 's')}")
    return " and ".join(parts)


def _pressure_remark(record: Record) -> str:
    """What is said of a pressure that no part stands: the numbers are those of the model, but no machine has them."""
    peaks = {n: float(v.max()) for n, v in record.signals.items() if record.machine.signals[n].unit == "Pa"}
    name = max(peaks, key=peaks.__getitem__, default="")
    if not peaks or not peaks[name] > BURST_PRESSURE:
        return ""
    reached = format_quantity(peaks[name], "Pa")
    return f"; {name} reaches {reached}, at which usual hydraulic parts burst: is a path closed?"


def _wrong_balance(what: str, residual: float, remedy: str = "take a smaller step") -> tuple[Status, str] | None:
    """The status and reason of a run whose balance of energy or oil has this error; None if it closes."""
    if not math.isfinite(residual):
        return Status.NOT_FINITE, f"the {what} balance is not a finite number"
    if abs(residual) <= LARGEST_RESIDUAL:
        return None
    return Status.STEP_TOO_LARGE, f"the {what} balance has an error of {100 * abs(residual):.2g} %: {remedy}"


def _check_signals(record: Record, energy_residual: float, step: float) -> tuple[Status, str]:
    """The status of a run by its signals alone, and by its energy balance if that says what goes in."""
    for name, values in record.signals.items():
        if not np.isfinite(np.square(values)).all():
            return Status.NOT_FINITE, f"{name} is not finite, or beyond 1e154, whose square is no number"
    remedy = "take a smaller step, or an equation takes or gives power unsaid"
    if wrong := _wrong_balance("energy", energy_residual, remedy):
        return wrong
    name, growth = growth_at_start(record.machine) if step else ("", 0.0)
    if growth * step > 2.0:
        fast, short = (format_quantity(t, "s") for t in (1.0 / growth, 0.5 / growth))
        return Status.STEP_TOO_LARGE, (f"{name} grows e-fold within {fast} at the start, which the step jumps over; "
                                       f"set `time_step` of the rig to {short} or less")  # fmt: skip
    return Status.OK, "finite, within the ranges that the equations state" + _sampling_remark(record) + _remarks(record)


def growth_at_start(machine: Rig) -> tuple[str, float]:
    """The state that grows fastest by itself at the start, and its rate λ [1/s]: it grows as e^(λt).

    The step divides by 2/h − λ: one that is longer than 2/λ jumps over what grows.
    """
    with runtime.double_precision():
        machine = jax.tree.map(jnp.asarray, machine)  # samples of a recorded drive are taken at a traced time
        y = {n: jnp.asarray(value, float) for n, value in machine.initial_state().items()}
        h = machine.time_step
        slopes = jacobian(linearize(lambda state: machine.evaluate(state, 0.0, h, y, defer_partials)[1], y))
    matrix = np.array([[float(slopes[n].get(m, 0.0)) for m in y] for n in y])
    if not np.isfinite(matrix).all():
        return "", 0.0
    rates, vectors = np.linalg.eig(matrix)
    fastest = int(np.argmax(rates.real))
    return list(y)[int(np.argmax(np.abs(vectors[:, fastest])))], float(rates.real[fastest])


def largest_change(machine: Rig, coarse: dict[str, np.ndarray], fine: dict[str, np.ndarray]) -> tuple[str, float]:
    """The signal that differs most between two runs, and its rms difference as a share of its range."""
    changes, count = {"no signal": 0.0}, min(len(fine["time"]), len(coarse["time"]))
    for name, values in fine.items():
        values, span = values[:count], np.ptp(values)
        if not span <= 1e-9 * (1.0 + np.abs(values).max()) or span > 0 and machine.signals[name].unit != "Pa":
            changes[name] = math.sqrt(np.mean((values - coarse[name][:count]) ** 2)) / span
    return _largest(changes)


def _change_of_last_cycles(record: Record) -> tuple[str, float]:
    """The main result that differs most between the last two cycles; ("", 0) without two cycles."""
    m, end = record.machine, float(record.signals["time"][-1])
    if m.cycle is None:
        return "", 0.0
    period = 1.0 / float(m.reference.frequency)
    first, last = record.window
    if last - first < 2.0 * period - 1e-9 or end - float(m.reference.ramp_time) < 2.0 * period - 1e-9:
        return "", 0.0
    middle = last - period
    changes = _changes(record.results(middle - period, middle), record.results(middle, last))
    changes = {name: change for name, change in changes.items() if name not in ONLY_WITH_STEP}
    return _largest(changes)


def _cylinder_at_stop(record: Record) -> bool:
    x = record.signals.get("cylinder_position")
    if x is None:
        return False
    stroke = float(record.machine.cylinder.cylinder_stroke)
    return bool(x.max() > stroke or x.min() < -1e-3 * stroke)
