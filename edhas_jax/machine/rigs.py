"""The three rigs of the package: which components each has, and how the sections of the equations are joined.

A rig is a pytree of parameters. Its method `evaluate` computes every signal of one instant and the rate of every
state; batching and differentiation are JAX transformations of this function. A state is a dict of scalars in SI by
name. The rate of an oil node's pressure is that of its strain pressure, see `edhas_jax.machine.components.oil`.
"""

import dataclasses
from collections.abc import Callable
from typing import Any, ClassVar

from edhas_jax.machine import metrics
from edhas_jax.machine.components.accumulator import Accumulator
from edhas_jax.machine.components.check_valve import CheckValve
from edhas_jax.machine.components.coil_and_amplifier import Coil, CurrentAmplifier, VoltageAmplifier
from edhas_jax.machine.components.controller_sampling import Continuous, Sampled
from edhas_jax.machine.components.controllers import Coordination, OpenLoop, PositionController, Supply
from edhas_jax.machine.components.cylinder import Cylinder, ReversingValve
from edhas_jax.machine.components.mover import EndStops, Mover
from edhas_jax.machine.components.oil import Oil
from edhas_jax.machine.components.orifice import Orifice
from edhas_jax.machine.components.outlet_and_load import LoadOrifice, Outlet
from edhas_jax.machine.components.pump import Pump
from edhas_jax.machine.components.set_points import Chirp, Recorded, Sine, Step
from edhas_jax.machine.effects import Effect, EffectError
from edhas_jax.machine.effects.base import effect_rates
from edhas_jax.machine.equations.cylinder import cylinder_rates
from edhas_jax.machine.equations.electrical import (
    actuator_initial_state,
    parameter_signals,
    reference_signals,
    set_electrical_signals,
)
from edhas_jax.machine.equations.motion import mover_rates, set_plunger_motion
from edhas_jax.machine.equations.outlet import outlet_rates, set_load_flow
from edhas_jax.machine.equations.pump import pump_initial_state, pump_rates
from edhas_jax.machine.interface import slots
from edhas_jax.machine.interface.controller_base import Controller
from edhas_jax.machine.interface.signals import PANELS, Signals
from edhas_jax.machine.rig_base import Rig, State

Amplifier = VoltageAmplifier | CurrentAmplifier
Sampling = Continuous | Sampled
SetPoint = Sine | Step | Chirp | Recorded


def _advance(machine: Rig, y: State, k: State, t, h) -> State:
    """The state after a step, with what a sampled controller does in it; see `Rig.advance`."""
    return machine.sampling.advance(machine, y, k, t, h)


def _cycle(machine: Rig) -> Sine | None:
    """The sine that drives a bench; None for another set point."""
    return machine.reference if isinstance(machine.reference, Sine) else None


def _drive_unit(machine: Rig, name: str) -> str:
    """Metres; volts for the reference of an open loop, which is the command; see `Rig.drive_unit`."""
    return "V" if name == "reference" and isinstance(machine.controller, OpenLoop) else "m"


def _replaceable_parts(machine: Rig) -> tuple:
    """What may be code of the user: effects and controller."""
    return (*machine.effects, machine.controller)


def _with_default_numbers(machine: Rig) -> Rig:
    """The rig with the same kind of amplifier and controller."""
    return type(machine)(amplifier=type(machine.amplifier)(), controller=type(machine.controller)())


class ActuatorBench(Rig):
    """The linear actuator alone: coil, mover, end stops, controller."""

    name: ClassVar[str] = "actuator_bench"
    slots: ClassVar[tuple] = slots.ACTUATOR_SLOTS
    metrics: ClassVar[dict] = metrics.ELECTRICAL | metrics.TRACKING
    panels: ClassVar[tuple] = PANELS

    reference: SetPoint = Sine()
    supply: Supply = Supply()
    controller: Controller = PositionController()
    sampling: Sampling = Continuous()
    amplifier: Amplifier = VoltageAmplifier()
    coil: Coil = Coil()
    mover: Mover = Mover()
    stops: EndStops = EndStops()
    effects: tuple[Effect, ...] = ()

    advance, cycle, drive_unit = _advance, property(_cycle), _drive_unit
    with_default_numbers, replaceable_parts = _with_default_numbers, _replaceable_parts

    def initial_state(self) -> State:
        """The state at rest."""
        return actuator_initial_state(self)

    def evaluate(
        self, y: State, t, h, y_start: State, orifice_linearisation: Callable | None = None
    ) -> tuple[Signals, State]:
        """Every signal and the rate of every state; see `Rig.evaluate`."""
        s = parameter_signals(self, y, t, h, orifice_linearisation)
        s.set(**reference_signals(self.reference, t, 1.0))
        set_electrical_signals(self, y, s)
        set_plunger_motion(y, s)
        rates = mover_rates(self, y, s, self.mover.mover_mass, self.mover.mover_damping, 0.0)
        return s, rates | effect_rates(s)


