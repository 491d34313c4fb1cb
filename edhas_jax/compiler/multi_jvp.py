"""The derivatives of a program of scalars along several directions at once, which share all that they can.

Pushing a direction through every operation of a program costs as much as the program again, for each direction. Here
the program is linearised once. Its sparse graph is then made shorter for all directions: a vertex in between is joined
into those that use it wherever the products this takes, once, are fewer than what every direction saves. What is left
is a product and a sum for each edge.

Source: Griewank & Walther, Evaluating Derivatives, 2008, chapters 9 and 10, on vertex elimination and scarcity.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax

from edhas_jax.compiler.derivative_graph import Mask, Row, add, linearize, multiply

SHARED = 0.25  # what an operation that several directions share takes beside one of each: measured


def multi_jvp(f: Callable, primals: tuple, directions: Sequence[tuple]) -> tuple[Any, list]:
    """`f(*primals)` and its derivative along each of the `directions`, as by `jax.jvp` for one.

    Primals, directions and results are pytrees of scalars; where a direction has the plain number 0.0 nothing is
    computed. What `f` may do is said at `linearize`.
    """
    values, rows, out = _linearized(f, primals)
    moved = [{_name(i): v for i, v in enumerate(jax.tree.leaves(d)) if not _nothing(v)} for d in directions]
    rows = _shortened(_moving(rows, {n for one in moved for n in one}), len(directions))
    for v, row in rows.items():
        for one in moved:
            _push(row, one, v)
    names = range(out.num_leaves)
    return values, [jax.tree.unflatten(out, [one.get(("d", _name(i)), 0.0) for i in names]) for one in moved]


def _linearized(f: Callable, primals: tuple) -> tuple[Any, dict[Any, Row], Any]:
    """`f(*primals)`, the graph of its partial derivatives by numbered inputs, and the structure of the result."""
    leaves, structure = jax.tree.flatten(primals)
    shape: list[Any] = []

    def program(inputs):
        out, of = jax.tree.flatten(f(*jax.tree.unflatten(structure, [inputs[_name(i)] for i in range(len(leaves))])))
        shape[:] = [of]
        return {_name(i): leaf for i, leaf in enumerate(out)}

    graph = linearize(program, {_name(i): leaf for i, leaf in enumerate(leaves)})
    return jax.tree.unflatten(shape[0], [graph.values[n] for n in sorted(graph.values)]), graph.rows, shape[0]


def _nothing(leaf) -> bool:
    return isinstance(leaf, float) and leaf == 0.0


def _name(i: int) -> str:
    return f"{i:06d}"


def _moving(rows: dict[Any, Row], inputs: set) -> dict[Any, Row]:
    """The part of a graph that lies between `inputs` and the outputs, each vertex after those it depends on."""
    out: dict[Any, Row] = {}
    seen = set()
    for root in [v for v in rows if isinstance(v, tuple)]:
        stack = [(root, False)]
        while stack:
            v, done = stack.pop()
            if done:
                row = {u: a for u, a in rows[v].items() if u in out or u in inputs}
                out |= {v: row} if row else {}
            elif v in rows and v not in seen:
                seen.add(v)
                stack.append((v, True))
                stack.extend((u, False) for u in rows[v])
    return out


def _shortened(rows: dict[Any, Row], directions: int) -> dict[Any, Row]:
    """The graph with vertices in between taken out while that saves operations."""
    weight = directions / SHARED if directions > 1 else 1.0
    users: dict[Any, dict] = {v: {} for v in rows}
    for v, row in rows.items():
        for u in row:
            if u in users:
                users[u][v] = None

    def cost(v) -> float:
        """The operations that come with taking out a vertex, less those that every direction saves."""
        row, edges, products = rows[v], -len(rows[v]) - len(users[v]), 0
        for w in users[v]:
            factor = rows[w][v]
            for u, a in row.items():
                edges += u not in rows[w]
                products += (u in rows[w]) + (not _free(a) and not _free(factor))
        return edges * weight + products

    costs = {v: cost(v) for v in rows if not isinstance(v, tuple)}
    while costs:
        v = min(costs, key=costs.__getitem__)
        if costs.pop(v) >= 0:
            return rows
        row, using = rows.pop(v), users.pop(v)
        for w in using:
            factor = rows[w].pop(v)
            for u, a in row.items():
                term = multiply(a, factor)
                rows[w][u] = add(rows[w][u], term) if u in rows[w] else term
                if u in users:
                    users[u][w] = None
        touched = dict.fromkeys((*using, *(u for u in row if u in users)))
        for u in row:
            users.get(u, {}).pop(v, None)
        for w in list(touched):
            touched |= dict.fromkeys((*users[w], *(u for u in rows[w] if u in users)))
        costs |= {w: cost(w) for w in touched if w in costs}
    return rows


def _free(partial) -> bool:
    """Whether a product with it is none: 1, −1, or what selects."""
    return isinstance(partial, Mask) or (isinstance(partial, float) and abs(partial) == 1.0)


def _push(row: Row, moved: dict[Any, Any], v) -> None:
    """Add what the vertex v changes by, from what those it depends on have `moved` by."""
    terms = [multiply(moved[u], a) for u, a in row.items() if u in moved]
    if terms:
        moved[v] = sum(terms[1:], terms[0])
