"""Sparse Gaussian elimination of the linear system of an implicit step, written out while it is traced.

The unknowns are the state increments and all intermediate vertices of the linearised computational graph, so that chain
rule and elimination share their work. The elimination order is chosen once, from the sparsity structure alone.
"""

import heapq
from collections.abc import Iterable
from typing import Any, NamedTuple

import jax.numpy as jnp

from edhas_jax.compiler.derivative_graph import Graph
from edhas_jax.compiler.partial_derivatives import Row, add, as_number, multiply


class StrainUnknown(NamedTuple):
    """A pressure whose time derivative is taken through its strain pressure w(p) = p − c/p.

    Its equation has the left side shift · (w(p + k) − w(p)) in place of shift · k.

    Attributes:
        pressure: p at the start of the step [Pa].
        air_coefficient: c [Pa²], air fraction × atmospheric pressure × bulk modulus of the oil.
    """

    pressure: Any
    air_coefficient: Any


def solve(
    graph: Graph,
    right_side: dict[str, Any],
    shift,
    strain_unknowns: dict[str, StrainUnknown] | None = None,
    outputs: Iterable[str] = (),
) -> dict[str, Any]:
    """Solve (shift · I − J) k = right_side for k, where J is the Jacobian of the function that `graph` linearises.

    The intermediate vertices stay in the system as unknowns with right side 0. The unknown to eliminate next is always
    the one that costs the fewest products (Markowitz). Pivots stay on the diagonal, which is safe as long as `shift`
    exceeds the growth rates of the unstable modes.

    Args:
        graph: has for each unknown an input and an output of its name.
        right_side: the right side by name of the unknown.
        shift: 2/h for the implicit midpoint rule [1/s].
        strain_unknowns: the unknowns whose left side is that of `StrainUnknown`; they are eliminated last.
        outputs: names of further outputs of the function, whose change along k is wanted as well.

    Returns:
        k by name of the unknown, and the change ∂output/∂inputs · k by name of the output.
    """
    strain_unknowns = strain_unknowns or {}
    rows = {v: dict(row) for v, row in graph.rows.items()}
    for name in right_side:
        rows[name] = {("d", name): 1.0}  # shift · k = right side + change of the output
    # for a strain unknown only what the elimination adds to the pivot: its own part depends on k
    pivots = {n: 0.0 if n in strain_unknowns else shift for n in right_side}
    k = dict(right_side)
    order = _eliminate(rows, pivots, k, [v for v in rows if v not in strain_unknowns])
    strain_rows = {n: rows[n] for n in strain_unknowns}
    k |= _solve_strain_unknowns(strain_rows, pivots, {n: k[n] for n in strain_unknowns}, shift, strain_unknowns)
    output_vertices = {name: ("d", name) for name in outputs}
    needed = {*right_side, *output_vertices.values()}
    for v in order:
        if v in needed:
            needed.update(rows[v])
    _substitute_back(rows, k, [v for v in order if v in needed])
    return {name: k[name] for name in right_side} | {name: k.get(v, 0.0) for name, v in output_vertices.items()}


def _solve_strain_unknowns(
    rows: dict[str, Row], pivots: dict, right_side: dict, shift, unknowns: dict[str, StrainUnknown]
) -> dict[str, Any]:
    """Solve shift · (w(p + k) − w(p)) + pivot · k = right_side + rows · k for the strain unknowns.

    First each pressure is solved exactly, with the unknowns before it along their tangents: a quadratic with one
    positive root, so that no pressure overshoots. Then all are solved together along the secants
    w(p₁) − w(p) = (1 + c/(p p₁)) k to these roots p₁, so that the flow out of one node equals the flow into the next
    and the oil balance is exact.
    """
    tangents = {
        n: pivots[n] + shift * (1.0 + u.air_coefficient / jnp.square(u.pressure)) for n, u in unknowns.items()
    }
    trial_rows, trial = {n: dict(row) for n, row in rows.items()}, dict(right_side)
    order = _eliminate(trial_rows, tangents, trial, list(unknowns), scaled=False)
    for n in reversed(order):
        _substitute_back(trial_rows, trial, [n])
        trial[n] = _positive_pressure_increment(trial[n], tangents[n], shift, *unknowns[n])
    secants = {
        n: pivots[n] + shift * (1.0 + u.air_coefficient / (u.pressure * (u.pressure + trial[n])))
        for n, u in unknowns.items()
    }
    rows, k = {n: dict(row) for n, row in rows.items()}, dict(right_side)
    _substitute_back(rows, k, _eliminate(rows, secants, k, list(unknowns)))
    return k


