"""Laws given by a table: the curve through the nodes, and machines that have such a law."""

import functools

import jax
import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import CubicHermiteSpline

import edhas_jax as edhas
from edhas_jax.config.machine_config import build_config, read_config
from edhas_jax.config.writer import dump_config
from edhas_jax.config.yaml_with_lines import parse_yaml
from edhas_jax.core import structs
from edhas_jax.design.sweep.config import load_sweep
from edhas_jax.design.sweep.identity import sweep_identity
from edhas_jax.machine.effects import EffectError, ParasiticSpring
from edhas_jax.machine.effects.tabulated_law import LawPlace, LawTable, interpolate, table_of, tabulated_class
from edhas_jax.machine.rigs import ActuatorBench, PumpBench
from edhas_jax.simulation.batch_trajectories import simulate_batch
from edhas_jax.simulation.run import simulate
from edhas_jax.simulation.run_settings import Precision, Simulation
from tests.support.convergence import Stretch, convergence
from tests.support.reference import nominal

POSITION = LawPlace("mover_force", "piston_position")
NODES = np.array([-3.0, -1.0, -0.5, 0.4, 0.5, 2.0])
VALUES = np.array([1.0, 1.0, -2.0, 0.3, 0.9, -1.0])
QUICK = Simulation(duration=0.06, sample_rate=2e3)


def law(nodes, values, place=POSITION, name="curve"):
    return LawTable(name, place, np.asarray(nodes, float), np.asarray(values, float)).effect()


def with_law(effect, machine=None):
    machine = nominal(PumpBench) if machine is None else machine
    return structs.replace(machine, effects=(*machine.effects, effect))


def curve(x, nodes=NODES, values=VALUES):
    return np.array([float(interpolate(float(q), list(nodes), list(values))) for q in np.atleast_1d(x)])


def test_the_curve_is_the_hermite_spline_of_the_chords():
    before, after = np.maximum(np.arange(6) - 1, 0), np.minimum(np.arange(6) + 1, 5)
    slopes = (VALUES[after] - VALUES[before]) / (NODES[after] - NODES[before])
    x = np.linspace(-3.0, 2.0, 301)
    np.testing.assert_allclose(curve(x), CubicHermiteSpline(NODES, VALUES, slopes)(x), rtol=0, atol=1e-13)
    np.testing.assert_allclose(curve(NODES), VALUES, atol=1e-14)
    np.testing.assert_allclose(curve([-1e6, 1e6]), VALUES[[0, -1]], atol=1e-14)
    np.testing.assert_allclose(curve(x, values=2.0 * NODES + 1.0), 2.0 * x + 1.0, atol=1e-13)


def test_the_curve_leaves_the_range_of_two_nodes_by_15_percent_of_the_changes_beside_them():
    rng = np.random.default_rng(7)
    largest = 0.0
    for _ in range(100):
        nodes = np.cumsum(10.0 ** rng.uniform(-3.0, 0.0, 4))
        values = rng.normal(size=4) * (rng.uniform(size=4) < 0.6)
        x = np.linspace(nodes[1], nodes[2], 41)
        y = np.array(interpolate(x, list(nodes), list(values)))
        low, high = np.sort(values[1:3])
        beside = abs(values[1] - values[0]) + abs(values[3] - values[2])
        if beside > 0.0:
            largest = max(largest, max(y.max() - high, low - y.min()) / beside)
    assert 0.1 < largest < 0.15


def test_the_slope_is_continuous_and_defined_at_the_nodes():
    """There the clipped coordinate of an interval is at its limit, where a derivative is easily halved or lost."""
    slope = jax.grad(lambda x: interpolate(x, list(NODES), list(VALUES)))
    for node in NODES[1:-1]:
        there, before, after = (float(slope(node + d)) for d in (0.0, -1e-9, 1e-9))
        assert there == pytest.approx(before, abs=1e-6) and there == pytest.approx(after, abs=1e-6)
    assert float(slope(NODES[0])) == pytest.approx((VALUES[1] - VALUES[0]) / (NODES[1] - NODES[0]))
    assert [float(slope(x)) for x in (NODES[0] - 1e-9, NODES[-1] + 1e-9)] == [0.0, 0.0]


