"""The conclusions of a diagnosis as sentences, the verdict first."""

import math

import numpy as np

from edhas_jax.core.units import format_quantity, format_with_error
from edhas_jax.diagnosis.calibration.confounding import model_error_sentence, weak_combinations
from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.laws.curve_onset import is_smooth, onset
from edhas_jax.diagnosis.likelihood.bench_deviations import DeviationKind
from edhas_jax.diagnosis.likelihood.bench_estimate import EstimatedDeviation
from edhas_jax.diagnosis.search.candidates import Candidate
from edhas_jax.diagnosis.search.curve_candidate import CurveCandidate
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit
from edhas_jax.diagnosis.search.law_deviation import deviation_of
from edhas_jax.diagnosis.search.outcome import MUCH_LEFT, Outcome
from edhas_jax.diagnosis.search.result import Diagnosis, Verdict
from edhas_jax.diagnosis.search.trial import Trial
from edhas_jax.measurements.campaign import Use

# units of deviations; the other kinds are relative
DEVIATION_UNITS = {DeviationKind.TRIGGER: "s", DeviationKind.CLOCK: "s", DeviationKind.SHIFT: "s"}
MAX_ACCURACIES, MOST_EXCESSIVE = 3.0, 3  # of a deviation of the bench: beyond them it is no usual one; sentences
MIN_UNPREDICTABLE = 0.02  # of the noise of a signal: less of it is not named
MIN_PROBABLE = 0.5  # of an effect that is possible; one that was removed and is less probable is not named
MIN_NAMED_SHARE = 1e-4  # of a signal's rms, left unexplained, below which the signal is not named

MOST_LEFT = 0.5  # of the residual over noise before the search: an answer that leaves more explains little
MOST_RUNS = 3  # that are named as those in which it is left

CORRECTED = (
    "The residuals of fitted models are those after correction of the estimated deviations of the bench (triggers, "
    "settings, sensors), which `edhas compare` does not correct."
)


def conclusions(diagnosis: Diagnosis) -> list[str]:
    """The result in sentences, the verdict first."""
    use, rms = _judged(diagnosis)
    runs = "held-out runs" if use is Use.HOLDOUT else "the fitted runs (none is held out)"
    runs = "the held-out part of the runs" if diagnosis.holdout_split else runs
    left, out = what_is_left(diagnosis), []
    if diagnosis.verdict is Verdict.ADEQUATE:
        out += [_adequate_sentence(diagnosis), *left]
    elif diagnosis.verdict is Verdict.UNKNOWN_EFFECT:
        out += [*_unknown_effect_sentences(diagnosis, use, runs), *left]
    else:
        named = [t.candidate for t in diagnosis.named]
        sizes = " and ".join(f"{t.candidate.name} ({_parameters_text(diagnosis, t)})" for t in diagnosis.named)
        one = len(named) == 1
        if explains_little(diagnosis):
            explain = "explains" if one else "explain"
            out.append(f"The cause was not found: {sizes} {explain} more than all else that was tried, but little.")
        else:
            out.append(f"{sizes} {'is' if one else 'are'} missing.")
        out += left
        out += [
            f"{t.candidate.name} improves the model too, but is {found.value}: it may stand in for several small "
            "causes."
            for t in diagnosis.accepted
            if (found := outcome(diagnosis, t.candidate)) is not Outcome.MISSING
        ]
        out += _law_sentences(diagnosis)
        out += _removed_sentences(diagnosis)
    if len(diagnosis.answer.members) > 1:
        parts = [f"{name} {diagnosis.answer.probabilities[name]:.2f}" for name in diagnosis.answer.members]
        out.append(f"Not ruled out, with their probabilities: {', '.join(parts)}.")
    for group in diagnosis.confounded_groups():
        names = " and ".join(candidate.name for candidate in group)
        out.append(f"These runs cannot distinguish {names}.")
    with_more = diagnosis.accepted and diagnosis.verdict is not Verdict.ADEQUATE
    out.append(
        f"Residual over noise on {runs}: {rms[0]:.2f} as it was, {rms[1]:.2f} calibrated"
        + (f", {rms[2]:.2f} with {' and '.join(t.candidate.name for t in diagnosis.accepted)}." if with_more else ".")
    )
    if diagnosis.after.bench.has_deviations:
        out[-1] += f" {CORRECTED}"
    out += [diagnosis.holdout_split] if diagnosis.holdout_split else []
    return out + excessive_deviations(diagnosis) + uncertainty_sentences(diagnosis)


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
    of = f"{after:.3g} of {calibrated:.3g}" if diagnosis.accepted else f"{after:.3g}"
    return [f"{of} times the noise is left, {share} in {worst.replace('_', ' ')} (first of all in {', '.join(runs)})."]


