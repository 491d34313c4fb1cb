"""A controller as a computer runs it: the instants, the hold, the delay, and the same in every engine."""

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
from edhas_jax.simulation.rk4_reference import trajectories
from tests.contract.test_no_trace import by_rig, operations, program

H = 20e-6


class Integrating(Controller):
    """Proportional and integral, as short as can be."""

    stiffness: float = par(1e4, "V/m", (0.0, 1e8), "gain of the error")
    patience: float = par(2e5, "V/(m*s)", (0.0, 1e9), "gain of its integral")

    def initial(self):
        return {"summed_error": 0.0}

    def command(self, y, s):
        return self.stiffness * (s.reference - s.piston_position) + self.patience * y["summed_error"]

    def rates(self, y, s):
        return {"summed_error": s.reference - s.piston_position}


def bench(sample_time, delay=0.0, controller=Integrating()):
    sampling = Sampled(sample_time=sample_time, computation_delay=delay)
    return ActuatorBench(controller=controller, sampling=sampling, reference=Sine(frequency=20.0, ramp_time=0.0))


@functools.partial(jax.jit, static_argnames="steps")
def states(machine, h, steps: int):
    """The states after each step, (steps,) by name."""

    def one(y, n):
        y, _ = step(machine, y, n * h, h)
        return y, y

    start = {n: jnp.asarray(v, float) for n, v in machine.initial_state().items()}
    return jax.lax.scan(one, start, jnp.arange(float(steps)))[1]


def exactly(machine, h, duration):
    """The piston at every millisecond, from the exact solution between the instants at which something happens."""
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
    events += [(n * 1e-3, "look") for n in range(int(round(duration / 1e-3)))]
    passing = functools.cache(lambda lapse: expm(a * lapse))
    z, now, summed, coming, seen = np.zeros(4), 0.0, 0.0, [], []
    for time, what in sorted(events, key=lambda event: (round(event[0], 12), event[1])):
        z, now = passing(round(time - now, 12)) @ z, time
        if what == "sample":
            error = float(set_point.value_and_rate(time)[0]) - z[1]
            coming.append(c.stiffness * error + c.patience * summed)
            summed += ts * error
        elif what == "command":
            z[3] = coming.pop(0)
        else:
            seen.append(z[1])
    return np.array(seen)


@pytest.mark.parametrize("delay", [0.0, 1e-4, 2e-4])
def test_it_is_the_sampled_loop(delay):
    """Against matrix exponentials from instant to instant; what is left falls with the square of the step."""
    left = []
    for h in (H, 0.5 * H):
        machine = bench(2e-4, delay)
        run = edhas.simulate(machine, edhas.Simulation(duration=0.05, step=h, sample_rate=1e3))
        wanted = exactly(machine, h, 0.05)
        left.append(np.abs(run.signals["piston_position"][: len(wanted)] - wanted).max())
    assert left[0] < 1e-4 * 3.5e-3
    assert left[0] / left[1] > 3.0


def test_the_command_is_held_and_late():
    """Both change every ten steps; what comes at a sample acts 10 steps later."""
    y = states(bench(10 * H, 10 * H), H, 400)
    coming, held = np.asarray(y["coming_voltage"]), np.asarray(y["held_voltage"])
    changed = np.flatnonzero(np.diff(coming)) + 1
    np.testing.assert_array_equal(changed, np.arange(10, 400, 10))
    np.testing.assert_array_equal(held[10:], coming[:-10])
    assert (held[:10] == 0.0).all()


@pytest.mark.parametrize("share", [3.7, 2.5, 10.0, 1.3])
def test_instants_between_steps_are_carried_on(share):
    """A sample time that is no multiple of the step: intervals differ by one step, their mean is the sample time."""
    steps = 3000
    coming = np.asarray(states(bench(share * H), H, steps)["coming_voltage"])
    at = np.flatnonzero(np.diff(coming))
    assert set(np.diff(at)) <= {int(np.floor(share)), int(np.ceil(share))}
    assert len(at) == pytest.approx(steps / share, abs=2.0)


def test_no_more_than_one_sample_a_step():
    continuous = structs.replace(bench(1e-6), sampling=ActuatorBench().sampling)
    runs = [edhas.simulate(m, edhas.Simulation(duration=0.05, step=5e-6)) for m in (bench(1e-6), continuous)]
    x, wanted = (run.signals["piston_position"] for run in runs)
    assert np.abs(x - wanted).max() < 2e-3 * np.ptp(wanted)


