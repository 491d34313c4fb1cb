"""The three rigs: which parts are mounted, and the one page of equations that joins them.

A rig is a pytree of parameters. `evaluate(y, t, h, known)` writes down every signal of one instant and the rate of
every state; `y` maps state names to scalars in SI, `h` is the step that is being taken and `known` the state at its
start (only Karnopp's standstill asks for them). Batching and differentiation are transformations of this function.
"""

import dataclasses
from typing import Any, ClassVar

import jax.numpy as jnp

from edhas_jax import slots, tree
from edhas_jax.components.accumulator import Accumulator
from edhas_jax.components.check_valve import CheckValve
from edhas_jax.components.coil import Coil, CurrentAmplifier, VoltageAmplifier
from edhas_jax.components.controller import (
    CascadeController,
    Coordination,
    OpenLoop,
    PositionController,
    Supply,
    limited,
)
from edhas_jax.components.cylinder import Cylinder, ReversingValve
from edhas_jax.components.mover import EndStops, Mover
from edhas_jax.components.orifice import Orifice
from edhas_jax.components.outlet import LoadOrifice, Outlet
from edhas_jax.components.pump import Pump
from edhas_jax.components.reference import Chirp, Recorded, Sine, Step
from edhas_jax.effects import Effect
from edhas_jax.effects.base import effect_rates, initial_states, own_states
from edhas_jax.oil import Oil
from edhas_jax.signals import Node, Signals
from edhas_jax.slots import enter
from edhas_jax.tree import struct

State = dict[str, Any]
HIGHEST_PRESSURE = 1e9  # beyond it no term of this model means anything
Amplifier = VoltageAmplifier | CurrentAmplifier
Controller = PositionController | CascadeController | OpenLoop
Input = Sine | Step | Chirp | Recorded


@struct
class ActuatorBench:
    """The linear actuator alone: coil, mover, end stops, controller."""

    name: ClassVar[str] = "actuator_bench"
    slots: ClassVar[tuple] = slots.ACTUATOR_SLOTS

    reference: Input = Sine()
    supply: Supply = Supply()
    controller: Controller = PositionController()
    amplifier: Amplifier = VoltageAmplifier()
    coil: Coil = Coil()
    mover: Mover = Mover()
    stops: EndStops = EndStops()
    effects: tuple[Effect, ...] = ()

    def start(self) -> State:
        """The state at rest."""
        return _start_drive(self)

    def evaluate(self, y: State, t, h, known: State) -> tuple[Signals, State]:
        """Every signal at time t and the rate of every state."""
        s = _signals(self, y, t, h)
        s.set(**_set_point(self.reference, t, 1.0))
        _drive(self, y, s)
        rates = _move(self, s, self.mover.mover_mass, self.mover.mover_damping, 0.0)
        return s, rates | effect_rates(s)


@struct
class PumpBench:
    """Actuator, pump, check valves, outlet volume, load orifice and accumulator."""

    name: ClassVar[str] = "pump_bench"
    slots: ClassVar[tuple] = slots.PUMP_SLOTS

    reference: Input = Sine()
    supply: Supply = Supply()
    controller: Controller = PositionController()
    amplifier: Amplifier = VoltageAmplifier()
    coil: Coil = Coil()
    mover: Mover = Mover()
    stops: EndStops = EndStops()
    oil: Oil = Oil()
    orifice: Orifice = Orifice()
    pump: Pump = Pump()
    valve: CheckValve = CheckValve()
    outlet: Outlet = Outlet()
    load: LoadOrifice = LoadOrifice()
    accumulator: Accumulator = Accumulator()
    effects: tuple[Effect, ...] = ()

    def start(self) -> State:
        """The state at rest, every pressure at that of the accumulator."""
        return _start_drive(self) | _start_pump(self)

    def evaluate(self, y: State, t, h, known: State) -> tuple[Signals, State]:
        """Every signal at time t and the rate of every state."""
        s = _signals(self, y, t, h)
        s.set(**_set_point(self.reference, t, 1.0))
        _drive(self, y, s)
        rates = _pump(self, y, s)
        drop = s.outlet_pressure - s.accumulator_pressure
        flow = self.orifice.flow(self.load.load_orifice_area, drop, self.oil.oil_density)
        s.set(outlet_flow=flow, return_flow=flow)
        s.bond("load orifice", "delivered", drop, flow)
        rates |= _outlet(self, s)
        return s, rates | effect_rates(s)


