"""Make the training table of the classifier from cases of the tuning families.

    python -m studies.hidden_effects.training [--families a b …] [--cases N] [--first K] [--workers K] [--out DIR]

Each case is drawn and calibrated, and its features are stored in DIR/training; finished cases are not repeated. The
classifier reads this table whenever it is asked, so that more cases make it better at once. The last line has its rates
on training cases that the trees had not seen: `cases=… first=… kind=…`
"""

import argparse
import dataclasses
import json
import sys
from pathlib import Path

import numpy as np

from edhas_jax.core.atomic_file import atomic_write
from studies.hidden_effects.answers import truth_as_json
from studies.hidden_effects.calibrated_case import CalibratedCase
from studies.hidden_effects.drawing import FAMILIES, CaseKey, draw
from studies.hidden_effects.generators.hidden_case import Split
from studies.hidden_effects.rivals.classifier import Classifier, NotTrained, read_training
from studies.hidden_effects.rivals.features import features_of
from studies.hidden_effects.store import ResultFolder
from studies.hidden_effects.work import run_all


@dataclasses.dataclass(frozen=True)
class TrainingJob:
    """A case whose features are stored in a file."""

    key: CaseKey
    file: Path


def make_features(job: TrainingJob) -> str:
    """Draw and calibrate a case and store its features; a sentence."""
    try:
        case = draw(job.key)
        shared = CalibratedCase(case)
        features = features_of(shared.table, shared.intervals)
    except Exception as error:  # one case less to train with
        return f"{job.key}: {type(error).__name__}: {error}"
    plain = {"truth": truth_as_json(case.truth), "features": features.as_json()}
    job.file.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(job.file) as temporary:
        temporary.write_text(json.dumps(plain) + "\n", encoding="utf-8")
    return f"{job.key}: {' + '.join(sorted(case.truth.names)) or 'nothing'}"


def main(arguments: list[str] | None = None) -> int:
    """Make the table from the command line and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--families", nargs="+", choices=FAMILIES, default=list(FAMILIES), metavar="LETTER",
                        help="families of the cases; all by default")  # fmt: skip
    parser.add_argument("--cases", type=int, default=40, help="number of cases of each family")
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("runs/hidden_effects"))
    options = parser.parse_args(arguments)
    folder = ResultFolder(options.out).training
    numbers = range(options.first, options.first + options.cases)
    keys = [CaseKey(family, Split.TUNING, number) for number in numbers for family in options.families]
    jobs = [TrainingJob(key, file) for key in keys if not (file := folder / f"{key}.json").exists()]
    try:
        run_all(make_features, jobs, options.workers)
        cases = read_training(folder)
    except KeyboardInterrupt:
        print(f"stopped; the features so far are in {folder}", file=sys.stderr)
        return 130
    except NotTrained as error:
        print(error)
        return 1
    classifier = Classifier(cases)
    first = kind = 0
    for case, scores in zip(cases, classifier.left_out_scores, strict=True):
        kind += classifier.kind(case.features, scores) == case.kind
        first += case.kind == "named" and bool(case.is_hidden[np.argmax(scores)])
    named = sum(case.kind == "named" for case in cases)
    print(f"cases={len(cases)} first={first / max(named, 1):.3f} kind={kind / len(cases):.3f}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
