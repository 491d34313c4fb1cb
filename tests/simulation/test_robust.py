"""Robustness: abrupt starts, cavitation, and runs that fail."""

import jax.numpy as jnp
import numpy as np
import pytest

from edhas_jax.core import structs
from edhas_jax.core.structs import par
from edhas_jax.machine.effects import Effect, EntrainedAir
from edhas_jax.machine.equations.orifice_flow import orifice_slopes
from edhas_jax.machine.interface.signals import OrificeConnection
from edhas_jax.machine.rigs import ActuatorBench, ActuatorSystem, PumpBench
from edhas_jax.simulation.metrics import mean_rate
from edhas_jax.simulation.run import SimulationError, simulate
from edhas_jax.simulation.run_settings import Precision, Simulation
from tests.support.reference import changed, nominal


def last_mean_flow(frequency: float, step: float) -> float:
    machine = changed(changed(nominal(PumpBench), "frequency", frequency), "ramp_time", 0.0)
    run = simulate(machine, Simulation(duration=12.0 / frequency, step=step))
    t = run.signals["time"]
    return mean_rate(t, run.volume["outlet_flow"], t[-1] - 4.0 / frequency, t[-1], run.signals["outlet_flow"])


@pytest.mark.parametrize("step", [20e-6, 40e-6])
@pytest.mark.parametrize("frequency", [30.0, 40.0])
def test_an_abrupt_start_at_full_amplitude_reaches_the_same_flow(frequency, step):
    fine = last_mean_flow(frequency, 2e-6)
    assert fine > 1e-5
    assert last_mean_flow(frequency, step) == pytest.approx(fine, rel=5e-3)


AREA, CAPACITY = 1e-5, 1e-14  # m², m³/Pa


def slope_and_rate(drop, step, downstream=0.0):
    """∂Q/∂Δp of an orifice in one step [s] where a small volume drains through it, and the rate of its pressure.

    The pressure behind the orifice has the rate `downstream`, over that of the volume.
    """
    m = PumpBench()
    rate = -m.orifice.flow(AREA, drop, m.oil.oil_density) / CAPACITY
    orifice = {"load": OrificeConnection(drop, AREA, ("before", "behind"))}
    slopes = orifice_slopes(m, orifice, {"before": rate, "behind": downstream * rate}, step)
    return float(slopes["load"][1]), float(rate)


@pytest.mark.parametrize("drop", [3e6, -3e6])
def test_a_volume_that_drains_within_one_step_does_not_overshoot(drop):
    """(2/h + ∂Q/∂Δp / C) k = 2 dp/dt: no step of any length ends on the other side, an endless one at equilibrium."""
    scale = abs(drop / slope_and_rate(drop, 1e-9)[1])  # s, in which the pressure falls to zero at its first rate
    ends = []
    for step in scale * np.geomspace(1e-3, 1e6, 60):
        slope, rate = slope_and_rate(drop, step)
        ends.append(1.0 + 2.0 * rate / (2.0 / step + slope / CAPACITY) / drop)
    assert min(ends) >= 0.0 and max(ends) < 1.0 and ends[-1] < 1e-5


@pytest.mark.parametrize(("share", "downstream"), [(0.01, 0.0), (0.95, 0.0), (100.0, 1.0)])
def test_an_orifice_is_linearised_by_its_tangent_where_a_step_resolves_it(share, downstream):
    """Within a step the pressure drop changes by a share of itself, or not at all, as both pressures change equally."""
    drop, m = 3e6, PumpBench()
    step = share * abs(drop / slope_and_rate(drop, 1e-9)[1])
    higher, lower = (float(m.orifice.flow(AREA, p, m.oil.oil_density)) for p in (1.001 * drop, 0.999 * drop))
    assert slope_and_rate(drop, step, downstream)[0] == pytest.approx((higher - lower) / (0.002 * drop), rel=1e-5)


