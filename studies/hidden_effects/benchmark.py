"""Benchmark of hidden effects: how often does the diagnosis name the effect that is hidden in a synthetic campaign?

    python -m studies.hidden_effects [--cases N] [--seed FIRST] [--workers K] [--out DIR] [--crumbs] [--baselines]

Each case is a campaign of eight runs of the pump bench with randomly drawn parameters, made by an integrator and sensor
models that the diagnosis does not use. `cases.py` draws the cases, `baselines.py` has the methods for comparison. Cases
are numbered from `--seed` on; those from `FIRST_TEST_CASE` on are the held-out test set. Finished cases are stored in
DIR and not repeated, so that the same command continues a study that was stopped. With `--baselines` only the baseline
methods run, from the calibrated model with which the diagnosis begins.

The last line: `top1=… false_alarms=… slot=… both=… unknown=… calibration=…`, with `--baselines` the first four of each
method as `bic_top1=…`
"""

import argparse
import dataclasses
import importlib.util
import json
import multiprocessing
import os
import sys
import time
from pathlib import Path
from typing import Any

from edhas_jax.core.atomic_file import atomic_write
from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.search.candidates import candidates_for
from edhas_jax.diagnosis.search.forward_selection import calibrate, diagnose
from edhas_jax.diagnosis.search.result import Diagnosis
from edhas_jax.diagnosis.search.trial import Trial
from studies.hidden_effects.baselines import correlation, exact_fit, forward_bic, screen
from studies.hidden_effects.cases import FIRST_TEST_CASE, PUMP_EFFECTS, Family, HiddenCase, draw_case
from studies.hidden_effects.figures import save_figures
from studies.hidden_effects.rates import last_line, report
from studies.hidden_effects.sparse_regression import sparse_discrepancy

CASES_PER_WORKER = 10  # cases after which a worker process is replaced, because compiled programs accumulate


@dataclasses.dataclass(frozen=True)
class Task:
    """How a case is run and stored.

    Args:
        folder: folder of the result files.
        unmodelled_lags: whether every sensor has a small lag that is not in the library of the diagnosis.
        only_baselines: whether the package's own diagnosis is left out.
    """

    folder: Path
    unmodelled_lags: bool = False
    only_baselines: bool = False

    def result_file(self, number: int) -> Path:
        """The result file of a case."""
        return self.folder / f"{'baselines' if self.only_baselines else 'case'}{number:04d}.json"


def run_case(number: int, task: Task) -> dict[str, Any]:
    """Draw one case, diagnose it with the package and with the baseline methods; the result file as plain data."""
    case = draw_case(number, task.unmodelled_lags)
    result, start = ground_truth(case, task.unmodelled_lags), time.perf_counter()
    if task.only_baselines:
        result["rivals"] = baseline_answers(case, calibrate(case.campaign)[0].fit)
        return result | {"seconds": time.perf_counter() - start}
    try:
        diagnosis = diagnose(case.campaign, [kind for kind in PUMP_EFFECTS if kind not in case.withheld])
        calibrated, answer = diagnosis.calibrated.fit, diagnosis_result(diagnosis)
    except Exception as error:  # counts as a wrong answer of the package; the baselines still have theirs
        calibrated, answer = calibrate(case.campaign)[0].fit, {"failed": _named(error)}
    return result | answer | {"rivals": baseline_answers(case, calibrated)}


def _named(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"


def ground_truth(case: HiddenCase, unmodelled_lags: bool) -> dict[str, Any]:
    """The entries of a result file that describe what is hidden."""
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
        "number": case.number, "family": case.family.value, "louder": case.noise_factor,
        "crumbs": unmodelled_lags, "hidden": hidden,
    }  # fmt: skip


