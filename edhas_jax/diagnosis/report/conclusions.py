"""The conclusions of a diagnosis in words: sentences, the verdict first, and what it says of each candidate."""

import enum
import math

import numpy as np

from edhas_jax.core.units import format_quantity
from edhas_jax.diagnosis.candidates.candidate import Candidate
from edhas_jax.diagnosis.candidates.free_curve import CurveCandidate
from edhas_jax.diagnosis.laws.curve_onset import is_smooth, onset
from edhas_jax.diagnosis.report.bench_findings import excessive_deviations
from edhas_jax.diagnosis.search.result import Diagnosis, Verdict
from edhas_jax.inference.fit.confounding import model_error_sentence, weak_combinations
from edhas_jax.inference.fit.evaluated_fit import MUCH_LEFT
from edhas_jax.measurements.campaign import Use
from edhas_jax.measurements.fitted_model import BENCH_CORRECTED

MIN_UNPREDICTABLE = 0.02  # of the noise of a signal: less of it is not named
MIN_PROBABLE = 0.5  # of a member of the best set; below it a sentence says that it may stand in for something else
MIN_NAMED_SHARE = 1e-4  # of a signal's rms, left unexplained, below which the signal is not named

MOST_LEFT = 0.5  # of the residual over noise before the search: an answer that leaves more explains little
MOST_RUNS = 3  # that are named as those in which it is left

CORRECTED = (
    f"The residuals of fitted models are those {BENCH_CORRECTED}: without what triggers, settings and sensors did. "
    "`edhas compare --model` shows both."
)

# log evidence [nats] below which it is called so
EVIDENCE_WORDS = ((3.0, "weak"), (12.0, "clear"), (100.0, "strong"), (math.inf, "overwhelming"))
RAISED = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")


class Outcome(enum.Enum):
    """What a diagnosis says of a candidate that it has fitted."""

    MISSING = "missing"  # it is in the best set
    POSSIBLE = "possibly missing"  # it is in a set that the measurements do not tell from the best one
    TRIED = "tried"  # it is in less probable sets only

    @property
    def is_quiet(self) -> bool:
        """Whether it is shown in grey: it is probably nothing."""
        return self is Outcome.TRIED


def conclusions(diagnosis: Diagnosis) -> list[str]:
    """The result in sentences, the verdict first."""
    use, rms = _judged(diagnosis)
    runs = "held-out runs" if use is Use.HOLDOUT else "the fitted runs (none is held out)"
    runs = "the held-out part of the runs" if diagnosis.holdout_split else runs
    left = [*what_is_left(diagnosis), *_worse_sentence(diagnosis)]
    if diagnosis.verdict is Verdict.ADEQUATE:
        out = [_adequate_sentence(diagnosis), *left]
    elif diagnosis.verdict is Verdict.UNKNOWN_EFFECT:
        out = [_unknown_sentence(diagnosis), *_free_term_sentences(diagnosis, "What explains most of it"), *left]
        out += [f"Beside it, {c.name} ({parameters_text(diagnosis, c)}) improves the model." for c in diagnosis.named]
    else:
        out = [_names_sentence(diagnosis), *left, *_doubt_sentences(diagnosis), *_law_sentences(diagnosis)]
        out += _free_term_sentences(diagnosis, "Beside it acts what no effect of the library explains; nearest to it")
    credible, p = diagnosis.posterior.credible, diagnosis.posterior.probabilities
    if len(credible) > 1:
        out.append(f"Not ruled out, with their probabilities: {', '.join(f'{n} {p[n]:.2f}' for n in credible)}.")
    for group in diagnosis.confounded_groups():
        names = " and ".join(candidate.name for candidate in group)
        out.append(f"These runs cannot distinguish {names}.")
    members = [*(c.name for c in diagnosis.named), *([] if diagnosis.free_term is None else [diagnosis.free_term.text])]
    out.append(
        f"Residual over noise on {runs}: {rms[0]:.2f} as it was, {rms[1]:.2f} calibrated"
        + (f", {rms[2]:.2f} with {' and '.join(members)}." if members else ".")
    )
    if diagnosis.after.bench.has_deviations:
        out[-1] += f" {CORRECTED}"
    out += [diagnosis.holdout_split] if diagnosis.holdout_split else []
    return out + excessive_deviations(diagnosis.after) + uncertainty_sentences(diagnosis)


