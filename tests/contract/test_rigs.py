"""The contract that every rig must satisfy, on the example of the guide, on the tanks, and on rigs that break it."""

import re

import jax
import jax.numpy as jnp
import pytest

from edhas_jax import Body, GasNode, Oil, OilNode, Reservoir, Rig, change, drive, par, simulate, state
from edhas_jax.machine.components.accumulator import Accumulator
from edhas_jax.machine.effects import ParasiticSpring
from edhas_jax.machine.interface.slots import MOVER_FORCE
from edhas_jax.machine.own_rig import check_rig
from edhas_jax.machine.rigs import ActuatorBench
from edhas_jax.simulation.rig_contract import check_contract
from edhas_jax.simulation.run_settings import Simulation
from studies.tanks.rig import TwoTanks
from tests.support import ROOT

PAGE = (ROOT / "docs" / "own_machine.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
GUIDE: dict = {"__name__": "guide"}
exec(compile(BLOCKS[0], "docs/own_machine.md", "exec"), GUIDE)
PowerPack = GUIDE["PowerPack"]


@pytest.mark.parametrize("rig", [PowerPack, TwoTanks, ActuatorBench], ids=lambda rig: rig.name)
def test_a_rig_satisfies_the_contract(rig):
    findings = check_contract(rig())
    assert [f.sentence for f in findings if not f.passed] == []
    assert {"run", "step", "batch", "derivatives"} <= {f.check for f in findings}


def test_the_example_of_the_guide_is_short_and_its_code_runs():
    body = BLOCKS[0].partition("class PowerPack")[2].splitlines()
    assert len([line for line in body if line.strip()]) <= 60
    check_rig(PowerPack)
    space = dict(GUIDE)
    for block in BLOCKS[1:]:
        exec(compile(block, "docs/own_machine.md", "exec"), space)
    assert space["table"].mean_load_flow.values.min() > 0.0
    assert space["sized"].machines[0].violation <= 1e-4
    friction = simulate(PowerPack(effects=(space["DryFriction"](),)))
    assert friction.metrics["final_speed"].value < space["run"].metrics["final_speed"].value


def test_energy_closes_and_pressure_holds_the_load():
    """At rest the torque of the motor holds the pressure: T = D Δp + drag · speed."""
    run = simulate(PowerPack(), Simulation(duration=20.0, sample_rate=50.0))
    assert abs(run.energy_residual()) < 1e-9
    s = {n: v[-1] for n, v in run.signals.items()}
    torque = 1e-6 * (s["line_pressure"] - 1e5) + 5e-3 * s["speed"]
    assert torque == pytest.approx(6.0, rel=2e-3)


class Pot(Rig):
    """A closed volume that a fixed flow fills, beside an accumulator: everything is known in closed form."""

    time_step, duration = 1e-3, 0.2
    inflow = drive("m^3/s", "flow into the pot", 1e-6)
    oil: Oil = Oil()
    accumulator: Accumulator = Accumulator()
    mass: float = par(2.0, "kg", (0.1, 10.0), "mass of the body")
    pressure = state("Pa", "pressure of the pot", 2e5)
    gas_change = state("m^3", "change of the gas volume")
    speed = state("m/s", "speed of the body", 1.0)

    def equations(self, y, s):
        pot = OilNode(s, "pressure", self.oil, 1e-4)
        gas = GasNode(s, "gas_pressure", "gas_change", self.accumulator)
        tank = Reservoir(s, "tank_pressure", 1e5 + 0.0 * y.speed)
        body = Body(s, "speed", self.mass)
        pot.add(s.inflow)
        tank.flow_to(gas, s.inflow, "")
        body.add(-3.0 * y.speed, "damping")
        return pot.rates() | gas.rates() | body.rates() | tank.rates()


def test_nodes_sum_what_connects_to_them():
    run = simulate(Pot())
    end = {n: v[-1] for n, v in run.signals.items()}
    assert end["pressure"] == pytest.approx(2e5 + 1.4e9 / 1e-4 * 1e-6 * 0.2, rel=1e-9)
    assert end["gas_change"] == pytest.approx(-1e-6 * 0.2, rel=1e-9)
    assert end["speed"] == pytest.approx(float(jnp.exp(-3.0 / 2.0 * 0.2)), rel=1e-6)


class FrozenGain(Rig):
    """A rig whose derivative by its gain is hidden from JAX."""

    time_step, duration = 0.01, 1.0
    gain: float = par(2.0, "1/s", (0.1, 10.0), "gain")
    x = state("m", "position", 1.0)

    def equations(self, y, s):
        return {"x": -jax.lax.stop_gradient(self.gain) * y.x}


class Explosion(Rig):
    """A rig whose state grows beyond all numbers."""

    time_step, duration = 0.01, 10.0
    x = state("m", "position", 1.0)
    rate: float = par(1.0, "1/(m*s)", (0.1, 10.0), "rate")

    def equations(self, y, s):
        return {"x": self.rate * jnp.square(y.x)}


def test_the_contract_finds_a_wrong_derivative_and_a_run_that_fails():
    failed = {f.check for f in check_contract(FrozenGain()) if not f.passed}
    assert failed == {"derivatives"}
    findings = check_contract(Explosion())
    assert not findings[-1].passed and findings[-1].check == "run"


class Sled(Rig):
    """A sled at the library's slot for forces on a mover."""

    time_step, duration = 1e-3, 0.5
    slots = (MOVER_FORCE,)
    mass: float = par(1.0, "kg", (0.1, 10.0), "mass")
    piston_position = state("m", "position", 1e-3)
    piston_velocity = state("m/s", "speed")

    def equations(self, y, s):
        return {"piston_position": y.piston_velocity, "piston_velocity": MOVER_FORCE.apply(0.0, s) / self.mass}


def test_effects_of_the_library_mount_where_their_slot_is():
    check_rig(Sled)
    stiffness = 100.0
    machine = change(Sled(effects=(ParasiticSpring(),)), spring_rate=stiffness)
    run = simulate(machine, Simulation(sample_rate=1000.0, step=1e-3))
    expected = 1e-3 * jnp.cos(jnp.sqrt(stiffness) * run.signals["time"])
    assert float(jnp.abs(run.signals["piston_position"] - expected).max()) < 1e-7
    found = {f.check: f.sentence for f in check_contract(Sled())}
    assert "parasitic_spring" in found["library"]


class Clipped(Rig):
    """A lag whose valve stands at a limit of `clip`, a kink of the equations."""

    time_step, duration = 1e-2, 2.0
    opening = drive("-", "opening of the valve", 1.0)
    level = state("m", "level", 1.0)

    def equations(self, y, s):
        return {"level": -y.level * jnp.clip(s.opening, 0.0, 1.0)}


class FirstOrder(Rig):
    """The same with a derivative that is hidden from the step, which is then Euler's."""

    time_step, duration = 1e-2, 2.0
    level = state("m", "level", 1.0)
    rate: float = par(1.0, "1/s", (0.0, 10.0), "rate")

    def equations(self, y, s):
        return {"level": -self.rate * jax.lax.stop_gradient(y.level)}


class Still(Rig):
    """A lag at rest."""

    opening = drive("V", "input", 0.0)
    level = state("V", "level", 0.0)

    def equations(self, y, s):
        return {"level": s.opening - y.level}


def test_a_number_at_a_kink_is_compared_on_both_sides():
    found = {f.check: f for f in check_contract(Clipped())}
    assert found["derivatives"].passed and "both sides of a kink in the equations: step_size" in str(found)
    assert found["step"].passed and "order 2.00 from" in found["step"].sentence


@pytest.mark.parametrize("breaks", [FirstOrder, Pot], ids=lambda rig: rig.name)
def test_the_order_of_the_step_is_a_check_that_can_fail(breaks):
    (found,) = (f for f in check_contract(breaks()) if f.check == "step")
    assert found.passed is (breaks is Pot)
    assert breaks is Pot or "order 1.00 from" in found.sentence


def test_where_nothing_moves_there_is_no_order():
    found = {f.check: f.sentence for f in check_contract(Still())}
    assert "nothing moves" in found["step"] and "could not be checked" in found["step"]
