"""The batch engine against the independent solver, against single runs, and against its own neighbours."""

import os
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

import edhas_jax as edhas
from edhas_jax.design.batch.batch import BatchError, BatchSettings, Status, plan_chunks, run_designs
from edhas_jax.machine.effects import EntrainedAir, LugreFriction, PistonLeakage
from edhas_jax.machine.metrics import METRICS
from edhas_jax.simulation.run_settings import Precision
from edhas_jax.simulation.validity import REASONS
from tests.support.reference import DATA

PUMP = edhas.PumpBench(effects=(LugreFriction(), PistonLeakage(), EntrainedAir()))
QUICK = BatchSettings(step=50e-6)
pytestmark = pytest.mark.usefixtures("engine")  # every test runs on every loop engine that is there


@pytest.fixture(scope="module")
def designs():
    table = pd.read_csv(DATA / "designs.csv")
    table.columns = [c.split(" [")[0] for c in table.columns]
    return table


def columns(table, rows=slice(None)):
    return {n: table[n].to_numpy()[rows] for n in table.columns[:8]}


@pytest.mark.parametrize("precision", list(Precision))
def test_designs_of_the_independent_solver(designs, precision, engine):
    """All forty on the native engine, every fifth on the others, which take longer."""
    designs = designs[:: 1 if engine == "native" else 5]
    got = run_designs(PUMP, columns(designs), BatchSettings(precision=precision))
    assert (got["status"] == Status.OK).all()
    np.testing.assert_allclose(got["mean_flow"], designs.mean_flow, rtol=2e-3)
    np.testing.assert_allclose(got["mean_electrical_power"], designs.mean_electrical_power, rtol=5e-3)
    np.testing.assert_allclose(got["peak_outlet_pressure"], designs.peak_outlet_pressure, rtol=5e-3)
    np.testing.assert_allclose(got["peak_current"], designs.peak_current, rtol=1e-2)


def test_metrics_are_those_of_a_single_run():
    frequency = np.array([20.0, 40.0])
    got = run_designs(PUMP, {"frequency": frequency}, BatchSettings(tolerance=1e-5))
    for k, f in enumerate(frequency):
        run = edhas.simulate(edhas.change(PUMP, frequency=f), edhas.Simulation(duration=0.4, sample_rate=20e3))
        last = {n: m.value for n, m in run.metrics.items()}
        for name in METRICS:
            if name in got:
                scale = abs(last[name]) if name != "mean_leakage" else last["peak_leakage"]
                assert got[name][k] == pytest.approx(last[name], abs=5e-3 * scale), name
    assert {n for n in got if n not in ("status", "cycles", "residual")} == set(last)


def test_a_design_does_not_depend_on_its_neighbours(designs):
    whole = run_designs(PUMP, columns(designs), QUICK)
    order = np.random.default_rng(0).permutation(len(designs))[:17]
    some = run_designs(PUMP, columns(designs, order), QUICK)
    for name in whole:
        np.testing.assert_array_equal(some[name], whole[name][order], err_msg=name)


def test_failures_are_named_and_harm_nobody(designs):
    table = columns(designs, slice(0, 8)) | {"supply_voltage": np.full(8, 48.0), "coil_inductance": np.full(8, 1.1e-3)}
    sound = run_designs(PUMP, table, QUICK)
    table = {n: v.copy() for n, v in table.items()}
    table["amplitude"][1] = 6e-3  # beyond the stops
    table["supply_voltage"][3] = 0.5  # cannot move
    table["oil_density" if "oil_density" in table else "valve_mass"][5] = np.nan
    spoilt = run_designs(PUMP, table, QUICK)
    assert [Status(int(s)) for s in spoilt["status"][[1, 3, 5]]] == [
        Status.HIT_STOPS, Status.STALLED, Status.NOT_FINITE
    ]  # fmt: skip
    others = [0, 2, 4, 6, 7]
    for name in sound:
        np.testing.assert_array_equal(spoilt[name][others], sound[name][others], err_msg=name)
    assert set(REASONS) == set(Status)


def test_a_design_that_is_not_periodic_in_time_says_so(designs):
    got = run_designs(PUMP, columns(designs, slice(0, 4)), BatchSettings(step=50e-6, max_cycles=2, tolerance=1e-12))
    assert (got["status"] == Status.NOT_PERIODIC).all() and (got["cycles"] == 2).all()


