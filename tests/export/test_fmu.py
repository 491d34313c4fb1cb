"""Export as an FMU: the unit simulated by FMPy against the package's own simulation, to rounding."""

import shutil
import subprocess
import warnings
import zipfile
from pathlib import Path

import jax
import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax import Rig, drive, par, signal, state
from edhas_jax.commands.cli import main
from edhas_jax.compiler.engines import EngineFallback
from edhas_jax.config.machine_config import Config, build_config
from edhas_jax.core import structs
from edhas_jax.export.fmu import export_fmu
from edhas_jax.export.fmu_inputs import FmuError
from edhas_jax.machine.components.set_points import Recorded, Steps
from edhas_jax.machine.parameters import set_parameters
from edhas_jax.simulation import time_loop
from tests.support import CONFIGS
from tests.support.fmu_unit import INTERVAL, Unit, difference

fmpy = pytest.importorskip("fmpy")
pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")

PUMP_EFFECTS = ["lugre_friction", "piston_leakage", "entrained_air"]
QUICK = {"duration": "0.06 s", "sample_rate": "2 kHz"}
SAMPLES = 121  # of a run with QUICK settings
SINE = {"kind": "sine", "frequency": "30 Hz", "ramp_time": "20 ms"}
ACTUATOR = {"rig": "actuator_bench", "reference": SINE, "simulation": QUICK}
PUMP = {"rig": "pump_bench", "effects": PUMP_EFFECTS, "reference": SINE, "simulation": QUICK}
SYSTEM = {"rig": "actuator_system", "effects": [*PUMP_EFFECTS, "karnopp_friction"], "simulation": QUICK}
TABLE = {"law": "tabulated", "name": "bump", "slot": "mover_force", "variable": "piston_position", "node_unit": "mm",
         "nodes": [-3, 0, 1, 3], "value_unit": "N", "values": [1, -2, 3, 0]}  # fmt: skip
CHANGED = {
    "actuator_bench": {"mover_mass": 3.0, "position_gain": 1.2e4},
    "pump_bench": {"piston_clearance": 12e-6, "load_orifice_area": 2e-6, "accumulator.accumulator_pressure": 3e5},
    "actuator_system": {"load_force": 150.0, "step_size": 8e-3, "cylinder_sliding_friction": 12.0},
}
ROUNDING = 1e-10  # share of the range of a signal; measured: about 1e-12


@pytest.fixture(scope="module")
def unit(tmp_path_factory):
    """`unit(mapping, *inputs)`: a unit, written and compiled once."""
    units: dict[str, Unit] = {}

    def of(mapping: dict, *inputs: str) -> Unit:
        key = repr((mapping, inputs))
        if key not in units:
            units[key] = Unit(tmp_path_factory.mktemp("fmu") / "machine.fmu", build_config(mapping), inputs)
        return units[key]

    return of


@pytest.mark.parametrize("mapping", [ACTUATOR, PUMP, SYSTEM], ids=lambda m: m["rig"])
def test_the_unit_equals_the_simulation(unit, mapping):
    u = unit(mapping)
    for values in ({}, CHANGED[mapping["rig"]]):
        run = edhas.simulate(set_parameters(u.config.machine, values), u.config.simulation)
        got = fmpy.simulate_fmu(
            str(u.path), stop_time=0.06, output_interval=INTERVAL, start_values=values, output=u.outputs
        )
        assert set(u.outputs) == set(run.signals) - {"time"} and len(got) == SAMPLES == len(run.signals["time"])
        assert difference({n: got[n] for n in u.outputs}, run.signals) < ROUNDING


@pytest.mark.parametrize(
    "more",
    [
        {"controller": {"kind": "cascade"}, "amplifier": {"kind": "current"}},
        {"sampling": {"kind": "sampled", "sample_time": "0.21 ms", "computation_delay": "0.05 ms"}},
        {"reference": {"kind": "chirp", "amplitude": "2 V"}, "controller": {"kind": "open_loop"}},
        {"effects": ["lugre_friction", "coil_heating", "supply_sag", TABLE], "simulation": {**QUICK, "step": "33 us"}},
    ],
    ids=["current", "sampled", "open loop", "effects"],
)
def test_other_controllers_drives_and_steps(unit, more):
    u = unit({**ACTUATOR, **more})
    run = edhas.simulate(u.config.machine, u.config.simulation)
    assert difference(u.run(u.instance(), SAMPLES), run.signals) < ROUNDING


