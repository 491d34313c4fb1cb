"""The shape of a curve: whether it is smooth, and where it begins to act."""

import numpy as np

MIN_SHARE = 0.6  # of the variation of a curve that a hinge has to explain
MIN_STILL_SHARE = 0.2  # of the range of the variable, that has to lie below the level at which a curve begins
MIN_ADVANTAGE = 1.3  # of the variation that a straight line leaves over that which the hinge leaves
MAX_BELOW = 0.5  # of the rms above the level, up to which the rms below it is called hardly anything


def is_smooth(values: np.ndarray) -> bool:
    """Whether the values (n,) of a curve at neighbouring nodes are more alike than independent values would be.

    The mean square successive difference of independent values is twice their variance.

    Source: von Neumann, Ann. Math. Stat. 12 (1941) 367.
    """
    deviations = values - np.mean(values)
    return not np.sum(np.square(np.diff(values))) > 2.0 * np.sum(np.square(deviations))


def onset(nodes: np.ndarray, values: np.ndarray) -> float | None:
    """The level at which a curve begins, by the best hinge b · max(x − x₀, 0) + c.

    The values at neighbouring nodes are negatively correlated where the data do not tell them apart; a binomial filter
    takes out what alternates from node to node.

    Args:
        nodes: (n,), increasing.
        values: of the curve at the nodes (n,).

    Returns:
        x₀ in the unit of the nodes; None where no hinge describes the curve, a straight line does as well, or the curve
        acts below the level too.
    """
    padded = np.concatenate([values[:1], values, 2.0 * values[-1:] - values[-2:-1]])
    smooth = 0.25 * padded[:-2] + 0.5 * padded[1:-1] + 0.25 * padded[2:]

    def left(column: np.ndarray) -> float:
        matrix = np.stack([column, np.ones(len(nodes))], axis=1)
        return float(np.sum(np.square(matrix @ np.linalg.lstsq(matrix, smooth, rcond=None)[0] - smooth)))

    total = float(np.sum(np.square(smooth - smooth.mean())))
    # a hinge near the lower end would only say that the curve is bent: nothing would be seen to be without influence
    lowest = max(nodes[1], nodes[0] + MIN_STILL_SHARE * (nodes[-1] - nodes[0]))
    levels = np.linspace(lowest, nodes[-2], 8 * len(nodes))
    remainders = [left(np.maximum(nodes - level, 0.0)) for level in levels]
    best = int(np.argmin(remainders))
    if best == 0 or remainders[best] > (1.0 - MIN_SHARE) * total or left(nodes) < MIN_ADVANTAGE * remainders[best]:
        return None
    below = nodes <= levels[best]
    acts_below = np.mean(np.square(smooth[below])) > MAX_BELOW**2 * np.mean(np.square(smooth[~below]))
    return None if acts_below else float(levels[best])
