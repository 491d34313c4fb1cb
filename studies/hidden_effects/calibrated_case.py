"""What the rival methods share in one case: the checked data, the calibrated model and the table of signatures.

The residual is taken at a time step whose solver error is far below the noise.
"""

import dataclasses
import functools
import time

from edhas_jax.diagnosis.candidates.candidate import Candidate, candidates_for
from edhas_jax.diagnosis.search.holdout_split import split_for_holdout
from edhas_jax.inference.fit.calibrated_model import calibrate
from edhas_jax.inference.fit.evaluated_fit import EvaluatedFit
from edhas_jax.inference.fit.fit import Fit
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.measurement_model import PredictedSignals
from edhas_jax.measurements.time_resolution import TimeResolution, choose_time_resolution
from studies.hidden_effects.generators.hidden_case import HiddenCase
from studies.hidden_effects.signatures import SignatureTable, signature_table

MAX_EXACT_ERROR_OVER_NOISE = 0.01  # largest rms error of the solver in the residual, in units of the noise


@dataclasses.dataclass(frozen=True)
class CalibratedCase:
    """A case with what its methods share, each part computed when it is first asked for.

    Args:
        drawn: the case.
    """

    drawn: HiddenCase

    @functools.cached_property
    def campaign(self) -> Campaign:
        """The data without what is impossible in them, with the noise as measured and hold-out runs."""
        return split_for_holdout(checked_campaign(self.drawn.campaign))[0]

    @functools.cached_property
    def calibrated(self) -> tuple[EvaluatedFit, TimeResolution]:
        """The model with its uncertain parameters fitted and nothing added, and the time steps."""
        return calibrate(self.campaign)

    @functools.cached_property
    def exact(self) -> tuple[Fit, int]:
        """The calibrated model with signals free of solver error, and its time steps per sample."""
        return exact_fit(self.calibrated[0].fit)

    @functools.cached_property
    def suspects(self) -> list[Candidate]:
        """The effects and sensor faults that may be named."""
        problem = self.calibrated[0].fit.problem
        return self.suspects_of(problem.machine, problem.instruments)

    def suspects_of(self, machine: Rig, instruments: Instruments) -> list[Candidate]:
        """The effects and sensor faults that a machine and its sensors can have in addition."""
        found = candidates_for(self.campaign, machine, instruments, self.drawn.own_library)
        return [c for c in found if c.signal is not None or c.kind in self.drawn.library]

    @functools.cached_property
    def table(self) -> SignatureTable:
        """Residual and signatures of all suspects."""
        return signature_table(self.exact[0], self.suspects)

    @functools.cached_property
    def seconds(self) -> float:
        """Computing time [s] of what the methods share."""
        start = time.process_time()
        _ = self.table
        return time.process_time() - start


def exact_fit(fitted: Fit) -> tuple[Fit, int]:
    """A fit with its signals at a step whose error is far below the noise, and this number of steps per sample."""
    model = fitted.problem.model()
    per_sample = choose_time_resolution(model, fitted.x, MAX_EXACT_ERROR_OVER_NOISE).fine
    exact = model.predict_all_runs(fitted.x, per_sample)
    outcomes = tuple(
        PredictedSignals(exact[r].values, outcome.sensitivities) for r, outcome in enumerate(fitted.outcomes)
    )
    return dataclasses.replace(fitted, outcomes=outcomes), per_sample
