"""Adaptive sliding-mode controller: its elements against the published equations, and its robustness to mismatch."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.core import structs
from edhas_jax.core.structs import par
from edhas_jax.machine.components.adaptive_sliding_mode import SURFACE_LENGTH, AdaptiveSlidingMode
from edhas_jax.machine.effects import Effect, LugreFriction
from edhas_jax.machine.interface.signals import Signals
from edhas_jax.machine.rigs import ActuatorBench, Step
from edhas_jax.simulation.integrator import step
from tests.support.xla import jit

NOMINAL = {"nominal_mass": 0.12, "nominal_damping": 20.0}
H = 10e-6


class RampForce(Effect):
    """A force on the mover, constant plus a ramp.

    Source: this test.
    """

    constant_force: float = par(20.0, "N", (-1e4, 1e4), "force at the start")
    force_rate: float = par(0.0, "N/s", (-1e6, 1e6), "its rate")

    def mover_force(self, s, z):
        return -(self.constant_force + self.force_rate * s.time) + 0.0 * s.piston_velocity


def states_over_time(machine, steps: int):
    """The states after each step, (steps,) by name."""

    @jit
    def run(machine):
        def one(y, n):
            y, _ = step(machine, y, n * H, H)
            return y, y

        start = {n: jnp.asarray(v, float) for n, v in machine.initial_state().items()}
        return jax.lax.scan(one, start, jnp.arange(float(steps)))[1]

    return {n: np.asarray(v) for n, v in run(machine).items()}


def fhan(x1, x2, r, h):
    """fhan as published by Han."""
    d, sign = r * h * h, np.sign
    a0 = h * x2
    y = x1 + a0
    a1 = np.sqrt(d * (d + 8.0 * abs(y)))
    a2 = a0 + sign(y) * (a1 - d) / 2.0
    sy = (sign(y + d) - sign(y - d)) / 2.0
    a = (a0 + y - a2) * sy + a2
    sa = (sign(a + d) - sign(a - d)) / 2.0
    return -r * (a / d - sign(a)) * sa - r * sign(a)


def test_the_tracking_differentiator_is_fhan():
    c, rng = AdaptiveSlidingMode(), np.random.default_rng(0)
    r, h = c.tracking_acceleration, c.tracking_time
    at = {"voltage": 0.0, "unlimited_voltage": 0.0, "piston_position": 0.0, "piston_velocity": 0.0, "current": 0.0}
    rates = jit(lambda y, where: c.rates(y, Signals(at | where)))
    for scale in (0.1, 1.0, 30.0):
        for x1, x2 in scale * np.array([r * h * h, r * h]) * rng.uniform(-2.0, 2.0, (200, 2)):
            reference, velocity = rng.uniform(-1e-3, 1e-3), rng.uniform(-0.1, 0.1)
            y = c.initial() | {"smooth_reference": x1 + reference, "smooth_velocity": x2 + velocity}
            result = rates(y, {"reference": reference, "reference_velocity": velocity})
            assert result["smooth_velocity"] == pytest.approx(fhan(x1, x2, r, h), abs=1e-6 * r)
            assert result["smooth_reference"] == pytest.approx(x2 + velocity)


def test_a_step_is_smoothed_at_the_largest_acceleration():
    size = 2e-3
    controller = AdaptiveSlidingMode(**NOMINAL, tracking_acceleration=500.0)
    machine = ActuatorBench(controller=controller, reference=Step(step_size=size))
    y = states_over_time(machine, 1500)
    time, smooth = H * np.arange(1, 1501), y["smooth_reference"]
    shortest = 2.0 * np.sqrt(size / 500.0)  # half of the travel accelerating, half braking
    arrival = time[np.argmax(np.abs(smooth - size) < 1e-2 * size)]
    assert 0.85 * shortest < arrival < 1.15 * shortest  # the last 1 % of the travel takes 14 % of the time
    assert smooth.max() < size * (1.0 + 1e-3)
    assert np.abs(np.diff(y["smooth_velocity"])).max() <= 500.0 * H * (1.0 + 1e-9)
    assert abs(y["piston_position"][-1] - size) < 2e-6


def test_the_sliding_motion_is_terminal():
    c = AdaptiveSlidingMode(smoothing_velocity=1e-5, surface_rate=200.0, surface_exponent=1.5)

    def surface_rate(error):
        """|s| from dκ̂/dt, which at κ̂ = 0 is |s| times the adaptation gain."""
        speed = -200.0 * SURFACE_LENGTH * (abs(error) / SURFACE_LENGTH) ** (1.0 / 1.5) * np.sign(error)
        s = Signals({"reference": 0.0, "reference_velocity": 0.0, "piston_position": error, "piston_velocity": speed,
                     "current": 0.0, "voltage": 0.0, "unlimited_voltage": 0.0})  # fmt: skip
        return float(c.rates(c.initial(), s)["switching_gain"]) / c.adaptation_gain

    for error in (1e-3, -3e-4, 2e-5):
        assert surface_rate(error) < 1e-3 * abs(error)


@pytest.mark.parametrize("rate", [0.0, 400.0])
def test_the_observer_estimates_a_constant_and_a_growing_force(rate):
    """The error of d̂ is (d₀ (1 − l t) + d₁ t) e^(−l t), that of two poles at −l; it decays even while d grows."""
    l, force = 800.0, RampForce(constant_force=20.0, force_rate=rate)  # noqa: E741
    machine = ActuatorBench(
        controller=AdaptiveSlidingMode(**NOMINAL, observer_rate=l), effects=(force,),
        reference=Step(step_size=0.0),
    )  # fmt: skip
    y = states_over_time(machine, 2000)
    time = H * np.arange(1, 2001)
    found = y["observed_force"] - 2.0 * l * NOMINAL["nominal_mass"] * y["piston_velocity"]
    expected = (20.0 * (1.0 - l * time) + rate * time) * np.exp(-l * time)
    np.testing.assert_allclose(20.0 + rate * time - found, expected, atol=2e-3 * 20.0)


def test_the_command_uses_nominal_values_only():
    """The command depends on the nominal values of the controller and not on the parameters of the machine."""
    machine = ActuatorBench(controller=AdaptiveSlidingMode(**NOMINAL), effects=(LugreFriction(),))
    y = {n: jnp.asarray(v, float) for n, v in machine.initial_state().items()}
    y |= {"piston_position": 1e-4, "piston_velocity": 0.05, "current": 1.0}

    def command(**changes):
        return float(edhas.change(machine, **changes).evaluate(y, 0.02, H, y)[0].unlimited_voltage)

    now = command()
    actual = ("mover_mass", "mover_damping", "force_constant", "coil_resistance", "coil_inductance")
    assert all(command(**{n: 1.3 * float(edhas.get(machine, n))}) == now for n in actual)
    nominal = ("mass", "damping", "force_constant", "resistance", "inductance")
    names = [f"nominal_{n}" for n in nominal]
    assert all(command(**{n: 1.3 * float(edhas.get(machine, n))}) != now for n in names)


@functools.cache
def error(controller, mass=0.12):
    machine = ActuatorBench(controller=controller, effects=(LugreFriction(),))
    machine = edhas.change(machine, mover_mass=mass, frequency=20.0)
    return edhas.simulate(machine, edhas.Simulation(duration=0.3)).metrics["tracking_error"].value


def test_the_observer_compensates_friction_and_mass():
    """A faster observer leaves less error from friction and a wrong mass."""
    slow, fast = (
        structs.replace(AdaptiveSlidingMode(**NOMINAL), observer_rate=rate, adaptation_gain=0.0)
        for rate in (1.0, 1500.0)
    )
    assert error(fast) < 0.2 * error(slow)
    assert error(fast, 0.156) < 0.25 * error(slow, 0.156)
    assert error(fast, 0.156) < 3.0 * error(fast)


def test_the_switching_gain_adapts():
    """Without an observer the switching gain grows and reduces the error."""
    fixed, adaptive = (
        AdaptiveSlidingMode(**NOMINAL, observer_rate=1.0, adaptation_gain=gain) for gain in (0.0, 1e8)
    )
    assert error(adaptive) < 0.7 * error(fixed)


def test_the_step_is_of_second_order():
    """Halving the step divides the error by four, as the control law is neither stiff nor singular."""
    machine = edhas.change(ActuatorBench(controller=AdaptiveSlidingMode(**NOMINAL)), frequency=10.0, amplitude=1e-3)
    ends = []
    for per_sample in (20, 40, 80):
        run = edhas.simulate(machine, edhas.Simulation(duration=0.12, step=1e-3 / per_sample, sample_rate=1e3))
        ends.append(run.signals["piston_position"])
    coarse, fine = np.abs(ends[0] - ends[1]).max(), np.abs(ends[1] - ends[2]).max()
    assert 3.0 < coarse / fine < 5.5
