"""The adaptive sliding-mode controller: its parts against the published equations, its whole against a mismatch."""

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

BELIEF = {"nominal_mass": 0.12, "nominal_damping": 20.0}
H = 10e-6


class Push(Effect):
    """A force on the mover that begins at once and grows.

    Source: this test.
    """

    constant_push: float = par(20.0, "N", (-1e4, 1e4), "force at the start")
    growing_push: float = par(0.0, "N/s", (-1e6, 1e6), "its rate")

    def mover_force(self, s, z):
        return -(self.constant_push + self.growing_push * s.time) + 0.0 * s.piston_velocity


def march(machine, steps: int):
    """The states after each step, (steps,) by name."""

    @jax.jit
    def run(machine):
        def one(y, n):
            y, _ = step(machine, y, n * H, H)
            return y, y

        start = {n: jnp.asarray(v, float) for n, v in machine.initial_state().items()}
        return jax.lax.scan(one, start, jnp.arange(float(steps)))[1]

    return {n: np.asarray(v) for n, v in run(machine).items()}


def fhan(x1, x2, r, h):
    """Han's function as it is printed, with its signs."""
    d, sign = r * h * h, np.sign
    a0 = h * x2
    y = x1 + a0
    a1 = np.sqrt(d * (d + 8.0 * abs(y)))
    a2 = a0 + sign(y) * (a1 - d) / 2.0
    sy = (sign(y + d) - sign(y - d)) / 2.0
    a = (a0 + y - a2) * sy + a2
    sa = (sign(a + d) - sign(a - d)) / 2.0
    return -r * (a / d - sign(a)) * sa - r * sign(a)


def test_the_tracking_differentiator_is_hans():
    c, rng = AdaptiveSlidingMode(), np.random.default_rng(0)
    r, h = c.tracking_acceleration, c.tracking_time
    at = {"voltage": 0.0, "unlimited_voltage": 0.0, "piston_position": 0.0, "piston_velocity": 0.0, "current": 0.0}
    rates = jax.jit(lambda y, where: c.rates(y, Signals(at | where)))
    for scale in (0.1, 1.0, 30.0):
        for x1, x2 in scale * np.array([r * h * h, r * h]) * rng.uniform(-2.0, 2.0, (200, 2)):
            reference, velocity = rng.uniform(-1e-3, 1e-3), rng.uniform(-0.1, 0.1)
            y = c.initial() | {"smooth_reference": x1 + reference, "smooth_velocity": x2 + velocity}
            got = rates(y, {"reference": reference, "reference_velocity": velocity})
            assert got["smooth_velocity"] == pytest.approx(fhan(x1, x2, r, h), abs=1e-6 * r)
            assert got["smooth_reference"] == pytest.approx(x2 + velocity)


def test_a_step_is_smoothed_at_the_largest_acceleration():
    size = 2e-3
    controller = AdaptiveSlidingMode(**BELIEF, tracking_acceleration=500.0)
    machine = ActuatorBench(controller=controller, reference=Step(step_size=size))
    y = march(machine, 1500)
    time, smooth = H * np.arange(1, 1501), y["smooth_reference"]
    least = 2.0 * np.sqrt(size / 500.0)  # half of the way accelerating, half braking
    arrived = time[np.argmax(np.abs(smooth - size) < 1e-2 * size)]
    assert 0.85 * least < arrived < 1.15 * least  # 1 % of the way is missing 14 % of the time before the end
    assert smooth.max() < size * (1.0 + 1e-3)
    assert np.abs(np.diff(y["smooth_velocity"])).max() <= 500.0 * H * (1.0 + 1e-9)
    assert abs(y["piston_position"][-1] - size) < 2e-6


def test_the_sliding_motion_is_terminal():
    c = AdaptiveSlidingMode(smoothing_velocity=1e-5, surface_rate=200.0, surface_exponent=1.5)

    def surface_rate(error):
        """dκ̂/dt without the leak is |s| times a gain: a look at the surface from outside."""
        speed = -200.0 * SURFACE_LENGTH * (abs(error) / SURFACE_LENGTH) ** (1.0 / 1.5) * np.sign(error)
        s = Signals({"reference": 0.0, "reference_velocity": 0.0, "piston_position": error, "piston_velocity": speed,
                     "current": 0.0, "voltage": 0.0, "unlimited_voltage": 0.0})  # fmt: skip
        return float(c.rates(c.initial(), s)["switching_gain"]) / c.adaptation_gain

    for error in (1e-3, -3e-4, 2e-5):
        assert surface_rate(error) < 1e-3 * abs(error)


