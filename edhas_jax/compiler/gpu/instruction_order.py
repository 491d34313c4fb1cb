"""The order of the operations of a step in which few values have to be kept at a time.

The assembler of NVIDIA follows the given order closely, and what a thread cannot keep in its registers goes to memory
and back. The order changes no result: every operation has the same operands.
"""

from collections import Counter
from collections.abc import Callable, Collection, Sequence

Operands = Callable[[int], Sequence[int]]


def order_with_few_values(
    given: Sequence[int], operands: Operands, results: Collection[int], start: Collection[int]
) -> list[int]:
    """The order `given`, or the one that `_from_the_end` finds if fewer values are kept at a time in that one.

    Args:
        given: the operations in an order of computation.
        operands: of an operation; those that are neither among `given` nor in `start` count as free.
        results: what has to be kept at the end.
        start: values that are there before the first operation.
    """
    orders = [list(given), _from_the_end(given, operands, results, start)]
    return min(orders, key=lambda order: most_values(order, operands, results, start))


def most_values(
    order: Sequence[int], operands: Operands, results: Collection[int], start: Collection[int]
) -> int:
    """The largest number of values that are kept at a time; arguments as of `order_with_few_values`."""
    last = {k: place for place, i in enumerate(order) for k in operands(i)} | dict.fromkeys(results, len(order))
    kept = {i for i in start if i in last}
    most = len(kept)
    for place, i in enumerate(order):
        kept.difference_update(k for k in operands(i) if last[k] == place)
        kept.update([i] if i in last else [])
        most = max(most, len(kept))
    return most


def _from_the_end(
    given: Sequence[int], operands: Operands, results: Collection[int], start: Collection[int]
) -> list[int]:
    """List scheduling from the last operation to the first.

    Each time, among the operations whose users all have their place, the one is taken that adds the fewest values to
    those kept before it; of several, the one that comes last in the given order.
    """
    place = {i: number for number, i in enumerate(given)}
    read = {i: [k for k in dict.fromkeys(operands(i)) if k in place or k in start] for i in given}
    users = Counter(k for i in given for k in read[i])
    ready, kept, order = {i for i in given if not users[i]}, set(results), []
    while ready:
        i = max(ready, key=lambda i: ((i in kept) - sum(k not in kept for k in read[i]), place[i]))
        ready.remove(i)
        order.append(i)
        kept.discard(i)
        kept.update(read[i])
        users.subtract(read[i])
        ready.update(k for k in read[i] if k in place and not users[k])
    return order[::-1]
