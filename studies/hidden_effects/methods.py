"""The methods that the benchmark compares, each a function of a case and of what the methods share in it.

Each method imports the diagnosis only when it is run: an answer of `previous` can be computed with another version of
the package (`python -m studies.hidden_effects` says how), which need not have everything that the others need.
"""

import dataclasses
import enum
import functools
import time

from studies.hidden_effects.answers import Answer
from studies.hidden_effects.generators.hidden_case import HiddenCase
from studies.hidden_effects.our_answer import answer_of


class Method(enum.Enum):
    """A method; the values are the words of the command line and the names of the result files."""

    OURS = "ours"
    PREVIOUS = "previous"
    BIC = "bic"
    CORRELATION = "correlation"

    @property
    def title(self) -> str:
        """The name in tables."""
        return TITLES[self]


TITLES = {
    Method.OURS: "edhas diagnose", Method.PREVIOUS: "edhas diagnose, previous",
    Method.BIC: "forward selection by BIC", Method.CORRELATION: "residual correlation",
}  # fmt: skip


class SharedParts:
    """What the rival methods share in one case, computed when it is first asked for."""

    def __init__(self, of: HiddenCase):
        self._of = of

    @functools.cached_property
    def calibrated(self):
        """The calibrated model and the table of signatures, see `studies.hidden_effects.calibrated_case`."""
        from studies.hidden_effects.calibrated_case import CalibratedCase

        return CalibratedCase(self._of)


def answer_with(method: Method, case: HiddenCase, shared: SharedParts) -> Answer:
    """The answer of a method to a case; an error of the method is an answer too.

    Args:
        method: the method.
        case: the case, of which the method sees the campaign and the suspects.
        shared: what the rival methods share in this case.
    """
    start = time.process_time()
    try:
        if method in (Method.OURS, Method.PREVIOUS):
            return _diagnosed(case)
        common = shared.calibrated.seconds  # computed by the first of them, counted for all
        start = time.process_time()
        return dataclasses.replace(_rival(method, shared.calibrated), seconds=common + _since(start))
    except Exception as error:  # counts as wrong, and the other methods still have their answers
        return Answer(None, seconds=_since(start), failed=f"{type(error).__name__}: {error}")


def _rival(method: Method, calibrated) -> Answer:
    if method is Method.BIC:
        from studies.hidden_effects.rivals.bic_refits import forward_bic

        return forward_bic(calibrated)
    from studies.hidden_effects.rivals.correlation import correlation

    return correlation(calibrated.table)


def _diagnosed(case: HiddenCase) -> Answer:
    """The answer of the diagnosis of the package that is imported."""
    import edhas_jax as edhas
    from edhas_jax.diagnosis.report.result_file import as_json

    start = time.process_time()
    found = edhas.diagnose(case.campaign, case.own_library, library=case.library)
    seconds = _since(start)
    return dataclasses.replace(answer_of(as_json(found)), seconds=seconds)


def _since(start: float) -> float:
    return time.process_time() - start