def excessive_deviations(diagnosis: Diagnosis) -> list[str]:
    """A sentence on each of the largest deviations of the bench that are larger than their accuracy allows.

    One sentence says what no bench does at all.
    """
    deviations = diagnosis.bench_deviations()
    rows = zip(bench_rows(diagnosis), (row for row in deviations if row.is_possible), strict=True)
    names = [
        f"{_deviation_name(row)} ({100.0 * row.value * row.deviation.std:+.2g} %)"
        for row in deviations
        if not row.is_possible
    ]
    impossible = [
        f"Part of what the model leaves is taken up by corrections that no bench needs: {', '.join(names)}. They are "
        "no deviations of the bench, but stand in for something that the model lacks."
    ] if names else []  # fmt: skip
    return impossible + [
        f"{what}{'' if run == 'all' else f' of {run}'}: {size}, more than {MAX_ACCURACIES:.0f} times its accuracy of "
        f"{accuracy}. Either the bench is less accurate than that (`accuracy:` of the campaign), or this stands in for "
        "something that the model lacks."
        for (what, run, size, accuracy), row in rows
        if abs(row.value) > MAX_ACCURACIES
    ][:MOST_EXCESSIVE]


def uncertainty_sentences(diagnosis: Diagnosis) -> list[str]:
    """What the data do not determine, and what the standard errors take for granted."""
    rms = diagnosis.errors()["after"]["fit"].get("overall", math.nan)
    larger = model_error_sentence(rms)
    curves = {name for law in diagnosis.laws for name in law.value_names}  # drawn with their own errors
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


def bench_rows(diagnosis: Diagnosis) -> list[tuple[str, str, str, str]]:
    """What the bench did: the clear deviations as texts of what, run, size with standard error, and accuracy.

    Those that no bench has are not among them.
    """
    rows, signals = [], diagnosis.campaign.machine.signals
    for row in diagnosis.bench_deviations():
        deviation = row.deviation
        if not row.is_possible:
            continue
        unit = DEVIATION_UNITS.get(deviation.kind, "-")
        unit = signals[deviation.name].unit if deviation.kind is DeviationKind.OFFSET else unit
        size, error = row.value * deviation.std, row.std * deviation.std
        texts = format_with_error(size, error, unit), format_quantity(deviation.std, unit)
        if unit == "-" and deviation.kind is not DeviationKind.OFFSET:
            texts = f"{100.0 * size:+.2g} ± {100.0 * error:.1g} %", f"{100.0 * deviation.std:.2g} %"
        rows.append((_deviation_name(row), row.run or "all", *texts))
    return rows


def _deviation_name(row: EstimatedDeviation) -> str:
    return " ".join(part for part in (row.deviation.kind.value, row.deviation.name.replace("_", " ")) if part)


def _adequate_sentence(diagnosis: Diagnosis) -> str:
    """To how many per cent of each signal the model is adequate."""
    shares = {name: share for name, share in diagnosis.unexplained_shares().items() if share > MIN_NAMED_SHARE}
    if diagnosis.left <= 0.0 or not shares:
        return "Nothing is missing: with its uncertain parameters fitted, the model is as good as the sensors."
    parts = [f"{100.0 * share:.2g} % of {name}" for name, share in sorted(shares.items(), key=lambda i: -i[1])]
    return (
        f"The model is adequate to {', '.join(parts)} (rms): with its uncertain parameters fitted, what is left "
        "has no single cause that these runs show."
    )


def _law_sentences(diagnosis: Diagnosis) -> list[str]:
    """Which effects do not follow the law of the library, and what their parameters are then."""
    tests, out = {member.candidate: member for member in diagnosis.members}, []
    for trial in diagnosis.accepted:
        test, name = tests.get(trial.candidate), trial.candidate.name
        has_curve = _model_without_curve(diagnosis, trial) is not None
        if test is None or not (test.law_differs or has_curve):
            continue
        fall = f"χ² by {2.0 * test.law_gain:.3g} more"
        differs = f"{name} acts by another law than that of the library: a deviation from it lowers {fall}."
        unclear = (
            f"A curve is added to the law of {name}. It lowers {fall}, which is little compared with what is left: it "
            "may stand in for other causes."
        )
        alone = f" The parameters of {name} are those of a fit with the library's law alone." if has_curve else ""
        out.append(f"{differs if test.law_differs else unclear}{alone}")
    return out


def _onset_sentence(trial: Trial) -> str | None:
    """At which level a free curve begins; None where it does not begin at one."""
    if not isinstance(trial.candidate, CurveCandidate) or trial.evaluated is None:
        return None
    table, place = trial.candidate.table(trial.evaluated.fit), trial.candidate.place
    level = onset(table.nodes, table.values)
    if level is None or not is_smooth(table.values):
        return None
    name, place_name = (text.replace("_", " ") for text in (place.variable, place.slot))
    shown = format_quantity(float(f"{level:.2g}"), place.variable_unit)
    what = f"The curve over {name} as {place_name} begins at {shown}"
    return f"{what}: hardly anything acts below it, more and more above."