@struct
class ActuatorSystem:
    """The whole actuator: the pump feeds a cylinder through a reversing valve; `target` is where the cylinder goes."""

    name: ClassVar[str] = "actuator_system"
    slots: ClassVar[tuple] = slots.SYSTEM_SLOTS

    target: Input = Step(step_size=15e-3)
    reference: Input = Sine(ramp_time=0.0)
    supply: Supply = Supply()
    controller: Controller = PositionController()
    coordination: Coordination = Coordination()
    amplifier: Amplifier = VoltageAmplifier()
    coil: Coil = Coil()
    mover: Mover = Mover()
    stops: EndStops = EndStops()
    oil: Oil = Oil()
    orifice: Orifice = Orifice()
    pump: Pump = Pump()
    valve: CheckValve = CheckValve()
    outlet: Outlet = Outlet()
    accumulator: Accumulator = Accumulator()
    reversing_valve: ReversingValve = ReversingValve()
    cylinder: Cylinder = Cylinder()
    effects: tuple[Effect, ...] = ()

    def start(self) -> State:
        """The state at rest, every pressure at that of the accumulator, the cylinder at 0."""
        y = _start_drive(self) | _start_pump(self)
        rest = y["outlet_coordinate"]
        return y | {
            "spool": 0.0, "head_coordinate": rest, "rod_coordinate": rest,
            "cylinder_position": 0.0, "cylinder_velocity": 0.0,
        }  # fmt: skip

    def evaluate(self, y: State, t, h, known: State) -> tuple[Signals, State]:
        """Every signal at time t and the rate of every state."""
        s = _signals(self, y, t, h)
        target, _ = self.target.at(t)
        s.set(target=target, cylinder_position=y["cylinder_position"], cylinder_velocity=y["cylinder_velocity"])
        error = target - s.cylinder_position
        s.set(**_set_point(self.reference, t, self.coordination.pump_share(error)))
        _drive(self, y, s)
        rates = _pump(self, y, s)
        rates |= _cylinder(self, y, s, known)
        rates["spool"] = (
            self.coordination.spool_command(error) - s.spool
        ) / self.reversing_valve.reversing_valve_time
        rates |= _outlet(self, s)
        return s, rates | effect_rates(s)


Rig = ActuatorBench | PumpBench | ActuatorSystem
RIGS: dict[str, type[Rig]] = {rig.name: rig for rig in (ActuatorBench, PumpBench, ActuatorSystem)}


def parts(machine: Rig) -> dict[str, Any]:
    """The structs of a machine that hold parameters, effects last, by field name or effect id."""
    named = {f.name: getattr(machine, f.name) for f in dataclasses.fields(machine) if f.name != "effects"}
    return named | {e.id: e for e in machine.effects}


def _signals(m: Rig, y: State, t, h) -> Signals:
    """The parameters of the machine and its parts as the first signals; an effect's own stay its own."""
    known = {
        p.name: getattr(part, p.name)
        for part in parts(m).values()
        if not isinstance(part, Effect)
        for p in tree.parameters(type(part))
    }
    return Signals(known | {"time": t, "time_step": h}, own_states(m.effects, y))


def _set_point(reference: Input, t, share) -> dict:
    value, rate = reference.at(t)
    return {"reference": share * value, "reference_velocity": share * rate}


def _start_drive(m) -> State:
    y = m.amplifier.initial() | m.controller.initial() | initial_states(m.effects)
    return y | {"piston_position": 0.0, "piston_velocity": 0.0}


def _start_pump(m) -> State:
    s = _signals(m, initial_states(m.effects), 0.0, 0.0)
    rest = m.oil.coordinate(m.accumulator.accumulator_pressure, s)
    y = {f"{node}_coordinate": rest for node in ("chamber_a", "chamber_b", "outlet")} | {"gas_volume_change": 0.0}
    for kind in ("suction", "delivery"):
        for side in ("a", "b"):
            y |= {f"{kind}_lift_{side}": 0.0, f"{kind}_lift_velocity_{side}": 0.0}
    return y


def _drive(m: Rig, y: State, s: Signals) -> None:
    """Controller, amplifier, coil: from the set point to the motor force."""
    s.set(piston_position=y["piston_position"], piston_velocity=y["piston_velocity"])
    if isinstance(m.amplifier, VoltageAmplifier):
        s.set(current=m.amplifier.current(y, s))
    s.set(unlimited_voltage=m.controller.command(y, s))
    s.set(voltage=limited(s.unlimited_voltage, s))
    if isinstance(m.amplifier, CurrentAmplifier):
        s.set(current=m.amplifier.current(y, s))
    m.coil.observe(s)
    s.set(coil_voltage=m.amplifier.coil_voltage(s))
    supplied = s.voltage if isinstance(m.amplifier, VoltageAmplifier) else s.coil_voltage
    s.bond("electrical input", "input", supplied, s.current)
    s.bond("copper", "copper", s.resistance * s.current, s.current)
    s.store("coil", 0.5 * s.inductance * jnp.square(s.current))
    s.limit("piston_position", -0.6 * m.stops.pump_stroke, 0.6 * m.stops.pump_stroke)
    for effect, value in s.entered("coil_voltage_change").items():
        s.bond(effect, "copper", -value, s.current)


