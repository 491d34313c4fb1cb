"""Jacobian-vector products along several tangents at once, which share their common work.

`jax.jvp` along each tangent costs about one evaluation of the function per tangent. Here the function is linearised
once, and its sparse graph is reduced by partial vertex elimination: an intermediate vertex is eliminated where the
products that this takes, once, cost less than the operations that it saves for every tangent. Each remaining edge then
costs one product and one sum per tangent.

Source: Griewank & Walther, Evaluating Derivatives, 2008, chapters 9 and 10, on vertex elimination and scarcity.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax

from edhas_jax.compiler.derivative_graph import linearize
from edhas_jax.compiler.partial_derivatives import Mask, Row, add, multiply

# measured cost of an operation that is done once for all tangents, relative to one that is done for each
SHARED_OPERATION_COST = 0.25


def multi_jvp(f: Callable, primals: tuple, tangents: Sequence[tuple]) -> tuple[Any, list]:
    """Evaluate `f(*primals)` and its Jacobian-vector product with each of the `tangents`.

    Args:
        f: a function of pytrees of scalars to a pytree of scalars, with the operations that `linearize` allows.
        primals: the arguments of `f`.
        tangents: each of the structure of `primals`; a leaf that is the Python float 0.0 is known to be zero while
            tracing, and nothing is computed for it.

    Returns:
        `f(*primals)`, and for each tangent the derivative of the result along it, of the structure of the result.
    """
    values, rows, structure = _linearized(f, primals)
    derivatives = [
        {_vertex_name(i): v for i, v in enumerate(jax.tree.leaves(t)) if not _is_known_zero(v)} for t in tangents
    ]
    rows = _eliminate_profitable(_active_part(rows, {n for d in derivatives for n in d}), len(tangents))
    for v, row in rows.items():
        for by_vertex in derivatives:
            _propagate(row, by_vertex, v)
    outputs = [("d", _vertex_name(i)) for i in range(structure.num_leaves)]
    return values, [jax.tree.unflatten(structure, [d.get(output, 0.0) for output in outputs]) for d in derivatives]


def _linearized(f: Callable, primals: tuple) -> tuple[Any, dict[Any, Row], Any]:
    """`f(*primals)`, the rows of its linearised graph with numbered inputs and outputs, and the result's structure."""
    leaves, argument_structure = jax.tree.flatten(primals)
    structures: list[Any] = []

    def flat_function(inputs):
        arguments = jax.tree.unflatten(argument_structure, [inputs[_vertex_name(i)] for i in range(len(leaves))])
        out, structure = jax.tree.flatten(f(*arguments))
        structures[:] = [structure]
        return {_vertex_name(i): leaf for i, leaf in enumerate(out)}

    graph = linearize(flat_function, {_vertex_name(i): leaf for i, leaf in enumerate(leaves)})
    values = [graph.values[n] for n in sorted(graph.values)]
    return jax.tree.unflatten(structures[0], values), graph.rows, structures[0]


def _is_known_zero(leaf) -> bool:
    """Whether a leaf of a tangent is zero at the time of tracing."""
    return isinstance(leaf, float) and leaf == 0.0


def _vertex_name(i: int) -> str:
    """The name of leaf i; names sort as the numbers do."""
    return f"{i:06d}"


def _active_part(rows: dict[Any, Row], inputs: set) -> dict[Any, Row]:
    """The vertices between `inputs` and the outputs, each after its predecessors."""
    active: dict[Any, Row] = {}
    seen = set()
    for root in [v for v in rows if isinstance(v, tuple)]:
        stack = [(root, False)]
        while stack:
            v, done = stack.pop()
            if done:
                row = {u: a for u, a in rows[v].items() if u in active or u in inputs}
                active |= {v: row} if row else {}
            elif v in rows and v not in seen:
                seen.add(v)
                stack.append((v, True))
                stack.extend((u, False) for u in rows[v])
    return active


def _eliminate_profitable(rows: dict[Any, Row], tangent_count: int) -> dict[Any, Row]:
    """The graph after greedy elimination of intermediate vertices, as long as that saves operations."""
    edge_cost = tangent_count / SHARED_OPERATION_COST if tangent_count > 1 else 1.0
    users: dict[Any, dict] = {v: {} for v in rows}
    for v, row in rows.items():
        for u in row:
            if u in users:
                users[u][v] = None

    def cost(v) -> float:
        """The change of the number of operations by eliminating v, in units of shared operations."""
        row, edges, products = rows[v], -len(rows[v]) - len(users[v]), 0
        for w in users[v]:
            factor = rows[w][v]
            for u, a in row.items():
                edges += u not in rows[w]
                products += (u in rows[w]) + (not _is_free_factor(a) and not _is_free_factor(factor))
        return edges * edge_cost + products

    costs = {v: cost(v) for v in rows if not isinstance(v, tuple)}
    while costs:
        v = min(costs, key=costs.__getitem__)
        if costs.pop(v) >= 0:
            return rows
        row, users_of_v = rows.pop(v), users.pop(v)
        for w in users_of_v:
            factor = rows[w].pop(v)
            for u, a in row.items():
                term = multiply(a, factor)
                rows[w][u] = add(rows[w][u], term) if u in rows[w] else term
                if u in users:
                    users[u][w] = None
        changed = dict.fromkeys((*users_of_v, *(u for u in row if u in users)))
        for u in row:
            users.get(u, {}).pop(v, None)
        for w in list(changed):
            changed |= dict.fromkeys((*users[w], *(u for u in rows[w] if u in users)))
        costs |= {w: cost(w) for w in changed if w in costs}
    return rows


def _is_free_factor(partial) -> bool:
    """Whether a product with it costs no multiplication: ±1 or a selection."""
    return isinstance(partial, Mask) or (isinstance(partial, float) and abs(partial) == 1.0)


def _propagate(row: Row, derivatives: dict[Any, Any], v) -> None:
    """Set the derivative of vertex v from those of its predecessors, if any of them has one."""
    terms = [multiply(derivatives[u], a) for u, a in row.items() if u in derivatives]
    if terms:
        derivatives[v] = sum(terms[1:], terms[0])
