"""Tables of derivatives against central differences of an independent solver, and forward against reverse mode."""

import numpy as np
import pandas as pd
import pytest

import edhas_jax as edhas
from edhas_jax.compiler.engines import ENGINES, VARIABLE
from edhas_jax.design.gradient import forward as forward_mode
from edhas_jax.design.gradient.fixed_point import GradientSettings
from edhas_jax.design.gradient.forward import forward
from edhas_jax.design.gradient.reverse import reverse
from edhas_jax.design.gradient.table import GradientError, Mode, gradient
from edhas_jax.machine.effects import EntrainedAir, LugreFriction, PistonLeakage
from tests.support.reference import DATA

PUMP = edhas.PumpBench(effects=(LugreFriction(), PistonLeakage(), EntrainedAir()))
ACTUATOR = edhas.ActuatorBench(effects=(LugreFriction(),))
METRICS = {"mean_flow": "flow_elasticity", "mean_electrical_power": "power_elasticity"}
POINTS = {"10 Hz": (10.0, 4.2e-6), "20 Hz": (20.0, 4.2e-6), "30 Hz": (30.0, 4.2e-6), "20 Hz loaded": (20.0, 1e-6)}


@pytest.fixture(scope="module")
def wanted():
    table = pd.read_csv(DATA / "derivatives.csv")
    table.columns = [c.split(" [")[0] for c in table.columns]
    return table


