"""The low-pressure accumulator."""

import jax.numpy as jnp

from edhas_jax.core.structs import par, struct


@struct
class Accumulator:
    """A gas volume with polytropic compression: p_s = p_pre (V_pre/V_gas)^n.

    The state is V_gas − V_pre rather than V_gas, so that float32 resolves its changes.
    """

    accumulator_pressure: float = par(0.2e6, "Pa", (2e3, 1e8), "pressure of gas and system at rest p_pre (absolute)")
    accumulator_gas_volume: float = par(1e-4, "m^3", (1e-7, 1.0), "gas volume at rest V_pre")
    polytropic_exponent: float = par(1.2, "-", (0.9, 2.0), "polytropic exponent n")

    def pressure(self, gas_change):
        """The absolute pressure p_s [Pa] at V_gas = V_pre + `gas_change` [m³]."""
        strain = jnp.log1p(gas_change / self.accumulator_gas_volume)
        return self.accumulator_pressure * jnp.exp(-self.polytropic_exponent * strain)
