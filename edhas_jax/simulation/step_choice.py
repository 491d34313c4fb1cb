"""Choice of the step of a run: halve it until flow, power and stroke, or every signal, no longer depend on it."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from edhas_jax.simulation.run_checks import largest_change, step_change
from edhas_jax.simulation.validity import STEP_SENSITIVITY, Status

MAX_HALVINGS = 6  # of the step, until flow, power and stroke no longer depend on it
MAX_ACCURACY_TRIALS = 8  # steps that are tried for an accuracy, each half of the one before
MOST_STEPS = 20_000_000  # of a run that only looks for a smaller step

# (largest step [s]) → the run with it, and how it failed, or None
Attempt = Callable[[float], tuple[Any, Any]]


class StepSearch(NamedTuple):
    """What halving the step has shown; runs are `edhas_jax.simulation.run.Run`.

    Attributes:
        confirmed: the first run whose main results half its step confirms; None if there is none.
        finest: the run with the smallest step that did not fail; None if all failed.
        first_change: main result that half the first step changes most, and by which share.
        last_change: the same of the last two steps.
        interrupted: whether the user has interrupted the search.
    """

    confirmed: Any
    finest: Any
    first_change: tuple[str, float]
    last_change: tuple[str, float]
    interrupted: bool = False


def search_step(first: Any, failed: bool, attempt: Attempt) -> StepSearch:
    """Halve the step of a run until its main results no longer depend on it.

    Args:
        first: the run with the largest step.
        failed: whether it has left the physical range.
        attempt: makes the run with another step.
    """
    coarse, changes = None if failed else first, []
    for number in range(1, MAX_HALVINGS + 1):
        step = first.step / 2.0**number
        if number > 1 and first.duration / step > MOST_STEPS:
            break
        fine, failure = attempt(step)
        if fine.interrupted:
            unknown = changes or [("", 0.0)]
            return StepSearch(None, coarse, unknown[0], unknown[-1], True)
        compared = coarse is not None and not failure
        changes.append(step_change(coarse.record, fine.record) if compared else ("the run", math.inf))
        if changes[-1][1] <= STEP_SENSITIVITY:
            return StepSearch(coarse, fine, changes[0], changes[-1])
        coarse = None if failure else fine
    return StepSearch(None, coarse, changes[0], changes[-1])


def step_status(change: tuple[str, float], step: float, remedy: str) -> tuple[Status, str]:
    """The status and reason of a run whose main result changes so much with half its step [s]."""
    name, share = change
    if share <= STEP_SENSITIVITY:
        return Status.OK, ""
    how_much = f"changes by {100 * share:.2g} %" if math.isfinite(share) else "fails"
    return Status.STEP_TOO_LARGE, (
        f"with a step of {0.5e6 * step:.4g} µs instead of {step * 1e6:.4g} µs {name} {how_much}; {remedy}"
    )


class AccuracySearch(NamedTuple):
    """The run with the last step that was tried for an accuracy.

    Attributes:
        run: that run; None if it failed.
        before: the run with twice its step; None if that failed.
        worst: the signal that halving the step changed most, and by which share of its range.
        reached: whether the accuracy is reached.
        failure: how the last run failed; None if it did not.
    """

    run: Any
    before: Any
    worst: tuple[str, float]
    reached: bool
    failure: Any


def search_accuracy(accuracy: float, largest_step: float, attempt: Attempt) -> AccuracySearch:
    """Halve the step until the estimated error of every signal is within the accuracy."""
    coarse = before = None
    worst, run, failure = ("", math.inf), None, None
    for number in range(MAX_ACCURACY_TRIALS):
        run, failure = attempt(largest_step / 2.0**number)
        if failure:
            coarse = None
            continue
        if coarse is not None:
            worst = largest_change(run.machine, coarse.signals, run.signals)
            # the error of a second-order rule falls to a quarter: a third of the change remains
            if worst[1] / 3.0 <= accuracy:
                return AccuracySearch(run, coarse, worst, True, None)
        before, coarse = coarse, run
        if run.interrupted:
            break
    return AccuracySearch(run, before, worst, False, failure)
