"""Runs side by side: each lane is the single run, its slopes are derivatives, numbers compile nothing."""

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.machine.components.set_points import Steps
from edhas_jax.simulation.batch_trajectories import simulate_batch
from tests.support.synthetic_campaign import bench

WATCH = ("current", "piston_position")
H, PER_SAMPLE = 1e-4, 5
RESISTANCE = np.array([1.3, 1.41, 1.5])
pytestmark = pytest.mark.usefixtures("engine")  # every test runs on every loop engine that is there


def march(values, seeds=None, samples=101):
    return simulate_batch(bench(), values, seeds, H, PER_SAMPLE, samples, WATCH)


def test_a_lane_is_the_single_run():
    traces = march({"coil_resistance": RESISTANCE})
    machine = edhas.change(bench(), coil_resistance=1.5)
    run = edhas.simulate(machine, edhas.Simulation(duration=0.05, step=H, sample_rate=2e3))
    for name in WATCH:
        assert traces.values[name].shape == (101, 3)
        np.testing.assert_allclose(traces.values[name][:, 2], run.signals[name], rtol=1e-9, atol=1e-12)


def test_slopes_are_derivatives():
    values = {"coil_resistance": RESISTANCE, "mover_damping": np.array([18.0, 20.0, 25.0])}
    seeds = {"coil_resistance": np.array([1.0, 0.0, 2.0]), "mover_damping": np.array([0.0, 1.0, -1.0])}
    found = march(values, seeds).slopes
    e = 1e-5
    ahead, behind = (march({n: v + sign * e * seeds[n] for n, v in values.items()}) for sign in (1.0, -1.0))
    for name in WATCH:
        expected = (ahead.values[name] - behind.values[name]) / (2.0 * e)
        np.testing.assert_allclose(found[name], expected, atol=2e-4 * np.abs(expected).max())


def test_a_name_without_a_seed_stands_still():
    values = {"coil_resistance": RESISTANCE, "mover_damping": np.full(3, 20.0)}
    one = march(values, {"coil_resistance": np.ones(3)}).slopes
    both = march(values, {"coil_resistance": np.ones(3), "mover_damping": np.zeros(3)}).slopes
    np.testing.assert_array_equal(one["current"], both["current"])


def test_lanes_of_their_own_length():
    lengths = np.array([40, 300, 101])
    traces = march({"coil_resistance": RESISTANCE}, samples=lengths)
    whole = march({"coil_resistance": RESISTANCE}, samples=300)
    for lane, length in enumerate(lengths):
        column = traces.values["current"][:, lane]
        np.testing.assert_array_equal(column[:length], whole.values["current"][:length, lane])
        assert np.isnan(column[length:]).all()


def test_the_result_does_not_depend_on_the_neighbours():
    many = np.linspace(1.2, 1.6, 133)
    traces = march({"coil_resistance": many})
    alone = march({"coil_resistance": many[-1:]})
    np.testing.assert_array_equal(traces.values["current"][:, -1:], alone.values["current"])


def test_a_lane_that_breaks_leaves_the_others_alone():
    values = {"coil_resistance": RESISTANCE, "mover_mass": np.array([0.12, np.nan, 0.12])}
    current = march(values).values["current"]
    assert np.isfinite(current[:, [0, 2]]).all() and not np.isfinite(current[-1, 1])


def test_other_numbers_compile_nothing(compilations):
    """Other values, steps and lengths run the program that is there; another signal to record compiles one."""
    watch = ("current", "piston_velocity")
    simulate_batch(bench(), {"coil_resistance": RESISTANCE}, None, H, PER_SAMPLE, 300, watch)
    before = compilations()
    other = edhas.change(bench(), mover_mass=0.15, ramp_time=0.07)
    traces = simulate_batch(other, {"coil_resistance": 1.1 * RESISTANCE[:2]}, None, 0.5 * H, 2 * PER_SAMPLE, 650, watch)
    assert traces.values["current"].shape == (650, 2)
    assert compilations() == before
    simulate_batch(bench(), {"coil_resistance": RESISTANCE}, None, H, PER_SAMPLE, 101, ("piston_velocity",))
    assert compilations() > before


STEPS = Steps(times=np.array([3e-3, 7.2e-3, 7.9e-3, 20e-3]), levels=1e-4 * np.array([0.0, 1.0, -2.0, 4.0, 3.0]))


@pytest.mark.parametrize("steps", [None, STEPS], ids=["smooth", "with steps"])
@pytest.mark.parametrize("interval", [1e-3, 2e-3])
def test_a_recorded_set_point_is_followed_alike_by_all_engines(monkeypatch, steps, interval):
    """In one interval of the time loop two steps, steps at samples, and intervals that are a part of a recorded one."""
    rng = np.random.default_rng(0)
    wanted = 1e-3 * np.cumsum(rng.standard_normal(60)) / 8.0
    machine = edhas.ActuatorBench(reference=edhas.Recorded(values=wanted, interval=interval, steps=steps))
    values, seeds = {"mover_mass": np.array([0.1, 0.2, 0.3])}, {"mover_mass": np.ones(3)}
    watch = ("piston_position", "reference", "voltage")
    here = simulate_batch(machine, values, seeds, 1e-4, 10, 80, watch)  # beyond the end it is held
    monkeypatch.setenv("EDHAS_ENGINE", "xla")
    xla = simulate_batch(machine, values, seeds, 1e-4, 10, 80, watch)
    there = 1e-3 * np.arange(80) != 59 * interval  # where the recording ends its rate has two values
    for n in watch:
        for one, other, share in ((here.values, xla.values, 1e-10), (here.slopes, xla.slopes, 1e-8)):
            scale = np.abs(other[n]).max() + 1e-30
            np.testing.assert_allclose(one[n][there], other[n][there], rtol=0, atol=share * scale, err_msg=n)