def test_the_model_description_is_valid_and_complete(unit):
    from fmpy.validation import validate_fmu

    u = unit(PUMP, "reference", "load_orifice_area")
    assert validate_fmu(str(u.path)) == []
    by_name = {v.name: v for v in u.description.modelVariables}
    clearance, flow = by_name["piston_clearance"], by_name["outlet_flow"]
    assert (clearance.causality, clearance.variability, clearance.unit) == ("parameter", "fixed", "m")
    assert float(clearance.start) == 20e-6 and float(clearance.max) == 1e-3 and "gap" in clearance.description
    assert (flow.causality, flow.unit) == ("output", "m3/s")
    units = {of.name: of for of in u.description.unitDefinitions}
    volt = units["V"].baseUnit
    assert (volt.kg, volt.m, volt.s, volt.A) == (1, 2, -3, -1)
    assert {d.name: float(d.factor) for d in units["m3/s"].displayUnits} == {"L/min": pytest.approx(6e4)}
    described = (*u.description.outputs, *u.description.derivatives)
    on = {o.variable.name: {d.name for d in o.dependencies} for o in described}
    assert on["piston_position"] == {"piston_position"} and on["der(piston_position)"] == {"piston_velocity"}
    acting = {n: {d for d in names if by_name[d].causality == "input"} for n, names in on.items()}
    assert acting["outlet_flow"] == {"load_orifice_area"} and acting["piston_position"] == set()
    assert {by_name[f"der({n})"].derivative.name for n in u.fmu.program.states} == set(u.fmu.program.states)
    assert acting["voltage"] == {"reference", "reference_velocity"} and "reference" not in acting
    again = edhas.load(Path(u.folder) / "resources" / "config.yaml")
    assert jax.tree.all(jax.tree.map(lambda a, b: a == b, again.machine, u.config.machine))


def test_an_input_acts_as_a_changed_parameter_of_a_simulation(unit):
    u = unit(PUMP, "load_orifice_area")
    instance, loop_state = u.instance(), time_loop.initial_loop_state(u.config.machine, np.float64(20e-6))
    for part, area in enumerate((4.2e-6, 1e-6)):
        machine = jax.tree.map(np.asarray, set_parameters(u.config.machine, {"load_orifice_area": area}))
        loop_state, expected = time_loop.integrate(machine, loop_state, np.float64(20e-6), 25, 60)
        got = u.run(instance, 60, 60 * part, before=lambda t, area=area: {"load_orifice_area": area})
        assert difference(got, expected.signals) < ROUNDING
    assert got["outlet_pressure"].max() > 1.2 * 2e5


def test_an_external_voltage_equals_an_open_loop(unit):
    u = unit(ACTUATOR, "voltage")
    assert not {"position_gain", "amplitude"} & set(u.number) and "reference" not in u.outputs
    got = u.run(u.instance(), SAMPLES, before=lambda t: {"voltage_command": -3.0 if t > 0.0199 else 0.0})
    step = {"kind": "step", "step_size": "-3 V", "step_time": "20 ms"}
    run = edhas.simulate(build_config({**ACTUATOR, "controller": {"kind": "open_loop"}, "reference": step}).machine,
                         u.config.simulation)  # fmt: skip
    assert difference(got, run.signals) < ROUNDING and got["current"].min() < -0.5


def test_an_external_set_point_is_extrapolated_at_its_rate(unit, tmp_path):
    u = unit(PUMP, "reference", "load_orifice_area")
    speed, ramp = 0.05, Recorded(values=np.arange(SAMPLES) * (0.05 * INTERVAL), interval=INTERVAL)
    run = edhas.simulate(structs.replace(u.config.machine, reference=ramp), u.config.simulation)
    given = u.run(u.instance(), SAMPLES - 1, before=lambda t: {"reference": speed * t, "reference_velocity": speed})
    assert difference(given, run.signals) < ROUNDING
    recorded = Unit(tmp_path / "recorded.fmu", Config(run.machine, run.simulation))
    assert difference(recorded.run(recorded.instance(), SAMPLES), run.signals) < ROUNDING


