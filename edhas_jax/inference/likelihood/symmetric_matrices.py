"""Inverses of curvatures and covariances: every one of the package is taken here, with a rule for singular matrices.

A direction of the unknowns that the data do not determine makes a curvature singular, and may make a covariance so by
rounding. The rule: coordinates are scaled to a unit diagonal, and eigenvalues below the rounding error of the largest
one count as that error. An undetermined direction then has a large but finite variance.
"""

import numpy as np


def regularised_inverse(matrix: np.ndarray) -> np.ndarray:
    """Invert a symmetric, positive semidefinite matrix (n, n); the result is positive definite.

    Args:
        matrix: a curvature or a covariance, in any unit.

    Returns:
        The inverse (n, n) under the rule of this module; NaN everywhere where an element is not finite.
    """
    if not np.isfinite(matrix).all():
        return np.full(np.shape(matrix), np.nan)
    scale, values, vectors = _scaled_eigenvalues(matrix)
    return scale[:, None] * ((vectors / values) @ vectors.T) * scale


def log_determinant(matrix: np.ndarray) -> float:
    """ln det of a symmetric, positive semidefinite matrix (n, n); finite, but NaN where an element is not finite."""
    if not np.isfinite(matrix).all():
        return float("nan")
    scale, values, _ = _scaled_eigenvalues(matrix)
    return _log_determinant(scale, values)


def inverse_factor(matrix: np.ndarray) -> tuple[np.ndarray, float]:
    """A factor W (n, n) of the inverse W Wᵀ of a symmetric, positive semidefinite matrix, and the ln det of the matrix.

    Both under the rule of this module; the matrix is finite.
    """
    scale, values, vectors = _scaled_eigenvalues(matrix)
    return scale[:, None] * (vectors / np.sqrt(values)), _log_determinant(scale, values)


def square_root(covariance: np.ndarray) -> np.ndarray:
    """A factor L (n, n) of a symmetric, positive semidefinite matrix: L Lᵀ, its negative eigenvalues taken as 0.

    NaN everywhere where an element is not finite.
    """
    if not np.isfinite(covariance).all():
        return np.full(np.shape(covariance), np.nan)
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))


def least_norm_solution(matrix: np.ndarray, right: np.ndarray, relative_limit: float) -> np.ndarray:
    """The shortest x (n,) that minimises |matrix · x − right|: no step along a direction that is not determined.

    Args:
        matrix: symmetric, shape (n, n), finite.
        right: shape (n,), finite.
        relative_limit: share of the largest singular value below which a direction counts as not determined.
    """
    return np.linalg.lstsq(matrix, right, rcond=relative_limit)[0]


def _scaled_eigenvalues(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Scale factors (n,) to a unit diagonal, and eigenvalues (n,), at least the rounding error, with their vectors."""
    diagonal = np.diag(matrix)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    values, vectors = np.linalg.eigh(scale[:, None] * matrix * scale)
    rounding = len(values) * np.finfo(float).eps * max(float(values.max(initial=0.0)), np.finfo(float).tiny)
    return scale, np.maximum(values, rounding), vectors


def _log_determinant(scale: np.ndarray, values: np.ndarray) -> float:
    """ln det of the matrix with these scale factors and eigenvalues, see `_scaled_eigenvalues`."""
    return float(np.sum(np.log(values)) - 2.0 * np.sum(np.log(scale)))
