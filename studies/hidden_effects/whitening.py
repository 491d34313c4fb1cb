"""Filter that makes correlated noise white: what the past samples do not predict, in units of its own size."""

import numpy as np

from edhas_jax.measurements.checks.noise_correlation import autocorrelation_of


def whitened(values: np.ndarray, coefficients: tuple[float, ...]) -> np.ndarray:
    """The innovations of an autoregressive process e_t = Σ a_k e_{t−k} + innovation.

    Args:
        values: values over time (samples, …), in units of the standard deviation of the noise.
        coefficients: a_1 … a_p of the noise; none for white noise.

    Returns:
        v_t − Σ a_k v_{t−k} over the standard deviation of an innovation, NaN for the first p samples and where a
        sample is missing.
    """
    if not coefficients:
        return values
    share = 1.0 - float(np.dot(coefficients, autocorrelation_of(coefficients, len(coefficients))[1:]))
    out = np.array(values, float)
    for k, a in enumerate(coefficients, start=1):
        out[k:] -= a * values[:-k]
    out[: len(coefficients)] = np.nan
    return out / np.sqrt(share)
