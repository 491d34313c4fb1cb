"""What a model cannot predict, because its signals depend irregularly on its parameters.

The signals of close neighbours in the space of the parameters lie on a smooth curve where the model is regular. No
estimate of the parameters can follow what scatters around this curve, however small the distances: it acts as noise.
"""

import dataclasses
import math

import numpy as np

from edhas_jax.inference.fit.ensemble_search import SEED, Ensemble
from edhas_jax.inference.fit.fit_problem import FitProblem
from edhas_jax.measurements.campaign import Campaign

# distance in coordinates within which neighbours are close, their number, and the degree of the curve through them
CLOSE, NEIGHBOURS, DEGREE = 0.005, 12, 3
MIN_SCATTER = 20.0  # nats of ½χ² by which neighbours scatter, from which a model is irregular


def unpredictable_part(
    problem: FitProblem, x: np.ndarray, steps_per_sample: int, min_scatter: float = MIN_SCATTER
) -> dict[str, float]:  # fmt: skip
    """How much close neighbours of a point scatter around a smooth curve through them.

    Args:
        problem: the model.
        x: the point (n,).
        steps_per_sample: time steps per sample.
        min_scatter: nats of ½χ² from which a model is irregular.

    Returns:
        The standard deviation of each signal (SI), as a root mean square over the runs; empty for a model so regular
        that less than `min_scatter` of ½χ² is irregular, and for one that fails there.
    """
    ensemble = Ensemble(problem, steps_per_sample)
    direction = np.random.default_rng(SEED).choice([-1.0, 1.0], len(x))
    places = np.linspace(-1.0, 1.0, NEIGHBOURS)
    smooth = np.linalg.qr(np.vander(places, DEGREE + 1))[0]
    found = ensemble.predict(ensemble.inside(x, CLOSE) + CLOSE * places[:, None] * direction)
    if not all(map(ensemble.is_finite, found)):
        return {}
    deviations, nats = {}, 0.0
    for name, channel in problem.campaign.channels.items():
        variances = [np.zeros(0)]
        for r, run in enumerate(ensemble.runs):
            if name in run.signals:
                rows = np.array([outcomes[r].values[name] for outcomes in found])
                scatter = rows - smooth @ (smooth.T @ rows)
                variances.append(np.sum(np.square(scatter), axis=0) / (NEIGHBOURS - DEGREE - 1))
        variance = np.concatenate(variances)
        deviations[name] = math.sqrt(float(np.mean(variance))) if variance.size else 0.0
        nats += 0.5 * float(np.sum(variance)) / channel.noise**2
    return deviations if nats > min_scatter else {}


def with_unpredictable_part(campaign: Campaign, deviations: dict[str, float]) -> Campaign:
    """The campaign with what its model cannot predict as a part of the noise.

    Args:
        campaign: the measurements.
        deviations: standard deviation (SI) of that part by signal; nothing for a regular model.
    """
    channels = {
        n: dataclasses.replace(c, noise=math.hypot(c.noise, deviations.get(n, 0.0)))
        for n, c in campaign.channels.items()
    }
    return dataclasses.replace(campaign, channels=channels, unpredictable=dict(deviations))