def test_the_hold_costs_half_a_sample():
    """A loop sampled ever faster approaches the continuous one as the sample time itself."""
    how = edhas.Simulation(duration=0.05, step=2e-6)
    wanted = edhas.simulate(structs.replace(bench(1e-4), sampling=ActuatorBench().sampling), how)
    wanted = wanted.signals["piston_position"]
    off = [np.abs(edhas.simulate(bench(t), how).signals["piston_position"] - wanted).max() for t in (2e-4, 1e-4, 5e-5)]
    assert 1.7 < off[0] / off[1] < 2.3 and 1.7 < off[1] / off[2] < 2.3


def test_single_precision_keeps_time():
    single, double = (
        edhas.simulate(bench(1.7e-4, 1e-4), edhas.Simulation(duration=0.5, precision=precision))
        for precision in (edhas.Precision.FLOAT32, edhas.Precision.FLOAT64)
    )
    x, wanted = (run.signals["piston_position"] for run in (single, double))
    assert np.abs(x - wanted).max() < 2e-3 * np.ptp(wanted)


def test_every_engine_runs_it(monkeypatch):
    machine = bench(2e-4, 1e-4, edhas.change(ActuatorBench(), velocity_gain=20.0).controller)
    table = {"position_gain": np.array([5e3, 1e4, 2e4]), "sample_time": np.array([1e-4, 2e-4, 3.3e-4])}
    settings = BatchSettings(step=5e-5, tolerance=1e-3, max_cycles=4)
    native = run_designs(machine, table, settings)
    traces = batch_trajectories.march_lanes(machine, table, None, H, 10, 60, ("piston_position",))
    monkeypatch.setenv("EDHAS_ENGINE", "xla")
    xla = run_designs(machine, table, settings)
    for name in ("tracking_error", "rms_current", "mean_electrical_power"):
        np.testing.assert_allclose(native[name], xla[name], rtol=1e-6)
    for k in range(3):
        one = edhas.change(machine, **{n: v[k] for n, v in table.items()})
        run = edhas.simulate(one, edhas.Simulation(duration=0.0118, step=H))
        np.testing.assert_allclose(traces.values["piston_position"][:, k], run.signals["piston_position"], atol=1e-12)
    # the explicit integrator has its own, smaller step: what differs is when its samples fall
    explicit = trajectories(machine, {n: v[1:2] for n, v in table.items()}, 2e-4, 60, ("piston_position",), 2e-6)
    one = edhas.change(machine, **{n: v[1] for n, v in table.items()})
    run = edhas.simulate(one, edhas.Simulation(duration=0.0118, step=2e-6))
    error = explicit["piston_position"][:, 0] - run.signals["piston_position"]
    assert np.abs(error).max() < 1e-4 * np.ptp(run.signals["piston_position"])


def test_metrics_are_those_of_the_run():
    """A batch in its periodic state and a simulation of the same machine see the same loop."""
    machine = bench(2e-4, 2e-4, ActuatorBench().controller)
    # without damping this delay leaves a limit cycle, whose error wanders by a percent
    machine = edhas.change(machine, frequency=10.0, ramp_time=0.1, integral_gain=0.0, velocity_gain=20.0)
    got = run_designs(machine, {"sample_time": np.array([2e-4])}, BatchSettings(step=1e-5, tolerance=1e-3))
    run = edhas.simulate(machine, edhas.Simulation(duration=0.4, step=1e-5))
    assert got["status"][0] == Status.OK
    assert got["tracking_error"][0] == pytest.approx(run.metrics["tracking_error"].value, rel=2e-3)


def test_derivatives_by_gains():
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


def test_the_times_have_no_derivative():
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
def test_what_is_not_sampled_leaves_no_trace(rig, monkeypatch):
    before = program(rig())
    assert operations(program(rig(sampling=Sampled())).jaxpr) > operations(before.jaxpr)
    assert not [n for n in rig().initial_state() if n in Sampled().initial(rig().controller) and "control" not in n]

    def forbidden(*_):
        raise AssertionError("the sampling that is not mounted was called")

    for method in ("initial", "command", "rates", "advance"):
        monkeypatch.setattr(Sampled, method, forbidden)
    assert str(program(rig())) == str(before)
    with pytest.raises(AssertionError, match="not mounted"):
        program(rig(sampling=Sampled()))
