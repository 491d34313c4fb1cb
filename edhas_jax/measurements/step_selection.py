"""Which time step serves a campaign: the solver's error beside the noise of the sensors."""

from typing import NamedTuple

import numpy as np

from edhas_jax.measurements.predicted_signals import Case, Model, Outcome

SHARE = 0.1  # error of the solver as a share of the noise (rms over a run) that goes unseen in a fit
ROUGH = 1.0  # and one that is good enough to look for where the minimum is
FINEST = 2.5e-6  # s; no smaller step is tried


class Resolution(NamedTuple):
    """Steps from sample to sample: `rough` to search with, `fine` to judge with; `error` of the latter, in noise."""

    rough: int
    fine: int
    error: float


def choose_resolution(model: Model, x: np.ndarray, share: float = SHARE) -> Resolution:
    """Halve the step until its error at `x` is below `share` of the noise on every signal of every run.

    The rule is of second order: of a change by halving, a third remains as the error of the finer step and four thirds
    was that of the coarser.
    """
    case = [Case(x, tuple(range(len(model.runs))))]
    n, rough, error = model.coarsest(), None, np.inf
    coarse = model.outcomes(case, n, derive=False)[0]
    while model.longest_interval() / n > FINEST:
        fine = model.outcomes(case, 2 * n, derive=False)[0]
        change = _change(model, coarse, fine)
        for steps, error in ((n, 4.0 / 3.0 * change), (2 * n, change / 3.0)):
            rough = steps if rough is None and error < ROUGH else rough
            if error < share:
                return Resolution(rough, steps, error)
        n, coarse = 2 * n, fine
    return Resolution(rough or n, n, error)


def _change(model: Model, coarse: dict[int, Outcome], fine: dict[int, Outcome]) -> float:
    worst = 0.0
    for r, outcome in fine.items():
        for name, channel in model.campaign.channels.items():
            rms = np.sqrt(np.mean(np.square(outcome.values[name] - coarse[r].values[name])))
            worst = max(worst, float(rms) / channel.noise if np.isfinite(rms) else np.inf)
    return worst
