"""What every rig must satisfy, tried on one: declarations, slots, a run, the step, derivatives, conservation."""

import functools
import re
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax.core import runtime
from edhas_jax.core.units import format_quantity
from edhas_jax.machine.effects import LIBRARY, EffectError
from edhas_jax.machine.effects.tabulated_law import LawPlace, rig_of, tabulated_class
from edhas_jax.machine.effects.validation import check_effect
from edhas_jax.machine.interface.slots import SLOTS
from edhas_jax.machine.parameters import get_parameter, short_names
from edhas_jax.machine.rig_base import Rig
from edhas_jax.simulation.batch_trajectories import simulate_batch
from edhas_jax.simulation.integrator import signal_names, step_with_outputs
from edhas_jax.simulation.run import Simulation, SimulationError, simulate

SAMPLES = 60  # of the runs that are compared
MOST_HALVINGS = 10  # of the step, until it resolves the fastest motion
ORDERS = 1.7, 2.3  # of a rule of second order, with what kinks in the equations and rounding move a regression over
FITTED_HALVINGS = 3  # the finest ones; a rule of first order has 1 there, steps that are still too large anything
ROUNDING = 1e-10  # change of a signal over its range, below which rounding hides the order
LARGEST_DIFFERENCE = 1e-2  # of derivative and difference quotient, over the largest derivative by this parameter
SMALLEST_ELASTICITY = 1e-4  # below which rounding hides a difference
STILL = "nothing moves with the usual values of the drives"
DIFFERENCE_STEP = 1e-5  # relative change of a parameter in a difference quotient
LARGEST_LOSS = 1e-6  # of oil, over what flowed through a node


class Finding(NamedTuple):
    """The outcome of one check: its name, whether it passed, and a sentence with its figures."""

    check: str
    passed: bool
    sentence: str


def check_contract(machine: Rig, on_progress: Callable[[str], None] | None = None) -> list[Finding]:
    """Try a machine, whose declarations are checked already, against the contract.

    Args:
        machine: the machine with the numbers and drives at which it is tried.
        on_progress: called with the name of each check.

    Returns:
        A finding for each check, in the order in which they were made; after a run that fails nothing more is tried.
    """
    checks = [slots_act, run_is_valid, step_has_order, batch_equals_run, derivatives_agree, oil_is_conserved]
    findings: list[Finding] = []
    with runtime.double_precision():
        for check in checks:
            if on_progress is not None:
                on_progress(check.__name__.replace("_", " "))
            findings += check(machine)
            if check is run_is_valid and not findings[-1].passed:
                break
    return findings


def slots_act(machine: Rig) -> Iterator[Finding]:
    """An effect at every slot of its own is called, with the signals over which curves can be drawn there."""
    for slot in (s for s in machine.slots if s.name not in SLOTS):
        variables = slot.over or ("time",)
        failed = []
        for text in variables:
            variable, *factors = text.split(":")
            place = LawPlace(slot.name, variable, tuple(factors), rig_of(machine))
            try:
                check_effect(tabulated_class("a_curve", place, 2)(node_1=0.0, node_2=1.0), machine)
            except EffectError as error:
                failed.append(str(error))
        curves = ", ".join(variables)
        yield Finding(f"slot {slot.name}", not failed, failed[0] if failed else f"acts; curves over {curves}")
    mounted = [kind.id for kind in LIBRARY if _mounts(machine, kind)]
    if mounted:
        words = f"{len(mounted)} effects of the library mount: {', '.join(mounted)}"
        lacking = [f"{kind.id} ({name})" for kind in LIBRARY if (name := _unknown_signal(machine, kind))]
        more = f"; no signal that others with a slot here read: {', '.join(lacking)}" if lacking else ""
        yield Finding("library", True, words + more)


def run_is_valid(machine: Rig) -> Iterator[Finding]:
    """A run of the usual length is finite and within its ranges, and half the step gives the same."""
    try:
        run = simulate(machine, Simulation())
    except SimulationError as error:
        yield Finding("run", False, str(error))
        return
    still = "" if _moves(run.signals) else f"; {STILL}, so that the rest is hardly a test"
    yield Finding("run", run.valid, f"{run.duration:g} s: {run.reason}; {run.step_note}{still}")
    if "input" in run.row_groups().values():
        words = f"closes to {abs(run.energy_residual()):.0e} of the energy turned over"
        yield Finding("energy balance", abs(run.energy_residual()) < 1e-2, words)


