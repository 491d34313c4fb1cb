"""What the bench did: the deviations of triggers, settings and sensors that the runs show, as texts."""

import numpy as np

from edhas_jax.core.units import format_number, format_quantity, format_with_error
from edhas_jax.diagnosis.search.holdout_split import FITTED_NAME, HELD_OUT_NAME
from edhas_jax.inference.fit.evaluated_fit import EvaluatedFit
from edhas_jax.inference.fit.time_correction import with_time_errors
from edhas_jax.inference.likelihood.bench_deviations import DeviationKind
from edhas_jax.inference.likelihood.bench_estimate import EstimatedDeviation

SHOWN_SIGMAS, MIN_SHOWN_DEVIATION = 3.0, 0.5  # of a deviation of the bench: standard errors, and accuracies
# units of deviations; the other kinds are relative
DEVIATION_UNITS = {DeviationKind.TRIGGER: "s", DeviationKind.CLOCK: "s", DeviationKind.SHIFT: "s"}
MAX_ACCURACIES, MOST_EXCESSIVE = 3.0, 3  # of a deviation of the bench: beyond them it is no usual one; sentences


def clear_deviations(evaluated: EvaluatedFit) -> list[EstimatedDeviation]:
    """The deviations of the bench that the runs show clearly, the largest in units of its accuracy first.

    Each has one row: the parts of a filter add up, and what the parts of a divided record show is averaged.
    """
    found = [
        row
        for row in _of_records(with_time_errors(evaluated.fit.problem, evaluated.bench))
        if abs(row.value) > SHOWN_SIGMAS * row.std and abs(row.value) > MIN_SHOWN_DEVIATION
    ]
    return sorted(found, key=lambda row: -abs(row.value))


def bench_rows(evaluated: EvaluatedFit) -> list[tuple[str, str, str, str]]:
    """The deviations that the runs show clearly, as texts: quantity, run, value ± standard error, accuracy.

    Corrections that no bench needs are left out.
    """
    return [_row(evaluated, row) for row in clear_deviations(evaluated) if row.is_possible]


def excessive_deviations(evaluated: EvaluatedFit) -> list[str]:
    """A sentence on each of the largest deviations of the bench that are larger than their accuracy allows.

    One sentence says what no bench does at all.
    """
    deviations = clear_deviations(evaluated)
    names = [
        f"{_name(row)} ({_per_cent(row.value * row.deviation.std)})" for row in deviations if not row.is_possible
    ]
    impossible = [
        f"Part of what the model leaves is taken up by corrections that no bench needs: {', '.join(names)}. They are "
        "no deviations of the bench, but stand in for something that the model lacks."
    ] if names else []  # fmt: skip
    excessive = [row for row in deviations if row.is_possible and abs(row.value) > MAX_ACCURACIES][:MOST_EXCESSIVE]
    return impossible + [
        f"{what}{'' if run == 'all' else f' of {run}'}: {size}, more than {MAX_ACCURACIES:.0f} times its accuracy of "
        f"{accuracy}. Either the bench is less accurate than that (`accuracy:` of the campaign), or this stands in for "
        "something that the model lacks."
        for what, run, size, accuracy in (_row(evaluated, row) for row in excessive)
    ]


def _per_cent(share: float) -> str:
    """A share with its sign and two significant digits, in per cent."""
    return f"{'+' if share > 0.0 else ''}{format_number(100.0 * share, 2)} %"


def _row(evaluated: EvaluatedFit, row: EstimatedDeviation) -> tuple[str, str, str, str]:
    deviation, signals = row.deviation, evaluated.fit.problem.machine.signals
    unit = DEVIATION_UNITS.get(deviation.kind, "-")
    unit = signals[deviation.name].unit if deviation.kind is DeviationKind.OFFSET else unit
    size, error = row.value * deviation.std, row.std * deviation.std
    texts = format_with_error(size, error, unit), format_quantity(deviation.std, unit)
    if unit == "-" and deviation.kind is not DeviationKind.OFFSET:
        texts = f"{100.0 * size:+.2g} ± {100.0 * error:.1g} %", f"{100.0 * deviation.std:.2g} %"
    return (_name(row), row.run or "all", *texts)


def _name(row: EstimatedDeviation) -> str:
    return " ".join(part for part in (row.deviation.kind.value, row.deviation.name.replace("_", " ")) if part)


def _of_records(rows: list[EstimatedDeviation]) -> list[EstimatedDeviation]:
    """The deviations with one row for each filter, and one for both parts of a record that was divided."""
    together: dict[tuple, list[EstimatedDeviation]] = {}
    for row in rows:
        record = row.run.removesuffix(FITTED_NAME).removesuffix(HELD_OUT_NAME)
        together.setdefault((row.deviation.kind, row.deviation.name, record), []).append(row)
    found = []
    for (kind, _, record), same in together.items():
        values, stds = np.array([row.value for row in same]), np.array([row.std for row in same])
        value, std = values.sum(), np.sqrt(np.sum(stds**2))
        if kind is not DeviationKind.FILTER:
            weights = 1.0 / np.maximum(stds, np.finfo(float).tiny) ** 2
            value = np.average(values, weights=weights)
            # parts that differ by more than their errors do not determine it any better than that
            std = max(1.0 / np.sqrt(weights.sum()), np.sqrt(np.average((values - value) ** 2, weights=weights)))
        found.append(same[0]._replace(run=record, value=float(value), std=float(std)))
    return found
