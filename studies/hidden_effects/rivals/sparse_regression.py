"""Rival: sparse regression (PySINDy) of the discrepancy between measured rates and the equations of the model.

The terms are the contributions of the effects to the equations, in weak form, each at the point of its grid that is
most parallel to the discrepancy; what small changes of the uncertain parameters can reproduce is projected out. As
PySINDy's authors recommend, the threshold of STLSQ is chosen on data that were not fitted, here by leaving out one run
after the other, and an ensemble of models of resampled data gives the probability that a term is included.

An effect that acts through its own states or through valves does not contribute to the rates of measured states
directly, and sensors do not appear in the equations: neither can be found by this method.

Sources: Brunton, Proctor, Kutz (2016); Kaheman et al. (2019), Learning discrepancy models from experimental data;
Mangan et al. (2017), Model selection for dynamical systems; Fasel et al. (2022), Ensemble-SINDy.
"""

import dataclasses
import math
import warnings
from collections.abc import Iterable

import numpy as np

from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.search.candidates import Candidate, screening_grid
from edhas_jax.machine.parameters import ParameterError, find_parameter, replace_value, set_parameters
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.unknown_parameters import UnknownParameter
from studies.hidden_effects.answers import Answer
from studies.hidden_effects.naming import MAX_NAMES, MAX_RANKED, answer_of_names
from studies.hidden_effects.rivals.weak_rates import WeakRates

THRESHOLDS = (0.8, 0.5, 0.3, 0.2, 0.1, 0.05)  # of STLSQ, as shares of the discrepancy; the sparsest first
RIDGE = 1e-2  # regularisation as a share of the squared norm of a term, because many terms are nearly parallel
ENSEMBLE = 40  # models of resampled data
MIN_INCLUSION = 0.6  # share of these models that must have a term
STANDARD_ERRORS = 1.0  # by which the error on runs left out must fall for a further term
PARAMETER_STEP = 0.01  # change of a parameter for its influence on the rates, in standard deviations of its prior


@dataclasses.dataclass(frozen=True)
class Regression:
    """A linear problem: target (rows,) and terms (rows, k) of unit rms with their names, and the run of each row."""

    target: np.ndarray
    terms: np.ndarray
    names: tuple[str, ...]
    run: np.ndarray


def sparse_discrepancy(fitted: Fit, candidates: list[Candidate], per_sample: int) -> Answer:
    """Sequentially thresholded least squares (PySINDy) on the discrepancy of the rates of the measured states.

    Args:
        fitted: the fit of the model without the candidates.
        candidates: candidate effects and sensor faults.
        per_sample: time steps per sample.
    """
    problem = regression(fitted, candidates, per_sample)
    if problem is None:
        return answer_of_names((), ())
    overlaps = problem.terms.T @ problem.target
    order = [problem.names[k] for k in np.argsort(-overlaps)]
    threshold = chosen_threshold(problem)
    if threshold is None:
        return answer_of_names((), tuple(order[:MAX_RANKED]))
    inclusion, weights = ensemble(problem, threshold)
    found = [k for k in np.argsort(-np.abs(weights)) if inclusion[k] >= MIN_INCLUSION and weights[k] > 0.0]
    named = tuple(problem.names[k] for k in found[:MAX_NAMES])
    answer = answer_of_names(named, tuple(dict.fromkeys((*named, *order)))[:MAX_RANKED])
    return dataclasses.replace(answer, probability=float(inclusion[found[0]])) if found else answer