def test_a_recorded_set_point_steps_as_in_a_simulation(tmp_path):
    """At a sample and between two; a smooth part, and one that is held."""
    levels, time = np.array([0.0, 1e-3, -2e-3, 5e-4]), np.array([0.0, 0.01, 0.0213, 0.04])
    ramp = np.arange(SAMPLES) * (0.05 * INTERVAL)
    ramp_with_steps = Recorded(values=ramp, interval=INTERVAL, steps=Steps(times=time[1:], levels=levels))
    for k, recorded in enumerate((ramp_with_steps, Recorded.held(time, levels))):
        config = build_config(ACTUATOR)
        machine = structs.replace(config.machine, reference=recorded)
        u = Unit(tmp_path / f"{k}.fmu", Config(machine, config.simulation))
        run = edhas.simulate(machine, config.simulation)
        assert np.abs(np.diff(run.signals["reference"])).max() > 2e-3
        assert difference(u.run(u.instance(), SAMPLES), run.signals) < ROUNDING


def test_the_reversing_valve_may_be_commanded_externally(unit):
    u = unit(SYSTEM, "target", "spool")
    got = u.run(u.instance(), 60, before=lambda t: {"target": 5e-3, "spool_command": -0.5})
    expected = -0.5 * (1.0 - np.exp(-np.arange(60) * INTERVAL / 8e-3))
    np.testing.assert_allclose(got["spool"], expected, atol=1e-5)
    assert got["head_pressure"][-1] < got["rod_pressure"][-1]


def test_a_communication_step_need_not_be_a_multiple_of_the_step(unit):
    u = unit(PUMP)
    # 50 µs is taken in three equal steps, as a run that is sampled every 50 µs takes it
    run = edhas.simulate(u.config.machine, edhas.Simulation(duration=0.02, sample_rate=20e3))
    assert run.step == pytest.approx(50e-6 / 3)
    assert difference(u.run(u.instance(), 400, interval=50e-6), run.signals) < ROUNDING
    # and steps of any length end near the same state
    instance, t = u.instance(), 0.0
    for size in [3e-6, 0.0, 1.234e-3, 777e-6] * 9:
        instance.doStep(t, size)
        t += size
    fine = dict(zip(u.outputs, u.read_outputs(instance), strict=True))
    assert fine["piston_position"] == pytest.approx(np.interp(t, np.arange(401) * 5e-5, run.signals["piston_position"]),
                                                    abs=2e-7)  # fmt: skip


def test_states_are_saved_and_instances_share_nothing(unit):
    u = unit(PUMP)
    alone = u.run(u.instance(), 40)
    one, other = u.instance(), u.instance(piston_clearance=40e-6)
    u.run(other, 17)
    u.run(one, 20)
    saved = one.getFMUstate()
    kept = one.serializeFMUstate(saved)
    ahead = u.run(one, 20, 20)
    other.setFMUstate(other.deSerializeFMUstate(kept))
    one.setFMUstate(saved)
    one.freeFMUstate(saved)
    for again in (u.run(one, 20, 20), u.run(other, 20, 20)):
        for n in u.outputs:
            np.testing.assert_array_equal(ahead[n], alone[n][20:])
            np.testing.assert_array_equal(again[n], ahead[n])
    one.reset()
    one.setupExperiment()
    one.enterInitializationMode()
    one.exitInitializationMode()
    np.testing.assert_array_equal(u.run(one, 40)["voltage"], alone["voltage"])


def test_leaving_the_physical_range_is_reported_as_by_a_simulation(unit, capfd):
    values = {"amplitude": 9e-3, "stop_stiffness": 1.0}
    u = unit(PUMP)
    with pytest.raises(edhas.SimulationError) as failure:
        edhas.simulate(set_parameters(u.config.machine, values), u.config.simulation)
    got = fmpy.simulate_fmu(str(u.path), stop_time=0.06, output_interval=INTERVAL, start_values=values)
    place, _, _ = str(failure.value).partition("; ")  # the unit cannot try another step
    assert f"[DISCARD] {place}; " in capfd.readouterr().out
    assert 1 < len(got) < SAMPLES and np.isfinite(got["gas_volume"]).all()


