"""The library of physical effects: one class each, which can be added to a machine or left out.

A new effect is a module in the folder of the section where it acts, and an entry in `LIBRARY`.
"""

from edhas_jax.machine.effects.base import Effect, EffectError, state
from edhas_jax.machine.effects.cylinder.cylinder_leakage_rise import CylinderLeakageRise
from edhas_jax.machine.effects.cylinder.cylinder_seal_friction import CylinderSealFriction
from edhas_jax.machine.effects.cylinder.karnopp_friction import KarnoppFriction
from edhas_jax.machine.effects.cylinder.load_spring import LoadSpring
from edhas_jax.machine.effects.electrical.amplifier_lag import AmplifierLag
from edhas_jax.machine.effects.electrical.coil_heating import CoilHeating
from edhas_jax.machine.effects.electrical.force_constant_droop import ForceConstantDroop
from edhas_jax.machine.effects.electrical.inverter_dead_time import InverterDeadTime
from edhas_jax.machine.effects.electrical.magnetic_saturation import MagneticSaturation
from edhas_jax.machine.effects.electrical.supply_sag import SupplySag
from edhas_jax.machine.effects.hydraulic.entrained_air import EntrainedAir
from edhas_jax.machine.effects.hydraulic.hose_compliance import HoseCompliance
from edhas_jax.machine.effects.hydraulic.oil_viscosity import OilTemperature, PressureViscosity
from edhas_jax.machine.effects.hydraulic.outlet_line import OutletLineInertance, OutletLineResistance
from edhas_jax.machine.effects.hydraulic.piston_leakage import PistonLeakage
from edhas_jax.machine.effects.hydraulic.seat_leakage import DeliverySeatLeakage, SuctionSeatLeakage
from edhas_jax.machine.effects.hydraulic.suction_line import SuctionLineInertance, SuctionLineResistance
from edhas_jax.machine.effects.hydraulic.valve_adhesion import ValveAdhesion
from edhas_jax.machine.effects.hydraulic.valve_flow_force import ValveFlowForce
from edhas_jax.machine.effects.mover.asymmetric_damping import AsymmetricDamping
from edhas_jax.machine.effects.mover.asymmetric_friction import AsymmetricFriction
from edhas_jax.machine.effects.mover.cogging_force import CoggingForce
from edhas_jax.machine.effects.mover.constant_bias_force import ConstantBiasForce
from edhas_jax.machine.effects.mover.coupling import Backlash, CouplingCompliance
from edhas_jax.machine.effects.mover.eddy_drag import EddyDrag
from edhas_jax.machine.effects.mover.lugre_friction import LugreFriction
from edhas_jax.machine.effects.mover.parasitic_spring import ParasiticSpring
from edhas_jax.machine.effects.mover.reluctance_force import ReluctanceForce
from edhas_jax.machine.effects.mover.seal_friction import SealFriction
from edhas_jax.machine.effects.mover.stroke_dependent_friction import StrokeDependentFriction

LIBRARY: tuple[type[Effect], ...] = (
    LugreFriction, PistonLeakage, EntrainedAir, KarnoppFriction, ForceConstantDroop, MagneticSaturation,
    ReluctanceForce, CoggingForce, EddyDrag, InverterDeadTime, SupplySag, AmplifierLag, CoilHeating,
    ConstantBiasForce, ParasiticSpring, AsymmetricFriction, AsymmetricDamping, StrokeDependentFriction, SealFriction,
    CouplingCompliance, Backlash, ValveFlowForce, ValveAdhesion, SuctionSeatLeakage, DeliverySeatLeakage,
    HoseCompliance, OutletLineInertance, OutletLineResistance, SuctionLineResistance, SuctionLineInertance,
    OilTemperature, PressureViscosity, CylinderSealFriction, LoadSpring, CylinderLeakageRise,
)  # fmt: skip

__all__ = ["LIBRARY", "Effect", "EffectError", "state", *(effect.__name__ for effect in LIBRARY)]