def regression(fitted: Fit, candidates: list[Candidate], per_sample: int) -> Regression | None:
    """The discrepancy and the terms of the effects that contribute to it, both without what parameters reproduce.

    None where no state with a rate is measured.
    """
    rates, campaign = WeakRates(fitted, per_sample), fitted.problem.campaign
    if not rates.equations:
        return None
    discrepancy = rates.discrepancy()
    scales = [float(of.std()) or 1.0 for of in discrepancy]

    def scaled(change: list[np.ndarray]) -> np.ndarray:
        return np.concatenate([of / scale for of, scale in zip(change, scales, strict=True)])

    changed = (_with_step(fitted.machine, u, x) for u, x in zip(fitted.problem.unknowns, fitted.x, strict=True))
    of_parameters = [row for machine in changed if (row := scaled(rates.change(machine))).any()]
    basis = np.linalg.qr(np.array(of_parameters).T)[0]
    target = scaled(discrepancy)
    target = target - basis @ (basis.T @ target)
    names, terms = [], []
    for candidate in candidates:
        if candidate.signal is not None:
            continue
        rows = [scaled(rates.change(machine)) for machine in _on_grid(candidate, fitted, campaign)]
        rows = [row - basis @ (basis.T @ row) for row in rows if np.isfinite(row).all() and row.any()]
        rows = [row / size for row in rows if (size := math.sqrt(np.mean(np.square(row)))) > 0.0]
        if rows:
            names.append(candidate.name)
            terms.append(max(rows, key=lambda row: row @ target))
    return Regression(target, np.array(terms).T, tuple(names), rates.run_of_row)


def _with_step(machine: Rig, unknown: UnknownParameter, x: float) -> Rig:
    """A machine with a slightly larger parameter; an order that its laws prescribe does not matter here."""
    p, path = find_parameter(machine, unknown.name)
    return replace_value(machine, path, p.name, float(unknown.value(x + PARAMETER_STEP)))


def _on_grid(candidate: Candidate, fitted: Fit, campaign: Campaign) -> Iterable[Rig]:
    """The calibrated machine with an effect at each point of its grid."""
    machine, _ = candidate.mounted(fitted.machine, fitted.instruments)
    unknowns = candidate.unknowns(campaign)
    for x in screening_grid(unknowns):
        values = {
            f"{candidate.id}.{u.name.removeprefix(candidate.prefix)}": float(u.value(v))
            for u, v in zip(unknowns, x, strict=True)
        }
        try:
            changed = set_parameters(machine, values)
        except ParameterError:  # values that contradict each other
            continue
        yield changed


def _stlsq(problem: Regression, rows: np.ndarray, threshold: float) -> np.ndarray:
    """The coefficients (k,) of STLSQ on some rows."""
    import pysindy

    optimizer = pysindy.STLSQ(threshold=threshold, alpha=RIDGE * len(rows))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # no term remains, which is a valid answer
        optimizer.fit(problem.terms[rows], problem.target[rows, None])
    return optimizer.coef_[0]


def chosen_threshold(problem: Regression) -> float | None:
    """The sparsest threshold whose error on runs left out no smaller one beats by a standard error; None: no term."""
    runs = np.unique(problem.run)
    errors = np.zeros((len(runs), 1 + len(THRESHOLDS)))
    for k, left_out in enumerate(runs):
        inside, outside = np.flatnonzero(problem.run != left_out), np.flatnonzero(problem.run == left_out)
        errors[k, 0] = np.sum(np.square(problem.target[outside]))
        for j, threshold in enumerate(THRESHOLDS, start=1):
            left = problem.target[outside] - problem.terms[outside] @ _stlsq(problem, inside, threshold)
            errors[k, j] = np.sum(np.square(left))
    chosen = 0
    for j in range(1, errors.shape[1]):
        falls = errors[:, chosen] - errors[:, j]
        if len(runs) > 1 and falls.sum() > STANDARD_ERRORS * falls.std(ddof=1) * math.sqrt(len(runs)):
            chosen = j
    return THRESHOLDS[chosen - 1] if chosen else None


def ensemble(problem: Regression, threshold: float) -> tuple[np.ndarray, np.ndarray]:
    """The share of models of resampled data that have each term (k,), and the median coefficients (k,)."""
    import pysindy

    base = pysindy.STLSQ(threshold=threshold, alpha=RIDGE * len(problem.target))
    optimizer = pysindy.EnsembleOptimizer(base, bagging=True, n_models=ENSEMBLE)
    state = np.random.get_state()  # noqa: NPY002 PySINDy draws from the global generator
    np.random.seed(0)  # noqa: NPY002
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            optimizer.fit(problem.terms, problem.target[:, None])
    finally:
        np.random.set_state(state)  # noqa: NPY002
    coefficients = np.array(optimizer.coef_list)[:, 0, :]
    return np.mean(coefficients != 0.0, axis=0), np.median(coefficients, axis=0)
