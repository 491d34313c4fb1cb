"""The prior of a free curve: near a known law, and smooth; its two sizes are those that the data make most probable.

The deviation d of the curve from the law at n nodes has the precision I/s² + DᵀD/b² with D d its bends (`bends`): s is
the size of the deviation, b that of its bends. Both are chosen by the evidence of the data, ∫ likelihood · prior.

Source: MacKay, Bayesian interpolation, Neural Computation 4 (1992) 415.
"""

from typing import NamedTuple

import numpy as np

from edhas_jax.diagnosis.laws.curve_basis import bends
from edhas_jax.inference.likelihood.symmetric_matrices import regularised_inverse, square_root

SIZES = 10.0 ** np.arange(-2.0, 1.01, 0.5)  # s over the size of the law
BENDS = 10.0 ** np.arange(-1.5, 0.51, 0.5)  # b over s
SMOOTHNESS = 0.3  # b over s of a curve of which nothing is known


class CurvePrior(NamedTuple):
    """Size and bend of the deviation of a curve, in the units of its values."""

    size: float
    bend: float

    def precision(self, nodes: np.ndarray) -> np.ndarray:
        """The inverse covariance (n, n) of the deviation at nodes (n,)."""
        bend = bends(nodes)
        return np.eye(len(nodes)) / self.size**2 + bend.T @ bend / self.bend**2

    def factor(self, nodes: np.ndarray) -> np.ndarray:
        """A matrix L (n, n) with covariance L Lᵀ: L times standard normal numbers are deviations at nodes (n,)."""
        return square_root(regularised_inverse(self.precision(nodes)))


def smooth_shapes(nodes: np.ndarray) -> np.ndarray:
    """Shapes (n, n) at nodes (n,), the smoothest first: their sum with standard normal factors is an unknown curve.

    They are the principal components of the prior with bends of `SMOOTHNESS`, scaled to a mean variance of 1.
    """
    vectors, sizes, _ = np.linalg.svd(CurvePrior(1.0, SMOOTHNESS).factor(nodes))
    return vectors * (sizes / np.sqrt(np.mean(np.square(sizes))))


class PriorChoice(NamedTuple):
    """The most probable prior, and the log-evidence [nats] that it gains over a curve without any deviation."""

    prior: CurvePrior
    log_evidence_gain: float


def choose_prior(
    curvature: np.ndarray, gradient: np.ndarray, deviation: np.ndarray, nodes: np.ndarray, size: float
) -> PriorChoice:
    """Choose the prior that makes the data most probable, to second order around a point.

    With S and g the curvature and gradient of ½χ² by the deviation, the other unknowns eliminated, Q = I + DᵀD/β² with
    β = b/s, and λ, u the eigenvalues and eigenvectors of Q^(−½) S Q^(−½), the log-evidence for s and β is
    ½ Σ (uᵀQ^(−½)g)²/(λ + 1/s²) − ½ Σ ln(1 + s²λ), plus a constant: one decomposition serves all sizes s.

    Args:
        curvature: curvature (k, k) of ½χ² by all unknowns, with the priors of the others; the curve's n values last.
        gradient: gradient (k,) of the same.
        deviation: deviation (n,) of the curve from the law at this point, in the units of `curvature`.
        nodes: nodes (n,) of the curve.
        size: typical size of the law in the units of `curvature`.
    """
    n = len(deviation)
    stiffness, slope = without_others(curvature, gradient - curvature[:, -n:] @ deviation, n)
    best = PriorChoice(CurvePrior(size * SIZES[0], size * SIZES[0] * BENDS[0]), -np.inf)
    for relative_bend in BENDS:
        root = inverse_root(CurvePrior(1.0, relative_bend).precision(nodes))
        stiff, vectors = np.linalg.eigh(root @ stiffness @ root)
        stiff, along = np.maximum(stiff, 0.0), vectors.T @ (root @ slope)
        for relative in size * SIZES:
            evidence = 0.5 * np.sum(along**2 / (stiff + relative**-2) - np.log1p(relative**2 * stiff))
            if evidence > best.log_evidence_gain:
                best = PriorChoice(CurvePrior(float(relative), float(relative * relative_bend)), float(evidence))
    return best


def without_others(curvature: np.ndarray, gradient: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Curvature (n, n) and gradient (n,) of ½χ² by its last n = `count` unknowns, minimised over all others.

    Args:
        curvature: curvature (k, k) by all unknowns.
        gradient: gradient (k,).
        count: number n of the last unknowns.
    """
    others, own = slice(0, len(gradient) - count), slice(len(gradient) - count, len(gradient))
    gain = curvature[own, others] @ regularised_inverse(curvature[others, others])
    return curvature[own, own] - gain @ curvature[others, own], gradient[own] - gain @ gradient[others]


def inverse_root(matrix: np.ndarray) -> np.ndarray:
    """The symmetric inverse square root (n, n) of a positive definite matrix."""
    values, vectors = np.linalg.eigh(matrix)
    return (vectors / np.sqrt(values)) @ vectors.T
