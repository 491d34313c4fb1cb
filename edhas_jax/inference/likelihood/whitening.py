"""Whitening: residuals of correlated noise to independent ones of unit variance.

The noise e of a signal is modelled as autoregressive, e_t = Σ a_k e_{t−k} + innovation. The innovations are
independent, so that the sum of their squares is a χ², which that of correlated residuals is not.

Source: Ljung, System Identification (1999), ch. 7.
"""

from collections.abc import Sequence

import numpy as np
from scipy.signal import lfilter

from edhas_jax.measurements.campaign import Channel

RESPONSE_LENGTH = 2000  # samples of the impulse response, beyond which it has died out


def whiten(rows: np.ndarray, channel: Channel) -> np.ndarray:
    """Rows of a signal as independent residuals of unit variance.

    Args:
        rows: values (samples, …) in the SI unit of the signal, in the order of time; NaN where not measured.
        channel: standard deviation and autoregressive coefficients of its noise.

    Returns:
        The rows (samples, …), dimensionless; NaN where a sample or one of its predecessors in the autoregression is
        missing. Correlated noise costs the first samples, one for each coefficient.
    """
    if not channel.correlation:
        return rows / channel.noise
    innovations = np.array(rows, float)
    for lag, coefficient in enumerate(channel.correlation, start=1):
        innovations[lag:] -= coefficient * rows[:-lag]
    innovations[: len(channel.correlation)] = np.nan
    return innovations / (channel.noise * innovation_share(channel.correlation))


def innovation_share(coefficients: Sequence[float]) -> float:
    """The standard deviation of the innovations over that of the autoregressive process itself, 0 … 1.

    The variance of the process is that of the innovations times the sum of squares of its impulse response.
    """
    impulse = np.zeros(RESPONSE_LENGTH)
    impulse[0] = 1.0
    response = lfilter([1.0], [1.0, *(-a for a in coefficients)], impulse)
    return float(1.0 / np.sqrt(np.sum(np.square(response))))
