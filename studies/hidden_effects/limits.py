"""What the true laws would explain: the ceiling of any method, and whether each of several effects stands out.

    python -m studies.hidden_effects.limits [--split varied|tuning|judging] [--families b c …] [--first K] [--cases N]
                                            [--out DIR] [--workers K]

In every case in which effects are hidden, the model is fitted without what is hidden and with the true laws, which no
method knows. Both fits also start from the true parameters. Their difference is what the true laws explain; compared
with what they leave, it is the *strength* of what is hidden. Where several effects are hidden, the model is also fitted
with all of their true laws but one. What the one that was left out explains in addition to the others, compared with
what all of them leave, is the strength of that effect; it stands out from 3 on.

Results are stored beside the answers, so that the same command continues a study that was stopped, and the report of
the benchmark tells the cases whose effects all stand out from the others. The last line has the counts:
`cases=… fitted=… stand_out=…`. No answer is read or shown.
"""

import argparse
import math
from pathlib import Path

import numpy as np

from edhas_jax.core.runtime import single_threaded_algebra
from edhas_jax.machine.parameters import get_parameter
from studies.hidden_effects.answers import Truth
from studies.hidden_effects.generators.drawing import draw
from studies.hidden_effects.generators.hidden_case import CaseKey, Family, HiddenCase, Split, keys_of
from studies.hidden_effects.store import Limit, Record, ResultFolder
from studies.hidden_effects.work import run_all

MIN_GAIN = 12.0  # nats: the best of some fifty candidates gains less by chance
STEPS = 20  # maximum number of Levenberg-Marquardt steps of a fit
REFINEMENT_STEPS = 6  # the same for the fit that follows once the error of the time step is removed


@single_threaded_algebra
def limit_of(case: HiddenCase) -> Limit:
    """Fit the model of a case without what is hidden, and with the true laws.

    Args:
        case: a case with effects hidden in it.

    Raises:
        FitError: the model cannot be fitted.
    """
    # here, so that with another version of the package the cases can be drawn and answered
    from edhas_jax.diagnosis.candidates.candidate import Candidate, with_candidates
    from edhas_jax.diagnosis.search.holdout_split import split_for_holdout
    from edhas_jax.inference.fit.calibrated_model import calibrate
    from edhas_jax.inference.fit.evaluated_fit import fit_coarse, remaining, with_solver_error
    from edhas_jax.inference.fit.fit_problem import FitError
    from edhas_jax.measurements.checks.campaign_checks import checked_campaign

    campaign = split_for_holdout(checked_campaign(case.campaign))[0]
    calibrated, resolution = calibrate(campaign)

    def from_truth(problem):
        """The fit that begins at the true parameters, without the error of the time step; None if the model fails."""
        low, high = np.array([u.bounds() for u in problem.unknowns]).T
        true = np.array([u.coordinate(float(get_parameter(case.machine, u.name))) for u in problem.unknowns])
        try:
            found = fit_coarse(problem, np.clip(true, low, high), resolution.coarse, STEPS)
        except FitError:
            return None
        return with_solver_error(found, resolution, REFINEMENT_STEPS)

    again = from_truth(calibrated.fit.problem)
    without = calibrated if again is None or again.log_evidence < calibrated.log_evidence else again
    hidden = [Candidate(type(effect)) for effect in case.machine.effects[-len(case.truth.hidden) :]]
    found = from_truth(with_candidates(calibrated.fit.problem, hidden))
    if found is None:
        raise FitError("the model with the true laws fails")
    simpler = [without]
    if len(hidden) > 1:
        others = [hidden[:position] + hidden[position + 1 :] for position in range(len(hidden))]
        simpler = [from_truth(with_candidates(calibrated.fit.problem, rest)) for rest in others]
    gains = [math.nan if fit is None else found.log_evidence - fit.log_evidence for fit in simpler]
    left = remaining(found.excess, found.samples)
    gain = found.log_evidence - without.log_evidence
    return Limit(gain, left, gain / (left + MIN_GAIN), tuple(of / (left + MIN_GAIN) for of in gains))


def has_effects(truth: Truth) -> bool:
    """Whether effects are hidden, and no fault of a sensor."""
    return bool(truth.hidden) and not any(" on " in h.name for h in truth.hidden)


def run_job(job: tuple[CaseKey, ResultFolder]) -> str:
    """Compute and store what the true laws explain in one case; return a sentence without what is hidden."""
    key, results = job
    stored = results.truth(key)
    case = draw(key, stored.attempt if stored else 0)
    if stored is not None and not case.is_same(stored):
        return f"{key}: left out, as the generators have changed since it was answered"
    if not has_effects(case.truth):
        return f"{key}: no effect is hidden"
    results.store_truth(key, case.truth)
    try:
        results.store_limit(key, limit_of(case))
    except Exception as error:
        return f"{key}: {type(error).__name__}: {error}"
    return f"{key}: done"


def main(arguments: list[str] | None = None) -> int:
    """Run the study from the command line and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--split", type=Split, choices=list(Split), default=Split.VARIED,
                        metavar="varied|tuning|judging", help="which cases (default varied)")  # fmt: skip
    parser.add_argument("--families", nargs="+", choices=[f.value for f in Family], default=[], metavar="LETTER")
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--cases", type=int, default=40, help="how many numbers")
    parser.add_argument("--out", type=Path, default=Path("runs/hidden_effects"), help="folder of the answers")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args(arguments)
    results = ResultFolder(options.out)
    keys = keys_of(options.split, options.families, options.first, options.cases)
    known = {key: record for key in keys for record in results.records([key], ())}
    jobs = [(key, results) for key in keys if key not in known or _lacks_limit(known[key])]
    run_all(run_job, jobs, options.workers, options.out)
    limits = [record.limit for record in results.records(keys, ()) if record.limit is not None]
    print(f"cases={len(keys)} fitted={len(limits)} stand_out={sum(limit.all_stand_out for limit in limits)}")
    return 0


def _lacks_limit(record: Record) -> bool:
    return record.limit is None and has_effects(record.truth)


if __name__ == "__main__":
    raise SystemExit(main())
