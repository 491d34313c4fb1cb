"""The integration rule: one step of the linearly implicit midpoint rule, used by every time loop of the package."""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp

from edhas_jax.compiler.derivative_graph import defer_partials, linearize
from edhas_jax.compiler.sparse_elimination import StrainUnknown, solve
from edhas_jax.core import runtime
from edhas_jax.machine.equations.orifice_flow import orifice_slopes
from edhas_jax.machine.interface.signals import OrificeConnection, Signals
from edhas_jax.machine.rigs import Rig, State

DEFAULT_STEP = 20e-6  # s
LARGEST_STEP = 100e-6  # s


def step(machine: Rig, y: State, t, h) -> tuple[State, State]:
    """Take one step of the linearly implicit midpoint rule (a one-stage Rosenbrock method, second order, A-stable).

    (2/h I − J) k = 2 f(t + h/2, y),   y(t + h) = y + k,   J = ∂f/∂y exact and sparse

    The equations are evaluated once and nothing is iterated, so a step costs the same through impact, standstill and
    cavitation. J holds every derivative, those of oil stiffness and chamber volume too: without them the rule would
    be of first order. An oil node is solved for the pressure that belongs to its new strain, not along the tangent: a
    tangent taken in a cavitating chamber overshoots by megapascals.

    Args:
        machine: the machine.
        y: state at the start of the step by name, SI.
        t: time at the start of the step [s].
        h: step [s], at most `LARGEST_STEP`.

    Returns:
        The state at the end of the step, and the change k.
    """
    y, k, _ = step_with_outputs(machine, y, t, h, lambda s: {})
    return y, k


def step_with_outputs(
    machine: Rig, y: State, t, h, outputs: Callable[[Signals], dict]
) -> tuple[State, State, dict[str, Any]]:
    """`step`, and values at mid-step that are consistent with it: value at the start + ½ ∂value/∂y · k.

    Args:
        machine: the machine.
        y: state at the start of the step by name, SI.
        t: time at the start of the step [s].
        h: step [s].
        outputs: computes the outputs by name from the signals.

    Returns:
        The state at the end of the step, the change k, and the outputs at mid-step by name.
    """
    pole, rate, drop, area, output = "pole ", "rate ", "drop ", "area ", "output "
    ends: dict[str, tuple[str, str]] = {}

    def equations(state):
        s, rates = machine.evaluate(state, t + 0.5 * h, h, y, defer_partials)
        out = rates | {pole + n: c for n, c in s.record.strain_poles.items()}
        out |= {rate + n: r for n, r in s.record.pressure_rates.items()}
        for n, orifice in s.record.orifices.items():
            ends[n] = orifice.ends
            out |= {drop + n: orifice.drop, area + n: orifice.area}
        return out | {output + n: value for n, value in outputs(s).items()}

    graph = linearize(equations, y)
    values = graph.values
    orifices = {n: OrificeConnection(values[drop + n], values[area + n], ends[n]) for n in ends}
    rates = {n: values[rate + n] for n in y if rate + n in values}
    for n, slopes in orifice_slopes(machine, orifices, rates, h).items():
        graph.set_partials(n, *slopes)
    strains = {n: StrainUnknown(y[n], values[pole + n]) for n in y if pole + n in values}
    output_names = [n for n in values if n.startswith(output)]
    k = solve(graph, {n: 2.0 * values[n] for n in y}, 2.0 / h, strains, output_names)
    at_midstep = {n.removeprefix(output): values[n] + 0.5 * k.pop(n) for n in output_names}
    return machine.advance(y, k, t, h), k, at_midstep


def rates(machine: Rig, y: State, t, h) -> tuple[State, list[str]]:
    """dy/dt of every state (for an oil node, of its pressure), and the names of the oil nodes."""
    s, found = machine.evaluate(y, t, h, y)
    return found | s.record.pressure_rates, list(s.record.pressure_rates)


def evaluate_signals(machine: Rig, y: State, t, h) -> dict[str, Any]:
    """The signals of a machine, by name in SI, in the state `y` at time `t` [s]."""
    values = machine.evaluate(y, t, h, y)[0].values()
    return {n: jnp.asarray(v) for n, v in values.items() if n in machine.signals}


def signal_names(machine: Rig) -> tuple[str, ...]:
    """The names of the signals that `evaluate_signals` gives, the time among them; nothing is computed."""
    return tuple(runtime.eval_shape(lambda m: evaluate_signals(m, m.initial_state(), 0.0, 1.0), machine))
