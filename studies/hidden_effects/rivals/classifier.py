"""Rival: a classifier trained by simulation, on cases of the tuning families.

Two stages of scikit-learn. Gradient-boosted trees give each suspect of a case a score from its features, the same trees
for all suspects. A logistic regression then gives the probabilities that nothing is missing, that something without a
name is, and that it is one of the suspects, from the largest scores and the features of the case; the suspects share
the last in proportion to powers of their scores. The second stage is trained on scores of trees that have not seen the
case (cross-validation by groups), so that its probabilities are not those of a memory.
"""

import dataclasses
import functools
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from studies.hidden_effects.answers import (
    NOTHING,
    UNKNOWN,
    Answer,
    Truth,
    Verdict,
    places_of,
    same_as_any,
    truth_from_json,
)
from studies.hidden_effects.naming import MAX_NAMES, MAX_RANKED, credible_set
from studies.hidden_effects.rivals.features import KINDS, SUSPECT_FEATURES, Features

FOLDS = 5
MIN_SECOND_SCORE = 0.5  # of a further suspect that is named beside the first
POWERS = (0.5, 0.75, 1.0, 1.5, 2.0, 3.0)  # of scores, tried for the division among suspects
TOP_SCORES = 3
KIND_COLUMN = SUSPECT_FEATURES.index("kind")
MIN_CASES = 20


class NotTrained(ValueError):
    """There are too few training cases."""


@dataclasses.dataclass(frozen=True)
class TrainingCase:
    """The features of a case whose truth is known."""

    truth: Truth
    features: Features

    @property
    def is_hidden(self) -> np.ndarray:
        """Whether each suspect is hidden (suspects,)."""
        return np.array([not self.truth.withheld and same_as_any(n, self.truth.names) for n in self.features.names])

    @property
    def kind(self) -> str:
        """`NOTHING`, `UNKNOWN`, or "named"."""
        if not self.truth.hidden:
            return NOTHING
        return UNKNOWN if self.truth.withheld or not self.is_hidden.any() else "named"


def read_training(folder: Path) -> list[TrainingCase]:
    """The training cases in a folder.

    Raises:
        NotTrained: there are too few.
    """
    plain = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(folder.glob("*.json"))]
    if len(plain) < MIN_CASES:
        raise NotTrained(
            f"{folder} has {len(plain)} training cases for the classifier, {MIN_CASES} are needed: "
            "run python -m studies.hidden_effects.training first"
        )
    return [TrainingCase(truth_from_json(of["truth"]), Features.from_json(of["features"])) for of in plain]


@functools.lru_cache(maxsize=1)
def trained(folder: Path) -> "Classifier":
    """The classifier of the training cases in a folder; trained once in a process."""
    return Classifier(read_training(folder))


class Classifier:
    """The trained classifier.

    Args:
        cases: the training cases.
    """

    def __init__(self, cases: Sequence[TrainingCase]):
        groups = np.random.default_rng(0).permutation(np.arange(len(cases)) % FOLDS)
        scores: list[np.ndarray] = [np.zeros(0)] * len(cases)
        for fold in range(FOLDS):
            trees = _trees([c for c, g in zip(cases, groups, strict=True) if g != fold])
            for k in np.flatnonzero(groups == fold):
                scores[k] = _scores(trees, cases[k].features)
        self._trees = _trees(cases)
        inputs = np.array([_inputs(c.features, of) for c, of in zip(cases, scores, strict=True)])
        self._kinds = _logistic().fit(inputs, [c.kind for c in cases])
        self._power = _best_power(cases, scores)
        self.left_out_scores = scores

    def kind(self, features: Features, scores: np.ndarray) -> str:
        """The most probable kind of a case, given the scores of its suspects."""
        return str(self._kinds.predict([_inputs(features, scores)])[0])

    def probabilities(self, features: Features, scores: np.ndarray | None = None) -> dict[str, float]:
        """The probability of each suspect to be the first, of `NOTHING` and of `UNKNOWN`; the largest first."""
        scores = _scores(self._trees, features) if scores is None else scores
        of_kinds = dict(
            zip(self._kinds.classes_, self._kinds.predict_proba([_inputs(features, scores)])[0], strict=True)
        )
        shares = scores**self._power
        shares = of_kinds.get("named", 0.0) * shares / shares.sum()
        out = {kind: float(of_kinds.get(kind, 0.0)) for kind in (NOTHING, UNKNOWN)}
        out |= {name: float(p) for name, p in zip(features.names, shares, strict=True)}
        return dict(sorted(out.items(), key=lambda item: -item[1]))

    def answer(self, features: Features) -> Answer:
        """Name the most probable suspect and others with a large score, or `nothing` or `unknown`."""
        scores = _scores(self._trees, features)
        probabilities = self.probabilities(features, scores)
        by_score = [features.names[k] for k in np.argsort(-scores)]
        kinds = {NOTHING: probabilities[NOTHING], UNKNOWN: probabilities[UNKNOWN]}
        kinds["named"] = 1.0 - sum(kinds.values())
        decided = max(kinds, key=lambda kind: kinds[kind])
        place = next(iter(places_of(by_score[0])), None)
        ranked, members = tuple(by_score[:MAX_RANKED]), credible_set(probabilities)
        if decided == NOTHING:
            return Answer(Verdict.ADEQUATE, (), members, None, kinds[NOTHING], ranked=ranked)
        if decided == UNKNOWN:
            return Answer(Verdict.UNKNOWN_EFFECT, (), members, place, kinds[UNKNOWN], ranked=ranked)
        score = dict(zip(features.names, scores, strict=True))
        further = [name for name in by_score[1:MAX_NAMES] if score[name] >= MIN_SECOND_SCORE]
        named = (by_score[0], *further)
        return Answer(Verdict.MISSING_EFFECT, named, members, place, probabilities[named[0]], ranked=ranked)


