"""The three rigs of the package: which components each has, and how the sections of the equations are joined.

They are declared like a rig of one's own, but for their states, which depend on the parts and effects that are mounted:
`initial_state` lists them. The rate of an oil node's pressure is that of its strain pressure, see
`edhas_jax.machine.components.oil`.
"""

import dataclasses
import types
from typing import Any, ClassVar

from edhas_jax.core.structs import struct
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
from edhas_jax.machine.effects import Effect, EffectError, EntrainedAir, KarnoppFriction, LugreFriction, PistonLeakage
from edhas_jax.machine.equations.cylinder import cylinder_rates
from edhas_jax.machine.equations.electrical import (
    actuator_initial_state,
    set_electrical_signals,
    set_reference,
)
from edhas_jax.machine.equations.motion import mover_rates, set_plunger_motion
from edhas_jax.machine.equations.outlet import outlet_rates, set_load_flow
from edhas_jax.machine.equations.pump import pump_initial_state, pump_rates
from edhas_jax.machine.interface import slots
from edhas_jax.machine.interface.controller_base import Controller
from edhas_jax.machine.interface.signals import PANELS, SIGNALS, Signals
from edhas_jax.machine.rig_base import Rig, State

Amplifier = VoltageAmplifier | CurrentAmplifier
Sampling = Continuous | Sampled
SetPoint = Sine | Step | Chirp | Recorded
USUAL_EFFECTS: tuple[type[Effect], ...] = (LugreFriction, PistonLeakage, EntrainedAir, KarnoppFriction)


@struct
class ActuatorParts:
    """The parts that every rig of the package has, the linear actuator with its controller, and what they entail."""

    signals: ClassVar[dict] = SIGNALS
    panels: ClassVar[tuple] = PANELS
    explaining: ClassVar[tuple] = (
        "piston_position", "piston_velocity", "current", "outlet_pressure", "reference", "voltage",
        "chamber_pressure_a",
    )  # fmt: skip
    fastest: ClassVar[str] = "the ball of a check valve oscillates on its seat with a period of 0.56 ms"
    check_interval: ClassVar[float] = 5e-4  # the checks need orders of magnitude and shapes only
    runs_whole: ClassVar[bool] = False  # its means come from balances, which batches of whole runs do not have

    reference: SetPoint = Sine()
    supply: Supply = Supply()
    controller: Controller = PositionController()
    sampling: Sampling = Continuous()
    amplifier: Amplifier = VoltageAmplifier()
    coil: Coil = Coil()
    mover: Mover = Mover()
    stops: EndStops = EndStops()

    def advance(self, y: State, k: State, t, h) -> State:
        """The state after a step, with what a sampled controller does in it; see `Rig.advance`."""
        return self.sampling.advance(self, y, k, t, h)

    @property
    def cycle(self) -> Sine | None:
        """The sine that drives a bench; None for another set point."""
        return self.reference if isinstance(self.reference, Sine) else None

    def drive_unit(self, name: str) -> str:
        """Metres; volts for the reference of an open loop, which is the command; see `Rig.drive_unit`."""
        return "V" if name == "reference" and isinstance(self.controller, OpenLoop) else "m"

    def replaceable_parts(self) -> tuple[Any, ...]:
        """What may be code of the user: effects and controller."""
        return (*self.effects, self.controller)

    def with_default_numbers(self) -> Rig:
        """The rig with the same kind of amplifier and controller."""
        return type(self)(amplifier=type(self.amplifier)(), controller=type(self.controller)())


@struct
class PumpParts(ActuatorParts):
    """The parts of the rigs with a pump: the actuator, and the pump from its oil to its outlet."""

    oil: Oil = Oil()
    orifice: Orifice = Orifice()
    pump: Pump = Pump()
    valve: CheckValve = CheckValve()
    outlet: Outlet = Outlet()
    accumulator: Accumulator = Accumulator()


class ActuatorBench(ActuatorParts, Rig):
    """The linear actuator alone: coil, mover, end stops, controller."""

    slots: ClassVar[tuple] = slots.ACTUATOR_SLOTS
    metrics: ClassVar[dict] = metrics.ELECTRICAL | metrics.TRACKING
    usual_effects: ClassVar[tuple] = USUAL_EFFECTS[:1]

    def initial_state(self) -> State:
        """The state at rest."""
        return actuator_initial_state(self)

    def equations(self, y: types.SimpleNamespace, s: Signals) -> State:
        """See `Rig.equations`."""
        set_reference(self.reference, s)
        set_electrical_signals(self, vars(y), s)
        set_plunger_motion(vars(y), s)
        return mover_rates(self, vars(y), s, self.mover.mover_mass, self.mover.mover_damping, 0.0)


class PumpBench(PumpParts, Rig):
    """Actuator, pump, check valves, outlet volume, load orifice and accumulator."""

    slots: ClassVar[tuple] = slots.PUMP_SLOTS
    metrics: ClassVar[dict] = metrics.ELECTRICAL | metrics.TRACKING | metrics.HYDRAULIC
    usual_effects: ClassVar[tuple] = USUAL_EFFECTS[:3]

    load: LoadOrifice = LoadOrifice()

    def initial_state(self) -> State:
        """The state at rest, every pressure at that of the accumulator."""
        return actuator_initial_state(self) | pump_initial_state(self)

    def equations(self, y: types.SimpleNamespace, s: Signals) -> State:
        """See `Rig.equations`."""
        set_reference(self.reference, s)
        set_electrical_signals(self, vars(y), s)
        rates = pump_rates(self, vars(y), s)
        set_load_flow(self, s)
        return rates | outlet_rates(self, s)


class ActuatorSystem(PumpParts, Rig):
    """The whole actuator: the pump feeds a cylinder through a reversing valve; `target` is the cylinder's set point."""

    slots: ClassVar[tuple] = slots.SYSTEM_SLOTS
    metrics: ClassVar[dict] = metrics.ELECTRICAL | metrics.HYDRAULIC | metrics.RESPONSE
    usual_effects: ClassVar[tuple] = USUAL_EFFECTS
    duration: ClassVar[float] = 0.6
    cycle: ClassVar[None] = None  # the coordination stops the sine of the pump

    reference: SetPoint = Sine(ramp_time=0.0)
    target: SetPoint = Step(step_size=15e-3)
    coordination: Coordination = Coordination()
    reversing_valve: ReversingValve = ReversingValve()
    cylinder: Cylinder = Cylinder()

    def initial_state(self) -> State:
        """The state at rest, every pressure at that of the accumulator, the cylinder at 0."""
        y = actuator_initial_state(self) | pump_initial_state(self)
        y |= dict.fromkeys(("head_pressure", "rod_pressure"), y["outlet_pressure"])
        return y | dict.fromkeys(("spool", "cylinder_position", "cylinder_velocity"), 0.0)

    def equations(self, y: types.SimpleNamespace, s: Signals) -> State:
        """See `Rig.equations`."""
        target, _ = self.target.value_and_rate(s.time)
        s.set(target=target, cylinder_position=y.cylinder_position, cylinder_velocity=y.cylinder_velocity)
        error = target - s.cylinder_position
        set_reference(self.reference, s, self.coordination.pump_share(error))
        set_electrical_signals(self, vars(y), s)
        rates = pump_rates(self, vars(y), s)
        rates |= cylinder_rates(self, vars(y), s)
        spool_error = self.coordination.spool_command(error) - s.spool
        rates["spool"] = spool_error / self.reversing_valve.reversing_valve_time
        return rates | outlet_rates(self, s)


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