def _judged(diagnosis: Diagnosis) -> tuple[Use, list[float]]:
    """The runs by which a result is judged, and residual over noise there: as it was, calibrated, final model."""
    use = Use.HOLDOUT if diagnosis.campaign.runs_for(Use.HOLDOUT) else Use.FIT
    errors = diagnosis.errors()
    return use, [errors[state][use.value].get("overall", math.nan) for state in ("before", "calibrated", "after")]


def explains_little(diagnosis: Diagnosis) -> bool:
    """Whether an answer that names something leaves most of the misfit."""
    if diagnosis.verdict in (Verdict.ADEQUATE, Verdict.UNKNOWN_EFFECT):
        return False
    _, (_, calibrated, after) = _judged(diagnosis)
    return not (after <= MUCH_LEFT or after <= MOST_LEFT * calibrated)


def what_is_left(diagnosis: Diagnosis) -> list[str]:
    """A sentence on what the final model leaves, and in which signal and runs; none where that is not much."""
    use, (_, calibrated, after) = _judged(diagnosis)
    if after <= MUCH_LEFT:
        return []
    squares: dict[str, dict[str, float]] = {}
    for run in diagnosis.campaign.runs_for(use) or diagnosis.campaign.runs:
        for signal, values in diagnosis.after.residuals[run.name].items():
            squares.setdefault(signal, {})[run.name] = float(np.nansum(np.square(values)))
    totals = {signal: sum(of_runs.values()) for signal, of_runs in squares.items()}
    worst = max(totals, key=totals.__getitem__)
    share = "most of it" if totals[worst] > 0.5 * sum(totals.values()) else "the largest part"
    runs = sorted(squares[worst], key=lambda run: -squares[worst][run])[:MOST_RUNS]
    of = f"{after:.3g} of {calibrated:.3g}" if diagnosis.posterior.best.members else f"{after:.3g}"
    return [f"{of} times the noise is left, {share} in {worst.replace('_', ' ')} (first of all in {', '.join(runs)})."]


def _worse_sentence(diagnosis: Diagnosis) -> list[str]:
    """That the final model predicts worse than the calibrated one; none where it does not."""
    use, (_, calibrated, after) = _judged(diagnosis)
    if use is not Use.HOLDOUT or not after > calibrated or not diagnosis.posterior.best.members:
        return []
    return [
        f"On the held-out runs this model is worse than the calibrated one ({after:.2f} against {calibrated:.2f} times "
        "the noise): it shows where something is missing, but does not predict."
    ]


def uncertainty_sentences(diagnosis: Diagnosis) -> list[str]:
    """What the data do not determine, and what the standard errors take for granted."""
    rms = diagnosis.errors()["after"]["fit"].get("overall", math.nan)
    larger = model_error_sentence(rms)
    curves = {name for curve in _mounted_curves(diagnosis) for name in curve.coefficient_names}  # drawn with errors
    combinations = [c.sentence() for c in weak_combinations(diagnosis.final) if not set(c.changes) <= curves]
    return [
        *([] if larger is None else [larger]), *_unpredictable_sentences(diagnosis), *combinations,
        *(a.sentence() for a in diagnosis.assumed),
    ]  # fmt: skip


def _unpredictable_sentences(diagnosis: Diagnosis) -> list[str]:
    """What the model cannot predict because its signals depend irregularly on its parameters."""
    campaign = diagnosis.campaign
    parts = [
        f"{format_quantity(size, campaign.machine.signals[name].unit)} of {name}"
        for name, size in campaign.unpredictable.items()
        if size > MIN_UNPREDICTABLE * campaign.channels[name].noise
    ]
    if not parts:
        return []
    return [
        "Runs with almost the same parameters part after a while, as where valves bounce or a friction sticks. What "
        f"no estimate of the parameters can predict counts as noise: {', '.join(parts)} (rms)."
    ]


def _adequate_sentence(diagnosis: Diagnosis) -> str:
    """To how many per cent of each signal the model is adequate."""
    shares = {name: share for name, share in diagnosis.unexplained_shares().items() if share > MIN_NAMED_SHARE}
    if diagnosis.left <= 0.0 or not shares:
        return "Nothing is missing: with its uncertain parameters fitted, the model is as good as the sensors."
    parts = [f"{100.0 * share:.2g} % of {name}" for name, share in sorted(shares.items(), key=lambda i: -i[1])]
    if what_is_left(diagnosis):
        return f"The cause was not found: nothing that was tried explains the {', '.join(parts)} (rms) that are left."
    return (
        f"The model is adequate to {', '.join(parts)} (rms): with its uncertain parameters fitted, what is left "
        "has no single cause that these runs show."
    )