def _trees(cases: Sequence[TrainingCase]) -> Any:
    """Trees that score a suspect of a case."""
    from sklearn.ensemble import HistGradientBoostingClassifier
    from threadpoolctl import threadpool_limits

    rows = np.concatenate([_rows(c.features) for c in cases])
    hidden = np.concatenate([c.is_hidden for c in cases])
    trees = HistGradientBoostingClassifier(
        max_iter=100, learning_rate=0.08, max_leaf_nodes=12, min_samples_leaf=15, l2_regularization=1.0,
        categorical_features=[KIND_COLUMN], random_state=0,
    )  # fmt: skip
    with threadpool_limits(1, "openmp"):  # each worker of a study has one core
        return trees.fit(rows, hidden)


def _logistic() -> Any:
    from sklearn.linear_model import LogisticRegression
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    return make_pipeline(StandardScaler(), LogisticRegression(C=0.3, max_iter=2000))


def _rows(features: Features) -> np.ndarray:
    """Features of each suspect with the first ones of the case; kinds of effects as categories from 0."""
    suspects = features.suspects.copy()
    suspects[:, KIND_COLUMN] = np.where(suspects[:, KIND_COLUMN] < 0, len(KINDS), suspects[:, KIND_COLUMN])
    of_case = np.repeat(features.case[None, :6], len(suspects), axis=0)
    return np.concatenate([suspects, of_case], axis=1)


def _scores(trees: Any, features: Features) -> np.ndarray:
    """The score of each suspect (suspects,), 0 … 1."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, "openmp"):
        return np.clip(trees.predict_proba(_rows(features))[:, 1], 1e-6, 1.0 - 1e-6)


def _inputs(features: Features, scores: np.ndarray) -> np.ndarray:
    """The inputs of the second stage: scores, what the best suspect explains, size and memory of the residual."""
    order = np.argsort(-scores)
    top = np.sort(np.log(scores / (1.0 - scores)))[::-1][:TOP_SCORES]
    top = np.pad(top, (0, TOP_SCORES - len(top)), constant_values=-12.0)
    columns = [SUSPECT_FEATURES.index(n) for n in ("fall_share", "log_fall", "left_out_share", "positive_runs")]
    largest = features.suspects[:, SUSPECT_FEATURES.index("log_fall")].max()
    memory = np.nanmax(features.case[7::7]) if np.isfinite(features.case[7::7]).any() else 0.0
    return np.array([*top, *features.suspects[order[0], columns], largest, *features.case[:6], memory])


def _best_power(cases: Sequence[TrainingCase], scores: Sequence[np.ndarray]) -> float:
    """The power of scores that divides the probability among the suspects best, by the logarithm of the right share."""
    named = [(c.is_hidden, of) for c, of in zip(cases, scores, strict=True) if c.kind == "named"]

    def loss(power: float) -> float:
        return -sum(float(np.log(np.sum(of[hidden] ** power) / np.sum(of**power))) for hidden, of in named)

    return min(POWERS, key=loss)