def diagnosis_result(found: Diagnosis) -> dict[str, Any]:
    """The entries of a result file that describe the answer of the diagnosis."""
    final = found.final
    parameters = {
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
        "parameters": parameters,
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


def baseline_answers(case: HiddenCase, calibrated: Fit) -> dict[str, dict[str, list[str]]]:
    """The answers of the baseline methods, which start from the same calibrated model, by method."""
    problem = calibrated.problem
    candidates = candidates_for(case.campaign, problem.machine, problem.instruments)
    candidates = [c for c in candidates if c.kind not in case.withheld and (c.signal or c.kind in PUMP_EFFECTS)]
    fitted, per_sample = exact_fit(calibrated)
    residual, screened = screen(fitted, candidates)
    answers = {
        "forward selection by BIC": forward_bic(residual, screened),
        "residual correlation": correlation(residual, screened),
    }
    if importlib.util.find_spec("pysindy"):  # of the extra `bench`
        answers["sparse regression (PySINDy)"] = sparse_discrepancy(fitted, candidates, per_sample)
    return {method: dataclasses.asdict(answer) for method, answer in answers.items()}


def _run_and_store(job: tuple[int, Task]) -> tuple[int, str]:
    """Run one case and write its result file; its number and a sentence on it."""
    number, task = job
    try:
        result = run_case(number, task)
    except Exception as error:  # a case that fails is a result too, and must not stop the others
        result = {"number": number, "failed": _named(error)}
    with atomic_write(task.result_file(number)) as temporary:
        temporary.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    return number, _sentence(result)


def _sentence(result: dict[str, Any]) -> str:
    if "failed" in result:
        return result["failed"]
    hidden = " + ".join(h["name"] for h in result["hidden"]) or "nothing"
    if result["family"] == Family.WITHHELD.value:
        hidden += " (withheld)"
    if "verdict" not in result:
        named = (f"{method}: {' + '.join(a['named']) or 'nothing'}" for method, a in result["rivals"].items())
        return f"{hidden} → {', '.join(named)} ({result['seconds']:.0f} s)"
    answer = f"{result['verdict']} {' + '.join(result['accepted'])}".strip()
    return f"{hidden} → {answer} ({result['seconds']:.0f} s)"


def study(numbers: range, workers: int, task: Task) -> list[dict[str, Any]]:
    """Run the cases that have no result file in the folder yet.

    Args:
        numbers: numbers of the cases.
        workers: number of processes.
        task: how to run and store a case.

    Returns:
        The contents of the result files of all cases.
    """
    task.folder.mkdir(parents=True, exist_ok=True)
    jobs = [(n, task) for n in numbers if not task.result_file(n).exists()]
    start = time.perf_counter()
    if workers == 1:
        _print_progress(map(_run_and_store, jobs), len(jobs), start)
    else:
        os.environ["EDHAS_CORES"] = "1"  # of each worker
        with multiprocessing.get_context("spawn").Pool(workers, maxtasksperchild=CASES_PER_WORKER) as pool:
            _print_progress(pool.imap_unordered(_run_and_store, jobs), len(jobs), start)
    paths = [task.result_file(n) for n in numbers]
    return [json.loads(path.read_text(encoding="utf-8")) for path in paths if path.exists()]


def _print_progress(done, count: int, start: float) -> None:
    for k, (number, sentence) in enumerate(done):
        minutes = (time.perf_counter() - start) / 60.0
        print(f"[{k + 1}/{count}, {minutes:.1f} min] case {number}: {sentence}", flush=True)


def main(arguments: list[str] | None = None) -> int:
    """Run the study from the command line; the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=150)
    parser.add_argument("--seed", type=int, default=FIRST_TEST_CASE,
                        help=f"number of the first case; {FIRST_TEST_CASE} and above: held-out test cases")  # fmt: skip
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("runs/hidden_effects"))
    parser.add_argument(
        "--crumbs", action="store_true", help="give every sensor a lag of 20 … 50 µs that is not in the library"
    )
    parser.add_argument(
        "--baselines", action="store_true", help="run the baseline methods only, without the package's own diagnosis"
    )
    options = parser.parse_args(arguments)
    numbers = range(options.seed, options.seed + options.cases)
    kind = "test" if options.seed >= FIRST_TEST_CASE else "development"
    if options.seed < FIRST_TEST_CASE < numbers.stop:
        parser.error(f"cases below {FIRST_TEST_CASE} are for development, the others for testing: do not mix them")
    try:
        results = study(numbers, options.workers, Task(options.out, options.crumbs, options.baselines))
    except KeyboardInterrupt:
        print(
            f"stopped; finished cases are in {options.out}, the same command continues with the rest", file=sys.stderr
        )
        return 130
    print(f"\n{kind} cases {numbers.start} … {numbers.stop - 1}")
    print(report(results))
    save_figures(results, options.out)
    print(last_line(results))
    return 0
