"""Whether the data demand implausible values of a candidate's parameters, and what such values cost."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from edhas_jax.core import structs
from edhas_jax.core.structs import par
from edhas_jax.diagnosis.calibration.fit import fit
from edhas_jax.diagnosis.search.candidates import Candidate, build_problem
from edhas_jax.diagnosis.search.evaluated_fit import evaluate_fit
from edhas_jax.diagnosis.search.plausibility import (
    beyond_plausible_range,
    implausibility,
    implausibility_cost,
    implausibility_penalty,
    prior_cost,
)
from edhas_jax.machine.effects import Effect
from edhas_jax.measurements.instruments import Instruments
from tests.support.synthetic_campaign import bench, empty_campaign, measured

PLAUSIBLE = (0.1, 2.0)  # V, the range of each voltage


class TwoDeadTimes(Effect):
    """Two voltages of which the data determine only the sum."""

    first: float = par(0.5, "V", (0.0, 50.0), "voltage that is lost", plausible=PLAUSIBLE)
    second: float = par(0.5, "V", (0.0, 50.0), "another one", plausible=PLAUSIBLE)

    def coil_voltage_change(self, s, z):
        return -(self.first + self.second) * jnp.tanh(9.0 * s.current)


def fit_with(total: float, first: float):
    """A fit to data in which `total` [V] is lost, moved to a point on its flat ridge, and without its covariances."""
    truth = structs.replace(bench(), effects=(*bench().effects, TwoDeadTimes(first=total, second=0.0)))
    campaign, candidate = measured(empty_campaign(lengths=(201,) * 3), truth), Candidate(TwoDeadTimes)
    found = fit(build_problem(campaign, campaign.machine, Instruments(), (), candidate), starts=1)
    x, own = found.x.copy(), candidate.own_unknowns(found.problem.unknowns)
    for k, unknown in enumerate(found.problem.unknowns):
        for name, value in (("first", first), ("second", total - first)):
            if unknown is own[name]:
                x[k] = unknown.coordinate(value)
    (outcomes,) = found.problem.predict(x[None], found.resolution.coarse, with_sensitivities=True)
    alone = np.diag(np.diag(found.covariance))  # as where the covariance does not hold far away
    return candidate, dataclasses.replace(found, x=x, covariance=alone, outcomes=outcomes)


def test_values_that_others_can_replace_are_not_demanded():
    candidate, found = fit_with(total=3.0, first=2.8)
    assert beyond_plausible_range(candidate, found) == ["first"]
    assert implausibility(candidate, found) == ((), 0.0)
    assert implausibility_cost(candidate, evaluate_fit(found), 1e3) == (0.0, 0.0)


def test_values_that_nothing_can_replace_cost_no_more_than_a_fit_without_them():
    candidate, found = fit_with(total=4.3, first=2.4)  # plausible values lose 4 V together
    demanded = implausibility(candidate, found)
    assert demanded.parameters == ("first",) and 5.0 < demanded.rise < np.inf
    evaluated = evaluate_fit(found)
    off_gain, off_weight = implausibility_cost(candidate, evaluated, 1e9)  # evidences are compared on a scale of 1e7
    assert off_gain == pytest.approx(min(demanded.rise, implausibility_penalty(evaluated.excess)), rel=1e-3)
    assert off_weight == pytest.approx(demanded.rise / 1e7, rel=0.01)
    assert off_weight < prior_cost(candidate, found)
