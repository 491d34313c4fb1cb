"""Curves through nodes on arrays: where nodes are placed, and which curve represents given samples best."""

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from edhas_jax.inference.likelihood.symmetric_matrices import regularised_inverse

CLOSE_TO_ZERO = 0.02  # of the far end of a range: a range that begins nearer to zero includes it
FREE_NODES = 11  # of a curve of which nothing is known
MIN_NODES, MAX_NODES = 15, 33  # of a curve beside a known law
CHANGE_PER_INTERVAL = 0.45  # of half the range of the law, from one node to the next
SCATTER = 0.02  # of half the range of the law: smaller changes count as none
SPACING_GROWTH = 0.5  # largest change of the spacing of nodes over the distance in which it happens
FINEST_SPACING = 5e-4  # of the range of the variable
SCAN_NODES = 49  # of the curve by which the shape of a law is found
NODE_CLUSTERING = 2.0  # nodes of an unknown law are spaced as sinh over ±2, denser around zero, where laws change most
CURVATURE_WEIGHT = 1e-2  # of the bends of a curve, over the mean weight of a sample; decides where no sample lies


def basis(nodes: np.ndarray, x: np.ndarray) -> np.ndarray:
    """The curves (m, n) at `x` (m,) whose value is 1 at one of n nodes and 0 at the others.

    The same interpolation as `edhas_jax.machine.effects.tabulated_law.interpolate`.
    """
    unit, index = np.eye(len(nodes)), np.arange(len(nodes))
    before, after = np.maximum(index - 1, 0), np.minimum(index + 1, len(nodes) - 1)
    slopes = (unit[after] - unit[before]) / (nodes[after] - nodes[before])[:, None]
    return CubicHermiteSpline(nodes, unit, slopes)(np.clip(x, nodes[0], nodes[-1]))


def bends(nodes: np.ndarray) -> np.ndarray:
    """The matrix (n − 2, n) that gives the bends of a curve: second differences, zero for every straight line.

    At a node they are the change of slope times the harmonic mean of the two intervals, on equidistant nodes therefore
    v₋ − 2 v + v₊.
    """
    widths, unit = np.diff(nodes), np.eye(len(nodes))
    slopes = np.diff(unit, axis=0) / widths[:, None]
    mean = 2.0 * widths[:-1] * widths[1:] / (widths[:-1] + widths[1:])
    return np.diff(slopes, axis=0) * mean[:, None]


def fit_values(nodes: np.ndarray, x: np.ndarray, y: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """The values (n,) at the nodes of the curve c that minimises Σ (weight · c(x) − y)².

    Args:
        nodes: nodes (n,), increasing.
        x: variable (m,).
        y: samples (m,).
        weight: factor (m,) of the curve in each sample.
    """
    columns = weight[:, None] * basis(nodes, x)
    bend = bends(nodes)
    curvature = columns.T @ columns
    curvature += CURVATURE_WEIGHT * np.trace(curvature) / len(nodes) * (bend.T @ bend)
    return regularised_inverse(curvature) @ (columns.T @ y)


def explained_share(nodes: np.ndarray, values: np.ndarray, x: np.ndarray, y: np.ndarray, weight: np.ndarray) -> float:
    """The share of Σy² that a curve explains, at most 1; the arguments are those of `fit_values`."""
    total = float(np.sum(np.square(y)))
    left = float(np.sum(np.square(y - weight * (basis(nodes, x) @ values))))
    return 1.0 - left / total if total > 0.0 else 1.0


def free_nodes(
    low: float, high: float, count: int = FREE_NODES, clustering: float = NODE_CLUSTERING
) -> np.ndarray:  # fmt: skip
    """Nodes (count,) over a range for an unknown law: denser around zero where it lies inside or at an end."""
    if low > CLOSE_TO_ZERO * high or high < CLOSE_TO_ZERO * low:
        return np.linspace(low, high, count)
    scale = np.sinh(clustering) / max(-low, high)
    return np.sinh(np.linspace(np.arcsinh(low * scale), np.arcsinh(high * scale), count)) / scale


def law_nodes(x: np.ndarray, y: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Nodes (n,) over the range of `x` for laws like the one of which samples are given.

    The nodes are equidistant where the law changes little, closer where it changes fast, and their spacing changes
    gradually: a law that differs from the given one seldom changes fast at quite the same place.

    Args:
        x: variable (m,).
        y: contribution (m,) of the law.
        weight: factor (m,) of the curve in each sample.
    """
    low, high = float(x.min()), float(x.max())
    scan = np.union1d(np.linspace(low, high, SCAN_NODES), free_nodes(low, high, SCAN_NODES))
    scan = scan[np.append(True, np.diff(scan) > 1e-6 * (high - low))]
    values = fit_values(scan, x, y, weight)
    swing = 0.5 * float(np.ptp(values))
    widths, changes = np.diff(scan), np.abs(np.diff(values))
    wanted = np.full(len(widths), (high - low) / (MIN_NODES - 1))
    if swing > 1e-9 * float(np.abs(values).max()):
        steep = CHANGE_PER_INTERVAL * swing * widths / np.maximum(changes - SCATTER * swing, 1e-9 * swing)
        wanted = np.clip(steep, FINEST_SPACING * (high - low), wanted)
    middle = 0.5 * (scan[1:] + scan[:-1])
    spacing = np.min(wanted + SPACING_GROWTH * np.abs(middle[:, None] - middle), axis=1)
    position = np.append(0.0, np.cumsum(widths / spacing))
    count = int(np.clip(np.ceil(position[-1]) + 1, MIN_NODES, MAX_NODES))
    nodes = np.interp(np.linspace(0.0, position[-1], count), position, scan)
    nodes[[0, -1]] = low, high
    return nodes
