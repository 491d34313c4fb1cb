"""The three rigs: which parts are mounted, and the one page of equations that joins them.

A rig is a pytree of parameters. `evaluate(y, t, h, known, law)` writes down every signal of one instant and the rate of
every state (of a node of oil: the rate of its strain pressure, see `edhas_jax.machine.oil`). `y` maps state names to
scalars in SI; `h` is the step that is being taken and `known` the state at its start, which only Karnopp's standstill
asks for; `law` lets a step put its own slopes on the orifices. Batching and differentiation are transformations of this
function.
"""

import dataclasses
from collections.abc import Callable
from typing import Any, ClassVar

from edhas_jax.core.structs import struct
from edhas_jax.machine import equations, equations_of_motion
from edhas_jax.machine.components.accumulator import Accumulator
from edhas_jax.machine.components.check_valve import CheckValve
from edhas_jax.machine.components.coil_and_amplifier import Coil, CurrentAmplifier, VoltageAmplifier
from edhas_jax.machine.components.controller_sampling import Continuous, Sampled
from edhas_jax.machine.components.controllers import Coordination, PositionController, Supply
from edhas_jax.machine.components.cylinder import Cylinder, ReversingValve
from edhas_jax.machine.components.mover import EndStops, Mover
from edhas_jax.machine.components.orifice import Orifice
from edhas_jax.machine.components.outlet_and_load import LoadOrifice, Outlet
from edhas_jax.machine.components.pump import Pump
from edhas_jax.machine.components.set_points import Chirp, Recorded, Sine, Step
from edhas_jax.machine.effects import Effect, EffectError
from edhas_jax.machine.effects.base import effect_rates
from edhas_jax.machine.interface import slots
from edhas_jax.machine.interface.controller_base import Controller
from edhas_jax.machine.interface.signals import Signals
from edhas_jax.machine.oil import Oil

State = dict[str, Any]
Amplifier = VoltageAmplifier | CurrentAmplifier
Sampling = Continuous | Sampled
Input = Sine | Step | Chirp | Recorded


@struct
class ActuatorBench:
    """The linear actuator alone: coil, mover, end stops, controller."""

    name: ClassVar[str] = "actuator_bench"
    slots: ClassVar[tuple] = slots.ACTUATOR_SLOTS

    reference: Input = Sine()
    supply: Supply = Supply()
    controller: Controller = PositionController()
    sampling: Sampling = Continuous()
    amplifier: Amplifier = VoltageAmplifier()
    coil: Coil = Coil()
    mover: Mover = Mover()
    stops: EndStops = EndStops()
    effects: tuple[Effect, ...] = ()

    def start(self) -> State:
        """The state at rest."""
        return equations.start_drive(self)

    def evaluate(self, y: State, t, h, known: State, law: Callable | None = None) -> tuple[Signals, State]:
        """Every signal at time t and the rate of every state (of an oil node: of its strain pressure)."""
        s = equations.first_signals(self, y, t, h, law)
        s.set(**equations.set_point(self.reference, t, 1.0))
        equations.drive(self, y, s)
        equations_of_motion.slide(y, s)
        rates = equations_of_motion.move(self, y, s, self.mover.mover_mass, self.mover.mover_damping, 0.0)
        return s, rates | effect_rates(s)


@struct
class PumpBench:
    """Actuator, pump, check valves, outlet volume, load orifice and accumulator."""

    name: ClassVar[str] = "pump_bench"
    slots: ClassVar[tuple] = slots.PUMP_SLOTS

    reference: Input = Sine()
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

    def start(self) -> State:
        """The state at rest, every pressure at that of the accumulator."""
        return equations.start_drive(self) | equations.start_pump(self)

    def evaluate(self, y: State, t, h, known: State, law: Callable | None = None) -> tuple[Signals, State]:
        """Every signal at time t and the rate of every state (of an oil node: of its strain pressure)."""
        s = equations.first_signals(self, y, t, h, law)
        s.set(**equations.set_point(self.reference, t, 1.0))
        equations.drive(self, y, s)
        rates = equations.pump(self, y, s)
        equations.load(self, s)
        rates |= equations.outlet(self, s)
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

    def start(self) -> State:
        """The state at rest, every pressure at that of the accumulator, the cylinder at 0."""
        y = equations.start_drive(self) | equations.start_pump(self)
        y |= dict.fromkeys(("head_pressure", "rod_pressure"), y["outlet_pressure"])
        return y | dict.fromkeys(("spool", "cylinder_position", "cylinder_velocity"), 0.0)

    def evaluate(self, y: State, t, h, known: State, law: Callable | None = None) -> tuple[Signals, State]:
        """Every signal at time t and the rate of every state (of an oil node: of its strain pressure)."""
        s = equations.first_signals(self, y, t, h, law)
        target, _ = self.target.at(t)
        s.set(target=target, cylinder_position=y["cylinder_position"], cylinder_velocity=y["cylinder_velocity"])
        error = target - s.cylinder_position
        s.set(**equations.set_point(self.reference, t, self.coordination.pump_share(error)))
        equations.drive(self, y, s)
        rates = equations.pump(self, y, s)
        rates |= equations.cylinder(self, y, s, known)
        rates["spool"] = (
            self.coordination.spool_command(error) - s.spool
        ) / self.reversing_valve.reversing_valve_time
        rates |= equations.outlet(self, s)
        return s, rates | effect_rates(s)


Rig = ActuatorBench | PumpBench | ActuatorSystem
RIGS: dict[str, type[Rig]] = {rig.name: rig for rig in (ActuatorBench, PumpBench, ActuatorSystem)}


def parts(machine: Rig) -> dict[str, Any]:
    """The structs of a machine that hold parameters, effects last, by field name or effect id.

    Raises:
        EffectError: an effect has the id of another, or the name of a part.
    """
    named = {f.name: getattr(machine, f.name) for f in dataclasses.fields(machine) if f.name != "effects"}
    for effect in machine.effects:
        if effect.id in named:
            raise EffectError(f"the id `{effect.id}` is taken twice in {machine.name}; every effect needs its own")
        named[effect.id] = effect
    return named