def test_a_design_that_depends_on_the_step_says_so():
    """Found among a thousand random ones: periodic after 16 cycles, with 2 % more flow than at a tenth of the step."""
    sensitive = {
        "frequency": 56.25, "amplitude": 1.68e-3, "piston_diameter": 9.181e-3, "valve_mass": 1.599e-3,
        "valve_spring_rate": 166.0, "load_orifice_area": 6.944e-7, "air_fraction": 0.01632,
        "accumulator_pressure": 1.168e5, "piston_clearance": 6.699e-6,
    }  # fmt: skip
    sound = {n: float(edhas.get(PUMP, n)) for n in sensitive} | {"frequency": 56.25}
    table = {n: np.array([sound[n], sensitive[n]]) for n in sensitive}
    coarse, fine = (
        run_designs(PUMP, table, BatchSettings(step=step, soft_start=False, max_cycles=40)) for step in (20e-6, 5e-6)
    )
    assert list(coarse["status"]) == [Status.OK, Status.STEP_TOO_LARGE] and (fine["status"] == Status.OK).all()
    error = np.abs(coarse["mean_flow"] / fine["mean_flow"] - 1.0)
    assert error[0] < 2e-3 and error[1] > 0.01


def test_the_actuator_alone():
    machine = edhas.ActuatorBench(effects=(LugreFriction(),))
    got = run_designs(machine, {"coulomb_friction": np.array([2.0, 4.0, 8.0])}, QUICK)
    assert (np.diff(got["rms_current"]) > 0).all() and "mean_flow" not in got


def test_chunks_cover_the_table_once_and_share_their_steps():
    frequency = np.linspace(5.0, 60.0, 3000)
    chunks = plan_chunks(PUMP, {"frequency": frequency}, BatchSettings())
    np.testing.assert_array_equal(np.sort(np.concatenate([c.rows for c in chunks])), np.arange(3000))
    for chunk in chunks:
        assert (1.0 / (frequency[chunk.rows] * chunk.steps_per_cycle)).max() <= 20e-6 * (1 + 1e-9)
        assert chunk.steps_per_cycle * frequency[chunk.rows].min() * 20e-6 < 2.1


def test_what_cannot_be_a_batch_is_refused():
    with pytest.raises(BatchError, match="driven by a sine"):
        plan_chunks(edhas.ActuatorSystem(), {"frequency": np.ones(3)}, BatchSettings())


def test_the_number_of_cores_changes_no_bit():
    program = (
        "import hashlib, numpy as np, edhas_jax as edhas\n"
        "from edhas_jax.design.batch.batch import BatchSettings, run_designs\n"
        "masses = {'mover_mass': np.linspace(0.1, 0.2, 200)}\n"
        "got = run_designs(edhas.ActuatorBench(), masses, BatchSettings(step=1e-4))\n"
        "print(hashlib.sha1(b''.join(got[n].tobytes() for n in sorted(got))).hexdigest())\n"
    )
    digests = set()
    for cores in "13":
        environment = os.environ | {"EDHAS_CORES": cores}
        done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        digests.add(done.stdout)
    assert len(digests) == 1


def test_another_number_of_designs_compiles_nothing(compilations):
    """There is one loop for few designs and one for many."""
    run_designs(PUMP, {"valve_mass": np.linspace(2e-3, 6e-3, 300)}, QUICK)
    before = compilations()
    for count in (3, 40, 500):
        run_designs(PUMP, {"valve_mass": np.linspace(2e-3, 6e-3, count)}, QUICK)
    assert compilations() == before
    run_designs(edhas.ActuatorBench(), {"coil_inductance": np.linspace(4e-3, 5e-3, 3)}, QUICK)
    assert compilations() > before


def test_engines_agree(monkeypatch):
    table = {"valve_mass": np.linspace(2e-3, 6e-3, 5), "frequency": np.linspace(20.0, 30.0, 5)}
    here = run_designs(PUMP, table, QUICK)
    monkeypatch.setenv("EDHAS_ENGINE", "xla")
    xla = run_designs(PUMP, table, QUICK)
    for name in here:
        np.testing.assert_allclose(here[name], xla[name], rtol=1e-6, err_msg=name)
    np.testing.assert_array_equal(here["cycles"], xla["cycles"])