@pytest.mark.parametrize(
    ("act", "sentence"),
    [
        (lambda u: u.instance(mover_mass=-1.0), "mover_mass: must lie in 100 mg"),
        (lambda u: u.instance(mover_mass=np.nan), "mover_mass: must lie in 100 mg"),
        (lambda u: u.set_values(u.instance(), mover_mass=3.0), "a parameter can be set only until initialization ends"),
        (lambda u: u.instance().doStep(1.0, 1e-3), "this unit is at 0 s"),
        (lambda u: u.instance().doStep(0.0, -1e-3), "must be finite and not negative"),
        (lambda u: u.instance().getInteger([0]), "every variable of this unit is a real number"),
    ],
)
def test_wrong_calls_of_a_tool_are_refused_with_a_message(unit, capfd, act, sentence):
    from fmpy.fmi1 import FMICallException

    with pytest.raises(FMICallException):
        act(unit(ACTUATOR))
    assert sentence in capfd.readouterr().out


def test_the_sources_are_plain_c_for_any_compiler(unit, tmp_path):
    with zipfile.ZipFile(unit(SYSTEM).path) as archive:
        archive.extractall(tmp_path)
    strict = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-Wno-unused-parameter"]
    command = ["cc", *strict, "-DFMI2_FUNCTION_PREFIX=machine_", "-c", "fmu_unit.c", "-o", "unit.o"]
    done = subprocess.run(command, cwd=tmp_path / "sources", capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    symbols = subprocess.run(["nm", "-g", "unit.o"], cwd=tmp_path / "sources", capture_output=True, text=True).stdout
    own = [line.split()[-1] for line in symbols.splitlines() if " U " not in line]
    assert own and all(name.lstrip("_").startswith("machine_fmi2") for name in own)


class Lag(Rig):
    """A pressure that follows a command with a lag, and a valve."""

    time_step, duration = 1e-3, 1.0

    command = drive("V", "command of the valve", 1.0)
    opening = drive("-", "opening of an outlet", 0.0)
    gain: float = par(2.2e6, "Pa/V", (1e4, 1e8), "pressure per voltage")
    tau: float = par(0.08, "s", (1e-3, 10.0), "time constant")
    start: float = par(1e5, "Pa", (0.0, 1e8), "pressure at the start")
    pressure = state("Pa", "pressure at the outlet", "start")
    flow = signal("m^3/s", "flow through the outlet", "L/min")

    def equations(self, y, s):
        s.set(flow=1e-9 * s.opening * y.pressure)
        return {"pressure": (self.gain * s.command - y.pressure) / self.tau}


LAG = {"rig": Lag, "command": "1.5 V", "simulation": {"duration": "1 s", "sample_rate": "100 Hz"}}


def test_an_input_that_is_not_connected_has_the_configured_value(unit, tmp_path):
    u = Unit(tmp_path / "lag.fmu", build_config(LAG), ("command", "opening"))
    by_name = {v.name: v for v in u.description.modelVariables}
    starts = {n: float(by_name[n].start) for n in ("command", "command_rate", "opening", "opening_rate")}
    assert starts == {"command": 1.5, "command_rate": 0.0, "opening": 0.0, "opening_rate": 0.0}
    assert by_name["command"].description == "command of the valve" and by_name["opening_rate"].unit == "1/s"
    assert by_name["command_rate"].description.startswith("rate of command, with which it goes on within")
    got = fmpy.simulate_fmu(str(u.path), stop_time=1.0, output_interval=0.01, output=["pressure"])
    run = edhas.simulate(u.config.machine, u.config.simulation)
    assert difference({"pressure": got["pressure"]}, run.signals) < ROUNDING
    assert got["pressure"][-1] == pytest.approx(3.3e6, rel=1e-4)
    target = unit(SYSTEM, "target", "spool").description.modelVariables
    assert {v.name: float(v.start) for v in target if v.causality == "input"} == {"target": 15e-3, "spool_command": 0.0}
    step = {"kind": "step", "from": "2 V", "step_size": "1 V", "step_time": "20 ms"}
    volts = {**ACTUATOR, "controller": {"kind": "open_loop"}, "reference": step}
    (voltage,) = (v for v in unit(volts, "voltage").description.modelVariables if v.causality == "input")
    assert float(voltage.start) == 2.0


def derivative(u, instance, unknown, **direction):
    known = [u.number[n] for n in direction]
    return instance.getDirectionalDerivative([u.number[unknown]], known, list(direction.values()))[0]


def test_directional_derivatives_of_a_lag_are_exact(tmp_path, capfd):
    from fmpy.fmi1 import FMICallException

    u = Unit(tmp_path / "lag.fmu", build_config(LAG), ("command", "opening"))
    assert u.description.coSimulation.providesDirectionalDerivative
    instance = u.instance(opening=0.5)
    instance.doStep(0.0, 0.05)
    pressure, rate = instance.getReal([u.number["pressure"], u.number["der(pressure)"]])
    assert rate == pytest.approx((2.2e6 * 1.5 - pressure) / 0.08, rel=1e-12)
    for unknown, known, expected in (
        ("der(pressure)", "command", 2.2e6 / 0.08), ("der(pressure)", "pressure", -1.0 / 0.08),
        ("pressure", "command", 0.0), ("flow", "command", 0.0),
        ("flow", "opening", 1e-9 * pressure), ("flow", "pressure", 0.5e-9),
    ):  # fmt: skip
        assert derivative(u, instance, unknown, **{known: 2.0}) == pytest.approx(2.0 * expected, rel=1e-12), known
    both = derivative(u, instance, "flow", opening=1.0, pressure=3.0)
    assert both == pytest.approx(1e-9 * pressure + 1.5e-9, rel=1e-12)
    with pytest.raises(FMICallException):
        derivative(u, instance, "flow", tau=1.0)
    assert "derivatives are by inputs and states" in capfd.readouterr().out


def test_derivatives_by_parameters_in_initialization_go_through_the_initial_state(tmp_path):
    from fmpy.fmi2 import FMU2Slave

    u = Unit(tmp_path / "lag.fmu", build_config(LAG), ("command",))
    identifier = u.description.coSimulation.modelIdentifier
    instance = FMU2Slave(guid=u.description.guid, unzipDirectory=u.folder, modelIdentifier=identifier)
    instance.instantiate()
    instance.setupExperiment()
    instance.enterInitializationMode()
    assert derivative(u, instance, "pressure", start=1.0) == 1.0
    assert derivative(u, instance, "der(pressure)", start=1.0) == pytest.approx(-1.0 / 0.08, rel=1e-12)
    expected = -(2.2e6 * 1.5 - 1e5) / 0.08**2
    assert derivative(u, instance, "der(pressure)", tau=1.0) == pytest.approx(expected, rel=1e-12)


def test_directional_derivatives_of_the_pump_equal_differences(unit):
    """By inputs from two values of each; by the states along their motion, which moves the outputs in time."""
    u = unit(PUMP, "reference", "load_orifice_area")
    states = u.fmu.program.states
    shown = [*u.outputs, *(f"der({n})" for n in states)]
    instance = u.instance(reference=1e-3, reference_velocity=0.02, load_orifice_area=3e-6)
    instance.doStep(0.0, 5e-3)
    u.set_values(instance, reference_velocity=0.0)

    def read():
        return np.array(instance.getReal([u.number[n] for n in shown]))

    def along(**direction):
        unknown, known = [u.number[n] for n in shown], [u.number[n] for n in direction]
        return np.array(instance.getDirectionalDerivative(unknown, known, list(direction.values())))

    for name, value, change in (("reference", 1e-3, 1e-7), ("load_orifice_area", 3e-6, 1e-10)):
        ends = []
        for sign in (1.0, -1.0):
            u.set_values(instance, **{name: value + sign * change})
            ends.append(read())
        u.set_values(instance, **{name: value})
        found = along(**{name: 1.0})
        assert np.abs(found).max() > 0.0
        difference_quotient = (ends[0] - ends[1]) / (2.0 * change)
        np.testing.assert_allclose(found, difference_quotient, rtol=1e-5, atol=1e-6 * np.abs(found).max())
    rates = dict(zip(states, read()[len(u.outputs) :], strict=True))
    before, moved, span = read(), along(**rates), 1e-8
    instance.doStep(5e-3, span)
    n = len(u.outputs)
    expected = (read() - before)[:n] / span
    for name, got, wanted in zip(u.outputs, moved[:n], expected, strict=True):
        assert got == pytest.approx(wanted, rel=2e-3, abs=1e-6 * np.abs(expected).max()), name


OWN = '''
import jax.numpy as jnp
from edhas_jax import Effect, par

class Table(Effect):
    """A force by a table."""
    gain: float = par(1.0, "N", (0.0, 1e3), "size of the force")

    def mover_force(self, s, z):
        return self.gain * jnp.interp(s.piston_position, jnp.array([0.0, 1e-3]), jnp.array([0.0, 1.0]))

class Ramps(Effect):
    """The same as a sum of ramps, and a drag."""
    gain: float = par(20.0, "N", (0.0, 1e3), "size of the force")

    def mover_force(self, s, z):
        x = s.piston_position
        return self.gain * 1e3 * (jnp.maximum(x, 0.0) - jnp.maximum(x - 1e-3, 0.0))

    def mover_friction(self, s, z):
        return self.gain * jnp.arctan(s.piston_velocity / 0.1)
'''


def test_a_user_effect_is_exported_unless_it_has_no_counterpart_in_c(tmp_path):
    (tmp_path / "own.py").write_text(OWN)

    def config(effect):
        return build_config({**ACTUATOR, "effects": [f"own.py:{effect}"]}, (), tmp_path, [tmp_path / "own.py"])

    u = Unit(tmp_path / "own.fmu", config("Ramps"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EngineFallback)  # C has an arc tangent, the native engine has none
        run = edhas.simulate(u.config.machine, u.config.simulation)
    assert difference(u.run(u.instance(), SAMPLES), run.signals) < ROUNDING
    with pytest.raises(FmuError, match="the effect table cannot be written in C"):
        export_fmu(config("Table"), tmp_path / "table.fmu")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--input", "load_orifice"], "nearest: load_orifice_area"),
        (["--input", "target"], "pump_bench has no target; valid: reference, voltage"),
        (["--input", "oil_temperature"], "nothing in this machine depends on it"),
        (["--input", "voltage", "--input", "reference"], "give one of them"),
        (["--input", "piston_clearance", "--input", "piston_leakage.piston_clearance"], "given twice"),
        (["--out", "taken.fmu"], "exists already"),
        (["--out", "taken.fmu/unit.fmu"], "cannot be written"),
        (["--set", "step=1 ms"], "100 µs"),
        (["--compiler", "cc", "--compiler", "cc"], "two compilers are for"),
        (["--compiler", "false"], "the C compiler `false` failed"),
    ],
)
def test_bad_input_ends_with_one_sentence(tmp_path, monkeypatch, capsys, arguments, sentence):
    monkeypatch.chdir(tmp_path)
    Path("taken.fmu").write_text("precious")
    assert main(["export", str(CONFIGS / "paper.yaml"), *arguments]) == 2
    caught = capsys.readouterr()
    assert sentence in caught.err and len(caught.err.strip().splitlines()) == 1
    assert [p.name for p in tmp_path.iterdir()] == ["taken.fmu"] and Path("taken.fmu").read_text() == "precious"


def test_sources_only_and_a_missing_compiler(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("CC", "no-such-compiler")
    arguments = ["export", str(CONFIGS / "actuator.yaml"), "--out", str(tmp_path / "unit.fmu")]
    assert main(arguments) == 2
    assert "no C compiler `no-such-compiler`" in capsys.readouterr().err
    assert main([*arguments, "--sources-only", "--input", "mover_damping"]) == 0
    assert "no binary" in capsys.readouterr().out
    with zipfile.ZipFile(tmp_path / "unit.fmu") as archive:
        assert "sources/fmu_unit.c" in archive.namelist() and not [n for n in archive.namelist() if "binaries" in n]