@pytest.mark.parametrize("precision", Precision)
@pytest.mark.parametrize(
    ("pressure", "frequency", "air"),
    [
        (20e3, 30.0, 0.005),
        (5e3, 40.0, 0.005),
        (0.2e6, 60.0, 0.005),
        (20e3, 40.0, 0.001),
        (20e3, 40.0, 1e-5),
    ],
)
def test_a_cavitating_pump_stays_finite_and_above_vacuum(pressure, frequency, air, precision):
    machine = nominal(PumpBench)
    for name, value in (("accumulator_pressure", pressure), ("frequency", frequency), ("air_fraction", air)):
        machine = changed(machine, name, value)
    run = simulate(machine, Simulation(duration=0.3, precision=precision))
    lowest = min(run.signals[f"chamber_pressure_{side}"].min() for side in "ab")
    assert 0.0 < lowest < 0.5 * pressure
    assert all(np.isfinite(v).all() for v in run.signals.values())


def test_the_flow_of_a_cavitating_pump_does_not_depend_on_the_step():
    machine = changed(changed(nominal(PumpBench), "accumulator_pressure", 20e3), "frequency", 30.0)
    flows = [
        simulate(machine, Simulation(duration=0.3, step=step)).metrics["mean_flow"].value for step in (20e-6, 5e-6)
    ]
    assert flows[0] == pytest.approx(flows[1], rel=5e-3)


class SuddenForce(Effect):
    """A force that sets in at a given time."""

    onset_time: float = par(0.05, "s", (0.0, 1.0), "time at which it sets in")
    sudden_force: float = par(1e6, "N", (0.0, 1e9), "its size")

    def mover_force(self, s, z):
        return jnp.where(s.time > self.onset_time, self.sudden_force, 0.0)


@pytest.mark.parametrize(
    ("force", "words"),
    [(1e6, ("piston_position", "left its physical range")), (np.nan, ("is not a finite number",))],
)
def test_a_failed_run_names_time_and_signal_and_keeps_earlier_samples(force, words):
    machine = structs.replace(ActuatorBench(), effects=(SuddenForce(sudden_force=force),))
    with pytest.raises(SimulationError) as caught:
        simulate(machine, Simulation(duration=0.2))
    message, run = str(caught.value), caught.value.run
    for word in (*words, "at 0.05", "the step is not the cause: with 5 µs it does so at 0.05"):
        assert word in message
    failure_time = float(message.split("at ")[1].split(" s ")[0])
    time = run.signals["time"]
    assert 0.05 <= failure_time < 0.06
    assert time[-1] < failure_time <= time[-1] + 2e-4 + 1e-9
    assert all(len(v) == len(time) and np.isfinite(v).all() for v in run.signals.values())
    assert all(len(v) == len(time) and np.isfinite(v).all() for v in (*run.energy.values(), *run.volume.values()))
    assert np.abs(run.signals["piston_position"]).max() <= 6e-3


def test_samples_before_a_failure_equal_those_of_a_shorter_run():
    broken = structs.replace(ActuatorBench(), effects=(SuddenForce(),))
    with pytest.raises(SimulationError) as caught:
        simulate(broken, Simulation(duration=0.2))
    early = simulate(broken, Simulation(duration=0.04))
    for name, values in early.signals.items():
        np.testing.assert_array_equal(caught.value.run.signals[name][: len(values)], values)


@pytest.mark.parametrize("step", [0.0, -1e-6, 2e-4, float("nan")])
def test_an_invalid_step_is_refused(step):
    with pytest.raises(ValueError, match="must lie above 0"):
        simulate(ActuatorBench(), Simulation(step=step))


def test_a_pressure_that_falls_to_zero_is_named_with_what_helps():
    """Oil without gas has no law below zero pressure: no step helps, the effect that describes the gas does."""
    with pytest.raises(SimulationError) as caught:
        simulate(ActuatorSystem(), Simulation(duration=0.01))
    message = str(caught.value)
    assert "chamber_pressure_b falls to zero (step 20 µs); oil cavitates there" in message
    assert "mount the effect entrained_air; the step is not the cause: with 5 µs" in message
    assert simulate(ActuatorSystem(effects=(EntrainedAir(),)), Simulation(duration=0.01)).status.is_valid