class PumpBench(Rig):
    """Actuator, pump, check valves, outlet volume, load orifice and accumulator."""

    name: ClassVar[str] = "pump_bench"
    slots: ClassVar[tuple] = slots.PUMP_SLOTS
    metrics: ClassVar[dict] = metrics.ELECTRICAL | metrics.TRACKING | metrics.HYDRAULIC
    panels: ClassVar[tuple] = PANELS

    reference: SetPoint = Sine()
    supply: Supply = Supply()
    controller: Controller = PositionController()
    sampling: Sampling = Continuous()
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

    advance, cycle, drive_unit = _advance, property(_cycle), _drive_unit
    with_default_numbers, replaceable_parts = _with_default_numbers, _replaceable_parts

    def initial_state(self) -> State:
        """The state at rest, every pressure at that of the accumulator."""
        return actuator_initial_state(self) | pump_initial_state(self)

    def evaluate(
        self, y: State, t, h, y_start: State, orifice_linearisation: Callable | None = None
    ) -> tuple[Signals, State]:
        """Every signal and the rate of every state; see `Rig.evaluate`."""
        s = parameter_signals(self, y, t, h, orifice_linearisation)
        s.set(**reference_signals(self.reference, t, 1.0))
        set_electrical_signals(self, y, s)
        rates = pump_rates(self, y, s)
        set_load_flow(self, s)
        rates |= outlet_rates(self, s)
        return s, rates | effect_rates(s)


class ActuatorSystem(Rig):
    """The whole actuator: the pump feeds a cylinder through a reversing valve; `target` is the cylinder's set point."""

    name: ClassVar[str] = "actuator_system"
    slots: ClassVar[tuple] = slots.SYSTEM_SLOTS
    metrics: ClassVar[dict] = metrics.ELECTRICAL | metrics.HYDRAULIC | metrics.RESPONSE
    panels: ClassVar[tuple] = PANELS
    duration: ClassVar[float] = 0.6

    target: SetPoint = Step(step_size=15e-3)
    reference: SetPoint = Sine(ramp_time=0.0)
    supply: Supply = Supply()
    controller: Controller = PositionController()
    sampling: Sampling = Continuous()
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

    advance, drive_unit = _advance, _drive_unit
    with_default_numbers, replaceable_parts = _with_default_numbers, _replaceable_parts

    def initial_state(self) -> State:
        """The state at rest, every pressure at that of the accumulator, the cylinder at 0."""
        y = actuator_initial_state(self) | pump_initial_state(self)
        y |= dict.fromkeys(("head_pressure", "rod_pressure"), y["outlet_pressure"])
        return y | dict.fromkeys(("spool", "cylinder_position", "cylinder_velocity"), 0.0)

    def evaluate(
        self, y: State, t, h, y_start: State, orifice_linearisation: Callable | None = None
    ) -> tuple[Signals, State]:
        """Every signal and the rate of every state; see `Rig.evaluate`."""
        s = parameter_signals(self, y, t, h, orifice_linearisation)
        target, _ = self.target.value_and_rate(t)
        s.set(target=target, cylinder_position=y["cylinder_position"], cylinder_velocity=y["cylinder_velocity"])
        error = target - s.cylinder_position
        s.set(**reference_signals(self.reference, t, self.coordination.pump_share(error)))
        set_electrical_signals(self, y, s)
        rates = pump_rates(self, y, s)
        rates |= cylinder_rates(self, y, s, y_start)
        spool_error = self.coordination.spool_command(error) - s.spool
        rates["spool"] = spool_error / self.reversing_valve.reversing_valve_time
        rates |= outlet_rates(self, s)
        return s, rates | effect_rates(s)


RIGS: dict[str, type[Rig]] = {rig.name: rig for rig in (ActuatorBench, PumpBench, ActuatorSystem)}


def components_by_name(machine: Rig) -> dict[str, Any]:
    """The components of a machine by field name and its effects by id, effects last.

    Raises:
        EffectError: an effect has the id of another effect, or the name of a component.
    """
    named = {f.name: getattr(machine, f.name) for f in dataclasses.fields(machine) if f.name != "effects"}
    for effect in machine.effects:
        if effect.id in named:
            raise EffectError(f"the id `{effect.id}` is taken twice in {machine.name}; every effect needs its own")
        named[effect.id] = effect
    return named
