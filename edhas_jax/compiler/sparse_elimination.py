"""The linear system of a step, solved by sparse elimination that is written out while it is traced."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import jax.numpy as jnp

from edhas_jax.compiler.derivative_graph import Graph, Row, add, multiply, number


class StrainUnknown(NamedTuple):
    """An unknown whose left side is bent: shift · (w(p + k) − w(p)) with w(p) = p − c/p, instead of shift · k."""

    pressure: Any
    pole: Any


def solve(
    graph: Graph, right: dict[str, Any], shift, bends: dict[str, StrainUnknown] | None = None, also: Iterable[str] = ()
) -> dict[str, Any]:
    """Solve (shift · I − J) k = right for k, J being the Jacobian of the program that `graph` linearises.

    The intermediate values of the program stay in the system as unknowns without a right side. Each unknown is taken
    out in turn, always the one that costs the fewest products (Markowitz), chosen from the structure alone, so that
    chain rule and elimination share their work. Pivots stay on the diagonal, which is safe because `shift` = 2/h stands
    far above the unstable rates of a dissipative machine. The unknowns in `bends` come last, see `_solve_bent`.
    The result also holds the change along k of those outputs of the program that are named in `also`.
    """
    bends = bends or {}
    rows = {v: dict(row) for v, row in graph.rows.items()}
    for name in right:
        rows[name] = {("d", name): 1.0}  # shift · k = right + δ(rate)
    # the part of the pivot that is bent is kept apart
    pivots = {n: 0.0 if n in bends else shift for n in right}
    k = dict(right)
    order = _eliminate(rows, pivots, k, [v for v in rows if v not in bends])
    k |= _solve_bent({n: rows[n] for n in bends}, pivots, {n: k[n] for n in bends}, shift, bends)
    outputs = {name: ("d", name) for name in also}
    wanted = {*right, *outputs.values()}
    for v in order:
        if v in wanted:
            wanted.update(rows[v])
    _substitute_back(rows, k, [v for v in order if v in wanted])
    return {name: k[name] for name in right} | {name: k.get(v, 0.0) for name, v in outputs.items()}


def _solve_bent(
    rows: dict[str, Row], pivots: dict, right: dict, shift, bends: dict[str, StrainUnknown]
) -> dict[str, Any]:
    """Solve shift · (w(p + k) − w(p)) + pivot k = right + rows · k for the few unknowns that are bent.

    First each in turn along the tangents of those before it, but itself exactly: a quadratic with one positive root,
    so that no pressure overshoots. Then all together along the secants, w(p₁) − w(p) = (1 + c/(p p₁)) k, to these
    roots: what leaves one node then enters the next, and the oil balance is exact.
    """
    tangents = {n: pivots[n] + shift * (1.0 + b.pole / jnp.square(b.pressure)) for n, b in bends.items()}
    trial_rows, trial = {n: dict(row) for n, row in rows.items()}, dict(right)
    order = _eliminate(trial_rows, tangents, trial, list(bends), scaled=False)
    for n in reversed(order):
        _substitute_back(trial_rows, trial, [n])
        trial[n] = _root(trial[n], tangents[n], shift, *bends[n])
    secants = {
        n: pivots[n] + shift * (1.0 + b.pole / (b.pressure * (b.pressure + trial[n]))) for n, b in bends.items()
    }
    rows, k = {n: dict(row) for n, row in rows.items()}, dict(right)
    _substitute_back(rows, k, _eliminate(rows, secants, k, list(bends)))
    return k


def _root(right, pivot, shift, pressure, pole):
    """k with shift · (w(p + k) − w(p)) = right + s k, s = shift w'(p) − pivot; p + k > 0 whatever the right side."""
    gas = shift * pole / pressure
    quadratic = pivot - gas / pressure
    linear = right + pivot * pressure - 2.0 * gas
    root = jnp.sqrt(jnp.square(linear) + 4.0 * quadratic * gas * pressure)
    # the two forms are equal; each is free of cancellation on its side of zero
    after = jnp.where(linear > 0.0, 0.5 * (root + linear) / quadratic, 2.0 * gas * pressure / (root + jnp.abs(linear)))
    return after - pressure


def _substitute_back(rows: dict[Any, Row], k: dict, order: list) -> None:
    """Complete k for the unknowns of `order`, the last one first."""
    for v in reversed(order):
        for u, a in rows[v].items():
            if u in k:
                term = multiply(k[u], a)
                k[v] = k[v] + term if v in k else term


def jacobian(graph: Graph) -> dict[str, dict[str, Any]]:
    """{output: {input: ∂output/∂input}} without structural zeros: the chain rule alone, in the cheapest order."""
    rows = {v: dict(row) for v, row in graph.rows.items()}
    inner = [v for v in rows if not isinstance(v, tuple)]
    _eliminate(rows, {}, {}, inner)
    return {v[1]: {u: number(a) for u, a in row.items()} for v, row in rows.items() if isinstance(v, tuple)}


def _eliminate(rows: dict[Any, Row], pivots: dict, k: dict, unknowns: list, scaled: bool = True) -> list:
    """Take the `unknowns` out of `rows` one by one and return the order; a pivot that is missing is 1.

    Row v stands for pivot_v δ_v = k_v + Σ_u rows[v][u] δ_u; with `scaled` it is divided by its pivot for good.
    """
    users: dict[Any, dict] = {v: {} for v in unknowns}
    for v, row in rows.items():
        for u in row:
            users.get(u, {})[v] = None
    left, order = dict.fromkeys(unknowns), []

    def cost(v):
        # an unknown with a pivot costs a division and a product for each entry of its row
        return len(users[v]) * len(rows[v]) + (3 + len(rows[v]) if v in pivots else 0)

    while left:
        v = min(left, key=cost)
        del left[v]
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
        for w in users.pop(v):
            factor = rows[w].pop(v)
            for u, a in row.items():
                term = multiply(a, factor)
                if u == w:
                    pivots[w] = pivots.get(w, 1.0) - number(term)
                else:
                    rows[w][u] = add(rows[w][u], term) if u in rows[w] else term
                    users.get(u, {})[w] = None
            if solution is not None:
                term = multiply(solution, factor)
                k[w] = k[w] + term if w in k else term
    return order
