"""The result folder of the benchmark: for each case what is hidden, and one file for each method's answer.

    OUT/judging/p00007/case.json         what is hidden
    OUT/judging/p00007/bic.json          the answer of a method
    OUT/judging/p00007/limit.json        what the true laws explain, see `studies.hidden_effects.limits`
    OUT/judging/p00007/not_drawn.txt     why the case could not be drawn

Files are complete or absent, so that a stopped study continues where it was.
"""

import dataclasses
import json
import math
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
from studies.hidden_effects.generators.hidden_case import CaseKey, Split

CASE_FILE, LIMIT_FILE, NOT_DRAWN_FILE = "case.json", "limit.json", "not_drawn.txt"
STANDS_OUT = 3.0  # an effect without which the fit is worse by this many times what all true laws leave


@dataclasses.dataclass(frozen=True)
class Limit:
    """What the true laws explain and leave in a case.

    Args:
        gain: log-evidence gain of the true laws [nats].
        left: excess of ½χ² that they leave [nats], beyond the scatter of noise.
        strength: the gain over what is left, and the least gain that counts.
        each: the strength of each hidden effect where the others are in the model, in the order of the truth; NaN where
            the model without it cannot be fitted.
    """

    gain: float
    left: float
    strength: float
    each: tuple[float, ...]

    @property
    def all_stand_out(self) -> bool:
        """Whether every hidden effect stands out beside the others."""
        return all(strength > STANDS_OUT for strength in self.each)


@dataclasses.dataclass(frozen=True)
class Record:
    """A case and the answers to it, by method; and what the true laws explain, where that has been computed."""

    truth: Truth
    answers: dict[str, Answer]
    limit: Limit | None = None


@dataclasses.dataclass(frozen=True)
class ResultFolder:
    """The results in a folder."""

    folder: Path

    def of(self, key: CaseKey) -> Path:
        """The folder of a case."""
        return self.folder / key.split.value / str(key)

    def missing(self, key: CaseKey, methods: Iterable[str]) -> tuple[str, ...]:
        """The methods without an answer to a case."""
        return tuple(method for method in methods if not (self.of(key) / f"{method}.json").exists())

    def truth(self, key: CaseKey) -> Truth | None:
        """What is hidden in a case that has been drawn."""
        path = self.of(key) / CASE_FILE
        return truth_from_json(read_json(path)) if path.exists() else None

    def store_truth(self, key: CaseKey, truth: Truth) -> None:
        """Write what is hidden in a case."""
        write_json(self.of(key) / CASE_FILE, truth_as_json(truth))

    def store_answer(self, key: CaseKey, method: str, answer: Answer) -> None:
        """Write the answer of a method."""
        write_json(self.of(key) / f"{method}.json", answer_as_json(answer))

    def store_limit(self, key: CaseKey, limit: Limit) -> None:
        """Write what the true laws explain."""
        write_json(self.of(key) / LIMIT_FILE, dataclasses.asdict(limit))

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
        """All finished cases of a split with the answers of some methods."""
        methods, paths = tuple(methods), sorted((self.folder / split.value).glob(f"*/{CASE_FILE}"))
        return [_record(path.parent, methods) for path in paths]

    def not_drawn(self, keys: Iterable[CaseKey]) -> dict[str, str]:
        """The cases that could not be drawn, with the reason."""
        paths = {key: self.of(key) / NOT_DRAWN_FILE for key in keys if not (self.of(key) / CASE_FILE).exists()}
        return {str(key): path.read_text(encoding="utf-8").strip() for key, path in paths.items() if path.exists()}


def read_json(path: Path) -> dict[str, Any]:
    """The plain data of a file."""
    return json.loads(path.read_text(encoding="utf-8"))


def limit_from_json(plain: dict[str, Any]) -> Limit:
    """A limit of plain data."""
    return Limit(**plain | {"each": tuple(math.nan if v is None else v for v in plain["each"])})


def _record(folder: Path, methods: tuple[str, ...]) -> Record:
    """The case in a folder with the answers of some methods, as far as they are there."""
    found = {m: folder / f"{m}.json" for m in methods if (folder / f"{m}.json").exists()}
    answers = {m: answer_from_json(read_json(path)) for m, path in found.items()}
    limit = folder / LIMIT_FILE
    return Record(
        truth_from_json(read_json(folder / CASE_FILE)), answers,
        limit_from_json(read_json(limit)) if limit.exists() else None,
    )  # fmt: skip


def write_json(path: Path, plain: dict[str, Any]) -> None:
    """Write plain data to a file, all of it or nothing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(plain, indent=1) + "\n", encoding="utf-8")
