"""Files of a diagnosis: the result as JSON, and the final model as a configuration."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from edhas_jax.config.law_file import write_law_file
from edhas_jax.config.run_folder import replace_nonfinite, write_json
from edhas_jax.core.literal_text import file_name
from edhas_jax.diagnosis.calibration.confounding import confounding_as_json, weak_combinations
from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.calibration.model_file import write_model_file
from edhas_jax.diagnosis.calibration.result import CONFIG_FILE, estimates_as_json, values_of_runs_as_json
from edhas_jax.diagnosis.search.candidates import Candidate
from edhas_jax.diagnosis.search.conclusions import (
    conclusions,
    explains_little,
    fit_of_parameters,
    is_in_final_model,
    model_with,
    outcome,
    what_is_left,
)
from edhas_jax.diagnosis.search.curve_candidate import CurveCandidate
from edhas_jax.diagnosis.search.law_deviation import LawDeviation, deviation_of
from edhas_jax.diagnosis.search.memory_term import TIMES
from edhas_jax.diagnosis.search.outcome import evidence_text
from edhas_jax.diagnosis.search.result import Diagnosis, MemberTest
from edhas_jax.diagnosis.search.trial import Trial
from edhas_jax.measurements.campaign import Use
from edhas_jax.measurements.campaign_reader import OF_RUNS
from edhas_jax.measurements.checks.data_summary import data_as_json
from edhas_jax.measurements.residuals import rms_by_signal

RESULT, CURVE_CONFIG_FILE = "diagnosis.json", "config_with_curve.yaml"
CALIBRATED_CONFIG_FILE = "config_calibrated.yaml"
VERSION = 2  # of the schema in docs/diagnosis.md
MIN_LISTED_PROBABILITY = 0.001  # candidates without a trial are listed above it


def save_diagnosis(
    diagnosis: Diagnosis, folder: Path, next_experiment: dict[str, Any] | None = None, failures: Sequence[str] = ()
) -> None:
    """Write `diagnosis.json`, the model with the accepted effects as `config.yaml`, and that before any was accepted.

    Curves of the model (deviations of accepted laws) are written as files of tabulated laws, which `config.yaml` names.
    For an unknown effect that a free curve explains best, the calibrated model with it is `config_with_curve.yaml`.

    Args:
        diagnosis: the result to write.
        folder: an existing folder.
        next_experiment: the recommended run as plain data.
        failures: a sentence on each optional part of the result that could not be made.
    """
    write_json(folder / RESULT, replace_nonfinite(as_json(diagnosis, next_experiment, failures)))
    final = diagnosis.final
    remark = ", as diagnosed by `edhas diagnose`; before the conditions of any run are set"
    if final.instruments.chains:
        chains = final.instruments.chains.items()
        names = ", ".join(f"{link.id} on {signal}" for signal, chain in chains for link in chain)
        remark += f"\n# sensor faults are not part of the machine: {names}"
    _write_model(folder / CONFIG_FILE, remark, final, diagnosis.laws)
    remark = ", as calibrated by `edhas diagnose`; before the conditions of any run are set"
    _write_model(folder / CALIBRATED_CONFIG_FILE, remark, diagnosis.calibrated.fit, ())
    best = diagnosis.best_free_trial
    if best is not None and isinstance(best.candidate, CurveCandidate):
        remark = f" with {best.candidate.text}; before the conditions of any run are set"
        _write_model(folder / CURVE_CONFIG_FILE, remark, best.evaluated.fit, [best.candidate])


def as_json(
    diagnosis: Diagnosis, next_experiment: dict[str, Any] | None = None, failures: Sequence[str] = ()
) -> dict[str, Any]:
    """The diagnosis as plain data, values in SI; schema in docs/diagnosis.md."""
    final = diagnosis.final
    uncertain = {u.name for u in diagnosis.calibrated.fit.problem.unknowns}
    return {
        "version": VERSION,
        "campaign": diagnosis.campaign.name,
        "data": data_as_json(diagnosis.campaign),
        "verdict": diagnosis.verdict.value,
        "conclusions": conclusions(diagnosis),
        "effects": [t.candidate.id for t in diagnosis.named],
        "candidates": [
            _candidate_data(diagnosis, candidate, p, trial)
            for candidate, p, trial in diagnosis.ranked_candidates()
            if trial is not None or p > MIN_LISTED_PROBABILITY
        ],
        "answer": {
            "first": diagnosis.answer.first,
            "set": list(diagnosis.answer.members),
            "probabilities": {n: p for n, p in diagnosis.answer.probabilities.items() if p > MIN_LISTED_PROBABILITY},
        },
        "laws": [_law_data(member, diagnosis.laws) for member in diagnosis.members],
        "bench": _bench_data(diagnosis),
        "left_unexplained": diagnosis.unexplained_shares(),
        "explains_little": explains_little(diagnosis),
        "left": next(iter(what_is_left(diagnosis)), None),
        "groups": [[candidate.id for candidate in group] for group in diagnosis.confounded_groups()],
        "where": [{"slot": name, "probability": p} for name, p in diagnosis.location_probabilities().items()],
        "form": _form_data(diagnosis),
        "calibrated": {n: v for n, v in estimates_as_json(final).items() if n in uncertain},
        OF_RUNS: values_of_runs_as_json(final),
        **confounding_as_json(weak_combinations(final), diagnosis.assumed),
        "error": diagnosis.errors(),
        "bench_corrected": diagnosis.after.bench.has_deviations,
        "next_experiment": next_experiment,
        "holdout_split": diagnosis.holdout_split or None,
        "failed_parts": list(failures),
        "seconds": diagnosis.seconds,
    }


def _law_data(member: MemberTest, mounted: Sequence[LawDeviation]) -> dict[str, Any]:
    """Whether the law of an accepted effect differs from that of the library, and the file with its deviation."""
    deviation = deviation_of(member.candidate, mounted)
    law = "differs" if member.law_differs else "as in the library"
    return {
        "effect": member.candidate.id, "signal": member.candidate.signal, "law": law,
        "gain_of_another": member.law_gain, "gain": member.gain, "gain_over_left": member.strength,
        "implausible": list(member.implausible),
        "deviation_file": None if deviation is None else _law_file(deviation),
    }  # fmt: skip


def _bench_data(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """The significant deviations of the bench, values in SI or relative."""
    return [
        {
            "kind": row.deviation.kind.value, "name": row.deviation.name or None, "run": row.run or None,
            "value": row.value * row.deviation.std, "std": row.std * row.deviation.std, "accuracy": row.deviation.std,
            "possible": row.is_possible,
        }
        for row in diagnosis.bench_deviations()
    ]  # fmt: skip


def _candidate_data(
    diagnosis: Diagnosis, candidate: Candidate, probability: float, trial: Trial | None
) -> dict[str, Any]:
    out: dict[str, Any] = {"effect": candidate.id}
    if candidate.signal is not None:
        out["signal"] = candidate.signal
    fitted = None if trial is None else model_with(diagnosis, trial)
    sized = None if trial is None else fit_of_parameters(diagnosis, trial)
    return out | {
        "slot": candidate.location,
        "accepted": is_in_final_model(diagnosis, candidate),
        "outcome": None if trial is None else outcome(diagnosis, candidate).value,
        "probability": probability,
        "parameters": {} if sized is None else _own_estimates(sized, candidate),
        "holdout_error": None if fitted is None else fitted.rms_over_noise(Use.HOLDOUT),
        "gain": None if trial is None else trial.log_evidence_gain,
        "evidence": None if trial is None else evidence_text(trial.log_evidence_gain),
        "gain_on_new_runs": None if trial is None else trial.holdout_half_chi_square_fall,
    }


def _own_estimates(fit: Fit, candidate: Candidate) -> dict[str, Any]:
    """The fitted parameters of a candidate."""
    fitted = estimates_as_json(fit)
    return {
        name: fitted[u.name] | {"unit": candidate.unit(u, fit.problem.machine)}
        for name, u in candidate.own_unknowns(fit.problem.unknowns).items()
    }


def _form_data(diagnosis: Diagnosis) -> dict[str, Any] | None:
    """The free term that explains most of an unknown effect; None for any other verdict."""
    best = diagnosis.best_free_trial
    if best is None:
        return None
    place, fitted = best.candidate.place, best.evaluated.fit
    out = {
        "slot": best.candidate.location, "enters": place.slot, "variable": place.variable,
        "factors": list(place.factors), "formula": best.candidate.text,
        "holdout_error": best.evaluated.rms_over_noise(Use.HOLDOUT),
        "error": rms_by_signal(diagnosis.campaign, best.evaluated.residuals, Use.HOLDOUT),
    }  # fmt: skip
    if not isinstance(best.candidate, CurveCandidate):
        return out | {"times": list(TIMES), "parameters": _own_estimates(fitted, best.candidate)}
    table = best.candidate.table(fitted)
    return out | {
        "unit": place.value_unit, "nodes": table.nodes.tolist(), "values": table.values.tolist(),
        "std": table.std.tolist(), "files": [_law_file(best.candidate), CURVE_CONFIG_FILE],
    }  # fmt: skip


def _law_file(curve: CurveCandidate) -> str:
    """The name of the file with a curve as a tabulated law."""
    return f"{file_name(curve.id)}.yaml"


def _write_model(path: Path, remark: str, fit: Fit, curves: Sequence[CurveCandidate]) -> None:
    """Write the machine of a fit as a configuration, and its curves as files of tabulated laws beside it."""
    for curve in curves:
        write_law_file(path.parent / _law_file(curve), curve.table(fit, "estimated by `edhas diagnose`"))
    write_model_file(path, fit, remark, {c.id: _law_file(c) for c in curves})
