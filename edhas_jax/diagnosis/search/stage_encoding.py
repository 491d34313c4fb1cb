"""Fits, trials and rounds of a diagnosis as plain data and arrays, from which they are restored without any fit.

A fit problem is not stored: it follows from the campaign and the candidates that are mounted. Candidates are stored by
the id of their class, so that reading a file runs no code.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.calibration.unpredictable_part import with_unpredictable_part
from edhas_jax.diagnosis.likelihood.bench_estimate import BenchEstimate
from edhas_jax.diagnosis.likelihood.residual_outliers import without_missing
from edhas_jax.diagnosis.likelihood.time_correction import with_clock_error, with_corrected_time
from edhas_jax.diagnosis.search.candidates import SENSOR_FAULTS, Candidate, build_problem, with_candidates
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit
from edhas_jax.diagnosis.search.law_deviation import LawDeviation
from edhas_jax.diagnosis.search.result import Round, mounted_candidates
from edhas_jax.diagnosis.search.screening import Score
from edhas_jax.diagnosis.search.trial import Trial
from edhas_jax.machine.effects import LIBRARY, Effect
from edhas_jax.machine.effects.tabulated_law import LawPlace, rig_of, tabulated_class
from edhas_jax.machine.rig_base import Rig
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.measurement_model import PredictedSignals
from edhas_jax.measurements.time_resolution import TimeResolution

Plain = dict[str, Any]
TRIAL_NUMBERS = (
    "log_evidence_gain", "left_out_gain", "explained_share", "holdout_half_chi_square_fall", "gain_beyond_laws",
    "remaining_excess", "own_law_excess", "own_law_gain", "prior_cost",
)  # fmt: skip


class RoundEnd(NamedTuple):
    """A finished round, and what the next one begins with; no baseline where nothing was accepted."""

    round: Round
    baseline: EvaluatedFit | None


class StageEncoder:
    """Turns parts of a diagnosis into plain data; `arrays` collects the arrays that it refers to by name."""

    def __init__(self):
        self.arrays: dict[str, np.ndarray] = {}

    def start(self, start: tuple[EvaluatedFit, TimeResolution]) -> Plain:
        """The calibrated model and the time steps."""
        return {"fit": self.fit(start[0]), "resolution": list(start[1])}

    def round_end(self, end: RoundEnd) -> Plain:
        """A round and what the next one begins with."""
        baseline = None if end.baseline is None else self.fit(end.baseline)
        return {"round": self.round(end.round), "baseline": baseline}

    def round(self, r: Round) -> Plain:
        """A round with the sensitivities of its baseline."""
        return {
            "baseline": self.fit(r.baseline),
            "scores": [self.score(score) for score in r.scores],
            "trials": [self.trial(trial) for trial in r.trials],
            "accepted": None if r.accepted is None else [t is r.accepted for t in r.trials].index(True),
            "laws": [_law_as_plain(law) for law in r.laws],
        }

    def trial(self, trial: Trial) -> Plain:
        """A trial; the sensitivities of its fit are left out, because nothing after the trial needs them."""
        return {
            "score": self.score(trial.score),
            "fit": None if trial.evaluated is None else self.fit(trial.evaluated, with_sensitivities=False),
            "numbers": {name: getattr(trial, name) for name in TRIAL_NUMBERS},
        }

    def score(self, score: Score) -> Plain:
        """A score; its direction is left out, because nothing after the screening needs it."""
        candidate = [score.candidate.id, score.candidate.signal]
        return {
            "candidate": candidate, "chi_square_fall": score.chi_square_fall, "x": self._put(score.x),
            "exponent": score.exponent,
        }  # fmt: skip

    def fit(self, evaluated: EvaluatedFit, with_sensitivities: bool = True) -> Plain:
        """A fit with its residuals."""
        fit = evaluated.fit
        return {
            "x": self._put(fit.x), "uncorrected": self._put(fit.uncorrected), "covariance": self._put(fit.covariance),
            "costs": self._put(fit.costs), "cost": fit.cost, "converged": fit.converged,
            "resolution": list(fit.resolution),
            "outcomes": [
                [self._table(o.values), self._table(o.sensitivities) if with_sensitivities else None]
                for o in fit.outcomes
            ],
            "residuals": {run: self._table(rows) for run, rows in evaluated.residuals.items()},
            "time_errors": {run: list(of) for run, of in fit.problem.time_errors.items()},
            "clock_error": fit.problem.campaign.accuracy.clock_error,
            "tightening": fit.problem.campaign.tightening, "unpredictable": fit.problem.campaign.unpredictable,
            "sensors": self._put(evaluated.bench.of_sensors), "runs": self._table(evaluated.bench.of_runs),
            "solver_error": (
                None
                if fit.problem.solver_error is None
                else {run: self._table(rows) for run, rows in fit.problem.solver_error.items()}
            ),
        }  # fmt: skip

    def _table(self, rows: Mapping[str, np.ndarray] | None) -> dict[str, str] | None:
        return None if rows is None else {name: self._put(values) for name, values in rows.items()}

    def _put(self, values: np.ndarray) -> str:
        name = f"array_{len(self.arrays)}"
        self.arrays[name] = np.asarray(values, float)
        return name


@dataclasses.dataclass(frozen=True)
class StageDecoder:
    """Restores parts of a diagnosis; the counterpart of `StageEncoder`.

    Attributes:
        campaign: the campaign of the diagnosis.
        kinds: effect classes of the user, beside the library.
        arrays: the arrays of the stage by name.
    """

    campaign: Campaign
    kinds: Sequence[type[Effect]]
    arrays: Mapping[str, np.ndarray]

    def start(self, plain: Plain) -> tuple[EvaluatedFit, TimeResolution]:
        """The calibrated model and the time steps."""
        return self.fit(plain["fit"], ()), TimeResolution(*plain["resolution"])

    def round_end(self, plain: Plain, mounted: Sequence[Candidate]) -> RoundEnd:
        """A round whose baseline has the candidates `mounted`, and what the next one begins with."""
        r = self.round(plain["round"], mounted)
        baseline = None if r.accepted is None else self.fit(plain["baseline"], (*mounted, *mounted_candidates([r])))
        return RoundEnd(r, baseline)

    def round(self, plain: Plain, mounted: Sequence[Candidate]) -> Round:
        """A round whose baseline has the candidates `mounted`."""
        trials = tuple(self.trial(t, mounted) for t in plain["trials"])
        return Round(
            self.fit(plain["baseline"], mounted), tuple(self.score(s) for s in plain["scores"]), trials,
            None if plain["accepted"] is None else trials[plain["accepted"]],
            tuple(_law_from_plain(law, self.campaign.machine) for law in plain["laws"]),
        )  # fmt: skip

    def trial(self, plain: Plain, mounted: Sequence[Candidate]) -> Trial:
        """A trial of one more candidate beside those `mounted`."""
        score = self.score(plain["score"])
        fit = None if plain["fit"] is None else self.fit(plain["fit"], (*mounted, score.candidate))
        return Trial(score.candidate, score, fit, **plain["numbers"])

    def score(self, plain: Plain) -> Score:
        """A score, its direction empty."""
        kind_id, signal = plain["candidate"]
        known = SENSOR_FAULTS if signal is not None else (*LIBRARY, *self.kinds)
        candidate = Candidate(next(kind for kind in known if kind.id == kind_id), signal)
        return Score(
            candidate, plain["chi_square_fall"], self.arrays[plain["x"]], np.zeros(0), plain.get("exponent", 1.0)
        )

    def fit(self, plain: Plain, mounted: Sequence[Candidate]) -> EvaluatedFit:
        """A fit of the model with the candidates `mounted`."""
        error = plain["solver_error"]
        error = None if error is None else {run: self._table(rows) for run, rows in error.items()}
        errors = {run: tuple(of) for run, of in plain["time_errors"].items()}
        residuals = {run: self._table(rows) for run, rows in plain["residuals"].items()}
        campaign = with_clock_error(self.campaign, plain["clock_error"])
        campaign = with_corrected_time(campaign, errors) if errors else campaign
        campaign = without_missing(dataclasses.replace(campaign, tightening=plain["tightening"]), residuals)
        campaign = with_unpredictable_part(campaign, plain["unpredictable"])
        problem = with_candidates(build_problem(campaign, campaign.machine, Instruments(), ()), mounted)
        problem = dataclasses.replace(problem, solver_error=error, time_errors=errors)
        fitted = Fit(
            problem, self.arrays[plain["x"]], self.arrays[plain["uncorrected"]],
            self.arrays[plain["covariance"]], plain["cost"],
            tuple(PredictedSignals(self._table(values), self._table(slopes)) for values, slopes in plain["outcomes"]),
            TimeResolution(*plain["resolution"]), plain["converged"], self.arrays[plain["costs"]],
        )  # fmt: skip
        bench = BenchEstimate(self.arrays[plain["sensors"]], self._table(plain["runs"]))
        return EvaluatedFit(fitted, residuals, bench)

    def _table(self, names: Mapping[str, str] | None) -> dict[str, np.ndarray] | None:
        return None if names is None else {name: self.arrays[key] for name, key in names.items()}


def _law_as_plain(law: LawDeviation) -> Plain:
    return {"name": law.id, "place": list(law.place[:3]), "nodes": list(law.nodes), "spread": law.spread}


def _law_from_plain(plain: Plain, machine: Rig) -> LawDeviation:
    slot, variable, factors = plain["place"]
    place, nodes = LawPlace(slot, variable, tuple(factors), rig_of(machine)), tuple(plain["nodes"])
    return LawDeviation(tabulated_class(plain["name"], place, len(nodes)), None, place, plain["spread"], nodes)
