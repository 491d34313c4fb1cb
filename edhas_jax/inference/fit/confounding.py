"""What the data do not determine: combinations of unknowns, and parameters taken as known that others would hide."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from edhas_jax.core.units import format_quantity
from edhas_jax.inference.fit.fit import Fit
from edhas_jax.inference.likelihood.run_equations import marginalised, run_columns, run_equations
from edhas_jax.inference.likelihood.symmetric_matrices import regularised_inverse
from edhas_jax.machine.effects.tabulated_law import table_of
from edhas_jax.machine.parameters import list_parameters, set_parameters, short_names
from edhas_jax.measurements.measurement_model import MeasurementModel
from edhas_jax.measurements.unknown_parameters import ParameterScale

MAX_EIGENVALUE = 0.05  # of the curvature at unit diagonal; 0.05 is a pair with a correlation of ±0.95
MIN_LOADING = 0.25  # component of a unit eigenvector from which an unknown takes part in a combination
MIN_CHANGE = 0.05  # of an unknown along a combination, in standard deviations of its prior
MAX_SHIFT = 0.2  # of an estimate: relative, or in prior standard deviations on a linear scale
ASSUMED_CHANGE = 0.01  # relative change of a parameter that is taken as known
MAX_VISIBLE = 3.0  # change of the signals that no unknown reproduces, in standard deviations of what remains
MIN_SHIFT_OVER_ERROR = 3.0  # of an estimate, from which a parameter that is taken as known is named
MAX_LISTED = 3  # parameters, and estimates of each
MIN_EXCESS_OVER_NOISE = 1.2  # residual over noise from which the standard errors are too small


@dataclasses.dataclass(frozen=True)
class Combination:
    """A combination of unknowns that the data hardly determine.

    Attributes:
        changes: by unknown, its change (SI) along the combination by one standard error.
        relative: the same relative to the estimate; NaN for unknowns on a linear scale.
        units: units of the changes.
    """

    changes: dict[str, float]
    relative: dict[str, float]
    units: dict[str, str]

    def sentence(self) -> str:
        """The combination in words."""
        texts = [
            f"{100.0 * share:+.2g} %" if np.isfinite(share) else format_quantity(self.changes[n], self.units[n])
            for n, share in self.relative.items()
        ]
        names = list(self.changes)
        together = f"{', '.join(names[:-1])} and {names[-1]}"
        return f"{together} can change together by {', '.join(texts)} without a visible change of the signals."


@dataclasses.dataclass(frozen=True)
class AssumedParameter:
    """A parameter that is taken as exactly known, although the unknowns would hide an error of it.

    Attributes:
        name: the parameter.
        change: relative change of it that is considered; at most 1 %, less where it would be visible or shift an
            estimate by more than `MAX_SHIFT`.
        hidden_share: share of the squared change of the signals by it that the unknowns reproduce, 0 … 1.
        shifts: by unknown, the shift of its estimate (SI) if the parameter were larger by that much; the largest in
            standard errors first.
        shifts_over_error: the same in standard errors.
        units: units of the shifts.
    """

    name: str
    change: float
    hidden_share: float
    shifts: dict[str, float]
    shifts_over_error: dict[str, float]
    units: dict[str, str]

    def sentence(self) -> str:
        """The assumption in words."""
        parts = [
            f"{n} by {format_quantity(shift, self.units[n])} ({abs(self.shifts_over_error[n]):.1f} standard errors)"
            for n, shift in list(self.shifts.items())[:MAX_LISTED]
        ]
        return (
            f"The standard errors take {self.name} as exactly known, and these data would not show an error of it: "
            f"{100.0 * self.change:.2g} % more would shift {', '.join(parts)}."
        )


def weak_combinations(fit: Fit) -> list[Combination]:
    """The combinations of unknowns that the data hardly determine, the least determined first.

    They are the eigenvectors of the curvature, scaled to a unit diagonal, with an eigenvalue below `MAX_EIGENVALUE`:
    together, their members change the signals less than a twentieth of what each does alone.

    Source: Belsley, Kuh, Welsch, Regression Diagnostics (1980), ch. 3.
    """
    unknowns = fit.problem.unknowns
    if len(unknowns) < 2 or not np.isfinite(fit.covariance).all():
        return []
    curvature = regularised_inverse(fit.covariance)
    scale = 1.0 / np.sqrt(np.diag(curvature))
    values, vectors = np.linalg.eigh(scale[:, None] * curvature * scale)
    found = []
    for value, vector in zip(values, vectors.T, strict=True):
        along = scale * vector / np.sqrt(max(value, np.finfo(float).eps))
        members = np.flatnonzero((np.abs(vector) > MIN_LOADING) & (np.abs(along) > MIN_CHANGE))
        if value > MAX_EIGENVALUE or len(members) < 2:
            continue
        members = members[np.argsort(-np.abs(vector[members]), kind="stable")]
        along = along * np.sign(vector[members[0]])
        changes, relative, units = {}, {}, {}
        for k in members:
            u = unknowns[k]
            estimate, change = float(u.value(fit.x[k])), float(u.derivative(fit.x[k]) * along[k])
            changes[u.name], units[u.name] = change, u.unit
            relative[u.name] = change / estimate if u.scale is ParameterScale.LOGARITHMIC else np.nan
        found.append(Combination(changes, relative, units))
    return found


def assumed_parameters(fit: Fit, on_progress: Callable[[str], None] | None = None) -> list[AssumedParameter]:
    """The parameters that are taken as known, whose error the unknowns would hide and which shift the estimates.

    Each parameter of the machine that is neither unknown, nor set by the runs, nor a number of a tabulated law is made
    1 % larger. The change of the
    signals is projected on the sensitivities to the unknowns: what they reproduce shifts the estimates, what remains
    would be visible.

    Args:
        fit: the estimate.
        on_progress: called with a sentence on the progress.

    Returns:
        The parameters whose largest invisible change, up to `ASSUMED_CHANGE`, shifts an estimate by at least
        `MIN_SHIFT_OVER_ERROR` standard errors; the largest shift first, at most `MAX_LISTED`.
    """
    campaign, machine, unknowns = fit.problem.campaign, fit.machine, fit.problem.unknowns
    runs = fit.runs
    steps = fit.steps_of_changes
    skipped = {u.name for u in unknowns} | {name for run in runs for name in run.conditions}

    problem = fit.problem
    noise_level = max(1.0, np.sqrt(2.0 * fit.cost / max(sum(e.samples for e in problem.equations(fit.outcomes)), 1)))

    def signals(changed):
        return MeasurementModel(campaign, changed, (), runs, fit.instruments).predict_all_runs(np.zeros(0), steps)

    def overlap_and_total(after) -> tuple[np.ndarray, float]:
        """Scalar products of the signal change with the sensitivities to the unknowns, and with itself."""
        n, products = len(unknowns), 0.0
        for r, (run, outcome) in enumerate(zip(runs, fit.outcomes, strict=True)):
            change = {name: (after[r].values[name] - before[r].values[name])[:, None] for name in run.signals}
            columns, own = run_columns(campaign, run, outcome, unknowns, problem.bench, change)
            products = products + run_equations(columns, own).gram
        products = marginalised(products, slice(n, n + problem.bench.count))
        return products[:n, n], float(products[n, n])

    before, found = signals(machine), []
    names = short_names(machine)
    tables = {effect.id for effect in machine.effects if table_of(effect) is not None}  # nobody takes these as exact
    rows = [
        (p, float(value), names[path, p.name])
        for p, value, path in list_parameters(machine)
        if float(value) != 0.0 and path not in tables and not {names[path, p.name], f"{path}.{p.name}"} & skipped
    ]
    for k, (p, value, name) in enumerate(rows):
        if on_progress is not None:
            on_progress(f"error bars: {name} ({k + 1} of {len(rows)})")
        changed = value * (1.0 + ASSUMED_CHANGE)
        if not p.span[0] <= changed <= p.span[1]:
            continue
        overlap, total = overlap_and_total(signals(set_parameters(machine, {name: changed})))
        if not np.isfinite(total) or total == 0.0:
            continue
        shift = -fit.covariance @ overlap
        hidden = float(overlap @ fit.covariance @ overlap) / total
        over_error = shift / fit.std
        # beyond this the shifts are not proportional
        scaled = max(
            abs(s) * (u.spread if u.scale is ParameterScale.LOGARITHMIC else 1.0)
            for s, u in zip(shift, unknowns, strict=True)
        )
        visible = np.sqrt(max(1.0 - hidden, 0.0) * total) / noise_level
        portion = min(1.0, MAX_SHIFT / max(scaled, MAX_SHIFT), MAX_VISIBLE / max(visible, MAX_VISIBLE))
        portion = _one_digit(portion)
        shift, over_error = portion * shift, portion * over_error
        if np.abs(over_error).max() < MIN_SHIFT_OVER_ERROR:
            continue
        order = [int(j) for j in np.argsort(-np.abs(over_error)) if abs(over_error[j]) > 1.0]
        shifts = {unknowns[j].name: float(unknowns[j].derivative(fit.x[j]) * shift[j]) for j in order}
        in_errors = {unknowns[j].name: float(over_error[j]) for j in order}
        units = {unknowns[j].name: unknowns[j].unit for j in order}
        found.append(AssumedParameter(name, portion * ASSUMED_CHANGE, hidden, shifts, in_errors, units))
    found.sort(key=lambda a: -max(map(abs, a.shifts_over_error.values())))
    return found[:MAX_LISTED]


def _one_digit(value: float) -> float:
    """A positive number rounded down to one digit."""
    size = 10.0 ** np.floor(np.log10(value))
    return float(np.floor(value / size) * size)


def model_error_sentence(rms: float) -> str | None:
    """That the standard errors are too small where more than noise remains; None where it does not."""
    if not rms > MIN_EXCESS_OVER_NOISE:
        return None
    return (
        f"The standard errors hold for a complete model. The residual is {rms:.1f} times the noise, so the true errors "
        "are larger, by that factor or more."
    )


def confounding_as_json(combinations: Sequence[Combination], assumed: Sequence[AssumedParameter]) -> dict[str, list]:
    """Both kinds as plain data, values in SI."""
    return {
        "not_determined": [{"changes": c.changes, "relative": c.relative} for c in combinations],
        "taken_as_known": [
            {"parameter": a.name, "change": a.change, "hidden_share": a.hidden_share, "shifts": a.shifts}
            for a in assumed
        ],
    }
