"""The benchmark of hidden effects: how often is the effect named that was hidden in a campaign?

    python -m studies.hidden_effects [--cases N] [--seed FIRST] [--workers K] [--out DIR] [--crumbs]

Each case is a campaign of eight runs of the pump bench, made by another integrator and sensor chain than those of the
diagnosis, its parameters drawn; see `cases.py` for what is hidden and `rivals.py` for what else is asked. Cases
are numbered from `--seed` on; `SEALED` in `cases.py` says from which on they are for judging alone. Those
that are finished are kept in DIR and not done again, so that a study that was stopped goes on with the same command.

The last line: `top1=… false_alarms=… slot=… both=… unknown=… calibration=…`
"""

import argparse
import importlib.util
import json
import multiprocessing
import os
import sys
import time
from pathlib import Path
from typing import Any

from edhas_jax.core.atomic_file import atomic_write
from edhas_jax.diagnosis.search.candidates import candidates_for
from edhas_jax.diagnosis.search.forward_selection import diagnose
from edhas_jax.diagnosis.search.result import Diagnosis
from edhas_jax.diagnosis.search.trial import Trial
from studies.hidden_effects.cases import PUMP, SEALED, HiddenCase, draw_case
from studies.hidden_effects.pictures import save_pictures
from studies.hidden_effects.rates import last_line, report
from studies.hidden_effects.rivals import correlation, forward_bic, signatures, sparse_discrepancy

RENEWED = 10  # cases after which a worker is replaced: compiled programs take up memory


def run_case(number: int, crumbs: bool) -> dict[str, Any]:
    """One case, diagnosed by the package and by its rivals, as plain data."""
    case = draw_case(number, crumbs)
    library = [kind for kind in PUMP if kind not in case.struck]
    found = diagnose(case.campaign, library)
    return told(case, crumbs) | answered(found) | {"rivals": rivals(case, found, library)}


def told(case: HiddenCase, crumbs: bool) -> dict[str, Any]:
    """What was hidden."""
    hidden = [
        {
            "name": h.candidate.name,
            "slots": (
                [h.candidate.location]
                if h.candidate.signal
                else sorted({slot.location for slot in h.candidate.kind.slots})
            ),
            "values": h.values,
            "visible": h.visible,
        }
        for h in case.hidden
    ]
    return {
        "number": case.number, "family": case.family.value, "louder": case.louder, "crumbs": crumbs, "hidden": hidden
    }  # fmt: skip


def answered(found: Diagnosis) -> dict[str, Any]:
    """What the diagnosis answered."""
    final = found.final
    own = {
        t.candidate.name: {
            n.removeprefix(t.candidate.prefix): [v, final.standard_errors[n]]
            for n, v in final.values.items()
            if n.startswith(t.candidate.prefix)
        }
        for t in found.accepted
    }
    return {
        "verdict": found.verdict.value,
        "accepted": [t.candidate.name for t in found.accepted],
        "parameters": own,
        "candidates": [[candidate.name, p] for candidate, p, _ in found.ranked_candidates()[:10]],
        "groups": [[candidate.name for candidate in group] for group in found.confounded_groups()],
        "where": found.location_probabilities(),
        "errors": {state: {use: row["overall"] for use, row in uses.items()} for state, uses in found.errors().items()},
        "rounds": [[_trial(t) for t in r.trials] for r in found.rounds],
        "forms": [[t.candidate.id, t.log_evidence_gain] for r in found.rounds for t in r.generic_trials],
        "seconds": found.seconds,
    }


def _trial(trial: Trial) -> list:
    fall, gain = trial.score.chi_square_fall, trial.log_evidence_gain
    return [trial.candidate.name, fall, gain, trial.holdout_half_chi_square_fall]


def rivals(case: HiddenCase, found: Diagnosis, library: list[type]) -> dict[str, list[str]]:
    """The answers of the others, who get the same calibrated model."""
    fitted = found.calibrated.fit
    problem = fitted.problem
    candidates = candidates_for(case.campaign, problem.machine, problem.instruments)
    candidates = [s for s in candidates if s.signal is not None or s.kind in library]
    per_sample = fitted.resolution.coarse
    residual, signs = signatures(fitted, candidates, per_sample)
    out = {
        "forward selection by BIC": forward_bic(residual, signs, candidates),
        "residual correlation": correlation(residual, signs, candidates),
    }
    if importlib.util.find_spec("pysindy"):  # of the extra `bench`
        out["sparse regression (PySINDy)"] = sparse_discrepancy(fitted, candidates, per_sample)
    return out


def _work(job: tuple[int, bool, Path]) -> tuple[int, str]:
    number, crumbs, folder = job
    path = folder / f"case{number:04d}.json"
    try:
        result = run_case(number, crumbs)
    except Exception as error:  # a case that fails is a result too, and must not take the others along
        result = {"number": number, "failed": f"{type(error).__name__}: {error}"}
    with atomic_write(path) as beside:
        beside.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    return number, _sentence(result)


def _sentence(result: dict[str, Any]) -> str:
    if "failed" in result:
        return result["failed"]
    hidden = " + ".join(h["name"] for h in result["hidden"]) or "nothing"
    if result["family"] == "struck":
        hidden += " (struck)"
    answer = f"{result['verdict']} {' + '.join(result['accepted'])}".strip()
    return f"{hidden} → {answer} ({result['seconds']:.0f} s)"


def study(numbers: range, workers: int, folder: Path, crumbs: bool = False) -> list[dict[str, Any]]:
    """The results of the cases, those that are in the folder already included."""
    folder.mkdir(parents=True, exist_ok=True)
    todo = [(n, crumbs, folder) for n in numbers if not (folder / f"case{n:04d}.json").exists()]
    began = time.perf_counter()
    if workers == 1:
        _show(map(_work, todo), len(todo), began)
    else:
        os.environ["EDHAS_CORES"] = "1"  # of each worker
        with multiprocessing.get_context("spawn").Pool(workers, maxtasksperchild=RENEWED) as pool:
            _show(pool.imap_unordered(_work, todo), len(todo), began)
    paths = [folder / f"case{n:04d}.json" for n in numbers]
    return [json.loads(path.read_text(encoding="utf-8")) for path in paths if path.exists()]


def _show(done, count: int, began: float) -> None:
    for k, (number, sentence) in enumerate(done):
        minutes = (time.perf_counter() - began) / 60.0
        print(f"[{k + 1}/{count}, {minutes:.1f} min] case {number}: {sentence}", flush=True)


def main(arguments: list[str] | None = None) -> int:
    """The study from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=150)
    parser.add_argument("--seed", type=int, default=SEALED, help=f"number of the first case; from {SEALED} on: sealed")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("runs/hidden_effects"))
    parser.add_argument("--crumbs", action="store_true", help="every sensor lags by 20 … 50 µs that no library knows")
    options = parser.parse_args(arguments)
    numbers = range(options.seed, options.seed + options.cases)
    kind = "sealed" if options.seed >= SEALED else "development"
    if options.seed < SEALED < numbers.stop:
        parser.error(f"cases below {SEALED} are for development, the others sealed: do not mix them")
    try:
        results = study(numbers, options.workers, options.out, options.crumbs)
    except KeyboardInterrupt:
        print(f"stopped; finished cases are in {options.out}, the same command goes on with the rest", file=sys.stderr)
        return 130
    print(f"\n{kind} cases {numbers.start} … {numbers.stop - 1}")
    print(report(results))
    save_pictures(results, options.out)
    print(last_line(results))
    return 0
