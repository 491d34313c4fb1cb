"""Amplifiers, controllers and set points, and the energy balance with each of them."""

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.core import structs
from edhas_jax.machine.components.coil_and_amplifier import CurrentAmplifier
from edhas_jax.machine.components.controllers import CascadeController, OpenLoop, PositionController
from edhas_jax.machine.effects import LugreFriction
from edhas_jax.machine.rigs import Chirp, Recorded, Sine, Step

CASCADE = CascadeController(cascade_position_gain=60.0, cascade_velocity_gain=8.0)
SHORT = edhas.Simulation(duration=0.3, sample_rate=5000.0)


def bench(**components):
    return edhas.ActuatorBench(effects=(LugreFriction(),), **components)


@pytest.mark.parametrize("amplifier", [None, CurrentAmplifier(amplifier_gain=0.5)])
@pytest.mark.parametrize(
    ("controller", "reference"),
    [
        (PositionController(), Sine()),
        (CASCADE, Chirp(amplitude=1e-3, start_frequency=2.0, end_frequency=30.0, sweep_time=0.2)),
        (CASCADE, Step(step_size=2e-3, step_time=0.05)),
        (OpenLoop(), Chirp(amplitude=2.0, start_frequency=20.0, end_frequency=60.0)),
    ],
)
def test_energy_closes(amplifier, controller, reference):
    if amplifier is not None and isinstance(controller, PositionController):
        controller = structs.replace(controller, position_gain=2e3, integral_gain=0.0)
    components = {"controller": controller, "reference": reference} | ({"amplifier": amplifier} if amplifier else {})
    run = edhas.simulate(bench(**components), SHORT)
    assert np.ptp(run.signals["piston_position"]) > 1e-4
    assert abs(run.energy_residual()) < 1e-6
    if amplifier is not None:
        np.testing.assert_allclose(run.signals["current"], 0.5 * run.signals["voltage"], rtol=1e-12)


def test_step_response_of_the_cascade():
    machine = edhas.ActuatorBench(controller=CASCADE, reference=Step(step_size=2e-3, step_time=0.05))
    run = edhas.simulate(machine, SHORT)
    x, t = run.signals["piston_position"], run.signals["time"]
    assert np.all(np.abs(x[t < 0.05]) < 1e-9)
    assert x[-1] == pytest.approx(2e-3, rel=0.05)


def test_a_recorded_voltage_reproduces_the_run():
    original = edhas.simulate(bench(), SHORT)
    recorded = Recorded(values=original.signals["voltage"], interval=1.0 / SHORT.sample_rate)
    replay = edhas.simulate(bench(controller=OpenLoop(), reference=recorded), SHORT)
    for name in ("piston_velocity", "current"):
        error = replay.signals[name] - original.signals[name]
        assert np.sqrt(np.mean(error**2)) < 2e-3 * np.ptp(original.signals[name])


def test_a_recorded_set_point_equals_the_analytic_one():
    t = np.arange(0, 0.3 + 5e-4, 5e-4)
    value, rate = Sine().value_and_rate(t)
    recorded = Recorded(values=np.asarray(value), interval=5e-4)
    between = np.linspace(1e-3, 0.29, 997)
    result, result_rate = np.asarray([recorded.value_and_rate(x) for x in between]).T
    expected, expected_rate = (np.asarray(v) for v in Sine().value_and_rate(between))
    np.testing.assert_allclose(result, expected, atol=3e-8)
    np.testing.assert_allclose(result_rate, expected_rate, atol=2e-4)
    run, again = (edhas.simulate(bench(reference=r), SHORT) for r in (Sine(), recorded))
    error = run.signals["piston_position"] - again.signals["piston_position"]
    assert np.abs(error).max() < 2e-3 * np.ptp(run.signals["piston_position"])


def test_a_recording_is_held_before_and_after():
    recorded = Recorded(values=np.array([1.0, 2.0, 4.0]), interval=0.1, start=1.0)
    for t, expected in ((0.0, 1.0), (0.999, 1.0), (1.1, 2.0), (1.2, 4.0), (5.0, 4.0)):
        value, rate = recorded.value_and_rate(t)
        assert float(value) == pytest.approx(expected)
        assert (float(rate) == 0.0) == (t < 1.0 or t > 1.2)
