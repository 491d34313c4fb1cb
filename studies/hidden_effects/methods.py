"""The methods that the benchmark compares, each a function of a case and of what the methods share in it."""

import dataclasses
import enum
import importlib.util
import time
from pathlib import Path

from edhas_jax.diagnosis.search.forward_selection import diagnose
from studies.hidden_effects.answers import Answer
from studies.hidden_effects.calibrated_case import CalibratedCase
from studies.hidden_effects.drawing import DrawnCase
from studies.hidden_effects.law_errors import law_errors
from studies.hidden_effects.our_answer import answer_of
from studies.hidden_effects.rivals.best_subset import best_subset
from studies.hidden_effects.rivals.bic_refits import forward_bic
from studies.hidden_effects.rivals.classifier import NotTrained, read_training, trained
from studies.hidden_effects.rivals.correlation import correlation
from studies.hidden_effects.rivals.features import features_of
from studies.hidden_effects.rivals.sparse_regression import sparse_discrepancy


class Method(enum.Enum):
    """A method; the values are the words of the command line and the names of the result files."""

    OURS = "ours"
    BIC = "bic"
    SUBSET = "subset"
    PYSINDY = "pysindy"
    CLASSIFIER = "classifier"
    CORRELATION = "correlation"

    @property
    def title(self) -> str:
        """The name in tables and figures."""
        return TITLES[self]


TITLES = {
    Method.OURS: "edhas diagnose", Method.BIC: "forward selection by BIC", Method.SUBSET: "best subset (L0)",
    Method.PYSINDY: "PySINDy", Method.CLASSIFIER: "trained classifier",
    Method.CORRELATION: "residual correlation",
}  # fmt: skip


PACKAGES = {Method.PYSINDY: "pysindy", Method.CLASSIFIER: "sklearn"}  # of the extra `bench`


def what_is_missing(method: Method, training: Path) -> str:
    """A sentence on what a method lacks; empty where it can run."""
    package = PACKAGES.get(method)
    if package is not None and importlib.util.find_spec(package) is None:
        return f"{method.value} needs {package}: pip install -e '.[bench]'"
    if method is Method.CLASSIFIER:
        try:
            read_training(training)
        except NotTrained as error:
            return str(error)
    return ""


def answer_with(method: Method, case: DrawnCase, shared: CalibratedCase) -> Answer:
    """The answer of a method to a case; an error of the method is an answer too.

    Args:
        method: the method.
        case: the case, of which the method sees the campaign and the suspects.
        shared: what the rival methods share in this case.
    """
    start = time.process_time()
    try:
        if method is Method.OURS:
            diagnosis = diagnose(case.campaign, case.library)
            answer = dataclasses.replace(answer_of(diagnosis), seconds=_since(start))
            return dataclasses.replace(answer, estimates=law_errors(diagnosis, case.machine, case.truth.hidden))
        common = shared.seconds  # computed by the first of them, counted for all
        start = time.process_time()
        return dataclasses.replace(_rival(method, shared), seconds=common + _since(start))
    except Exception as error:  # counts as wrong, and the other methods still have their answers
        return Answer(None, seconds=_since(start), failed=f"{type(error).__name__}: {error}")


def _since(start: float) -> float:
    return time.process_time() - start


def _rival(method: Method, shared: CalibratedCase) -> Answer:
    match method:
        case Method.BIC:
            return forward_bic(shared)
        case Method.SUBSET:
            return best_subset(shared.table)
        case Method.PYSINDY:
            fitted, per_sample = shared.exact
            return sparse_discrepancy(fitted, shared.suspects, per_sample)
        case Method.CLASSIFIER:
            return trained(shared.training).answer(features_of(shared.table, shared.intervals))
        case Method.CORRELATION:
            return correlation(shared.table)
    raise ValueError(f"{method} is no rival")
