"""Autocovariance of noise that was seen through a filter, and its autoregressive model.

The signal itself is removed by a linear filter (differences between cycles, deviations from local polynomials), which
changes the autocovariance of the noise by a known linear map. Its inverse restores the one of the noise.

Sources: Brockwell, Davis, Time Series: Theory and Methods, 2nd ed. (1991), ch. 8 (Yule-Walker equations, order by AIC).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.special import chdtri

LAGS = 12  # sample intervals over which the noise may be correlated
LONG_LAGS = 120  # up to which an autoregressive model continues its autocovariance
MAX_ORDER = 8  # of the autoregressive model: fewer coefficients cannot follow slow noise above a white one
MAX_FALSE_CORRELATION = 1e-3  # probability of calling white noise correlated
MIN_PREDICTED_SHARE = 0.004  # of the variance that earlier samples must predict; less changes no result
CONTINUATION_ORDER = 4  # of the autoregressive model that continues an autocovariance beyond `LAGS`
MAX_CONTINUATIONS = 30  # of the autocovariance beyond `LAGS`, each by the autoregressive model of the one before
MAX_CHANGE = 1e-3  # of the autocovariance by the last continuation, over the variance
SPECTRUM_LENGTH = 2048  # samples over which the autocovariance has to die out


class Autocovariance(NamedTuple):
    """Autocovariance (LAGS + 1,) of the noise of a signal, and the number of independent samples that it is from."""

    values: np.ndarray
    samples: float

    @property
    def level(self) -> float:
        """The standard deviation of the noise."""
        return math.sqrt(max(float(self.values[0]), 0.0))


def lagged_products(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sums of products of samples (samples,), NaN where missing, at lags 0 … LAGS, and their numbers (LAGS + 1,)."""
    used = np.isfinite(values)
    filled, n = np.where(used, values, 0.0), len(values)
    sums = [filled[: n - lag] @ filled[lag:] for lag in range(LAGS + 1)]
    return np.array(sums), np.array([float((used[: n - lag] & used[lag:]).sum()) for lag in range(LAGS + 1)])


def filter_map(autocorrelation: np.ndarray, lags: int = LAGS) -> np.ndarray:
    """The matrix from the autocovariance of a noise to the one after a filter.

    Args:
        autocorrelation: of the coefficients of the filter, lag 0 in the middle.
        lags: largest lag of the noise.

    Returns:
        A matrix (LAGS + 1, lags + 1).
    """
    middle = len(autocorrelation) // 2
    padded = np.pad(autocorrelation, lags + LAGS + 1)
    middle += lags + LAGS + 1
    k, j = np.arange(LAGS + 1)[:, None], np.arange(lags + 1)[None, :]
    both = padded[middle + k - j] + padded[middle + k + j]
    return np.where(j == 0, 0.5 * both, both)


def restore(filtered: np.ndarray, autocorrelation: np.ndarray) -> np.ndarray:
    """The autocovariance of a noise from the one after a filter.

    Args:
        filtered: autocovariance after the filter (LAGS + 1,).
        autocorrelation: of the coefficients of the filter, lag 0 in the middle.

    Returns:
        The autocovariance (LAGS + 1,); beyond these lags it goes on as an autoregressive model predicts.
    """
    short, long = filter_map(autocorrelation), filter_map(autocorrelation, LONG_LAGS)
    found = np.linalg.lstsq(short, filtered, rcond=None)[0]
    for _ in range(MAX_CONTINUATIONS):
        if not found[0] > 0.0 or not is_stable(coefficients := yule_walker(found, CONTINUATION_ORDER)):
            break
        continued = found[0] * autocorrelation_of(coefficients, LONG_LAGS)
        change = np.linalg.lstsq(short, filtered - long @ continued, rcond=None)[0]
        before, found = found, continued[: LAGS + 1] + change
        if np.abs(found - before).max() < MAX_CHANGE * before[0]:
            break
    return found


def yule_walker(autocovariance: np.ndarray, order: int) -> tuple[float, ...]:
    """Coefficients of the autoregressive model of an order; empty for order 0.

    Raises:
        numpy.linalg.LinAlgError: the autocovariance is singular.
    """
    if order == 0:
        return ()
    return tuple(float(a) for a in solve_toeplitz(autocovariance[:order], autocovariance[1 : order + 1]))


def predicted_share(autocovariance: np.ndarray, coefficients: Sequence[float]) -> float:
    """The share of the variance that an autoregressive model predicts from earlier samples."""
    return float(np.dot(coefficients, autocovariance[1 : len(coefficients) + 1]) / autocovariance[0])


def autoregression(autocovariance: Autocovariance) -> tuple[float, ...]:
    """Coefficients of the autoregressive model with the smallest AIC; empty where the noise is white.

    The noise counts as white if its likelihood ratio against the model could be chance, or the model predicts next to
    nothing.
    """
    values, samples = autocovariance
    best, smallest = (), 0.0
    if not values[0] > 0.0:
        return best
    for order in range(1, MAX_ORDER + 1):
        coefficients = yule_walker(values, order)
        share = predicted_share(values, coefficients)
        if not share < 1.0 or not is_stable(coefficients):
            break
        ratio = -samples * math.log(1.0 - share)
        is_white = ratio < chdtri(order, MAX_FALSE_CORRELATION / MAX_ORDER) or share < MIN_PREDICTED_SHARE
        if not is_white and 2.0 * order - ratio < smallest:
            best, smallest = coefficients, 2.0 * order - ratio
    return best


def is_stable(coefficients: Sequence[float]) -> bool:
    """Whether an autoregressive process is stationary: all roots of its characteristic polynomial within the circle."""
    return bool(np.all(np.abs(np.roots([1.0, *(-a for a in coefficients)])) < 1.0)) if len(coefficients) else True


def autocorrelation_of(coefficients: Sequence[float], lags: int) -> np.ndarray:
    """Autocorrelation (lags + 1,) of an autoregressive process.

    Args:
        coefficients: a_1 … a_p of a stationary process.
        lags: largest lag.
    """
    if len(coefficients) == 0:
        return np.eye(1, lags + 1)[0]
    # the power spectrum is 1/|1 − Σ a_k e^(−iωk)|², its inverse transform the autocovariance
    response = np.fft.rfft([1.0, *(-a for a in coefficients)], SPECTRUM_LENGTH)
    covariance = np.fft.irfft(1.0 / np.abs(response) ** 2)
    return covariance[: lags + 1] / covariance[0]