@pytest.mark.usefixtures("engine")
@pytest.mark.parametrize("precision", Precision)
def test_a_straight_table_is_the_linear_law_of_the_library(precision):
    spring = ParasiticSpring(spring_rate=800.0)
    nodes = np.array([-6e-3, -2e-3, 0.0, 1e-3, 6e-3])
    how = structs.replace(QUICK, precision=precision)
    runs = [simulate(with_law(effect, nominal(ActuatorBench)), how) for effect in (spring, law(nodes, -800.0 * nodes))]
    for name, expected in runs[0].signals.items():
        scale = np.ptp(expected) or 1.0
        tolerance = 1e-9 if precision is Precision.FLOAT64 else 2e-2
        np.testing.assert_allclose(runs[1].signals[name] / scale, expected / scale, atol=tolerance, err_msg=name)
    assert abs(runs[1].energy_residual()) < 1e-6 and "curve" in runs[1].energy


def test_factors_multiply_the_curve():
    """A constant curve times the speed is viscous damping; a curve over the position makes it the library's."""
    bare, damped = (edhas.change(nominal(ActuatorBench), mover_damping=damping) for damping in (10.0, 30.0))
    place = LawPlace("mover_friction", "piston_position", ("piston_velocity",))
    got = simulate(with_law(law([0.0, 1e-3], [20.0, 20.0], place), bare), QUICK)
    expected = simulate(damped, QUICK)
    for name in ("current", "piston_position", "voltage"):
        np.testing.assert_allclose(
            got.signals[name], expected.signals[name], atol=1e-9 * np.ptp(expected.signals[name])
        )
    assert place.value_unit == "N/(m/s)" and place.neutral == 0.0


def test_the_step_stays_of_second_order():
    """With a force that bends strongly within the stroke; 10 Hz, where no valve switches."""
    x = 1e-3 * np.array([-5.0, -2.0, -0.5, 0.0, 0.4, 1.5, 5.0])
    machine = with_law(law(x, 8.0 * np.sin(2.0 * np.pi * x / 4e-3)))
    found = convergence(Stretch(machine, 0.189, 0.209, "no reversal, no valve at its seat"))
    assert found.order >= 1.9 and found.errors[-1] < 2e-5


@pytest.mark.usefixtures("engine")
def test_derivatives_by_the_values_equal_differences():
    x = 1e-3 * np.array([-4.0, -2.0, 0.0, 1.0, 4.0])
    values = np.array([1.0, -2.0, 0.5, 1.5, -1.0])
    machine = with_law(law(x, values), edhas.change(nominal(ActuatorBench), ramp_time=1e-3))
    names = [f"curve.value_{k}" for k in range(1, 6)] + ["curve.node_3"]
    base = dict(zip(names, [*values, x[2]], strict=True))
    steps = dict(zip(names, [1e-3] * 5 + [1e-7], strict=True))
    lanes = {n: np.full(len(names), v) for n, v in base.items()}
    seeds = {n: np.eye(len(names))[k] for k, n in enumerate(names)}
    signals = ("current", "piston_position", "voltage")
    run = functools.partial(simulate_batch, machine, step_size=2e-5, steps_per_sample=10, samples=300, signals=signals)
    exact = run(values=lanes, seeds=seeds).slopes
    ends = [run(values={n: v + sign * steps[n] * seeds[n] for n, v in lanes.items()}, seeds=None) for sign in (1, -1)]
    for signal in signals:
        for k, n in enumerate(names):
            difference = (ends[0].values[signal] - ends[1].values[signal])[:, k] / (2.0 * steps[n])
            scale = np.abs(difference).max()
            assert scale > 0.0
            np.testing.assert_allclose(
                exact[signal][:, k] / scale, difference / scale, atol=2e-4, err_msg=f"{signal} {n}"
            )


