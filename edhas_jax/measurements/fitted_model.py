"""What a fit has said of its model, in the file that lies beside the configuration of that model."""

import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from edhas_jax.core.remark import Severity
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.comparison import Comparison
from edhas_jax.measurements.replay import Replay

RESULT_FILES = "fit.json", "diagnosis.json", "result.json"  # beside the `config.yaml` of a fitted model
BENCH_CORRECTED = "with the bench corrected"  # of residuals without what triggers, settings and sensors did
ERROR_BY_RUN, IS_CORRECTED = "error_by_run", "bench_corrected"  # keys of a result
OF_RUNS = "of_runs"  # key of a result: by run and parameter, what was estimated of the run alone


def with_values_of_runs(campaign: Campaign, model: Path | str) -> Campaign:
    """A campaign whose runs have, as conditions, what was estimated of them together with a model.

    Args:
        campaign: the campaign.
        model: file of the configuration of the model; the result of its fit lies beside it.

    Returns:
        The campaign; itself where there is no such result, or the runs have nothing of their own.
    """
    for file, found in _results_beside(model):
        try:
            own = {run: {n: float(row["value"]) for n, row in rows.items()} for run, rows in found[OF_RUNS].items()}
        except (ValueError, KeyError, TypeError, AttributeError):
            continue
        known = {run.whole: own.get(run.whole, {}).keys() & run.uncertain.keys() for run in campaign.runs}
        if not any(known.values()):
            return campaign
        conditions = [r.conditions | {n: own[r.whole][n] for n in known[r.whole]} for r in campaign.runs]
        runs = (dataclasses.replace(r, conditions=c) for r, c in zip(campaign.runs, conditions, strict=True))
        names = ", ".join(sorted(set().union(*known.values())))
        sentence = f"{names}: the values of the runs are those that were estimated with the model ({file.name})"
        remarks = (*campaign.remarks, campaign.remark(Severity.NOTE, sentence))
        return dataclasses.replace(campaign, runs=tuple(runs), remarks=remarks)
    return campaign


def bench_corrected_errors(comparison: Comparison, model: Path | str) -> dict[str, dict[str, float]]:
    """Residual over noise by run and signal with the bench corrected, as the fit of a model has left it.

    Args:
        comparison: of this model with the measurements.
        model: file of the configuration of the model; the result of its fit lies beside it.

    Returns:
        The errors of the runs and signals of the comparison; empty where there is no such result, where nothing of the
        bench was estimated with the model, and where a measured signal drives it.
    """
    for _, found in _results_beside(model) if comparison.replay is Replay.SET_POINT else ():
        try:
            if found[IS_CORRECTED]:
                errors = {run: found[ERROR_BY_RUN].get(run, {}) for run in comparison.rms_over_noise()}
                return {run: {n: float(v) for n, v in row.items() if v is not None} for run, row in errors.items()}
        except (KeyError, TypeError, ValueError, AttributeError):
            continue
    return {}


def _results_beside(model: Path | str) -> Iterator[tuple[Path, dict[str, Any]]]:
    """The readable results that lie beside the configuration of a model, with their paths."""
    path = Path(model)
    for name in RESULT_FILES if path.name == "config.yaml" else (f"{path.stem}.json", f"{path.stem}.runs.json"):
        file = path.with_name(name)
        try:
            found = json.loads(file.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            continue
        if isinstance(found, dict):
            yield file, found
