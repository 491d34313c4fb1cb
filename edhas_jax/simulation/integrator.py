"""The integrator: one linearly implicit midpoint step, and the march of a single run."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from edhas_jax.compiler.derivative_graph import defer_partials, linearize
from edhas_jax.compiler.sparse_elimination import StrainUnknown, solve
from edhas_jax.machine.equations import passage_slopes
from edhas_jax.machine.interface.signals import SIGNALS, Passage, Signals
from edhas_jax.machine.rigs import Rig, State
from edhas_jax.simulation import energy_balance

DEFAULT_STEP = 20e-6
LARGEST_STEP = 100e-6


def step(machine: Rig, y: State, t, h) -> tuple[State, State]:
    """One step of the linearly implicit midpoint rule (a one-stage Rosenbrock method, second order, A-stable).

    (2/h I − J) k = 2 f(t + h/2, y),   y(t + h) = y + k,   J = ∂f/∂y exact and sparse

    Returns the new state and k. The equations are evaluated once and nothing is iterated, so a step costs the same
    through impact, stick and cavitation. J holds every derivative, those of oil stiffness and chamber volume too:
    without them the rule would be of first order. The nodes of oil are solved for the pressure that belongs to the
    new strain, not along its tangent: a tangent taken in a cavitating chamber overshoots by megapascals.
    """
    y, k, _ = watched_step(machine, y, t, h, lambda s: {})
    return y, k


def watched_step(machine: Rig, y: State, t, h, watch: Callable[[Signals], dict]) -> tuple[State, State, dict[str, Any]]:
    """`step`, and what `watch` makes of the signals, as the step saw it: value + ½ ∂·k, at mid-step."""
    pole, rate, drop, area, seen = "pole ", "rate ", "drop ", "area ", "seen "
    ends: dict[str, tuple[str, str]] = {}

    def program(state):
        s, rates = machine.evaluate(state, t + 0.5 * h, h, y, defer_partials)
        out = rates | {pole + n: c for n, c in s.notes.poles.items()}
        out |= {rate + n: r for n, r in s.notes.pressure_rates.items()}
        for n, p in s.notes.passages.items():
            ends[n] = p.ends
            out |= {drop + n: p.drop, area + n: p.area}
        return out | {seen + n: value for n, value in watch(s).items()}

    graph = linearize(program, y)
    at = graph.values
    passages = {n: Passage(at[drop + n], at[area + n], ends[n]) for n in ends}
    rates = {n: at[rate + n] for n in y if rate + n in at}
    for n, slopes in passage_slopes(machine, passages, rates, h).items():
        graph.set_partials(n, *slopes)
    bends = {n: StrainUnknown(y[n], at[pole + n]) for n in y if pole + n in at}
    watched = [n for n in at if n.startswith(seen)]
    k = solve(graph, {n: 2.0 * at[n] for n in y}, 2.0 / h, bends, watched)
    middle = {n.removeprefix(seen): at[n] + 0.5 * k.pop(n) for n in watched}
    return machine.sampling.after(machine, y, k, t, h), k, middle


class March(NamedTuple):
    """Where a march stands between two stretches.

    `y` and `book` are state and ledger, `step_number` the steps taken; `broken_step` is the number of the first step
    that left the physical range (-1: none) and `broken_check` which of `checks` it failed.
    """

    y: State
    book: energy_balance.Book
    step_number: Any
    broken_step: Any
    broken_check: Any


class Samples(NamedTuple):
    """What a stretch leaves behind; every array has the samples as its first axis.

    `signals` by name in SI; `book` with the energies [J] and volumes [m³] cumulated since the start of the run.
    """

    signals: dict[str, Any]
    book: energy_balance.Book


def observe(machine: Rig, y: State, t, h) -> dict[str, Any]:
    """The named signals of one instant."""
    values = machine.evaluate(y, t, h, y)[0].values()
    return {n: jnp.asarray(v) for n, v in values.items() if n in SIGNALS}


def checks(machine: Rig) -> tuple[str, ...]:
    """The names of `violations`, in their order: every state finite, every limited signal in its range."""
    y = machine.start()
    return (*sorted(y), *machine.evaluate(y, 0.0, 1.0, y)[0].notes.limits)


def violations(machine: Rig, y: State, t, h) -> list:
    """Whether each of `checks` fails, in their order."""
    s, _ = machine.evaluate(y, t, h, y)
    values = s.values()
    bad = [~jnp.isfinite(y[n]) for n in sorted(y)]
    return bad + [~((values[n] >= low) & (values[n] <= high)) for n, (low, high) in s.notes.limits.items()]


def _broken(machine: Rig, y: State, t, h):
    """The index of the first check that fails, or −1."""
    failed = jnp.stack(violations(machine, y, t, h))
    return jnp.where(failed.any(), jnp.argmax(failed), -1)


def start(machine: Rig, h) -> March:
    """A march that has not begun: the machine at rest, in the precision of `h`."""
    dtype = jnp.result_type(h)
    y = {n: jnp.asarray(v, dtype) for n, v in machine.start().items()}
    zero = jnp.zeros((), int)
    return March(y, energy_balance.opening(machine, y, h), zero, zero - 1, zero - 1)


@partial(jax.jit, static_argnames="samples")
def march(machine: Rig, begin: March, h, per_sample, samples: int) -> tuple[March, Samples]:
    """Take `samples` samples with `per_sample` steps of `h` [s] after each; the first is where the march stands.

    Changing any number, the step and `per_sample` included, compiles nothing anew; another number of samples, another
    rig or another list of effects does.
    """
    dtype = jnp.result_type(h)

    def one(_, m: March) -> March:
        t = m.step_number.astype(dtype) * h
        y, _, middle = watched_step(machine, m.y, t, h, energy_balance.ports)
        book = energy_balance.post(machine, m.book, m.y, y, middle, t, h)
        check = _broken(machine, y, t + h, h)
        first = (check >= 0) & (m.broken_step < 0)
        return March(
            y, book, m.step_number + 1,
            jnp.where(first, m.step_number + 1, m.broken_step), jnp.where(first, check, m.broken_check),
        )  # fmt: skip

    def sample(m: March, _):
        row = Samples(observe(machine, m.y, m.step_number.astype(dtype) * h, h), m.book)
        return jax.lax.fori_loop(0, per_sample, one, m), row

    return jax.lax.scan(sample, begin, length=samples)