def _names_sentence(diagnosis: Diagnosis) -> str:
    """The effects of the best set with their sizes."""
    sizes = " and ".join(f"{c.name} ({parameters_text(diagnosis, c)})" for c in diagnosis.named)
    one = len(diagnosis.named) == 1
    if explains_little(diagnosis):
        explain = "explains" if one else "explain"
        return f"The cause was not found: {sizes} {explain} more than all else that was tried, but little."
    return f"{sizes} {'is' if one else 'are'} missing."


def _doubt_sentences(diagnosis: Diagnosis) -> list[str]:
    """Which effects of the best set are less probable than not."""
    return [
        f"{c.name} improves the model, but its probability is only {p:.2f}: it may stand in for several small causes."
        for c in diagnosis.named
        if (p := diagnosis.posterior.probabilities[c.name]) < MIN_PROBABLE
    ]


def _unknown_sentence(diagnosis: Diagnosis) -> str:
    """Where something is missing that the library does not have, or that no curve explains it either."""
    if diagnosis.free_term is None:
        what = "it is an unknown effect, or an error of the records (clock, noise, sensors)"
        return f"Neither an effect of the library nor a curve explains what is left: {what}."
    place = diagnosis.free_term.location.replace("_", " ")
    return f"Something is missing that no effect of the library explains; most likely it acts on {place}."


def _law_sentences(diagnosis: Diagnosis) -> list[str]:
    """Which effects do not follow the law of the library, and what their parameters are then."""
    return [
        f"{law.candidate.name} acts by another law than that of the library ({evidence_text(law.gain)})."
        + ("" if law.curve is None else f" The parameters of {law.candidate.name} are those of a fit with the "
           "library's law alone.")
        for law in diagnosis.laws
        if law.differs
    ]  # fmt: skip


def _free_term_sentences(diagnosis: Diagnosis, beginning: str) -> list[str]:
    """What the free term of the best set is; none where it has none."""
    term = diagnosis.free_term
    if term is None:
        return []
    out = [f"{beginning} is {term.text}."]
    if not isinstance(term, CurveCandidate):
        return out
    table = term.table(diagnosis.final)
    if not is_smooth(table.values):
        out.append(
            "This curve is no law of one cause: it is not smooth, its values at neighbouring points differ as much as "
            "at distant ones."
        )
    elif (level := onset(table.nodes, table.values)) is not None:
        name, place = (text.replace("_", " ") for text in (term.place.variable, term.place.slot))
        shown = format_quantity(float(f"{level:.2g}"), term.place.variable_unit)
        what = f"The curve over {name} as {place} begins at {shown}"
        out.append(f"{what}: hardly anything acts below it, more and more above.")
    return out


def _mounted_curves(diagnosis: Diagnosis) -> list[CurveCandidate]:
    """The curves of the final model, which are drawn with their own errors."""
    term = diagnosis.free_term
    return [*diagnosis.curves, *([term] if isinstance(term, CurveCandidate) else [])]


def evidence_text(gain: float) -> str:
    """How strongly the runs speak for a model with something more, in words with the rounded number.

    Args:
        gain: of log evidence or log weight [nats]; NaN or infinite where there is none.
    """
    if not math.isfinite(gain) or abs(gain) < 1.0:
        return "none"
    word = "against it" if gain < 0.0 else next(word for limit, word in EVIDENCE_WORDS if gain < limit)
    return f"{word} ({_rounded(gain)} nats)"


def _rounded(value: float) -> str:
    """Two significant digits, large numbers with a power of ten: "34", "1.3·10⁶"."""
    mantissa, exponent = f"{value:.1e}".split("e")
    if int(exponent) < 4:
        return f"{float(f'{value:.2g}'):g}".replace("-", "−")
    return f"{mantissa}·10{str(int(exponent)).translate(RAISED)}".replace("-", "−")


def outcome(diagnosis: Diagnosis, candidate: Candidate) -> Outcome:
    """What the diagnosis says of a candidate that it has fitted."""
    if candidate in diagnosis.named:
        return Outcome.MISSING
    is_near = any(candidate.name in of.key for of in diagnosis.posterior.near)
    return Outcome.POSSIBLE if is_near else Outcome.TRIED


def parameters_text(diagnosis: Diagnosis, candidate: Candidate) -> str:
    """The stated parameters of a candidate, with their standard errors."""
    fit = diagnosis.fit_of_parameters(candidate)
    own = candidate.own_unknowns(fit.problem.unknowns)
    return ", ".join(f"{n} {fit.text(u.name, candidate.unit(u, fit.problem.machine))}" for n, u in own.items())
