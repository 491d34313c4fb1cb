"""`edhas_jax.model`: metrics and trajectories that JAX transforms, against other ways to the same numbers."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

import edhas_jax as edhas
from edhas_jax.compiler.engines import ENGINES, VARIABLE
from edhas_jax.design.batch.batch import BatchError, BatchSettings, run_designs, steps_per_cycle
from edhas_jax.design.function import computations
from edhas_jax.design.gradient.fixed_point import GradientSettings
from edhas_jax.design.gradient.forward import forward
from edhas_jax.machine.effects import EntrainedAir, PistonLeakage
from edhas_jax.machine.parameters import ParameterError
from edhas_jax.simulation.validity import Status

SETTINGS = GradientSettings(steps_per_cycle=256, tolerance=1e-7, max_cycles=60)
BENCH = edhas.ActuatorBench()
POINT = {"frequency": 12.0, "coil_resistance": 4.0, "mover_mass": 1.2}


@pytest.fixture(scope="module")
def bench():
    return edhas.model(BENCH, SETTINGS)


@pytest.fixture
def calls(monkeypatch):
    """The number of designs or runs of every call of the loop engine."""
    seen = []
    states, runs = computations.periodic_state, computations.simulate_batch

    def counted_states(machine, columns, settings):
        seen.append(len(next(iter(columns.values()))))
        return states(machine, columns, settings)

    def counted_runs(machine, values, *rest):
        seen.append(len(next(iter(values.values()))))
        return runs(machine, values, *rest)

    monkeypatch.setattr(computations, "periodic_state", counted_states)
    monkeypatch.setattr(computations, "simulate_batch", counted_runs)
    return seen


def power(model, **fixed):
    return lambda parameters: model.metrics(fixed | parameters, ["mean_electrical_power"])["mean_electrical_power"]


def differences(function, point, share=1e-4):
    """Central differences of a function of named parameters, which JAX knows nothing of."""
    slopes = {}
    for name, value in point.items():
        ends = [np.asarray(function(point | {name: value * (1.0 + sign * share)})) for sign in (1, -1)]
        slopes[name] = (ends[0] - ends[1]) / (2.0 * share * value)
    return slopes


def test_derivatives_are_those_of_differences_and_of_every_transformation(bench):
    function = power(bench)
    wanted = differences(function, POINT)
    for transformed in (jax.grad(function), jax.jit(jax.grad(function)), jax.jacfwd(function), jax.jacrev(function)):
        found = transformed(POINT)
        for name, slope in wanted.items():
            assert found[name] == pytest.approx(slope, rel=2e-4), name
    value, slope = jax.jvp(function, (POINT,), ({n: 0.5 * v for n, v in POINT.items()},))
    assert value == function(POINT)
    assert slope == pytest.approx(sum(0.5 * POINT[n] * wanted[n] for n in POINT), rel=2e-4)


def test_values_and_derivatives_of_the_engines_agree(monkeypatch):
    """Inside a compiled program the native engine serves by a callback; XLA gives the same numbers there."""
    names = [engine.name for engine in ENGINES if not engine.unavailable()]
    found = {}
    for name in names:
        monkeypatch.setenv(VARIABLE, name)
        model = edhas.model(BENCH, SETTINGS)
        value, slopes = jax.jit(jax.value_and_grad(power(model)))(POINT)
        found[name] = np.array([value, *slopes.values()])
    assert "xla" in found
    for numbers in found.values():
        np.testing.assert_allclose(numbers, found["xla"], rtol=1e-9)


def test_all_metrics_are_those_of_the_derivative_tables():
    settings = dataclasses.replace(SETTINGS, tolerance=1e-5)
    bench = edhas.model(BENCH, settings)
    columns = {n: np.array([v, 1.1 * v]) for n, v in POINT.items()}
    wanted = forward(BENCH, columns, tuple(POINT), bench.metric_names, settings)
    found = bench.metrics(columns)
    slopes = jax.vmap(jax.jacfwd(bench.metrics))({n: jnp.asarray(v) for n, v in columns.items()})
    assert set(found) == set(bench.metric_names) == set(slopes)
    for metric in bench.metric_names:
        np.testing.assert_allclose(found[metric], wanted.values[metric], rtol=1e-5)
        for k, name in enumerate(POINT):
            np.testing.assert_allclose(slopes[metric][name], wanted.slopes[metric][:, k], rtol=1e-9, err_msg=name)


def test_reverse_mode_where_parameters_are_many():
    """One metric of more parameters than tangents go together is differentiated backwards, with the same result."""
    model = edhas.model(BENCH, SETTINGS)
    many = {n: v for n, v in model.parameters.items() if n != "ramp_time" and v != 0.0}
    assert len(many) > computations.MOST_TANGENTS
    backwards = jax.grad(power(model))(many)
    columns = {n: np.array([v]) for n, v in many.items()}
    wanted = forward(BENCH, columns, tuple(many), ["mean_electrical_power"], SETTINGS)
    slopes = wanted.slopes["mean_electrical_power"][0]
    scale = np.abs(slopes * np.array(list(many.values()))).max()
    for slope, (name, value) in zip(slopes, many.items(), strict=True):
        assert abs(backwards[name] - slope) * abs(value) < 1e-8 * scale, name


def test_vmap_is_one_batch(bench, calls):
    frequencies, masses = jnp.linspace(8.0, 16.0, 5), jnp.linspace(1.0, 1.5, 3)

    def function(frequency, mass):
        return power(bench)({"frequency": frequency, "mover_mass": mass})

    one_by_one = [[float(function(f, m)) for m in masses] for f in frequencies]
    calls.clear()
    grid = jax.jit(jax.vmap(jax.vmap(function, (None, 0)), (0, None)))(frequencies, masses)
    assert calls == [15]
    np.testing.assert_allclose(grid, one_by_one, rtol=1e-12)
    calls.clear()
    slopes = jax.vmap(jax.vmap(jax.grad(function), (None, 0)), (0, None))(frequencies, masses)
    assert calls == [15]
    assert slopes[2, 1] == pytest.approx(float(jax.grad(function)(frequencies[2], masses[1])), rel=1e-9)
    calls.clear()
    jax.vmap(lambda f: bench.trajectory({"frequency": f}, jnp.linspace(0.0, 0.01, 11), ["current"]))(frequencies)
    assert calls == [5]


def test_another_number_compiles_nothing(compilations):
    model = edhas.model(BENCH, SETTINGS)
    gradient = jax.jit(jax.value_and_grad(power(model)))
    start = compilations()
    gradient({"frequency": 12.0})
    begun = compilations()
    assert begun > start
    power(model)({"frequency": 12.0})  # what JAX needs outside a compiled program
    begun = compilations()
    gradient({"frequency": 13.5})
    other = edhas.model(edhas.change(BENCH, coil_resistance=5.0), SETTINGS)
    other.metrics({"frequency": 9.0}, ["mean_electrical_power"])
    assert compilations() == begun
    gradient({"frequency": 13.5, "coil_resistance": 4.0})  # another set of names is another loop
    assert compilations() > begun


def test_optax_finds_a_frequency(bench):
    """A few steps of Adam inside one compiled loop bring the power to what was asked for."""
    wanted = float(power(bench)({"frequency": 14.0}))
    optimiser = optax.adam(0.2)

    @jax.jit
    def search(frequency):
        def advance(carry, _):
            frequency, state = carry
            loss = lambda f: (power(bench)({"frequency": f}) / wanted - 1.0) ** 2  # noqa: E731
            updates, state = optimiser.update(jax.grad(loss)(frequency), state, frequency)
            return (optax.apply_updates(frequency, updates), state), None

        return jax.lax.scan(advance, (frequency, optimiser.init(frequency)), length=80)[0][0]

    with jax.numpy_dtype_promotion("standard"):  # optax needs it
        found = search(jnp.asarray(11.0))
    assert float(found) == pytest.approx(14.0, abs=0.1)


def test_a_design_without_metrics_spoils_no_other(bench):
    """With a supply of a twentieth of a volt the piston stalls: it has a power, but no derivative, and the status."""
    voltages = jnp.array([bench.parameters["supply_voltage"], 0.05])
    status = bench.status({"supply_voltage": voltages})
    assert list(status) == [Status.OK, Status.STALLED]
    slopes = jax.vmap(jax.grad(lambda v: power(bench)({"supply_voltage": v, "frequency": 10.0})))(voltages)
    assert np.isfinite(slopes[0]) and np.isnan(slopes[1])
    assert np.isfinite(bench.metrics({"supply_voltage": voltages})["rms_current"]).all()
    assert isinstance(bench.status({"frequency": 10.0}), Status)


def test_names_texts_and_nested_names(bench):
    plain = bench.metrics({"frequency": 10.0, "mover_mass": 1.2}, ["rms_current"])["rms_current"]
    nested = {"reference": {"frequency": 10}, "mover": {"mover_mass": 1.2}}
    for same in ({"frequency": "10 Hz", "mover_mass": "1200 g"}, nested):
        assert bench.metrics(same, ["rms_current"])["rms_current"] == plain
    assert np.isfinite(bench.metrics({})["rms_current"])
    table = bench.metrics({"frequency": np.array([[10.0], [11.0]]), "mover_mass": [1.1, 1.2]})
    assert table["rms_current"].shape == (2, 2)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"frequencies": 10.0}, "frequency"),
        ({"frequency": -3.0}, "must lie in"),
        ({"frequency": "10 mm"}, "Hz"),
        ({"frequency": [10.0, float("nan")]}, "must lie in"),
        ({"frequency": 10.0, "reference.frequency": 11.0}, "given twice"),
        ({"frequency": [1.0, 2.0], "mover_mass": [1.0, 1.1, 1.2]}, "do not go together"),
        ({"frequency": True}, "belongs here"),
        ({"mean_electrical_power": 1.0}, "result of a run"),
    ],
)
def test_a_wrong_parameter_is_named(bench, parameters, message):
    with pytest.raises(ParameterError, match=message):
        bench.metrics(parameters)


def test_what_is_not_there_is_said(bench):
    with pytest.raises(ValueError, match="mean_flow: no metric of this machine"):
        bench.metrics({}, ["mean_flow"])
    with pytest.raises(ValueError, match="no signal of this machine"):
        bench.trajectory({}, [0.0], ["outlet_flow"])
    with pytest.raises(ValueError, match="from 0 s on"):
        bench.trajectory({}, [-1.0])
    with pytest.raises(TypeError, match="second derivatives"):
        jax.hessian(lambda f: power(bench)({"frequency": f}))(10.0)
    with pytest.raises(TypeError, match="times of a trajectory"):
        jax.grad(lambda t: bench.trajectory({}, t, ["current"])["current"].sum())(jnp.array([0.0, 1e-3]))
    with pytest.raises(BatchError, match="trajectory"):
        edhas.model(edhas.ActuatorSystem()).metrics({})
    with pytest.raises(TypeError, match=r"edhas_jax\.model"):
        jax.jit(lambda f: edhas.simulate(edhas.change(BENCH, frequency=f)).signals["current"])(10.0)


def test_single_precision_of_the_caller():
    with jax.enable_x64(False):
        model = edhas.model(BENCH, SETTINGS)
        value, slope = jax.jit(jax.value_and_grad(power(model)))({"frequency": 12.0})
        assert value.dtype == slope["frequency"].dtype == np.float32
    value64, slope64 = jax.value_and_grad(power(model))({"frequency": 12.0})
    assert float(value) == pytest.approx(float(value64), rel=1e-5)
    assert float(slope["frequency"]) == pytest.approx(float(slope64["frequency"]), rel=1e-4)


@pytest.mark.parametrize("begin", [0.0, 0.004])
def test_a_trajectory_is_that_of_a_run(bench, begin):
    run = edhas.simulate(edhas.change(BENCH, **POINT), edhas.Simulation(duration=0.02, step=2e-5))
    times = np.arange(round(begin / 2e-4), 101) * 2e-4
    for found in (bench.trajectory(POINT, times), jax.jit(lambda p: bench.trajectory(p, times))(POINT)):
        for name in ("current", "piston_position", "voltage"):
            np.testing.assert_allclose(found[name], run.signals[name][-len(times) :], rtol=1e-9, atol=1e-12)


def test_times_that_are_not_evenly_spaced(bench):
    fine = np.linspace(0.0, 0.02, 1001)
    wanted = bench.trajectory(POINT, fine, ["piston_position"])["piston_position"]
    times = np.array([0.0, 1.234e-3, 0.0071, 0.01999])
    found = bench.trajectory(POINT, times, ["piston_position"])["piston_position"]
    np.testing.assert_allclose(found, np.interp(times, fine, wanted), atol=1e-5 * float(np.ptp(wanted)))
    both = jax.vmap(lambda t: bench.trajectory(POINT, t, ["current"])["current"])(jnp.stack([times, 0.5 * times]))
    np.testing.assert_allclose(both[1], bench.trajectory(POINT, 0.5 * times, ["current"])["current"], rtol=1e-12)


def test_derivatives_of_a_trajectory(bench):
    times = np.arange(51) * 4e-4
    measured = bench.trajectory(POINT | {"coil_resistance": 4.4}, times, ["current"])["current"]

    def loss(parameters):
        return jnp.sum((bench.trajectory(parameters, times, ["current"])["current"] - measured) ** 2)

    found, wanted = jax.jit(jax.grad(loss))(POINT), differences(loss, POINT, 1e-5)
    for name in POINT:
        assert found[name] == pytest.approx(wanted[name], rel=1e-3, abs=1e-6)
    table = jax.jacfwd(lambda p: bench.trajectory(p, times, ["current", "piston_position"]))(POINT)
    slopes = differences(lambda p: bench.trajectory(p, times, ["piston_position"])["piston_position"], POINT, 1e-5)
    for name in POINT:
        size = np.abs(slopes[name]).max()
        np.testing.assert_allclose(table["piston_position"][name], slopes[name], atol=1e-4 * size)


def test_the_pump_has_the_metrics_of_a_sweep():
    """A pump with valves and effects, at the step of a sweep: the same numbers as its table."""
    machine = edhas.PumpBench(effects=(PistonLeakage(), EntrainedAir()))
    designs = {"frequency": np.array([20.0, 20.0]), "piston_clearance": np.array([1e-5, 3e-5])}
    step = 5e-5
    table = run_designs(machine, designs, BatchSettings(step=step, tolerance=2e-4, max_cycles=24))
    model = edhas.model(machine, GradientSettings(steps_per_cycle=int(steps_per_cycle(20.0, step)), max_cycles=24))
    found = jax.jit(jax.vmap(model.metrics))({n: jnp.asarray(v) for n, v in designs.items()})
    for name in model.metric_names:
        np.testing.assert_allclose(found[name], table[name], rtol=1e-12, err_msg=name)
