"""The fit of a campaign with choices, repeated where it refutes the noise that it began with."""

from collections.abc import Callable

import numpy as np

from edhas_jax.inference.fit.fit import Fit, FitStep, fit
from edhas_jax.inference.fit.fit_choices import FitChoices
from edhas_jax.inference.fit.fit_problem import FitProblem
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.checks.noise_measurement import without_refuted_noise
from edhas_jax.measurements.residuals import normalised_residuals


def fit_with_choices(
    given: Campaign,
    choices: FitChoices,
    starts: int | np.ndarray = 4,
    search: bool = True,
    on_progress: Callable[[str], None] | None = None,
    on_step: Callable[[FitStep], None] | None = None,
) -> tuple[Campaign, Fit]:
    """Fit the free parameters of a campaign.

    Args:
        given: the campaign, its data checked.
        choices: what is chosen for the fit.
        starts: number of starts, the first with the initial values of the choices; or their coordinates (k, n).
        search: False skips the rough search: the first start begins at the fine step.
        on_progress: called with a sentence on the progress.
        on_step: called after every step of a search.

    Returns:
        The campaign as chosen, with the noise of the sensors; the fit, with the factors on the noise. After
        KeyboardInterrupt in a search the fit is the best point until then, `stopped`.

    Raises:
        FitError: no run to fit, no unknown, no start, or a model that fails from every start.
    """
    report = on_progress or (lambda sentence: None)
    campaign = choices.applied(given)
    unknowns = choices.unknowns(campaign)
    if isinstance(starts, int) and starts > 0:
        starts = choices.starts(unknowns, starts)

    def problem_of(campaign: Campaign) -> FitProblem:
        return FitProblem(choices.weighted(campaign), campaign.machine, unknowns)

    found = fit(problem_of(campaign), starts, search=search, on_progress=report, on_step=on_step, keeps_best=True)
    quieter = without_refuted_noise(campaign, _over_noise(campaign, found), len(unknowns))
    if quieter is campaign or found.stopped:
        return campaign, found
    report("once more, with the noise that the fit leaves")
    again = fit(problem_of(quieter), found.x, search=False, on_progress=report, on_step=on_step, keeps_best=True)
    return quieter, again


def _over_noise(campaign: Campaign, found: Fit) -> dict[str, dict[str, np.ndarray]]:
    """(measured − model)/noise (samples,) of the fitted runs, by run and signal, with the noise of a campaign."""
    rows = zip(found.problem.model().runs, found.outcomes, strict=True)
    return {run.name: normalised_residuals(campaign, run, predicted) for run, predicted in rows}