def errors(wanted, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """(errors of all elasticities, the elasticities that are right)."""
    frequency, area = np.array(list(POINTS.values())).T
    points = {"frequency": frequency, "load_orifice_area": area}
    names = list(dict.fromkeys(wanted["parameter"]))
    frame = gradient(PUMP, list(METRICS), names, points, GradientSettings(steps)).frame
    frame["at"] = [list(POINTS)[k] for k in frame["point"]]
    found = frame.set_index(["at", "parameter", "metric"])["elasticity"]
    right = wanted.melt(["point", "parameter"], list(METRICS.values()), "column", "right")
    kinds = {column: metric for metric, column in METRICS.items()}
    got = [found[row.point, row.parameter, kinds[row.column]] for row in right.itertuples()]
    return np.array(got) - right["right"], right["right"].to_numpy()


def test_every_elasticity_of_the_independent_solver(wanted):
    """Through valve contact and friction reversal, the frequency included: 0.01, and 1 % of what is larger than 0.1."""
    error, right = errors(wanted, GradientSettings().steps_per_cycle)
    assert len(error) == 128 and np.abs(error).max() <= 0.01
    large = np.abs(right) > 0.1
    assert (np.abs(error[large] / right[large])).max() <= 0.01


def test_the_error_falls_with_the_step(wanted):
    worst = [np.abs(errors(wanted, steps)[0]).max() for steps in (1024, 4096, 16384)]
    assert worst[1] < 0.5 * worst[0] and worst[2] < 0.5 * worst[1]


def table(machine, names, count=3):
    rng = np.random.default_rng(0)
    return {n: float(edhas.get(machine, n)) * rng.uniform(0.9, 1.1, count) for n in names}


@pytest.mark.parametrize("designs", [3, 9])
def test_forward_equals_reverse_on_every_engine(designs, monkeypatch):
    """With as many terms: to rounding; one tangent per lane with few designs, two groups of tangents with many."""
    monkeypatch.setattr(forward_mode, "MOST_TANGENTS", 2)
    names, metrics = ["frequency", "coil_resistance", "mover_damping"], ["mean_electrical_power", "phase_lag"]
    columns, settings = table(ACTUATOR, names, designs), GradientSettings(128, 0.0, 3)
    found = []
    for engine in (e for e in ENGINES if not e.unavailable()):
        monkeypatch.setenv(VARIABLE, engine.name)
        found += [mode(ACTUATOR, columns, names, metrics, settings) for mode in (forward, reverse)]
    first, *others = found
    sizes = np.stack([columns[n] for n in names], axis=1)
    for other in others:
        for m in metrics:
            np.testing.assert_allclose(other.values[m], first.values[m], rtol=1e-9)
            scale = sizes / first.values[m][:, None]
            np.testing.assert_allclose(other.slopes[m] * scale, first.slopes[m] * scale, rtol=1e-9, atol=1e-9)


@pytest.mark.usefixtures("engine")
def test_derivatives_are_those_of_the_metrics():
    """Central differences of the actuator, which has no valves and no events that jump."""
    names, metrics = ["amplitude", "frequency"], ["rms_current", "amplitude_ratio", "phase_lag"]
    settings = GradientSettings(128, 1e-9, 60)
    machine = edhas.change(edhas.ActuatorBench(), amplitude="2 mm")
    frame = gradient(machine, metrics, names, settings=settings).frame

    def values(**changes):
        return gradient(edhas.change(machine, **changes), metrics, ["mover_mass"], settings=settings).frame

    for row in frame.itertuples():
        up, down = (values(**{row.parameter: row.parameter_value * (1 + d)}) for d in (1e-5, -1e-5))
        pick = up["metric"] == row.metric
        slope = (up["value"][pick].item() - down["value"][pick].item()) / (2e-5 * row.parameter_value)
        assert row.derivative == pytest.approx(slope, rel=1e-4, abs=1e-8 * abs(row.value / row.parameter_value))


@pytest.mark.usefixtures("engine")
def test_units_and_points_are_told():
    got = gradient(ACTUATOR, ["rms_current"], ["coil_resistance", "reference.frequency"],
                   {"amplitude": ["2 mm", 3e-3]}, GradientSettings(128, 1e-2, 5))  # fmt: skip
    assert list(got.frame["amplitude"]) == [2e-3, 2e-3, 3e-3, 3e-3]
    assert list(got.frame["derivative_unit"][:2]) == ["A/ohm", "A/Hz"]
    assert got.elasticities(1).shape == (2, 1)


@pytest.mark.usefixtures("engine")
def test_what_has_no_derivative_says_so():
    quick = GradientSettings(256, 1e-2, 5)
    stalled = gradient(edhas.change(ACTUATOR, supply_voltage="0.5 V"), ["rms_current"], ["mover_mass"], settings=quick)
    assert "follows less than half" in stalled.frame["note"][0] and np.isnan(stalled.frame["derivative"][0])
    clipped = gradient(edhas.change(ACTUATOR, supply_voltage="4.5 V"), ["peak_voltage", "rms_current"],
                       ["mover_mass"], settings=quick).frame  # fmt: skip
    assert "clipped" in clipped["note"][0] and np.isfinite(clipped["derivative"][1])
    zero = gradient(edhas.change(ACTUATOR, mover_damping=0.0), ["rms_current"], ["mover_damping"], settings=quick).frame
    assert "parameter is zero" in zero["note"][0] and zero["derivative"][0] > 0.0


@pytest.mark.parametrize(("arguments", "says"), [
    ({"metrics": ["mean_flw"]}, "mean_flw: no metric of pump_bench.*mean_flow"),
    ({"parameters": ["valve_mas"]}, "valve_mas: unknown parameter.*valve_mass"),
    ({"parameters": ["valve_mass", "valve_mass"]}, "asked for twice"),
    ({"points": {"frequency": ["10 Hz"], "amplitude": ["1 mm", "2 mm"]}}, "equally many values"),
    ({"points": {"frequency": ["-3 Hz"]}}, "frequency: must lie in"),
])  # fmt: skip
def test_bad_requests(arguments, says):
    with pytest.raises(GradientError, match=says):
        gradient(PUMP, **{"metrics": ["mean_flow"], "parameters": ["valve_mass"]} | arguments)
    with pytest.raises(GradientError, match="driven by a sine"):
        gradient(edhas.ActuatorSystem(), mode=Mode.FORWARD)
