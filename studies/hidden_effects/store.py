"""The result folder of the benchmark: for each case what is hidden, and one file for each method's answer.

    OUT/judging/b00007/case.json         what is hidden
    OUT/judging/b00007/bic.json          the answer of a method
    OUT/judging/b00007/not_drawn.txt     why the case could not be drawn

Files are complete or absent, so that a stopped study continues where it was.
"""

import dataclasses
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from edhas_jax.core.atomic_file import atomic_write
from studies.hidden_effects.answers import (
    Answer,
    Truth,
    answer_as_json,
    answer_from_json,
    truth_as_json,
    truth_from_json,
)
from studies.hidden_effects.drawing import LAGS_SUFFIX, CaseKey
from studies.hidden_effects.generators.hidden_case import Split

CASE_FILE, NOT_DRAWN_FILE = "case.json", "not_drawn.txt"
TRAINING_FOLDER = "training"


@dataclasses.dataclass(frozen=True)
class Record:
    """A case and the answers to it, by method."""

    truth: Truth
    answers: dict[str, Answer]


@dataclasses.dataclass(frozen=True)
class ResultFolder:
    """The results in a folder."""

    folder: Path

    @property
    def training(self) -> Path:
        """The folder of the training table of the classifier."""
        return self.folder / TRAINING_FOLDER

    def of(self, key: CaseKey) -> Path:
        """The folder of a case."""
        return self.folder / key.split.value / str(key)

    def missing(self, key: CaseKey, methods: Iterable[str]) -> tuple[str, ...]:
        """The methods without an answer to a case."""
        return tuple(method for method in methods if not (self.of(key) / f"{method}.json").exists())

    def store_truth(self, key: CaseKey, truth: Truth) -> None:
        """Write what is hidden in a case."""
        write_json(self.of(key) / CASE_FILE, truth_as_json(truth))

    def store_answer(self, key: CaseKey, method: str, answer: Answer) -> None:
        """Write the answer of a method."""
        write_json(self.of(key) / f"{method}.json", answer_as_json(answer))

    def store_failed_draw(self, key: CaseKey, reason: str) -> None:
        """Write why a case could not be drawn; it is tried again by the next study."""
        path = self.of(key) / NOT_DRAWN_FILE
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(reason + "\n", encoding="utf-8")

    def records(self, keys: Iterable[CaseKey], methods: Iterable[str]) -> list[Record]:
        """The finished cases with the answers of some methods to them."""
        methods = tuple(methods)
        return [_record(self.of(key), methods) for key in keys if (self.of(key) / CASE_FILE).exists()]

    def all_records(self, split: Split, methods: Iterable[str]) -> list[Record]:
        """All finished cases of a split with the answers of some methods, without the cases with sensor lags."""
        methods, paths = tuple(methods), sorted((self.folder / split.value).glob(f"*/{CASE_FILE}"))
        return [_record(path.parent, methods) for path in paths if not path.parent.name.endswith(LAGS_SUFFIX)]

    def not_drawn(self, keys: Iterable[CaseKey]) -> dict[str, str]:
        """The cases that could not be drawn, with the reason."""
        paths = {key: self.of(key) / NOT_DRAWN_FILE for key in keys if not (self.of(key) / CASE_FILE).exists()}
        return {str(key): path.read_text(encoding="utf-8").strip() for key, path in paths.items() if path.exists()}


def read_json(path: Path) -> dict[str, Any]:
    """The plain data of a file."""
    return json.loads(path.read_text(encoding="utf-8"))


def _record(folder: Path, methods: tuple[str, ...]) -> Record:
    """The case in a folder with the answers of some methods, as far as they are there."""
    found = {m: folder / f"{m}.json" for m in methods if (folder / f"{m}.json").exists()}
    answers = {m: answer_from_json(read_json(path)) for m, path in found.items()}
    return Record(truth_from_json(read_json(folder / CASE_FILE)), answers)


def write_json(path: Path, plain: dict[str, Any]) -> None:
    """Write plain data to a file, all of it or nothing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(plain, indent=1) + "\n", encoding="utf-8")
