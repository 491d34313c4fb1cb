"""Free curves one after another: what acts at several places of a machine, where no law is known.

One curve often takes over a part of another one, so that after each curve all numbers are fitted again, those of
earlier curves too, and the places are scored anew.
"""

from collections.abc import Callable, Sequence

from edhas_jax.core.runtime import single_threaded_algebra
from edhas_jax.diagnosis.search.candidates import Candidate
from edhas_jax.diagnosis.search.decision_rules import MIN_GAIN
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit
from edhas_jax.diagnosis.search.free_curves import score_free_curves
from edhas_jax.diagnosis.search.screening import ScoreTest
from edhas_jax.diagnosis.search.trial import Trial, try_candidate
from edhas_jax.measurements.time_resolution import TimeResolution

MIN_LEFT_SHARE = 0.05  # of the excess of ½χ², by which a further curve has to raise the log-evidence
FIT_STEPS = 60  # maximum number of Levenberg-Marquardt steps of each fit
MOST_CURVES = 3

Report = Callable[[str], None]


@single_threaded_algebra
def add_curves_in_turn(
    evaluated: EvaluatedFit, accepted: Sequence[Candidate], resolution: TimeResolution, most: int = MOST_CURVES,
    on_progress: Report | None = None,
) -> list[Trial]:  # fmt: skip
    """Add free curves to a fitted model, each where it explains most, until one explains little.

    Args:
        evaluated: the fit from which the search begins.
        accepted: the candidates that its machine has.
        resolution: coarse and fine time steps per sample.
        most: largest number of curves.
        on_progress: called with a sentence on the progress.

    Returns:
        The trials with one, two, … curves, in the order in which these were added; their candidates are the curves.
    """
    report = on_progress or (lambda sentence: None)
    mounted, trials = list(accepted), []
    while len(trials) < most:
        scores = score_free_curves(ScoreTest(evaluated.fit, mounted), evaluated.fit, report)
        # far from the noise a linear prediction is far too small, so that it decides only where it is tiny
        if not scores or scores[0].predicted_gain < MIN_GAIN:
            break
        report(f"fitting {scores[0].candidate.text}")
        trial = try_candidate(evaluated, mounted, scores[0], resolution, FIT_STEPS)
        if trial.evaluated is None or trial.log_evidence_gain < max(MIN_GAIN, MIN_LEFT_SHARE * evaluated.excess):
            break
        trials.append(trial)
        mounted.append(trial.candidate)
        evaluated = trial.evaluated
    return trials
