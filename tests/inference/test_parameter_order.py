"""Orders that a law prescribes among its parameters: in fits, configurations, drawn machines and user effects."""

import dataclasses

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.config.machine_config import ConfigError
from edhas_jax.core.structs import par
from edhas_jax.inference.fit.calibration import Calibration, estimates_as_json
from edhas_jax.inference.fit.fit import fit
from edhas_jax.inference.fit.fit_problem import FitProblem
from edhas_jax.inference.fit.least_squares import QuadraticModel, levenberg_marquardt
from edhas_jax.inference.fit.parameter_order import LinearConstraints, order_constraints
from edhas_jax.inference.fit.uncertainty import profile_likelihood
from edhas_jax.machine.effects import Effect, EffectError
from edhas_jax.machine.effects.validation import check_declaration
from edhas_jax.machine.parameters import ParameterError
from edhas_jax.measurements.unknown_parameters import uncertain_unknowns
from studies.synthetic_campaign import draw_parameters
from tests.support.synthetic_campaign import bench, empty_campaign, measured

FRICTION = {"coulomb_friction": 0.5, "static_friction": 0.5}
CONFIG = """
rig: actuator_bench
effects: [lugre_friction]
parameters: {coulomb_friction: 5 N, static_friction: 3 N}
"""


def test_a_search_keeps_to_a_linear_constraint():
    """The minimum of a quadratic with x₁ ≥ x₀ + 1, from inside, from outside and along the boundary."""
    target, curvature = np.array([2.0, 1.0, 0.5]), np.diag([4.0, 1.0, 2.0])

    def evaluate(x, starts):
        d = x - target
        return QuadraticModel(
            0.5 * np.einsum("ki,ij,kj->k", d, curvature, d), d @ curvature, np.tile(curvature, (len(x), 1, 1))
        )

    constraint = LinearConstraints(np.array([[-1.0, 1.0, 0.0]]) / np.sqrt(2.0), np.array([1.0]) / np.sqrt(2.0))
    low, high = np.full(3, -5.0), np.full(3, 5.0)
    starts = np.array([[-1.0, 3.0, 0.0], [3.0, 0.0, 0.0], [0.0, 1.0, 4.0]])
    found = levenberg_marquardt(evaluate, starts, low, high, tolerance=1e-12, constraints=constraint)
    # on the boundary the cost is 2 (x₀ − 2)² + ½ x₀², with its minimum at 1.6
    np.testing.assert_allclose(found.x, [[1.6, 2.6, 0.5]] * 3, atol=3e-4)  # a share of 1e-7 of the cost
    assert found.converged.all() and (found.x @ constraint.rows[0] >= constraint.limits[0] - 1e-9).all()
    high[1] = 2.0
    found = levenberg_marquardt(evaluate, starts, low, high, tolerance=1e-12, constraints=constraint)
    np.testing.assert_allclose(found.x, [[1.0, 2.0, 0.5]] * 3, atol=3e-4)


def test_static_friction_is_fitted_at_least_as_large_as_coulomb_friction():
    """The data come from a friction that falls to three quarters at standstill, which the law does not allow."""
    campaign = empty_campaign(uncertain=FRICTION, lengths=(201, 201, 201))
    truth = bench()
    for name, value in (("coulomb_friction", 4.0), ("static_friction", 3.0)):
        object.__setattr__(truth.effects[0], name, value)
    campaign = measured(campaign, truth)
    found = fit(FitProblem(campaign, campaign.machine, uncertain_unknowns(campaign)), starts=1)
    values = found.values
    assert values["static_friction"] >= values["coulomb_friction"] * (1.0 - 1e-9)
    assert values["static_friction"] == pytest.approx(values["coulomb_friction"], rel=1e-3) and found.converged
    assert found.at_limit == {"static_friction": "lower", "coulomb_friction": "upper"}
    assert found.at_order == [("static_friction", "coulomb_friction")]
    assert all(np.isnan(found.standard_errors[name]) and np.isnan(found.interval(name)).all() for name in FRICTION)
    assert found.text("static_friction").endswith(" N, its lower limit")
    calibration = Calibration(found, None, (), {}, {}, 0.0)
    calibration = dataclasses.replace(calibration, before=found.residuals, after=found.residuals)
    assert "static_friction and coulomb_friction are equal: the law asks" in " ".join(calibration.findings())
    assert all("limit" in row and row["std"] is None for row in estimates_as_json(found).values())