def step_has_order(machine: Rig) -> Iterator[Finding]:
    """Halving a step that is small enough reduces its error to a quarter."""
    before, changes = _trace(machine, 1), []
    if not _moves(before):
        yield Finding("step", True, f"{STILL}, so that the order could not be checked")
        return
    sizes = {n: _size(v) for n, v in before.items()}
    for k in range(1, MOST_HALVINGS + 1):
        trace = _trace(machine, 2**k)
        changes.append(float(np.max([_rms(trace[n] - before[n]) / sizes[n] for n in sizes])))
        before = trace
        if not changes[-1] >= ROUNDING:
            break
    first, *_ = steps = [format_quantity(machine.time_step / 2.0**k, "s") for k in range(len(changes) + 1)]
    words = f"half of {first} changes signals by {changes[0]:.0e} of their range"
    above = len(changes) - (changes[-1] < ROUNDING)
    if above < FITTED_HALVINGS and changes[-1] < ROUNDING:
        yield Finding("step", True, f"{words}; rounding hides the order from {steps[above]}")
        return
    fitted = slice(above - FITTED_HALVINGS, above)
    order = -np.polyfit(range(FITTED_HALVINGS), np.log2(changes[fitted]), 1)[0]
    words += f"; order {order:.2f} from {steps[fitted.start]} to {steps[fitted.stop]}"
    passed = bool(ORDERS[0] <= order <= ORDERS[1])
    if not passed:
        words += "; it must be 2: an equation hides a derivative or reads the step, or time_step is too large"
    yield Finding("step", passed, words)


def batch_equals_run(machine: Rig) -> Iterator[Finding]:
    """A lane of a batch is the single run."""
    settings = Simulation(duration=_interval(machine) * (SAMPLES - 1), step=machine.time_step)
    run, lane = simulate(machine, settings).signals, _trace(machine, 1)
    worst = float(np.max([_rms(run[n][: len(v)] - v[: len(run[n])]) / _size(v) for n, v in lane.items()]))
    yield Finding("batch", worst < 1e-9, f"a lane differs from the single run by {worst:.0e} of a signal's range")


def derivatives_agree(machine: Rig) -> Iterator[Finding]:
    """The derivative of every signal by every number agrees with the difference quotient.

    Where it does not, the number may stand at a kink of the equations, such as the limit of a `clip`: there the
    derivatives on both sides of it have to agree.
    """
    names, worst, culprit, kinks = list(short_names(machine).values()), 0.0, "none", []
    for name in names:
        value = float(get_parameter(machine, name))
        change = DIFFERENCE_STEP * (abs(value) or 1.0)
        found, signal = _derivative_error(machine, name, value, change)
        if not found < LARGEST_DIFFERENCE:
            beside, _ = max(_derivative_error(machine, name, value + k * change, change) for k in (-3.0, 3.0))
            if beside < LARGEST_DIFFERENCE:
                found, kinks = beside, [*kinks, name]
        if not found <= worst:
            worst, culprit = found, f"{signal} by {name}"
    words = f"{len(names)} numbers; derivative and difference differ by {worst:.0e} at most ({culprit})"
    if kinks:
        words += f"; compared on both sides of a kink in the equations: {', '.join(kinks)}"
    yield Finding("derivatives", worst < LARGEST_DIFFERENCE, words)


def _derivative_error(machine: Rig, name: str, value: float, change: float) -> tuple[float, str]:
    """How much the derivative of a signal by a number at `value` differs from the difference at most, and of which."""
    observed, errors = _observed(machine), {"none": 0.0}
    slopes = _simulated(machine, {name: [value]}, {name: np.ones(1)}, observed).slopes
    ends = _simulated(machine, {name: [value - change, value + change]}, None, observed).values
    for n in observed:
        difference = (ends[n][:, 1] - ends[n][:, 0]) / (2.0 * change)
        size = max(_rms(difference), SMALLEST_ELASTICITY * _rms(ends[n][:, 0]) / max(abs(value), 1e-300))
        if not size <= 0.0:
            errors[n] = float(np.nan_to_num(_rms(slopes[n][:, 0] - difference) / size, nan=np.inf))
    signal = max(errors, key=errors.__getitem__)
    return errors[signal], signal


