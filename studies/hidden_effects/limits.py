"""What the true laws would explain: why a first answer is wrong, and where any method ends.

    python -m studies.hidden_effects.limits [--split varied|tuning|practice|earlier|judging] [--families b c …]
                                            [--out DIR] [--workers K]

For every case in DIR in which an effect is hidden and which `edhas diagnose` has answered, the model is fitted without
what is hidden and with the true laws, which no method knows. Both fits also start from the true parameters. Their
difference is what the true laws explain; compared with what they leave, it is the *strength* of what is hidden. With
judging cases only the counts are printed, no single answer. A wrong first answer (where the effect is withheld from the
library, any but an effect without a name) has one of three causes:

* *weak*: the true laws explain less than what a candidate must explain, over what is left, to be accepted; a rule that
  accepted it would accept imitations of small disturbances as well;
* *fit*: the true laws leave much less than the best model that the search has found;
* *confused*: neither. A model with other effects instead, or with adjusted parameters only, fits about as well; or the
  rules by which the diagnosis accepts an effect were too strict.

Where several effects are hidden, the model is also fitted with all of their true laws but one. What the one that was
left out explains in addition to the others, compared with what all of them leave, is the strength of that effect. A
second table gives the share of these effects that are named, by this strength.

Results are stored beside the answers, so that the same command continues a study that was stopped. The last line has
the counts: `cases=… right=… weak=… fit=… confused=…`.
"""

import argparse
import dataclasses
import enum
import itertools
import math
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from edhas_jax.core.runtime import single_threaded_algebra
from edhas_jax.diagnosis.calibration.fit_problem import FitError, FitProblem
from edhas_jax.diagnosis.search.calibrated_model import calibrate
from edhas_jax.diagnosis.search.candidates import Candidate, with_candidates
from edhas_jax.diagnosis.search.decision_rules import MIN_GAIN, MIN_STRENGTH, remaining, strength
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit, fit_coarse, with_solver_error
from edhas_jax.diagnosis.search.holdout_split import split_for_holdout
from edhas_jax.machine.parameters import get_parameter
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from edhas_jax.measurements.time_resolution import TimeResolution
from studies.hidden_effects.answers import Answer, Truth, same_as_any
from studies.hidden_effects.drawing import FAMILIES, DrawnCase, draw, key_of
from studies.hidden_effects.generators.hidden_case import Split
from studies.hidden_effects.rates import Rate, first_is_right, is_null
from studies.hidden_effects.report import case_name, description, markdown_table
from studies.hidden_effects.store import Record, ResultFolder, read_json, write_json
from studies.hidden_effects.work import run_all

FILE = "limit.json"
STEPS = 20  # maximum number of Levenberg-Marquardt steps of a fit
REFINEMENT_STEPS = 6  # the same for the fit that follows once the error of the time step is removed
MUCH_LESS = 0.5  # what the true laws leave over what the search has left, below which the search has missed them
STRENGTHS = (0.0, 0.3, 1.0, 3.0, 10.0, math.inf)  # limits of the bands


class Cause(enum.Enum):
    """Why a first answer is wrong."""

    WEAK = "weak"
    FIT = "fit"
    CONFUSED = "confused"


@dataclasses.dataclass(frozen=True)
class Limit:
    """What the true laws explain and leave in a case.

    Args:
        gain: log-evidence gain of the true laws [nats].
        left: excess of ½χ² that they leave [nats], beyond the scatter of noise.
        without: the same of the model without them.
        strength: the gain over what is left, as in the rules of the search.
        samples: number of samples.
        each: where several effects are hidden, the strength of each where the others are in the model, in the order of
            the truth; NaN where the model without it cannot be fitted.
    """

    gain: float
    left: float
    without: float
    strength: float
    samples: int
    each: tuple[float, ...] = ()


@single_threaded_algebra
def limit_of(case: DrawnCase) -> Limit:
    """Fit the model of a case without what is hidden and with the true laws.

    Args:
        case: a case whose machine is known, with effects hidden in it.

    Raises:
        FitError: the model cannot be fitted.
    """
    campaign = split_for_holdout(checked_campaign(case.campaign))[0]
    calibrated, resolution = calibrate(campaign)
    again = _from_truth(calibrated.fit.problem, case.machine, resolution)
    without = calibrated if again is None or again.log_evidence < calibrated.log_evidence else again
    hidden = [Candidate(type(effect)) for effect in case.machine.effects[-len(case.truth.hidden) :]]
    found = _from_truth(with_candidates(calibrated.fit.problem, hidden), case.machine, resolution)
    if found is None:
        raise FitError("the model with the true laws fails")

    def strength_over(simpler: EvaluatedFit) -> float:
        return strength(found.log_evidence - simpler.log_evidence, found.excess, found.samples)

    each = []
    for position in range(len(hidden)) if len(hidden) > 1 else ():
        others = hidden[:position] + hidden[position + 1 :]
        rest = _from_truth(with_candidates(calibrated.fit.problem, others), case.machine, resolution)
        each.append(math.nan if rest is None else strength_over(rest))
    return Limit(
        found.log_evidence - without.log_evidence, remaining(found.excess, found.samples),
        remaining(without.excess, without.samples), strength_over(without), found.samples, tuple(each),
    )  # fmt: skip


def _from_truth(problem: FitProblem, machine: Rig, resolution: TimeResolution) -> EvaluatedFit | None:
    """The fit that begins at the true parameters, without the error of the time step; None where the model fails."""
    low, high = np.array([u.bounds() for u in problem.unknowns]).T
    true = np.array([u.coordinate(float(get_parameter(machine, u.name))) for u in problem.unknowns])
    try:
        found = fit_coarse(problem, np.clip(true, low, high), resolution.coarse, STEPS)
    except FitError:
        return None
    return with_solver_error(found, resolution, REFINEMENT_STEPS)