def test_an_estimate_above_the_order_has_a_standard_error():
    campaign = empty_campaign(uncertain=FRICTION, lengths=(201, 201, 201))
    campaign = measured(campaign, bench())
    found = fit(FitProblem(campaign, campaign.machine, uncertain_unknowns(campaign)), starts=1)
    assert not found.at_limit and not found.at_order and np.isfinite(list(found.standard_errors.values())).all()


def test_the_value_of_a_known_parameter_is_a_limit_of_the_other():
    campaign = empty_campaign(uncertain={"coulomb_friction": 0.5}, lengths=(201, 201, 201))
    truth = edhas.change(bench(), coulomb_friction="9 N", static_friction="9 N")
    campaign = measured(campaign, truth)
    found = fit(FitProblem(campaign, campaign.machine, uncertain_unknowns(campaign)), starts=1)
    assert found.at_limit == {"coulomb_friction": "upper"} and not found.at_order
    assert found.values["coulomb_friction"] == pytest.approx(6.0)
    assert np.isnan(found.standard_errors["coulomb_friction"])


def test_a_profile_keeps_to_the_order_and_so_never_lies_below_the_minimum():
    campaign = empty_campaign(uncertain=FRICTION | {"mover_damping": 0.5}, lengths=(201, 201, 201))
    truth = bench()
    for name, value in (("coulomb_friction", 4.0), ("static_friction", 3.0)):
        object.__setattr__(truth.effects[0], name, value)
    campaign = measured(campaign, truth)
    found = fit(FitProblem(campaign, campaign.machine, uncertain_unknowns(campaign)), starts=1)
    profile = profile_likelihood(found, "mover_damping")
    assert profile.chi2_increase.min() > -0.1 and profile.chi2_increase[[0, -1]].min() > 5.0


@pytest.mark.parametrize("uncertain", [("static_friction",), ("coulomb_friction",), ("mover_damping",)])
def test_a_parameter_that_is_known_limits_the_other(uncertain):
    campaign = empty_campaign(uncertain=dict.fromkeys(uncertain, 0.5))
    constraints = order_constraints(campaign.machine, uncertain_unknowns(campaign))
    limit = np.log(4.0 / 6.0) / 0.5  # static 6 N may fall to 4 N, coulomb 4 N may rise to 6 N
    expected = {"static_friction": [[1.0, limit]], "coulomb_friction": [[-1.0, limit]]}.get(uncertain[0], [])
    np.testing.assert_allclose(np.column_stack([constraints.rows, constraints.limits]), np.reshape(expected, (-1, 2)))


def test_a_configuration_in_the_wrong_order_is_refused(tmp_path):
    path = tmp_path / "wrong.yaml"
    path.write_text(CONFIG, encoding="utf-8")
    sentence = r"static_friction \(3 N\) must be at least coulomb_friction \(5 N\)"
    with pytest.raises(ConfigError, match=r":4: parameters.static_friction: " + sentence):
        edhas.load(path)
    with pytest.raises(ParameterError, match="static_friction: " + sentence.replace("5 N", "4 N")):
        edhas.change(bench(), static_friction="3 N")
    assert edhas.get(edhas.change(bench(), coulomb_friction=7.0, static_friction=7.0), "static_friction") == 7.0


def test_drawn_machines_keep_the_order():
    rng, campaign = np.random.default_rng(0), empty_campaign(uncertain=FRICTION)
    for spreads in (FRICTION, {"coulomb_friction": 0.5}, {"static_friction": 0.5}):
        drawn = dataclasses.replace(campaign, uncertain=spreads)
        for _ in range(20):
            effect = draw_parameters(drawn, campaign.machine, rng).effects[0]
            assert effect.static_friction >= effect.coulomb_friction


def test_an_effect_must_name_a_parameter_of_its_own():
    class Wrong(Effect):
        """A force with a limit that does not exist."""

        level: float = par(1.0, "N", (0.0, 10.0), "level", at_least="lower_level")

        def mover_force(self, s, z):
            return self.level

    with pytest.raises(EffectError, match="at_least must name another parameter of Wrong"):
        check_declaration(Wrong)
