"""Sampled controllers: sampling instants, zero-order hold and delay, in every engine."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

import edhas_jax as edhas
from edhas_jax.core import structs
from edhas_jax.core.structs import par
from edhas_jax.design.batch.batch import BatchSettings, Status, run_designs
from edhas_jax.design.gradient.fixed_point import GradientSettings
from edhas_jax.design.gradient.table import GradientError, gradient, parameters_of
from edhas_jax.machine.components.controller_sampling import Sampled
from edhas_jax.machine.effects import LugreFriction
from edhas_jax.machine.interface.controller_base import Controller
from edhas_jax.machine.rigs import ActuatorBench, Sine
from edhas_jax.simulation import batch_trajectories
from edhas_jax.simulation.integrator import step
from studies.rk4_reference import trajectories
from tests.contract.test_absent_effects import by_rig, count_operations, step_jaxpr
from tests.support.xla import jit

H = 20e-6


class PiController(Controller):
    """A PI controller."""

    pi_gain: float = par(1e4, "V/m", (0.0, 1e8), "gain of the error")
    pi_integral_gain: float = par(2e5, "V/(m*s)", (0.0, 1e9), "gain of its integral")

    def initial(self):
        return {"summed_error": 0.0}

    def command(self, y, s):
        return self.pi_gain * (s.reference - s.piston_position) + self.pi_integral_gain * y["summed_error"]

    def rates(self, y, s):
        return {"summed_error": s.reference - s.piston_position}


def bench(sample_time, delay=0.0, controller=PiController()):
    sampling = Sampled(sample_time=sample_time, computation_delay=delay)
    return ActuatorBench(controller=controller, sampling=sampling, reference=Sine(frequency=20.0, ramp_time=0.0))


@functools.partial(jit, static_argnames="steps")
def states(machine, h, steps: int):
    """The states after each step, (steps,) by name."""

    def one(y, n):
        y, _ = step(machine, y, n * h, h)
        return y, y

    start = {n: jnp.asarray(v, float) for n, v in machine.initial_state().items()}
    return jax.lax.scan(one, start, jnp.arange(float(steps)))[1]


def exact_positions(machine, h, duration):
    """The piston position at every millisecond, from the exact solution between sampling and command events."""
    coil, mover, c, set_point = machine.coil, machine.mover, machine.controller, machine.reference
    resistance, inductance, km = coil.coil_resistance, coil.coil_inductance, coil.force_constant
    a = np.zeros((4, 4))  # current, position, velocity, held voltage
    a[0] = [-resistance / inductance, 0.0, -km / inductance, 1.0 / inductance]
    a[1] = [0.0, 0.0, 1.0, 0.0]
    a[2] = [km / mover.mover_mass, 0.0, -mover.mover_damping / mover.mover_mass, 0.0]
    ts, delay = machine.sampling.sample_time, machine.sampling.computation_delay
    count = int(round(duration / ts))
    events = [(0.5 * h + n * ts, "sample") for n in range(count)]
    events += [(h + n * ts + delay, "command") for n in range(count)]
    events += [(n * 1e-3, "output") for n in range(int(round(duration / 1e-3)))]
    transition = functools.cache(lambda interval: expm(a * interval))
    z, now, integral, pending, positions = np.zeros(4), 0.0, 0.0, [], []
    for time, event in sorted(events, key=lambda event: (round(event[0], 12), event[1])):
        z, now = transition(round(time - now, 12)) @ z, time
        if event == "sample":
            error = float(set_point.value_and_rate(time)[0]) - z[1]
            pending.append(c.pi_gain * error + c.pi_integral_gain * integral)
            integral += ts * error
        elif event == "command":
            z[3] = pending.pop(0)
        else:
            positions.append(z[1])
    return np.array(positions)


@pytest.mark.parametrize("delay", [0.0, 1e-4, 2e-4])
def test_agrees_with_the_exact_sampled_loop(delay):
    """Agrees with matrix exponentials from event to event; the difference falls with the square of the step."""
    errors = []
    for h in (H, 0.5 * H):
        machine = bench(2e-4, delay)
        run = edhas.simulate(machine, edhas.Simulation(duration=0.05, step=h, sample_rate=1e3))
        expected = exact_positions(machine, h, 0.05)
        errors.append(np.abs(run.signals["piston_position"][: len(expected)] - expected).max())
    assert errors[0] < 1e-4 * 3.5e-3
    assert errors[0] / errors[1] > 3.0


def test_the_command_is_held_and_delayed():
    """Pending and held command change every ten steps; a command acts ten steps after its sample."""
    y = states(bench(10 * H, 10 * H), H, 400)
    pending, held = np.asarray(y["pending_voltage"]), np.asarray(y["held_voltage"])
    changed = np.flatnonzero(np.diff(pending)) + 1
    np.testing.assert_array_equal(changed, np.arange(10, 400, 10))
    np.testing.assert_array_equal(held[10:], pending[:-10])
    assert (held[:10] == 0.0).all()


@pytest.mark.parametrize("share", [3.7, 2.5, 10.0, 1.3])
def test_sampling_instants_between_steps_are_carried_over(share):
    """Intervals between samples differ by at most one step, and their mean is the sample time."""
    steps = 3000
    pending = np.asarray(states(bench(share * H), H, steps)["pending_voltage"])
    at = np.flatnonzero(np.diff(pending))
    assert set(np.diff(at)) <= {int(np.floor(share)), int(np.ceil(share))}
    assert len(at) == pytest.approx(steps / share, abs=2.0)


def test_at_most_one_sample_per_step():
    continuous = structs.replace(bench(1e-6), sampling=ActuatorBench().sampling)
    runs = [edhas.simulate(m, edhas.Simulation(duration=0.05, step=5e-6)) for m in (bench(1e-6), continuous)]
    x, expected = (run.signals["piston_position"] for run in runs)
    assert np.abs(x - expected).max() < 2e-3 * np.ptp(expected)


def test_the_hold_costs_half_a_sample():
    """The difference from the continuous loop is proportional to the sample time."""
    settings = edhas.Simulation(duration=0.05, step=2e-6)
    expected = edhas.simulate(structs.replace(bench(1e-4), sampling=ActuatorBench().sampling), settings)
    expected = expected.signals["piston_position"]
    positions = [edhas.simulate(bench(t), settings).signals["piston_position"] for t in (2e-4, 1e-4, 5e-5)]
    errors = [np.abs(x - expected).max() for x in positions]
    assert 1.7 < errors[0] / errors[1] < 2.3 and 1.7 < errors[1] / errors[2] < 2.3


def test_single_precision_keeps_the_sample_time():
    single, double = (
        edhas.simulate(bench(1.7e-4, 1e-4), edhas.Simulation(duration=0.5, precision=precision))
        for precision in (edhas.Precision.FLOAT32, edhas.Precision.FLOAT64)
    )
    x, expected = (run.signals["piston_position"] for run in (single, double))
    assert np.abs(x - expected).max() < 2e-3 * np.ptp(expected)


def test_every_engine_gives_the_same_result(monkeypatch):
    machine = bench(2e-4, 1e-4, edhas.change(ActuatorBench(), velocity_gain=20.0).controller)
    table = {"position_gain": np.array([5e3, 1e4, 2e4]), "sample_time": np.array([1e-4, 2e-4, 3.3e-4])}
    settings = BatchSettings(step=5e-5, tolerance=1e-3, max_cycles=4)
    native = run_designs(machine, table, settings)
    traces = batch_trajectories.simulate_batch(machine, table, None, H, 10, 60, ("piston_position",))
    monkeypatch.setenv("EDHAS_ENGINE", "xla")
    xla = run_designs(machine, table, settings)
    for name in ("tracking_error", "rms_current", "mean_electrical_power"):
        np.testing.assert_allclose(native[name], xla[name], rtol=1e-6)
    for k in range(3):
        one = edhas.change(machine, **{n: v[k] for n, v in table.items()})
        run = edhas.simulate(one, edhas.Simulation(duration=0.0118, step=H))
        np.testing.assert_allclose(traces.values["piston_position"][:, k], run.signals["piston_position"], atol=1e-12)
    # the explicit integrator has its own, smaller step, so that its samples fall at other times
    explicit = trajectories(machine, {n: v[1:2] for n, v in table.items()}, 2e-4, 60, ("piston_position",), 2e-6)
    one = edhas.change(machine, **{n: v[1] for n, v in table.items()})
    run = edhas.simulate(one, edhas.Simulation(duration=0.0118, step=2e-6))
    error = explicit["piston_position"][:, 0] - run.signals["piston_position"]
    assert np.abs(error).max() < 1e-4 * np.ptp(run.signals["piston_position"])


def test_batch_metrics_equal_those_of_a_run():
    """A batch in its periodic state and a simulation of the same machine give the same metrics."""
    machine = bench(2e-4, 2e-4, ActuatorBench().controller)
    # without damping this delay leaves a limit cycle, whose error wanders by a percent
    machine = edhas.change(machine, frequency=10.0, ramp_time=0.1, integral_gain=0.0, velocity_gain=20.0)
    got = run_designs(machine, {"sample_time": np.array([2e-4])}, BatchSettings(step=1e-5, tolerance=1e-3))
    run = edhas.simulate(machine, edhas.Simulation(duration=0.4, step=1e-5))
    assert got["status"][0] == Status.OK
    assert got["tracking_error"][0] == pytest.approx(run.metrics["tracking_error"].value, rel=2e-3)


def test_derivatives_with_respect_to_gains():
    machine = bench(2e-4, 1e-4, edhas.change(ActuatorBench(), velocity_gain=20.0).controller)
    settings = GradientSettings(steps_per_cycle=2500, tolerance=1e-6, max_cycles=20)
    gains = {"position_gain": 1e4, "velocity_gain": 20.0}

    def found(**changes):
        at = gradient(edhas.change(machine, **changes), ["tracking_error"], list(gains), settings=settings)
        return at.frame.set_index("parameter")

    slopes = found(**gains)["derivative"]
    for name, value in gains.items():
        e = 1e-4 * value
        ahead, behind = (found(**gains | {name: value + sign * e})["value"].iloc[0] for sign in (1.0, -1.0))
        assert slopes[name] == pytest.approx((ahead - behind) / (2.0 * e), rel=1e-4)


def test_sample_time_and_delay_have_no_derivative():
    machine = bench(2e-4, controller=ActuatorBench().controller)
    assert not {"sample_time", "computation_delay"} & set(parameters_of(machine))
    with pytest.raises(GradientError, match="whole numbers of steps"):
        gradient(machine, ["tracking_error"], ["sample_time"])


def test_a_sweep_over_the_sample_time(tmp_path, monkeypatch):
    (tmp_path / "sweep.yaml").write_text(
        "machine: {rig: actuator_bench, sampling: {kind: sampled}}\n"
        "sweep: {kind: grid, parameters: {sample_time: {values: [0.1 ms, 0.2 ms, 0.4 ms]}}}\n"
        "batch: {step: 50 us, tolerance: 0.5 %}\n"
    )
    monkeypatch.chdir(tmp_path)
    frame = edhas.run_sweep(edhas.load_sweep("sweep.yaml"), "out")
    errors = frame.sort_values("sample_time")["tracking_error"].to_numpy()
    assert len(errors) == 3 and (np.diff(errors) > 0.0).all()


def test_energy_closes():
    machine = structs.replace(bench(3.3e-4, 1e-4, ActuatorBench().controller), effects=(LugreFriction(),))
    run = edhas.simulate(machine, edhas.Simulation(duration=0.2))
    assert abs(run.energy_residual()) < 1e-6


@by_rig
def test_a_continuous_controller_adds_no_sampling_operations(rig, monkeypatch):
    before = step_jaxpr(rig())
    assert count_operations(step_jaxpr(rig(sampling=Sampled())).jaxpr) > count_operations(before.jaxpr)
    assert not [n for n in rig().initial_state() if n in Sampled().initial(rig().controller) and "control" not in n]

    def forbidden(*_):
        raise AssertionError("the sampling that is not mounted was called")

    for method in ("initial", "command", "rates", "advance"):
        monkeypatch.setattr(Sampled, method, forbidden)
    assert str(step_jaxpr(rig())) == str(before)
    with pytest.raises(AssertionError, match="not mounted"):
        step_jaxpr(rig(sampling=Sampled()))
