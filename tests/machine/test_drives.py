"""Amplifiers, controllers and set points, and the energy balance with each of them."""

import jax
import numpy as np
import pytest
import yaml

import edhas_jax as edhas
from edhas_jax import Rig, drive, state
from edhas_jax.config.machine_config import ConfigError, build_config
from edhas_jax.core import structs
from edhas_jax.machine.components.coil_and_amplifier import CurrentAmplifier
from edhas_jax.machine.components.controllers import CascadeController, OpenLoop, PositionController
from edhas_jax.machine.components.set_points import RecordedInterval, Steps
from edhas_jax.machine.effects import LugreFriction
from edhas_jax.machine.rigs import Chirp, Recorded, Sine, Step


class Valve(Rig):
    """A volume behind a valve."""

    time_step, duration = 1e-2, 1.0

    opening = drive("-", "opening of the valve", 1.0)
    level = state("m", "level", 1.0)

    def equations(self, y, s):
        return {"level": -s.opening * y.level}


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


def test_a_step_starts_where_the_user_says():
    """An open valve is closed; `step_size` is the height, in the unit of the drive."""

    def valve(section):
        mapping = {"rig": Valve, "opening": section, "simulation": {"duration": "1 s", "sample_rate": "10 Hz"}}
        config = build_config(mapping)
        return config, edhas.simulate(config.machine, config.simulation).signals["opening"]

    config, opening = valve({"kind": "step", "from": 0.8, "step_size": -0.8, "step_time": "0.5 s"})
    np.testing.assert_allclose(opening, np.where(np.arange(11) < 5, 0.8, 0.0), atol=1e-15)
    again = build_config(yaml.safe_load(config.text) | {"rig": Valve})
    assert (again.machine.opening.step_from, again.machine.opening.step_size) == (0.8, -0.8)
    with pytest.raises(ConfigError, match="opening.from: .*must lie in"):
        valve({"kind": "step", "from": 1e13})
    volts = {"kind": "step", "from": "2 V", "step_size": "3 V", "step_time": "0.1 s"}
    command = build_config({"rig": "actuator_bench", "controller": {"kind": "open_loop"}, "reference": volts}).machine
    assert [float(command.reference.value_and_rate(t)[0]) for t in (0.0, 0.1)] == [2.0, 5.0]


@pytest.mark.parametrize("parts", [1, 4])
def test_the_intervals_of_a_time_loop_give_the_recording(parts):
    rng = np.random.default_rng(1)
    steps = Steps(times=np.array([0.1, 0.2, 0.33, 0.34, 0.9]), levels=rng.normal(size=6))
    for recorded in (
        Recorded(values=rng.normal(size=11), interval=0.1, steps=steps),
        Recorded.held(np.array([0.0, 0.1, 0.23, 0.24, 0.7]), rng.normal(size=5)),
    ):
        length, count = 0.1 / parts, 10 * parts
        intervals = RecordedInterval.split(recorded, length, count)
        for k in range(count):
            one = jax.tree.map(lambda leaf, k=k: leaf if np.ndim(leaf) == 0 else leaf[k], intervals)
            for t in (k + np.array([0.0, 0.01, 0.35, 0.5, 0.99])) * length:
                np.testing.assert_allclose(one.value_and_rate(t), recorded.value_and_rate(t), rtol=1e-9, atol=1e-9)
    many = Recorded.held(0.01 * np.arange(9), np.arange(9))
    assert RecordedInterval.split(many, 0.1, 3) is None  # eight steps in one interval: looked up in the table