@pytest.mark.parametrize("growing", [0.0, 400.0])
def test_the_observer_finds_a_force_that_is_constant_or_grows(growing):
    """The error of d̂ is that of two poles at −l: (d₀ (1 − l t) + d₁ t) e^(−l t), and it dies out even while d grows."""
    l, push = 800.0, Push(constant_push=20.0, growing_push=growing)  # noqa: E741
    machine = ActuatorBench(
        controller=AdaptiveSlidingMode(**BELIEF, observer_rate=l), effects=(push,),
        reference=Step(step_size=0.0),
    )  # fmt: skip
    y = march(machine, 2000)
    time = H * np.arange(1, 2001)
    found = y["observed_force"] - 2.0 * l * BELIEF["nominal_mass"] * y["piston_velocity"]
    expected = (20.0 * (1.0 - l * time) + growing * time) * np.exp(-l * time)
    np.testing.assert_allclose(20.0 + growing * time - found, expected, atol=2e-3 * 20.0)


def test_what_it_believes_is_not_what_the_machine_has():
    """The command hangs on the beliefs, and not at all on the parameters of the machine."""
    machine = ActuatorBench(controller=AdaptiveSlidingMode(**BELIEF), effects=(LugreFriction(),))
    y = {n: jnp.asarray(v, float) for n, v in machine.initial_state().items()}
    y |= {"piston_position": 1e-4, "piston_velocity": 0.05, "current": 1.0}

    def command(**changes):
        return float(edhas.change(machine, **changes).evaluate(y, 0.02, H, y)[0].unlimited_voltage)

    now = command()
    real = ("mover_mass", "mover_damping", "force_constant", "coil_resistance", "coil_inductance")
    assert all(command(**{n: 1.3 * float(edhas.get(machine, n))}) == now for n in real)
    believed = ("mass", "damping", "force_constant", "resistance", "inductance")
    names = [f"nominal_{n}" for n in believed]
    assert all(command(**{n: 1.3 * float(edhas.get(machine, n))}) != now for n in names)


@functools.cache
def error(controller, mass=0.12):
    machine = ActuatorBench(controller=controller, effects=(LugreFriction(),))
    machine = edhas.change(machine, mover_mass=mass, frequency=20.0)
    return edhas.simulate(machine, edhas.Simulation(duration=0.3)).metrics["tracking_error"].value


def test_the_observer_takes_up_friction_and_mass():
    """The better the observer, the less of the machine's mismatch is left in the error."""
    blind, seeing = (
        structs.replace(AdaptiveSlidingMode(**BELIEF), observer_rate=rate, adaptation_gain=0.0)
        for rate in (1.0, 1500.0)
    )
    assert error(seeing) < 0.2 * error(blind)
    assert error(seeing, 0.156) < 0.25 * error(blind, 0.156)
    assert error(seeing, 0.156) < 3.0 * error(seeing)


def test_the_switching_gain_adapts():
    """Without an observer the switching gain grows to what is missing, and the error falls."""
    fixed, adaptive = (
        AdaptiveSlidingMode(**BELIEF, observer_rate=1.0, adaptation_gain=gain) for gain in (0.0, 1e8)
    )
    assert error(adaptive) < 0.7 * error(fixed)


def test_the_step_is_of_second_order():
    """Halving the step divides the error by four: nothing of the law is stiff or singular."""
    machine = edhas.change(ActuatorBench(controller=AdaptiveSlidingMode(**BELIEF)), frequency=10.0, amplitude=1e-3)
    ends = []
    for per_sample in (20, 40, 80):
        run = edhas.simulate(machine, edhas.Simulation(duration=0.12, step=1e-3 / per_sample, sample_rate=1e3))
        ends.append(run.signals["piston_position"])
    coarse, fine = np.abs(ends[0] - ends[1]).max(), np.abs(ends[1] - ends[2]).max()
    assert 3.0 < coarse / fine < 5.5
