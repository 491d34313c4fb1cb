"""Rival: forward selection by BIC, all parameters being fitted again with each of the most promising suspects.

    BIC = Σ over signals of n ln(RSS/n) + k ln N

with n the samples of a signal and RSS the sum of squares of its residual after the usual errors of the bench, k the
free parameters of the suspects in the model and N all samples. The noise of each signal is thus estimated along with
the model (Schwarz 1978; for unknown variances Burnham and Anderson 2002, chapter 6.9). In each round the suspects with
the largest predicted falls of χ² are fitted and the one with the smallest BIC is added, while BIC falls. Probabilities
are Schwarz weights exp(−BIC/2) of the first round.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from edhas_jax.diagnosis.candidates.candidate import Candidate, with_candidates
from edhas_jax.inference.fit.evaluated_fit import EvaluatedFit, fit_coarse, start_coordinates, with_solver_error
from edhas_jax.inference.fit.fit import FitError
from edhas_jax.measurements.time_resolution import TimeResolution
from studies.hidden_effects.answers import NOTHING, Answer
from studies.hidden_effects.calibrated_case import CalibratedCase, exact_fit
from studies.hidden_effects.naming import (
    MAX_NAMES,
    MAX_RANKED,
    answer_of_names,
    credible_set,
    unknown_where_unexplained,
)
from studies.hidden_effects.signatures import Signatures, SignatureTable, signature_table

REFITS = 8  # suspects that are fitted in each round
REFINED = 3  # of them, with the best fits, are refined and compared by BIC
MIN_SHARE_OF_BEST = 0.05  # of the largest predicted fall of χ²; suspects that predict less are not fitted
MIN_FALL = 12.0  # predicted fall of χ² below which no BIC can fall
FIT_STEPS = 10  # maximum number of Levenberg-Marquardt steps
MIN_ACHIEVED_SHARE = 0.3  # of the predicted fall: a fit that achieves less is started again nearer the prior mean
RESTART_SHARE = 0.3  # of the calibrated coordinates, where it is started again
MIN_SCALE, MAX_SCALE = 0.25, 4.0  # of a signature: beyond, another grid point is nearer


@dataclasses.dataclass(frozen=True)
class Start:
    """A suspect with the fall of χ² that its signature predicts, and the coordinates of its parameters there."""

    candidate: Candidate
    fall: float
    x: np.ndarray


@dataclasses.dataclass(frozen=True)
class Model:
    """A fitted model with some suspects mounted, what it leaves of the signals (m,) in units of noise, and its BIC."""

    evaluated: EvaluatedFit
    mounted: tuple[Candidate, ...]
    left: np.ndarray
    bic: float


def best_starts(table: SignatureTable, case: CalibratedCase) -> list[Start]:
    """The suspects with the largest predicted falls of χ², the largest first."""
    found = [start for suspect in table.suspects if (start := _start(table, suspect, case)).fall > MIN_FALL]
    found.sort(key=lambda s: -s.fall)
    return [s for s in found[:REFITS] if s.fall > MIN_SHARE_OF_BEST * found[0].fall]


def _start(table: SignatureTable, suspect: Signatures, case: CalibratedCase) -> Start:
    rows, residual = table.projected(suspect), table.projected_residual
    squares, overlaps = np.sum(np.square(rows), axis=1), rows @ residual
    scales = np.clip(np.divide(overlaps, squares, out=np.zeros_like(squares), where=squares > 0.0), 0.0, MAX_SCALE)
    falls = scales * (2.0 * overlaps - scales * squares)
    best = int(np.argmax(falls))
    x = np.array(suspect.points[best], float)
    unknowns = suspect.candidate.unknowns(case.campaign)
    if unknowns:  # the first is the size
        size = max(scales[best], MIN_SCALE) * float(unknowns[0].value(x[0]))
        x[0] = np.clip(unknowns[0].coordinate(size), *unknowns[0].bounds())
    return Start(suspect.candidate, float(falls[best]), x)


def evaluated_model(evaluated: EvaluatedFit, mounted: tuple[Candidate, ...]) -> Model:
    """A model with its BIC."""
    table = signature_table(exact_fit(evaluated.fit)[0], ())
    own = sum(len(c.unknowns(evaluated.fit.problem.campaign)) for c in mounted)
    left = table.unexplained
    total = sum(
        len(of) * math.log(float(np.mean(np.square(of))))
        for k in range(len(table.signal_names))
        if len(of := left[table.signal == k])
    )
    return Model(evaluated, mounted, left, total + own * math.log(len(left)))


def coarse_fit(start: Start, base: Model, resolution: TimeResolution, reached: float) -> EvaluatedFit | None:
    """Fit all parameters with a suspect added, at the coarse time step.

    Args:
        start: the suspect and the coordinates of its parameters to begin with.
        base: the model without it.
        resolution: time steps per sample.
        reached: the largest fall of χ² that another suspect has achieved. A fit that achieves far less than is
            predicted is started again nearer the prior mean, where the prediction exceeds this.

    Returns:
        The better fit; None where no fit is possible.
    """
    known = base.evaluated.fit.problem
    problem = with_candidates(known, [start.candidate])
    count = len(problem.unknowns) - len(start.x)
    calibrated = start_coordinates(problem, base.evaluated.fit.values)[:count]
    best: EvaluatedFit | None = None
    for share in (1.0, RESTART_SHARE):
        try:
            x = np.concatenate([share * calibrated, start.x])
            found = fit_coarse(problem, x, resolution.coarse, FIT_STEPS)
        except FitError:
            continue
        best = found if best is None or found.cost < best.cost else best
        if fall_of(best, base) > MIN_ACHIEVED_SHARE * start.fall or start.fall < reached:
            break
    return best


def fall_of(found: EvaluatedFit, base: Model) -> float:
    """The fall of χ² from a model to a fit with one suspect more."""
    return 2.0 * (base.evaluated.cost - found.cost)


def best_addition(starts: Sequence[Start], base: Model, resolution: TimeResolution) -> list[Model]:
    """The models with one suspect more, of the suspects whose fits are best, the smallest BIC first."""
    fits: list[tuple[EvaluatedFit, Candidate]] = []
    for start in starts:
        reached = max((fall_of(found, base) for found, _ in fits), default=0.0)
        found = coarse_fit(start, base, resolution, reached)
        if found is not None:
            fits.append((found, start.candidate))
    models = []
    for found, candidate in sorted(fits, key=lambda fit: fit[0].cost)[:REFINED]:
        refined = with_solver_error(found, resolution, FIT_STEPS)
        models.append(evaluated_model(refined, (*base.mounted, candidate)))
    return sorted(models, key=lambda model: model.bic)


def forward_bic(case: CalibratedCase) -> Answer:
    """Add suspects while BIC falls.

    Args:
        case: calibrated model, suspects and signatures.
    """
    evaluated, resolution = case.calibrated
    first = model = evaluated_model(evaluated, ())
    table = case.table
    weights: dict[str, float] = {}
    while True:
        trials = best_addition(best_starts(table, case), model, resolution)
        if not model.mounted:
            weights = schwarz_weights({NOTHING: model.bic} | {t.mounted[-1].name: t.bic for t in trials})
        if not trials or trials[0].bic >= model.bic:
            break
        model = trials[0]
        if len(model.mounted) == MAX_NAMES:
            break
        problem = model.evaluated.fit.problem
        mounted = {c.name for c in model.mounted}
        suspects = [c for c in case.suspects_of(problem.machine, problem.instruments) if c.name not in mounted]
        table = signature_table(exact_fit(model.evaluated.fit)[0], suspects)
    named = tuple(c.name for c in model.mounted)
    ranked = tuple(name for name in weights if name != NOTHING)[:MAX_RANKED]
    answer = answer_of_names(named, ranked)
    answer = dataclasses.replace(answer, answer_set=credible_set(weights), probability=weights[answer.first])
    return unknown_where_unexplained(answer, first.left, model.left)


def schwarz_weights(bic: dict[str, float]) -> dict[str, float]:
    """Probabilities ∝ exp(−BIC/2), the largest first."""
    least = min(bic.values())
    weights = {name: math.exp(-0.5 * (value - least)) for name, value in bic.items()}
    total = sum(weights.values())
    return {name: w / total for name, w in sorted(weights.items(), key=lambda item: -item[1])}
