"""Balances of energy and oil close, and a machine at rest stays at rest."""

import dataclasses

import numpy as np
import pytest

from edhas_jax.machine.rigs import ActuatorSystem, PumpBench
from edhas_jax.simulation import energy_balance
from edhas_jax.simulation.metrics import metric_window
from edhas_jax.simulation.run import Simulation, simulate
from tests.support.reference import cases, changed, nominal, trajectory

CLOSED = 1e-6
PUMPS = [n for n in cases() if "outlet_flow" in trajectory(n)]


@pytest.mark.parametrize("name", cases())
def test_energy_and_oil_close(name, run):
    assert abs(run(name).energy_residual()) < CLOSED
    assert abs(run(name).volume_residual()) < CLOSED


@pytest.mark.parametrize("name", ["actuator_stops", "pump_10hz_relief", "system_step_loaded"])
def test_without_a_row_the_energy_does_not_close(name, run):
    """Without any row of at least a thousandth of the input the balance does not close."""
    full = run(name)
    scale = abs(full.energy["electrical input"][-1])
    rows_tested = 0
    for row, energy in full.energy.items():
        if abs(energy[-1]) < 1e-3 * scale:
            continue
        reduced = dataclasses.replace(full, energy={n: v for n, v in full.energy.items() if n != row})
        assert abs(reduced.energy_residual()) > 100.0 * CLOSED, row
        rows_tested += 1
    assert rows_tested >= 4


def oil_in(volume: dict, node: str) -> str:
    """The row of the oil stored in a node."""
    return next(n for n in volume if n.startswith("oil") and node in n)


@pytest.mark.parametrize("node", ["outlet", "head", "accumulator gas"])
def test_without_a_row_the_oil_does_not_close(node, run):
    full = run("system_step_loaded")
    row = node if node in full.volume else oil_in(full.volume, node)
    volume = {n: np.zeros_like(v) if n == row else v for n, v in full.volume.items()}
    assert abs(dataclasses.replace(full, volume=volume).volume_residual()) > 10.0 * CLOSED


@pytest.mark.parametrize("name", PUMPS)
def test_the_outlet_node_closes_at_every_sample(name, run):
    """Independently of the reported residual: delivered = flow to load and relief valve + stored."""
    volume = run(name).volume
    delivered = volume["delivery_flow_a"] + volume["delivery_flow_b"]
    outflow = volume["outlet_flow"] + volume["relief_flow"] + volume[oil_in(volume, "outlet")]
    assert np.abs(delivered - outflow).max() < CLOSED * np.abs(delivered).max()


@pytest.mark.parametrize("name", ["pump_10hz", "pump_20hz_no_leakage", "system_step"])
def test_cumulated_flow_agrees_with_sampled_flow(name, run):
    finished = run(name)
    flow, t = finished.signals["outlet_flow"], finished.signals["time"]
    sampled = np.sum(0.5 * np.diff(t) * (flow[1:] + flow[:-1]))
    np.testing.assert_allclose(finished.volume["outlet_flow"][-1], sampled, rtol=2e-3)


@pytest.mark.parametrize("name", ["actuator_10hz", "pump_10hz", "system_step"])
def test_losses_only_take_energy(name, run):
    finished = run(name)
    groups = energy_balance.row_groups(finished.machine)
    lossy = [n for n in finished.energy if groups[n] == "copper" or n.endswith("damping") or n.endswith("_friction")]
    lossy += [n for n in finished.energy if groups[n] == "fluid" and not n.startswith("leakage")]
    assert len(lossy) >= 2
    for row in lossy:
        # bristles return their stored energy, which is at most F_S²/(2 σ0)
        tolerance = 0.5 * 6.0**2 / 1e5 if row == "lugre_friction" else 1e-6 * finished.energy["electrical input"][-1]
        assert np.diff(finished.energy[row]).min() > -tolerance, row
        assert finished.energy[row][-1] >= 0.0, row


@pytest.mark.parametrize("rig", [PumpBench, ActuatorSystem])
def test_rest_stays_at_rest(rig):
    """Without a set point the preloaded valves settle into their seats, and nothing else moves."""
    machine = changed(nominal(rig), "amplitude", 0.0)
    if rig is ActuatorSystem:
        machine = changed(machine, "step_size", 0.0)
    finished = simulate(machine, Simulation(duration=0.3))
    s = finished.signals
    for flow in ("outlet_flow", "suction_flow_a", "delivery_flow_b", "leakage_a", "relief_flow"):
        assert np.abs(s[flow]).max() < 1e-9, flow  # a hundred-thousandth of what the pump delivers
    for pressure in ("chamber_pressure_a", "chamber_pressure_b", "outlet_pressure", "accumulator_pressure"):
        settled = s[pressure][s["time"] > 0.1]
        assert np.ptp(settled) < 20.0 and abs(settled.mean() - 0.2e6) < 500.0, pressure
    assert np.abs(s["piston_position"]).max() < 1e-9
    for side in ("a", "b"):
        for kind in ("suction", "delivery"):
            assert -1e-5 < s[f"{kind}_lift_{side}"][-1] < 0.0
    if rig is ActuatorSystem:
        assert np.abs(s["cylinder_position"]).max() == 0.0


def test_both_sides_of_the_pump_are_symmetric(run):
    """Side B repeats side A half a cycle later."""
    finished = run("pump_10hz")
    t = finished.signals["time"]
    first, last = metric_window(finished.machine, t[-1])
    half = round(0.5 / 10.0 / (t[1] - t[0]))
    inside = np.flatnonzero((t >= last - 0.1 - 1e-9) & (t < last - 1e-9))
    for a, b in (("chamber_pressure_a", "chamber_pressure_b"), ("suction_lift_a", "suction_lift_b")):
        one, other = finished.signals[a], finished.signals[b]
        np.testing.assert_allclose(one[inside].mean(), other[inside].mean(), rtol=2e-3)
        shifted = other[inside - half]
        assert np.sqrt(np.mean((one[inside] - shifted) ** 2)) < 0.02 * np.ptp(one)
    assert first < last