def test_another_number_compiles_nothing(compilations):
    machine = with_law(law(NODES, VALUES), nominal(ActuatorBench))
    simulate(machine, QUICK)
    before = compilations()
    other = simulate(with_law(law(1.1 * NODES, 0.5 * VALUES), nominal(ActuatorBench)), QUICK)
    assert compilations() == before and np.isfinite(other.signals["current"]).all()
    simulate(with_law(law(np.arange(7.0), np.arange(7.0)), nominal(ActuatorBench)), QUICK)
    assert compilations() > before


def test_a_configuration_keeps_the_table_to_the_bit():
    rng = np.random.default_rng(1)
    place = LawPlace("check_valve_force", "lift", ("pressure_drop",))
    tables = [law(np.sort(rng.normal(0.0, 1e-3, 7)), rng.normal(0.0, 3.0, 7)),
              law([-1e-5, 3e-4], rng.normal(0.0, 1e-6, 2), place, "flow_force")]  # fmt: skip
    machine = structs.replace(PumpBench(), effects=tuple(tables))
    text = dump_config(machine)
    again = build_config(parse_yaml(text)[0]).machine
    for one, other in zip(machine.effects, again.effects, strict=True):
        assert type(one) is type(other) and table_of(other).place == table_of(one).place
        np.testing.assert_array_equal(table_of(other).nodes, table_of(one).nodes)
        np.testing.assert_array_equal(table_of(other).values, table_of(one).values)
    assert dump_config(again) == text


SWEEP = """
name: heights
base: base.yaml
sweep: {kind: grid, parameters: {value_2: [0 N, 10 N], frequency: [20 Hz]}}
batch: {step: 100 us, tolerance: 1 %, max_cycles: 6}
"""
BASE = """
rig: actuator_bench
effects:
  - {law: tabulated, name: bump, slot: SLOT, variable: piston_position, node_unit: mm, nodes: [-4, 0, 4],
     value_unit: N, values: [0, 5, 0]}
"""


def test_a_sweep_varies_a_value_and_knows_the_place(tmp_path):
    identities = []
    for slot in ("mover_force", "mover_friction"):
        (tmp_path / "base.yaml").write_text(BASE.replace("SLOT", slot))
        (tmp_path / "sweep.yaml").write_text(SWEEP)
        sweep = load_sweep(tmp_path / "sweep.yaml")
        identities.append(sweep_identity(sweep)["effects"])
    assert identities[0] != identities[1] and identities[0] == {"bump": "table mover_force piston_position"}
    edhas.run_sweep(sweep, tmp_path / "out")
    table = pd.read_parquet(tmp_path / "out" / "table.parquet")
    without, with_bump = (table[table["value_2"] == value].iloc[0] for value in (0.0, 10.0))
    assert without["status"] == with_bump["status"] and without["rms_current"] < with_bump["rms_current"]


def test_what_cannot_be_tabulated_is_refused():
    for place, count, sentence in (
        (LawPlace("no_slot", "current"), 3, "no slot `no_slot`"),
        (LawPlace("mover_force", "weight"), 3, "no law can be tabulated over `weight`"),
        (LawPlace("mover_force", "current"), 1, "has 2 to 100 nodes, not 1"),
    ):
        with pytest.raises(EffectError, match=sentence):
            tabulated_class("x", place, count)
    assert table_of(ParasiticSpring()) is None


def test_a_law_file_is_used_by_a_configuration(tmp_path):
    (tmp_path / "spring.yaml").write_text(
        "law: tabulated\nslot: mover_force\nvariable: piston_position\nnode_unit: mm\nnodes: [-5, 0, 5]\n"
        "value_unit: mN\nvalues: [4000, 0, -4e3]\n"
    )
    (tmp_path / "bench.yaml").write_text("rig: actuator_bench\neffects: [spring.yaml]\n")
    config = read_config(tmp_path / "bench.yaml", overrides=["spring.value_2=1 N"])
    table = table_of(config.machine.effects[0])
    np.testing.assert_allclose(table.nodes, [-5e-3, 0.0, 5e-3])
    np.testing.assert_allclose(table.values, [4.0, 1.0, -4.0])
    assert config.machine.effects[0].id == "spring" == table.name
    assert edhas.get(config.machine, "spring.value_3") == -4.0
