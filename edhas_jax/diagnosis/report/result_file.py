"""Files of a diagnosis: the result as JSON, and the final model as a configuration."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from edhas_jax.config.law_file import write_law_file
from edhas_jax.config.run_folder import replace_nonfinite, write_json
from edhas_jax.core.literal_text import file_name
from edhas_jax.diagnosis.candidates.candidate import Candidate
from edhas_jax.diagnosis.candidates.free_curve import CurveCandidate
from edhas_jax.diagnosis.candidates.memory_term import FREQUENCIES, TIMES, OscillatorTerm
from edhas_jax.diagnosis.report.bench_findings import clear_deviations
from edhas_jax.diagnosis.report.conclusions import conclusions, evidence_text, explains_little, outcome, what_is_left
from edhas_jax.diagnosis.search.member_laws import MemberLaw
from edhas_jax.diagnosis.search.result import Diagnosis
from edhas_jax.inference.fit.calibration import CONFIG_FILE, estimates_as_json, values_of_runs_as_json
from edhas_jax.inference.fit.confounding import confounding_as_json, weak_combinations
from edhas_jax.inference.fit.evaluated_fit import EvaluatedFit
from edhas_jax.inference.fit.fit import Fit
from edhas_jax.inference.fit.model_file import write_model_file
from edhas_jax.measurements.campaign import Use
from edhas_jax.measurements.checks.data_summary import data_as_json
from edhas_jax.measurements.fitted_model import ERROR_BY_RUN, IS_CORRECTED, OF_RUNS
from edhas_jax.measurements.residuals import rms_by_run

RESULT, CALIBRATED_CONFIG_FILE = "diagnosis.json", "config_calibrated.yaml"
CALIBRATED_FILE = "config_calibrated.json"  # of that model: what runs have of their own, and its errors by run
VERSION = 3  # of the schema in docs/diagnosis.md; 2 had the gains of trials in place of sets of effects
MIN_LISTED_PROBABILITY = 0.001  # of a name or a set


def save_diagnosis(
    diagnosis: Diagnosis, folder: Path, next_experiment: dict[str, Any] | None = None, failures: Sequence[str] = ()
) -> None:
    """Write `diagnosis.json`, the model with the most probable set of effects as `config.yaml`, and that without any.

    Its curves are written as files of tabulated laws, which `config.yaml` names.

    Args:
        diagnosis: the result to write.
        folder: an existing folder.
        next_experiment: the recommended run as plain data.
        failures: a sentence on each optional part of the result that could not be made.
    """
    write_json(folder / RESULT, replace_nonfinite(as_json(diagnosis, next_experiment, failures)))
    final, term = diagnosis.final, diagnosis.free_term
    remark = ", as diagnosed by `edhas diagnose`; before the conditions of any run are set"
    if final.instruments.chains:
        chains = final.instruments.chains.items()
        names = ", ".join(f"{link.id} on {signal}" for signal, chain in chains for link in chain)
        remark += f"\n# sensor faults are not part of the machine: {names}"
    curves, without = [*diagnosis.curves], set()
    if isinstance(term, CurveCandidate):
        curves.append(term)
    elif term is not None:
        without = {term.id}
        remark += f"\n# without {term.text}, which no configuration can hold"
    for curve in curves:
        write_law_file(folder / _law_file(curve), curve.table(final, "estimated by `edhas diagnose`"))
    write_model_file(folder / CONFIG_FILE, final, remark, {c.id: _law_file(c) for c in curves}, without=without)
    remark = ", as calibrated by `edhas diagnose`; before the conditions of any run are set"
    write_model_file(folder / CALIBRATED_CONFIG_FILE, diagnosis.calibrated.fit, remark)
    write_json(folder / CALIBRATED_FILE, replace_nonfinite(_of_runs(diagnosis, diagnosis.calibrated)))


def as_json(
    diagnosis: Diagnosis, next_experiment: dict[str, Any] | None = None, failures: Sequence[str] = ()
) -> dict[str, Any]:
    """The diagnosis as plain data, values in SI; schema in docs/diagnosis.md."""
    final, posterior = diagnosis.final, diagnosis.posterior
    uncertain = {u.name for u in diagnosis.calibrated.fit.problem.unknowns}
    return {
        "version": VERSION,
        "campaign": diagnosis.campaign.name,
        "data": data_as_json(diagnosis.campaign),
        "verdict": diagnosis.verdict.value,
        "conclusions": conclusions(diagnosis),
        "effects": [candidate.id for candidate in diagnosis.named],
        "candidates": [_candidate_data(diagnosis, candidate, p) for candidate, p in posterior.candidates()],
        "sets": [
            {
                "members": [c.name for c in of.members], "probability": weight, "log_weight": of.log_weight,
                "error": {use.value: of.evaluated.rms_over_noise(use) for use in Use},
            }
            for of, weight in zip(posterior.sets, posterior.weights, strict=True)
            if weight > MIN_LISTED_PROBABILITY
        ],
        "answer": {
            "first": diagnosis.first,
            "set": list(posterior.credible),
            "probabilities": {n: p for n, p in posterior.probabilities.items() if p > MIN_LISTED_PROBABILITY},
        },
        "laws": [_law_data(law) for law in diagnosis.laws],
        "bench": _bench_data(diagnosis),
        "left_unexplained": diagnosis.unexplained_shares(),
        "explains_little": explains_little(diagnosis),
        "left": next(iter(what_is_left(diagnosis)), None),
        "groups": [[candidate.id for candidate in group] for group in diagnosis.confounded_groups()],
        "where": [{"slot": name, "probability": p} for name, p in posterior.locations().items()],
        "form": _form_data(diagnosis),
        "calibrated": {n: v for n, v in estimates_as_json(final).items() if n in uncertain},
        **confounding_as_json(weak_combinations(final), diagnosis.assumed),
        "error": diagnosis.errors(),
        **_of_runs(diagnosis, diagnosis.after),
        "next_experiment": next_experiment,
        "holdout_split": diagnosis.holdout_split or None,
        "failed_parts": list(failures),
        "seconds": diagnosis.seconds,
    }  # fmt: skip


def _of_runs(diagnosis: Diagnosis, model: EvaluatedFit) -> dict[str, Any]:
    """What the runs have of their own in a fitted model, and its residual over noise by run and signal."""
    return {
        OF_RUNS: values_of_runs_as_json(model.fit),
        ERROR_BY_RUN: rms_by_run(diagnosis.campaign, model.residuals),
        IS_CORRECTED: model.bench.has_deviations,
    }


def _law_data(law: MemberLaw) -> dict[str, Any]:
    """Whether the law of an effect differs from that of the library, and the file with its deviation."""
    return {
        "effect": law.candidate.id, "signal": law.candidate.signal,
        "law": "differs" if law.differs else "as in the library", "gain_of_another": law.gain,
        "deviation_file": None if law.curve is None else _law_file(law.curve),
    }  # fmt: skip


def _bench_data(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """The significant deviations of the bench, values in SI or relative."""
    return [
        {
            "kind": row.deviation.kind.value, "name": row.deviation.name or None, "run": row.run or None,
            "value": row.value * row.deviation.std, "std": row.std * row.deviation.std, "accuracy": row.deviation.std,
            "possible": row.is_possible,
        }
        for row in clear_deviations(diagnosis.after)
    ]  # fmt: skip


def _candidate_data(diagnosis: Diagnosis, candidate: Candidate, probability: float) -> dict[str, Any]:
    out: dict[str, Any] = {"effect": candidate.id}
    if candidate.signal is not None:
        out["signal"] = candidate.signal
    gain = diagnosis.posterior.evidence(candidate)
    return out | {
        "slot": candidate.location,
        "accepted": candidate in diagnosis.named,
        "outcome": outcome(diagnosis, candidate).value,
        "probability": probability,
        "parameters": _own_estimates(diagnosis.fit_of_parameters(candidate), candidate),
        "holdout_error": diagnosis.model_with(candidate).rms_over_noise(Use.HOLDOUT),
        "gain": gain,
        "evidence": evidence_text(gain),
    }


def _own_estimates(fit: Fit, candidate: Candidate) -> dict[str, Any]:
    """The fitted parameters of a candidate."""
    fitted = estimates_as_json(fit)
    return {
        name: fitted[u.name] | {"unit": candidate.unit(u, fit.problem.machine)}
        for name, u in candidate.own_unknowns(fit.problem.unknowns).items()
    }


def _form_data(diagnosis: Diagnosis) -> dict[str, Any] | None:
    """The free term of the best set, for what no effect of the library explains; None where it has none."""
    term, fitted = diagnosis.free_term, diagnosis.final
    if term is None:
        return None
    place = term.place
    out = {
        "slot": term.location, "enters": place.slot, "variable": place.variable, "factors": list(place.factors),
        "formula": term.text,
    }  # fmt: skip
    if not isinstance(term, CurveCandidate):
        parts = {"frequencies": list(FREQUENCIES)} if isinstance(term, OscillatorTerm) else {"times": list(TIMES)}
        return out | parts | {"parameters": _own_estimates(fitted, term)}
    table = term.table(fitted)
    return out | {
        "unit": place.value_unit, "nodes": table.nodes.tolist(), "values": table.values.tolist(),
        "std": table.std.tolist(), "file": _law_file(term),
    }  # fmt: skip


def _law_file(curve: CurveCandidate) -> str:
    """The name of the file with a curve as a tabulated law."""
    return f"{file_name(curve.id)}.yaml"
