"""Leave-one-run-out prediction: how well each run is predicted by a model fitted to the other runs.

Around a fit the model is linear, and every density is Gaussian. With E(S) the log-evidence of the runs S,

    ln p(run r | other runs) = E(all) − E(all without r)

which needs the normal equations of each run only. It holds the spread of the parameters that the other runs leave, so
that a candidate gains only by what it predicts.

Source: Gelfand, Dey, J. Royal Statistical Society B 56 (1994) 501, predictive densities for model choice.
"""

from collections.abc import Sequence

import numpy as np

from edhas_jax.diagnosis.calibration.symmetric_matrices import log_determinant, regularised_inverse
from edhas_jax.diagnosis.likelihood.run_equations import RunEquations


def left_out_log_density(
    equations: Sequence[RunEquations], x: np.ndarray, prior: np.ndarray, common: int
) -> np.ndarray:
    """Log predictive density (runs,) of each run from all others, without the constant of the noise, in nats.

    Args:
        equations: normal equations of the runs at the fit.
        x: coordinates of the unknowns (n,) at the fit.
        prior: 1 for an unknown with a prior, else 0 (n,).
        common: number of deviations of the bench that are common to all runs.
    """
    weights = np.concatenate([prior, np.ones(common)])
    pull, offset = np.concatenate([-prior * x, np.zeros(common)]), float(prior @ np.square(x))
    total = np.sum([e.gram for e in equations], axis=0)

    def log_evidence(gram: np.ndarray) -> float:
        curvature = gram[:-1, :-1] + np.diag(weights)
        right = gram[:-1, -1] + pull
        best = right @ regularised_inverse(curvature) @ right
        return -0.5 * (gram[-1, -1] + offset - best) - 0.5 * log_determinant(curvature)

    whole = log_evidence(total)
    return np.array([whole - log_evidence(total - e.gram) for e in equations])
