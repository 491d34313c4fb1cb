"""Rival: the best subset of suspects (L0), with its size chosen by leaving out one run after the other.

The residual of the calibrated model is fitted by signatures with weights of at least 0, at most three suspects at a
time; the coordinates of the model are free within their priors. For each size the best subset on the other runs
predicts the run left out. The size is the smallest whose error on the runs left out is not more than one standard error
above that of a larger one (Hastie, Tibshirani, Friedman, The Elements of Statistical Learning, chapter 7.10).
"""

import itertools
import math

import numpy as np

from studies.hidden_effects.answers import Answer
from studies.hidden_effects.naming import MAX_NAMES, MAX_RANKED, answer_of_names, unknown_where_unexplained
from studies.hidden_effects.rivals.grams import Grams, LinearFit, grams_of
from studies.hidden_effects.signatures import SignatureTable

POINTS = 3  # points of the grid of a suspect with the largest falls of χ², whose weighted sum may act
SCREENED, KEPT_PAIRS = 16, 12  # best single suspects of which pairs are made, and best pairs to which a third is added
STANDARD_ERRORS = 1.0
MIN_FALL = 12.0  # of χ² on the runs left out, below which no suspect is added


def best_subsets(fit: LinearFit) -> list[tuple[tuple[int, ...], np.ndarray, np.ndarray]]:
    """For each size from 0 the suspects of the best subset, the indices of its signatures and their weights."""
    falls = fit.falls()
    points = [columns[np.argsort(-falls[columns])[:POINTS]] for columns in fit.grams.columns]
    points = [columns[falls[columns] > 0.0] for columns in points]
    best = [((), np.zeros(0, int), np.zeros(0))]
    candidates = [(k,) for k in range(len(points)) if len(points[k])]
    singles: list[tuple[int, ...]] = []
    for size in range(1, MAX_NAMES + 1):
        found = []
        for subset in candidates:
            columns = np.concatenate([points[k] for k in subset])
            weights, fall = fit.weights(columns)
            found.append((fall, subset, columns, weights))
        if not found:
            break
        found.sort(key=lambda item: -item[0])
        best.append(found[0][1:])
        if size == 1:
            singles = [subset for _, subset, *_ in found[:SCREENED]]
            candidates = [a + b for a, b in itertools.combinations(singles, 2)]
        else:
            pairs = [subset for _, subset, *_ in found[:KEPT_PAIRS]]
            candidates = sorted({tuple(sorted(p + s)) for p in pairs for s in singles if s[0] not in p})
    return best


def chosen_size(grams: Grams) -> int:
    """The size of the subset, from the errors on the runs left out."""
    runs = range(len(grams.by_run))
    errors = np.full((len(runs), MAX_NAMES + 1), math.nan)
    for left_out in runs:
        fit = grams.fitted_to([r for r in runs if r != left_out])
        for size, (_, columns, weights) in enumerate(best_subsets(fit)):
            errors[left_out, size] = fit.error_on(left_out, columns, weights)
    errors = errors[:, np.isfinite(errors).all(axis=0)]
    size = 0
    for larger in range(1, errors.shape[1]):
        falls = errors[:, size] - errors[:, larger]
        standard_error = falls.std(ddof=1) * math.sqrt(len(falls)) if len(falls) > 1 else math.inf
        if falls.sum() > max(STANDARD_ERRORS * standard_error, MIN_FALL):
            size = larger
    return size


def best_subset(table: SignatureTable) -> Answer:
    """Name the suspects of the best subset, the one with the largest share first."""
    grams = grams_of(table)
    whole = grams.fitted_to(range(len(grams.by_run)))
    falls = whole.falls()
    order = sorted(range(len(grams.names)), key=lambda k: -falls[grams.columns[k]].max())
    subset, columns, weights = best_subsets(whole)[chosen_size(grams)]
    shares = {}
    for k in subset:
        others = columns[~np.isin(columns, grams.columns[k])]
        shares[grams.names[k]] = -(whole.weights(others)[1] if len(others) else 0.0)
    named = tuple(sorted(shares, key=lambda name: -shares[name]))
    ranked = dict.fromkeys((*named, *(grams.names[k] for k in order)))
    answer = answer_of_names(named, tuple(ranked)[:MAX_RANKED])
    rows = np.concatenate([s.rows for s in table.suspects])
    return unknown_where_unexplained(answer, table.unexplained, table.unexplained_with(weights @ rows[columns]))