def _move(m: Rig, s: Signals, mass, damping, pressure_force) -> State:
    """The mover's equation: M dv/dt = F_e − c v − (p_A − p_B) S_p − F_f − F_stop."""
    x, v = s.piston_position, s.piston_velocity
    half = 0.5 * m.stops.pump_stroke
    stop = m.stops.force(x, v, -half, half)
    friction = enter(slots.MOVER_FRICTION, None, s)
    s.set(stop_force=stop, friction_force=jnp.zeros_like(v) if friction is None else friction)
    force = s.motor_force - damping * v - stop - pressure_force
    if friction is not None:
        force = force - friction
    force = enter(slots.MOVER_FORCE, force, s)
    s.store("mover", 0.5 * mass * jnp.square(v))
    s.bond("mover damping", "mechanical", damping * v, v)
    s.bond("end stops", "mechanical", stop, v)
    for effect, value in s.entered("mover_friction").items():
        s.bond(effect, "mechanical", value, v)
    for effect, value in s.entered("mover_force").items():
        s.bond(effect, "mechanical", -value, v)
    if s.entered("motor_force_factor"):
        s.bond("back-EMF", "mechanical", s.back_emf, s.current)
        s.bond("motor force", "mechanical", -s.motor_force, v)
    rates = {"piston_position": v, "piston_velocity": force / mass}
    return rates | m.amplifier.rates(s) | m.controller.rates(s)


def _pump(m, y: State, s: Signals) -> State:
    """Accumulator pressure, chambers, leakage and check valves; the mover with its plungers."""
    oil, pump = m.oil, m.pump
    s.set(
        piston_area=pump.area(),
        viscosity=oil.viscosity(s),
        accumulator_pressure=m.accumulator.pressure(y["gas_volume_change"]),
        gas_volume=m.accumulator.accumulator_gas_volume + y["gas_volume_change"],
        outlet_pressure=oil.pressure(y["outlet_coordinate"], s),
    )
    s.limit("gas_volume", 0.02 * m.accumulator.accumulator_gas_volume, 50.0 * m.accumulator.accumulator_gas_volume)
    s.limit("outlet_pressure", 0.0, HIGHEST_PRESSURE)
    for side in ("a", "b"):
        s.set(**{f"chamber_pressure_{side}": oil.pressure(y[f"chamber_{side}_coordinate"], s)})
    rates = {}
    for side, sign in (("a", 1.0), ("b", -1.0)):
        rates |= _chamber(m, y, s, side, sign)
    pressure_force = (s.chamber_pressure_a - s.chamber_pressure_b) * s.piston_area
    mass = m.mover.mover_mass + pump.plunger_mass
    return rates | _move(m, s, mass, m.mover.mover_damping + pump.pump_damping, pressure_force)


def _chamber(m, y: State, s: Signals, side: str, sign: float) -> State:
    """One chamber with its two valves: V/β dp/dt = S_p v − Q_d + Q_s − Q_L."""
    p = getattr(s, f"chamber_pressure_{side}")
    v = s.piston_velocity if sign > 0 else -s.piston_velocity
    x = s.piston_position if sign > 0 else -s.piston_position
    volume = m.pump.volume(0.5 * m.stops.pump_stroke - x)
    rates = {}
    flows = {}
    for kind, drop, slot in (
        ("suction", s.accumulator_pressure - p, slots.SUCTION_VALVE_AREA),
        ("delivery", p - s.outlet_pressure, slots.DELIVERY_VALVE_AREA),
    ):
        lift, speed = y[f"{kind}_lift_{side}"], y[f"{kind}_lift_velocity_{side}"]
        area = m.valve.area(lift, speed, drop, slot, s)
        flows[kind] = m.orifice.flow(area, drop, m.oil.oil_density)
        rates[f"{kind}_lift_{side}"] = speed
        rates[f"{kind}_lift_velocity_{side}"] = m.valve.acceleration(lift, speed, drop, area, s)
        s.set(**{f"{kind}_lift_{side}": lift, f"{kind}_flow_{side}": flows[kind]})
        give = 0.5 * m.valve.valve_seat_diameter
        s.limit(f"{kind}_lift_{side}", -give, m.valve.valve_max_lift + give)
        s.bond(f"{kind} valve {side}", "fluid", drop, flows[kind])
    flow = s.piston_area * v + flows["suction"] - flows["delivery"]
    local = s.at(chamber_pressure=p, plunger_velocity=v)
    leakage = enter(slots.CHAMBER_LEAKAGE, None, local)
    if leakage is not None:
        flow = flow - leakage
        s.bond(f"leakage {side}", "fluid", p - s.accumulator_pressure, leakage)
    s.set(**{f"leakage_{side}": jnp.zeros_like(p) if leakage is None else leakage})
    s.notes.nodes[f"chamber {side}"] = Node(p, volume, None)
    s.limit(f"chamber_pressure_{side}", 0.0, HIGHEST_PRESSURE)
    rates[f"chamber_{side}_coordinate"] = m.oil.rate(p, flow, volume, s)
    return rates


