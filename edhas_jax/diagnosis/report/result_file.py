"""A diagnosis as a file that programs read, and as the configuration of the model that it leaves behind."""

from pathlib import Path
from typing import Any

from edhas_jax.config.run_folder import replace_nonfinite, write_json
from edhas_jax.config.writer import dump_config
from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.calibration.result import CONFIG_FILE, estimates_as_json
from edhas_jax.diagnosis.search.candidates import Suspect
from edhas_jax.diagnosis.search.result import Diagnosis, Verdict
from edhas_jax.diagnosis.search.trial import Trial
from edhas_jax.measurements.campaign import Use
from edhas_jax.measurements.residuals import rms_by_signal
from edhas_jax.simulation.run import Simulation

RESULT = "diagnosis.json"
VERSION = 1  # of the schema in docs/diagnosis.md
LISTED = 0.001  # probability below which a candidate without a trial is not listed


def save_diagnosis(diagnosis: Diagnosis, folder: Path, next_experiment: dict[str, Any] | None = None) -> None:
    """Write `diagnosis.json` and `config.yaml`, the model with what was accepted, into a folder that exists."""
    campaign, final = diagnosis.campaign, diagnosis.final
    rate = 1.0 / min(run.interval for run in campaign.runs)
    head = f"# {campaign.name}, as diagnosed by `edhas diagnose`; before the conditions of any run are set\n"
    if final.instruments.chains:
        chains = final.instruments.chains.items()
        names = ", ".join(f"{link.id} on {signal}" for signal, chain in chains for link in chain)
        head += f"# what is wrong with a sensor is not part of the machine: {names}\n"
    text = head + dump_config(final.machine, Simulation(sample_rate=rate))
    (folder / CONFIG_FILE).write_text(text, encoding="utf-8")
    write_json(folder / RESULT, replace_nonfinite(as_json(diagnosis, next_experiment)))


def as_json(diagnosis: Diagnosis, next_experiment: dict[str, Any] | None = None) -> dict[str, Any]:
    """The diagnosis as plain data; values in SI."""
    final = diagnosis.final
    known = [u.name for u in final.problem.unknowns if "." not in u.name]
    return {
        "version": VERSION,
        "campaign": diagnosis.campaign.name,
        "verdict": diagnosis.verdict.value,
        "effects": [t.suspect.id for t in diagnosis.accepted],
        "candidates": [
            _candidate(diagnosis, suspect, p, trial)
            for suspect, p, trial in diagnosis.candidates()
            if trial is not None or p > LISTED
        ],
        "groups": [[suspect.id for suspect in group] for group in diagnosis.groups()],
        "where": [{"slot": part, "probability": p} for part, p in diagnosis.where().items()],
        "form": _form(diagnosis),
        "calibrated": {n: v for n, v in estimates_as_json(final).items() if n in known},
        "error": diagnosis.errors(),
        "next_experiment": next_experiment,
        "seconds": diagnosis.seconds,
    }


def _candidate(diagnosis: Diagnosis, suspect: Suspect, probability: float, trial: Trial | None) -> dict[str, Any]:
    out: dict[str, Any] = {"effect": suspect.id}
    if suspect.signal is not None:
        out["signal"] = suspect.signal
    accepted = suspect in [t.suspect for t in diagnosis.accepted]
    judged = diagnosis.after if accepted else trial.judged if trial is not None else None
    return out | {
        "slot": suspect.where,
        "accepted": accepted,
        "probability": probability,
        "parameters": {} if judged is None else _own(judged.fit, suspect),
        "holdout_error": None if judged is None else judged.level(Use.HOLDOUT),
        "gain": None if trial is None else trial.gain,
        "gain_on_new_runs": None if trial is None else trial.gain_on_new,
    }


def _own(fit: Fit, suspect: Suspect) -> dict[str, Any]:
    """A suspect's own parameters as fitted."""
    every = estimates_as_json(fit)
    return {name: every[u.name] for name, u in suspect.own(fit.problem.unknowns).items()}


def _form(diagnosis: Diagnosis) -> dict[str, Any] | None:
    """The formula that explains most of what no effect of the library explains."""
    if diagnosis.verdict is not Verdict.UNKNOWN_EFFECT or not diagnosis.forms:
        return None
    best = diagnosis.forms[0]
    if best.judged is None:
        return None
    return {
        "slot": best.suspect.where,
        "enters": best.suspect.kind.slots[0].name,
        "unit": best.suspect.kind.slots[0].unit,
        "formula": f"c · {best.suspect.kind.text}",
        "parameters": _own(best.judged.fit, best.suspect),
        "holdout_error": best.judged.level(Use.HOLDOUT),
        "error": rms_by_signal(diagnosis.campaign, best.judged.residuals, Use.HOLDOUT),
    }