def cause_of(limit: Limit, answer: Answer) -> Cause:
    """Why the first answer is wrong."""
    if limit.strength < MIN_STRENGTH:
        return Cause.WEAK
    members = answer.evidence.get("members", ())
    ours = min((member["left"] for member in members), default=0.5 * limit.samples * answer.evidence["misfit"])
    return Cause.FIT if limit.left + MIN_GAIN < MUCH_LESS * ours else Cause.CONFUSED


def strength_table(cases: Sequence[tuple[Truth, Answer, Limit]]) -> list[str]:
    """Lines of a Markdown table: the rate of right first answers, by the strength of all that is hidden together."""
    return _over_strength(
        "right answer first", [(limit.strength, first_is_right(truth, answer)) for truth, answer, limit in cases]
    )


def each_table(cases: Sequence[tuple[Truth, Answer, Limit]]) -> list[str]:
    """Lines of a Markdown table with the share of effects named, by strength, in cases with several effects."""
    return _over_strength("named", [
        (value, same_as_any(hidden.name, answer.named))
        for truth, answer, limit in cases
        for hidden, value in zip(truth.hidden, limit.each, strict=False)
    ])  # fmt: skip


def _over_strength(head: str, found: Sequence[tuple[float, bool]]) -> list[str]:
    """Lines of a Markdown table with the rate of right answers in each band of strength.

    Args:
        head: title of the column of rates.
        found: a strength and whether the answer is right, for each effect or case.
    """
    rows = {}
    for low, high in itertools.pairwise(STRENGTHS):
        right = [is_right for value, is_right in found if low <= max(value, 0.0) < high]
        rows[f"{low:g} {f'… {high:g}' if math.isfinite(high) else 'and more'}"] = str(Rate(sum(right), len(right)))
    return markdown_table([head], [rows])


def run_job(job: tuple[Truth, ResultFolder]) -> str:
    """Compute and store what the true laws explain in one case; return a sentence that says how much.

    Args:
        job: what was hidden in the case when it was answered, and the folder of the results.
    """
    stored, results = job
    key = key_of(stored)
    case = draw(key)
    if not _is_same(case.truth, stored):
        return f"{key}: left out, as the generators have changed since it was answered"
    try:
        found = limit_of(case)
    except FitError as error:
        return f"{key}: {error}"
    write_json(results.of(key) / FILE, dataclasses.asdict(found))
    return f"{key}: strength {found.strength:.2f}"


def main(arguments: list[str] | None = None) -> int:
    """Run the study from the command line and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--split", type=Split, choices=list(Split), default=Split.VARIED,
                        metavar="varied|tuning|practice|earlier|judging",
                        help="which cases (default varied)")  # fmt: skip
    parser.add_argument("--families", nargs="+", choices=FAMILIES, default=list("bcdefgh"), metavar="LETTER")
    parser.add_argument("--out", type=Path, default=Path("runs/hidden_effects"), help="folder of the answers")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args(arguments)
    results = ResultFolder(options.out)
    records = {key_of(record.truth): record for record in results.all_records(options.split, ["ours"])
               if _can_be_fitted(record) and record.truth.family in options.families}  # fmt: skip
    if not records:
        print(f"{options.out}: no answers of edhas diagnose to {options.split.value} cases with an effect")
        return 1
    jobs = [(record.truth, results) for key, record in records.items() if not (results.of(key) / FILE).exists()]
    try:
        run_all(run_job, jobs, options.workers)
    except KeyboardInterrupt:
        print("stopped; the same command continues with the rest", file=sys.stderr)
        return 130
    cases = [
        (record.truth, record.answers["ours"], Limit(**read_json(results.of(key) / FILE)))
        for key, record in records.items()
        if (results.of(key) / FILE).exists()
    ]
    print("\nright first answers by strength: the gain of the true laws over what they leave\n")
    print("\n".join([*strength_table(cases), ""]))
    if any(limit.each for *_, limit in cases):
        print("effects named in cases with several: by what each explains in addition to the others\n")
        print("\n".join([*each_table(cases), ""]))
    wrong = [(*case, cause_of(case[2], case[1])) for case in cases if not first_is_right(case[0], case[1])]
    if options.split is not Split.JUDGING:  # there nobody looks at single answers
        for truth, answer, limit, cause in wrong:
            print(f"{case_name(truth)}: {description(truth)}: {answer.first}; strength {limit.strength:.2f}, "
                  f"{cause.value}")  # fmt: skip
    causes = " ".join(f"{cause.value}={sum(c is cause for *_, c in wrong)}" for cause in Cause)
    print(f"cases={len(cases)} right={len(cases) - len(wrong)} {causes}")
    return 0


def _is_same(drawn: Truth, stored: Truth) -> bool:
    """Whether the same effects of the same sizes are hidden."""
    pairs = zip(drawn.hidden, stored.hidden, strict=False)
    return len(drawn.hidden) == len(stored.hidden) and all(
        a.name == b.name and math.isclose(a.visible, b.visible, rel_tol=0.01) for a, b in pairs
    )


def _can_be_fitted(record: Record) -> bool:
    """Whether a case has an answer with its evidence, and what is hidden are effects, without a fault of a sensor."""
    answer = record.answers.get("ours")
    if answer is None or not answer.evidence or is_null(record.truth):
        return False
    return not any(" on " in h.name for h in record.truth.hidden)


if __name__ == "__main__":
    raise SystemExit(main())
