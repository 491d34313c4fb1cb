"""Numbers that the paper prints without their derivation."""

import math
import types

import pytest
from scipy.integrate import quad

from edhas_jax.machine.effects import PistonLeakage


def test_the_factor_of_the_leakage_is_the_integral_over_the_inclined_gap():
    """Eq. (8): a gap of eccentricity ε = 2x/L passes 1 + 1.5 ε² times the flow of a concentric one."""
    diameter, clearance, length, viscosity, drop = 12e-3, 20e-6, 20e-3, 0.04, 1e6  # SI
    signals = types.SimpleNamespace(
        piston_diameter=diameter, viscosity=viscosity, chamber_pressure=drop, accumulator_pressure=0.0,
        plunger_velocity=0.0,
    )  # fmt: skip
    leakage = PistonLeakage(piston_clearance=clearance, piston_fit_length=length).chamber_leakage(signals, None)
    per_flow = 12.0 * viscosity / (math.pi * diameter * clearance**3)
    found = 2.0 * quad(lambda x: per_flow * leakage / (1.0 + 1.5 * (2.0 * x / length) ** 2), 0.0, length / 2.0)[0]
    assert found == pytest.approx(drop, rel=3e-4)  # the paper rounds 8.682 to 8.68