def _outlet(m, s: Signals) -> State:
    """Outlet node and accumulator: what the load returns, plunger leakage and relief flow come back."""
    p = s.outlet_pressure
    relief = m.outlet.relief_flow(p)
    drawn = s.suction_flow_a + s.suction_flow_b
    back = s.return_flow + relief - drawn
    if s.entered("chamber_leakage"):
        back = back + s.leakage_a + s.leakage_b
    s.set(relief_flow=relief, accumulator_flow=back)
    s.bond("relief valve", "fluid", p - s.accumulator_pressure, relief)
    s.bond("accumulator gas", "stored", s.accumulator_pressure, back)
    capacity = enter(slots.OUTLET_CAPACITY, None, s)
    s.notes.nodes["outlet"] = Node(p, m.outlet.outlet_volume, capacity)
    flow = s.delivery_flow_a + s.delivery_flow_b - s.outlet_flow - relief
    return {
        "outlet_coordinate": m.oil.rate(p, flow, m.outlet.outlet_volume, s, capacity),
        "gas_volume_change": -back,
    }


def _cylinder(m: ActuatorSystem, y: State, s: Signals, known: State) -> State:
    """Reversing valve, both sides of the cylinder and its load; sets outlet and return flow."""
    oil, c, rho = m.oil, m.cylinder, m.oil.oil_density
    x, v = s.cylinder_position, s.cylinder_velocity
    head, rod = oil.pressure(y["head_coordinate"], s), oil.pressure(y["rod_coordinate"], s)
    s.set(spool=y["spool"], head_pressure=head, rod_pressure=rod, caught_velocity=known["cylinder_velocity"])
    forward, backward = m.reversing_valve.areas(s.spool)
    edges = {
        "P to head": (forward, s.outlet_pressure - head),
        "rod to T": (forward, rod - s.accumulator_pressure),
        "P to rod": (backward, s.outlet_pressure - rod),
        "head to T": (backward, head - s.accumulator_pressure),
    }
    q = {edge: m.orifice.flow(area, drop, rho) for edge, (area, drop) in edges.items()}
    for edge, (_, drop) in edges.items():
        s.bond(f"reversing valve {edge}", "fluid", drop, q[edge])
    s.set(outlet_flow=q["P to head"] + q["P to rod"], return_flow=q["rod to T"] + q["head to T"])

    area = c.area()
    conductance = enter(slots.CYLINDER_LEAKAGE, c.cylinder_leakage, s)
    leakage = conductance * (head - rod)
    s.bond("cylinder leakage", "fluid", head - rod, leakage)
    volumes = c.cylinder_dead_volume + area * x, c.cylinder_dead_volume + area * (c.cylinder_stroke - x)
    s.notes.nodes.update({"head": Node(head, volumes[0], None), "rod": Node(rod, volumes[1], None)})

    stop = m.stops.force(x, v, 0.0, c.cylinder_stroke)
    free = (head - rod) * area - c.cylinder_damping * v - c.load_force - stop
    free = enter(slots.CYLINDER_FORCE, free, s)
    level = enter(slots.CYLINDER_FRICTION_LEVEL, 0.0, s)
    local = s.at(cylinder_free_force=free, cylinder_friction_level=level)
    friction = enter(slots.CYLINDER_FRICTION, None, local)
    s.set(cylinder_friction=jnp.zeros_like(v) if friction is None else friction)
    s.limit("cylinder_position", -0.2 * c.cylinder_stroke, 1.2 * c.cylinder_stroke)
    s.limit("head_pressure", 0.0, HIGHEST_PRESSURE)
    s.limit("rod_pressure", 0.0, HIGHEST_PRESSURE)
    s.store("cylinder load", 0.5 * c.load_mass * jnp.square(v))
    s.bond("cylinder damping", "mechanical", c.cylinder_damping * v, v)
    s.bond("cylinder stops", "mechanical", stop, v)
    s.bond("load", "delivered", c.load_force, v)
    for effect, value in s.entered("cylinder_friction_force").items():
        s.bond(effect, "mechanical", value, v)
    for effect, value in s.entered("cylinder_force").items():
        s.bond(effect, "mechanical", -value, v)
    force = free if friction is None else free - friction
    return {
        "cylinder_position": v,
        "cylinder_velocity": force / c.load_mass,
        "head_coordinate": oil.rate(head, q["P to head"] - q["head to T"] - area * v - leakage, volumes[0], s),
        "rod_coordinate": oil.rate(rod, q["P to rod"] - q["rod to T"] + area * v + leakage, volumes[1], s),
    }