def oil_is_conserved(machine: Rig) -> Iterator[Finding]:
    """What flows into every node of oil is what its compression takes up."""
    y0 = machine.initial_state()
    nodes = tuple(machine.evaluate(y0, 0.0, 1.0, y0)[0].record.oil_nodes)
    if not nodes:
        return
    h, count = machine.time_step, 200

    def inflows(s):
        found = {}
        for n in nodes:
            node = s.record.oil_nodes[n]
            capacity = node.volume * machine.oil.compressibility(node.pressure, s)
            found[n] = s.record.pressure_rates[n] * (capacity if node.extra_capacity is None else
                                                     capacity + node.extra_capacity)  # fmt: skip
            found[f"volume {n}"] = node.volume + jnp.zeros_like(node.pressure)
        return found

    @functools.partial(jax.jit)
    def advance(k, carry):
        y, into, taken, turned = carry
        after, _, seen = step_with_outputs(machine, y, k * h, h, inflows)
        s = machine.evaluate(y, k * h, h, y)[0]
        into = {n: into[n] + h * seen[n] for n in nodes}
        turned = {n: turned[n] + h * jnp.abs(seen[n]) for n in nodes}
        taken = {n: taken[n] + seen[f"volume {n}"] * machine.oil.strain(y[n], after[n], s) for n in nodes}
        return after, into, taken, turned

    zeros = {n: jnp.zeros(()) for n in nodes}
    start = {n: jnp.asarray(v, float) for n, v in y0.items()}
    _, into, taken, turned = jax.lax.fori_loop(0, count, advance, (start, zeros, zeros, zeros))
    for n in nodes:
        loss = abs(float(into[n] - taken[n])) / max(float(turned[n]), 1e-300)
        extra = machine.evaluate(y0, 0.0, 1.0, y0)[0].record.oil_nodes[n].extra_capacity is not None
        words = f"{count} steps lose {loss:.0e} of the oil that flowed"
        yield Finding(f"oil, {n}", extra or loss < LARGEST_LOSS, words + ("; it has further capacity" if extra else ""))


def _mounts(machine: Rig, kind) -> bool:
    try:
        check_effect(kind(), machine)
    except EffectError:
        return False
    return set(kind.slots) <= set(machine.slots)


def _unknown_signal(machine: Rig, kind) -> str:
    """The signal or parameter that an effect reads and the machine lacks, although it has the slot; else empty."""
    if not set(kind.slots) <= set(machine.slots):
        return ""
    try:
        check_effect(kind(), machine)
    except EffectError as error:
        found = re.search(r"no signal or parameter `(\w+)`", str(error))
        return found[1] if found else ""
    return ""


def _observed(machine: Rig) -> tuple[str, ...]:
    """The signals that the machine has, without the time."""
    found = signal_names(machine)
    return tuple(n for n in machine.signals if n in found and n != "time")


def _interval(machine: Rig) -> float:
    return 10.0 * machine.time_step


def _trace(machine: Rig, refinement: int) -> dict[str, np.ndarray]:
    """The signals of the machine as it is, (samples,), with a step that is `refinement` times smaller."""
    name = next(iter(short_names(machine).values()))
    observed = _observed(machine)
    found = _simulated(machine, {name: [float(get_parameter(machine, name))]}, None, observed, refinement).values
    return {n: v[:, 0] for n, v in found.items()}


def _simulated(machine: Rig, columns, seeds, observed, refinement: int = 1):
    columns = {n: np.asarray(v, float) for n, v in columns.items()}
    step = machine.time_step / refinement
    return simulate_batch(machine, columns, seeds, step, 10 * refinement, SAMPLES, observed)


def _moves(signals: Mapping[str, np.ndarray]) -> bool:
    return any(np.ptp(values) > 1e-9 * _size(values) for name, values in signals.items() if name != "time")


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _size(values: np.ndarray) -> float:
    return max(float(np.ptp(values)), 1e-9 * _rms(values), 1e-300)
