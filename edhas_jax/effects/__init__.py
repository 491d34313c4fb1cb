"""The library of physical effects: one small class each, all alike, each removable."""

from edhas_jax.effects.amplifier_lag import AmplifierLag
from edhas_jax.effects.asymmetric_damping import AsymmetricDamping
from edhas_jax.effects.asymmetric_friction import AsymmetricFriction
from edhas_jax.effects.base import Effect, EffectError, state
from edhas_jax.effects.cogging_force import CoggingForce
from edhas_jax.effects.coil_heating import CoilHeating
from edhas_jax.effects.constant_bias_force import ConstantBiasForce
from edhas_jax.effects.coupling import Backlash, CouplingCompliance
from edhas_jax.effects.cylinder_leakage_rise import CylinderLeakageRise
from edhas_jax.effects.cylinder_seal_friction import CylinderSealFriction
from edhas_jax.effects.eddy_drag import EddyDrag
from edhas_jax.effects.entrained_air import EntrainedAir
from edhas_jax.effects.force_constant_droop import ForceConstantDroop
from edhas_jax.effects.hose_compliance import HoseCompliance
from edhas_jax.effects.inverter_dead_time import InverterDeadTime
from edhas_jax.effects.karnopp_friction import KarnoppFriction
from edhas_jax.effects.load_spring import LoadSpring
from edhas_jax.effects.lugre_friction import LugreFriction
from edhas_jax.effects.magnetic_saturation import MagneticSaturation
from edhas_jax.effects.oil_viscosity import OilTemperature, PressureViscosity
from edhas_jax.effects.outlet_line import OutletLineInertance, OutletLineResistance
from edhas_jax.effects.parasitic_spring import ParasiticSpring
from edhas_jax.effects.piston_leakage import PistonLeakage
from edhas_jax.effects.reluctance_force import ReluctanceForce
from edhas_jax.effects.seal_friction import SealFriction
from edhas_jax.effects.seat_leakage import DeliverySeatLeakage, SuctionSeatLeakage
from edhas_jax.effects.stroke_dependent_friction import StrokeDependentFriction
from edhas_jax.effects.suction_line import SuctionLineInertance, SuctionLineResistance
from edhas_jax.effects.supply_sag import SupplySag
from edhas_jax.effects.valve_adhesion import ValveAdhesion
from edhas_jax.effects.valve_flow_force import ValveFlowForce

LIBRARY: tuple[type[Effect], ...] = (
    LugreFriction, PistonLeakage, EntrainedAir, KarnoppFriction, ForceConstantDroop, MagneticSaturation,
    ReluctanceForce, CoggingForce, EddyDrag, InverterDeadTime, SupplySag, AmplifierLag, CoilHeating,
    ConstantBiasForce, ParasiticSpring, AsymmetricFriction, AsymmetricDamping, StrokeDependentFriction, SealFriction,
    CouplingCompliance, Backlash, ValveFlowForce, ValveAdhesion, SuctionSeatLeakage, DeliverySeatLeakage,
    HoseCompliance, OutletLineInertance, OutletLineResistance, SuctionLineResistance, SuctionLineInertance,
    OilTemperature, PressureViscosity, CylinderSealFriction, LoadSpring, CylinderLeakageRise,
)  # fmt: skip

__all__ = ["LIBRARY", "Effect", "EffectError", "state", *(effect.__name__ for effect in LIBRARY)]
