"""Flow through an orifice between two oil nodes, and its linearisation in the time step."""

import jax.numpy as jnp

from edhas_jax.compiler.one_sided_minmax import one_sided_max, one_sided_min
from edhas_jax.machine.interface.signals import OrificeConnection, Signals


def orifice_flow(m, s: Signals, name: str, area, ends: tuple[str, str]):
    """The flow through an orifice between two oil nodes.

    Args:
        m: the machine.
        s: signals, with both pressures known.
        name: name of the orifice, by which the step finds it again.
        area: flow area [m²].
        ends: signals of the upstream and the downstream pressure.

    Returns:
        Flow [m³/s], positive from the first to the second node. The step replaces its derivatives by those of
        `orifice_slopes`.
    """
    drop = getattr(s, ends[0]) - getattr(s, ends[1])
    s.record.orifices[name] = OrificeConnection(drop, area, ends)
    flow = m.orifice.flow(area, drop, m.oil.oil_density)
    return flow if s.orifice_linearisation is None else s.orifice_linearisation(name, flow, area, drop)


def orifice_slopes(m, orifices: dict[str, OrificeConnection], pressure_rates: dict, h) -> dict:
    """The derivatives by which a step of `h` [s] linearises each orifice flow.

    They are the tangents, except where a pressure drop is about to change by more than its own size within one step.
    The tangent of the square-root law is half its chord, so that a linear prediction then overshoots to the other
    sign and may oscillate for ever. There the slope is blended into twice the chord, which ends at the equilibrium of
    the pressure drop. Steps that resolve the change are not altered, so the order of the rule stays two.

    Args:
        m: the machine.
        orifices: by name.
        pressure_rates: dp/dt [Pa/s] of the oil nodes, by signal.
        h: time step [s].

    Returns:
        By name, (∂Q/∂A [m/s], ∂Q/∂Δp [m³/(s·Pa)]).
    """
    slopes = {}
    for name, (drop, area, ends) in orifices.items():
        chord, tangent, inverse = m.orifice.conductance(drop, m.oil.oil_density)
        rates = [pressure_rates[end] for end in ends if end in pressure_rates]
        change = jnp.abs(rates[0] - rates[1] if len(rates) == 2 else rates[0])
        overshoot = one_sided_min(one_sided_max(h * change * inverse - 1.0, 0.0), 1.0)
        slopes[name] = chord * drop, area * (tangent + overshoot * (2.0 * chord - tangent))
    return slopes