def _rough_sentence(trial: Trial) -> str | None:
    """That a free curve is no law because it is not smooth; None where it is smooth."""
    if not isinstance(trial.candidate, CurveCandidate) or is_smooth(trial.candidate.table(trial.evaluated.fit).values):
        return None
    return (
        "This curve is no law of one cause: it is not smooth, its values at neighbouring points differ as much as at "
        "distant ones."
    )


def _unknown_effect_sentences(diagnosis: Diagnosis, use: Use, runs: str) -> list[str]:
    """Where an unknown effect acts, the best free curve there, and accepted candidates at their prior bound."""
    component = next(iter(diagnosis.location_probabilities()), "the machine").replace("_", " ")
    out = [f"Something is missing that no effect of the library explains; most likely it acts on {component}."]
    if (best := diagnosis.best_free_trial) is not None:
        out.append(
            f"What explains most of it is {best.candidate.text}; with it, residual over noise on {runs} is "
            f"{best.evaluated.rms_over_noise(use):.2f}."
        )
        out += [] if (rough := _rough_sentence(best)) is None else [rough]
        if diagnosis.campaign.machine.is_own:
            out += [sentence for trial in diagnosis.free_trials if (sentence := _onset_sentence(trial)) is not None]
    for member in diagnosis.members:
        for name in member.implausible:
            u = member.candidate.own_unknowns(diagnosis.final.problem.unknowns)[name]
            value = format_quantity(diagnosis.final.values[u.name], u.unit)
            out.append(f"{member.candidate.name} only imitates it: its {name} would have to be {value} or beyond.")
    return out


def model_with(diagnosis: Diagnosis, trial: Trial) -> EvaluatedFit | None:
    """The final model if it contains the candidate of a trial, else the model of the trial; None if that has failed."""
    return diagnosis.after if is_in_final_model(diagnosis, trial.candidate) else trial.evaluated


def fit_of_parameters(diagnosis: Diagnosis, trial: Trial) -> Fit | None:
    """The fit from which the stated parameters of a candidate are taken; None if its trial has failed.

    It is the fit of the model that `model_with` returns. Where the final model adds a curve to the law of the
    candidate, it is the fit of the trial, which has no curve: the measurements determine the sum of law and curve, but
    hardly how it is divided between the two.
    """
    model = _model_without_curve(diagnosis, trial) or model_with(diagnosis, trial)
    return None if model is None else model.fit


def _model_without_curve(diagnosis: Diagnosis, trial: Trial) -> EvaluatedFit | None:
    """The model of a trial, where the final model has a curve beside the law of its candidate that this one has not."""
    curve = deviation_of(trial.candidate, diagnosis.laws)
    if curve is None or trial.evaluated is None:
        return None
    return None if curve.id in [e.id for e in trial.evaluated.fit.machine.effects] else trial.evaluated


def is_in_final_model(diagnosis: Diagnosis, candidate: Candidate) -> bool:
    """Whether the final model contains a candidate."""
    return candidate in [t.candidate for t in diagnosis.accepted]


def outcome(diagnosis: Diagnosis, candidate: Candidate) -> Outcome:
    """What the search has done with a candidate that it has fitted."""
    if is_in_final_model(diagnosis, candidate):
        names_any = diagnosis.verdict not in (Verdict.ADEQUATE, Verdict.UNKNOWN_EFFECT)
        if names_any and candidate in [t.candidate for t in diagnosis.named]:
            return Outcome.MISSING
        implausible = {m.candidate for m in diagnosis.members if m.implausible}
        if diagnosis.verdict is Verdict.UNKNOWN_EFFECT and candidate in implausible:
            return Outcome.IMITATING
        p = diagnosis.answer.probabilities.get(candidate.name, 0.0)
        return Outcome.POSSIBLE if p > MIN_PROBABLE else Outcome.UNLIKELY
    return Outcome.REMOVED if candidate in [test.candidate for _, test in diagnosis.rejected] else Outcome.TRIED


def _removed_sentences(diagnosis: Diagnosis) -> list[str]:
    """The effects that were removed from the model although they act more probably than not."""
    removed = {test.candidate: test for _, test in diagnosis.rejected}
    return [
        f"{candidate.name} was removed from the model, although its probability is {p:.2f}: its gain is only "
        f"{test.strength:.2g} times the misfit that remains with it, so that these runs do not decide whether it acts."
        for candidate, test in removed.items()
        if outcome(diagnosis, candidate) is Outcome.REMOVED
        and (p := diagnosis.answer.probabilities.get(candidate.name, 0.0)) > MIN_PROBABLE
    ]


def _parameters_text(diagnosis: Diagnosis, accepted: Trial) -> str:
    """The stated parameters of an accepted candidate, with their standard errors."""
    fit, candidate = fit_of_parameters(diagnosis, accepted), accepted.candidate
    own = candidate.own_unknowns(fit.problem.unknowns)
    return ", ".join(f"{n} {fit.text(u.name, candidate.unit(u, fit.problem.machine))}" for n, u in own.items())
