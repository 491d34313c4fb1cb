"""What a search reports of a finished stage: the sentence, and its reading by a program that follows the search."""

import math
import re
from collections.abc import Iterable

from edhas_jax.inference.fit.evaluated_fit import EvaluatedFit
from edhas_jax.measurements.campaign import Use

CALIBRATED, BEST = "calibrated", "best so far: "
SENTENCE = re.compile(
    r"(?P<stage>.+); residual over noise (?P<fit>\S+) on the runs used(, (?P<holdout>\S+) on others)?"
)


def stage_sentence(stage: str, model: EvaluatedFit) -> str:
    """The sentence on a finished stage.

    Args:
        stage: `CALIBRATED`, or `BEST` and the names of a set.
        model: the model after it.
    """
    used, others = (model.rms_over_noise(use) for use in (Use.FIT, Use.HOLDOUT))
    return f"{stage}; residual over noise {used:.2f} on the runs used" + (
        f", {others:.2f} on others" if math.isfinite(others) else ""
    )


def read_stages(sentences: Iterable[str]) -> dict[str, dict[str, float]]:
    """Residual over noise ("fit", "holdout") by stage, from the sentences of a search; a search may begin anew.

    Args:
        sentences: all that it has reported so far, among others those of `stage_sentence`.

    Returns:
        The stages of its last beginning: "calibrated", and "+ NAMES" of the best set, if that has members.
    """
    stages: dict[str, dict[str, float]] = {}
    for sentence in sentences:
        if (read := SENTENCE.fullmatch(sentence)) is None:
            continue
        values = {use: float(read[use]) for use in ("fit", "holdout") if read[use] is not None}
        if read["stage"] == CALIBRATED:
            stages = {CALIBRATED: values}
        else:
            stages = {k: v for k, v in stages.items() if k == CALIBRATED}
            stages[read["stage"].replace(BEST, "+ ", 1)] = values
    return stages