def _positive_pressure_increment(right_side, pivot, shift, pressure, air_coefficient):
    """k with shift · (w(p + k) − w(p)) = right_side + s k, s = shift w'(p) − pivot; p + k > 0 for any right side."""
    gas = shift * air_coefficient / pressure
    quadratic = pivot - gas / pressure
    linear = right_side + pivot * pressure - 2.0 * gas
    root = jnp.sqrt(jnp.square(linear) + 4.0 * quadratic * gas * pressure)
    # two forms of the same root; each is free of cancellation for one sign of the linear coefficient
    after = jnp.where(linear > 0.0, 0.5 * (root + linear) / quadratic, 2.0 * gas * pressure / (root + jnp.abs(linear)))
    return after - pressure


def _substitute_back(rows: dict[Any, Row], k: dict, order: list) -> None:
    """Back substitution: add the terms of the later unknowns to k, from the last unknown of `order` to the first."""
    for v in reversed(order):
        for u, a in rows[v].items():
            if u in k:
                term = multiply(k[u], a)
                k[v] = k[v] + term if v in k else term


def jacobian(graph: Graph) -> dict[str, dict[str, Any]]:
    """The Jacobian by vertex elimination in the cheapest order.

    Returns:
        {output: {input: ∂output/∂input}} without structural zeros.
    """
    rows = {v: dict(row) for v, row in graph.rows.items()}
    intermediate = [v for v in rows if not isinstance(v, tuple)]
    _eliminate(rows, {}, {}, intermediate)
    return {v[1]: {u: as_number(a) for u, a in row.items()} for v, row in rows.items() if isinstance(v, tuple)}


def _eliminate(rows: dict[Any, Row], pivots: dict, k: dict, unknowns: list, scaled: bool = True) -> list:
    """Eliminate the `unknowns` from `rows` and the right side `k`, in place, and return the elimination order.

    Row v stands for pivot_v δ_v = k_v + Σ_u rows[v][u] δ_u; a missing pivot is 1. Where `scaled`, the stored row and
    right side of an eliminated unknown are divided by its pivot.
    """
    users: dict[Any, dict] = {v: {} for v in unknowns}
    for v, row in rows.items():
        for u in row:
            users.get(u, {})[v] = None
    place, order = {v: k for k, v in enumerate(unknowns)}, []

    def cost(v):
        # a pivot costs a division (taken as three products) and a product for each entry of its row
        return len(users[v]) * len(rows[v]) + (3 + len(rows[v]) if v in pivots else 0)

    queue = [(cost(v), place[v], v) for v in unknowns]
    heapq.heapify(queue)
    while queue:
        asked, _, v = heapq.heappop(queue)
        if v not in users or asked != cost(v):  # eliminated, or entered again when its cost changed
            continue
        order.append(v)
        row, solution = rows[v], k.get(v)
        if v in pivots:
            inverse = 1.0 / pivots[v]
            row = {u: multiply(inverse, a) for u, a in row.items()}
            solution = None if solution is None else inverse * solution
        if scaled:
            rows[v] = row
            k |= {} if solution is None else {v: solution}
        for u in row:
            users.get(u, {}).pop(v, None)
        targets = users.pop(v)
        for w in targets:
            factor = rows[w].pop(v)
            for u, a in row.items():
                term = multiply(a, factor)
                if u == w:
                    pivots[w] = pivots.get(w, 1.0) - as_number(term)
                else:
                    rows[w][u] = add(rows[w][u], term) if u in rows[w] else term
                    users.get(u, {})[w] = None
            if solution is not None:
                term = multiply(solution, factor)
                k[w] = k[w] + term if w in k else term
        for u in {**row, **targets}:
            if u in users:
                heapq.heappush(queue, (cost(u), place[u], u))
    return order
