"""Models of sensors and their electronics; a measurement chain is a tuple of them.

A sensor model treats its input as linear between samples and starts in steady state at the first value. It acts on the
recorded signal only: the controller of the machine sees the true value. All models can be traced by JAX, batched and
differentiated in their parameters.
"""

from typing import Any, ClassVar

import jax
import jax.numpy as jnp

from edhas_jax.core.structs import par, struct


class SensorModel:
    """One link of a measurement chain, with one parameter; `record` gives the recorded signal.

    Attributes:
        id: name in files and reports.
        looks_like: how its error shows.
        confused_with: ids of what looks alike.
        memoryless: whether the error depends on the present value of the signal, and not on its rate of change.
        plausible_share: plausible range of a parameter in the unit of the signal, as a share of the range of the signal
            in a campaign; None where the parameter states its plausible range itself, or has none.
    """

    id: ClassVar[str]
    looks_like: ClassVar[str]
    confused_with: ClassVar[tuple[str, ...]] = ()
    memoryless: ClassVar[bool] = False
    plausible_share: ClassVar[tuple[float, float] | None] = None

    def record(self, time, values):
        """The recorded signal (samples, …) for the true signal `values` (samples, …) at `time` (samples,) [s]."""
        raise NotImplementedError


@struct
class SensorLag(SensorModel):
    """First-order lag: τ ẏ = u − y, with u constant over each interval at the value of the sample that ends it.

    y_k = u_k + (y_{k−1} − u_k) e^{−h/τ}
    """

    id: ClassVar[str] = "sensor_lag"
    looks_like: ClassVar[str] = "this signal alone is late, and its high frequencies are attenuated"
    confused_with: ClassVar[tuple[str, ...]] = ("sensor_delay", "anti_alias_filter")

    lag_time: float = par(2e-3, "s", (1e-7, 10.0), "time constant τ", plausible=(1e-4, 50e-3))

    def record(self, time, values):
        """The recorded signal (samples, …) for the true signal `values` (samples, …) at `time` (samples,) [s]."""
        values = jnp.asarray(values)
        decay = jnp.exp(-jnp.diff(time) / self.lag_time)

        def advance(y, row):
            decay, u = row
            y = u + decay * (y - u)
            return y, y

        recorded = jax.lax.scan(advance, values[0], (decay, values[1:]))[1]
        return jnp.concatenate([values[:1], recorded])


@struct
class SensorDelay(SensorModel):
    """Dead time: y(t) = u(t − T), and the first value until t = T."""

    id: ClassVar[str] = "sensor_delay"
    looks_like: ClassVar[str] = "this signal alone is late, by the same time at every frequency"
    confused_with: ClassVar[tuple[str, ...]] = ("sensor_lag", "anti_alias_filter")

    delay_time: float = par(2e-3, "s", (0.0, 10.0), "dead time T", plausible=(1e-4, 20e-3))

    def record(self, time, values):
        """The recorded signal (samples, …) for the true signal `values` (samples, …) at `time` (samples,) [s]."""
        return _interpolate(time - self.delay_time, time, values)


@struct
class SensorGain(SensorModel):
    """Gain error: y = g u."""

    id: ClassVar[str] = "sensor_gain"
    looks_like: ClassVar[str] = "this signal alone is too large or too small by a constant factor"
    confused_with: ClassVar[tuple[str, ...]] = ("sensor_offset",)
    memoryless: ClassVar[bool] = True

    gain: float = par(1.05, "-", (1e-3, 1e3), "gain g", plausible=(0.9, 1.1))

    def record(self, time, values):
        """The recorded signal (samples, …) for the true signal `values` (samples, …) at `time` (samples,) [s]."""
        return self.gain * jnp.asarray(values)


@struct
class SensorOffset(SensorModel):
    """Offset error: y = u + b, b in the SI unit of the signal."""

    id: ClassVar[str] = "sensor_offset"
    looks_like: ClassVar[str] = "this signal alone is shifted by a constant, even before the run starts"
    confused_with: ClassVar[tuple[str, ...]] = ("sensor_gain",)
    memoryless: ClassVar[bool] = True
    plausible_share: ClassVar[tuple[float, float]] = (-0.1, 0.1)

    offset: float = par(0.0, "-", (-1e12, 1e12), "offset b, in the SI unit of the signal")

    def record(self, time, values):
        """The recorded signal (samples, …) for the true signal `values` (samples, …) at `time` (samples,) [s]."""
        return jnp.asarray(values) + self.offset


@struct
class AntiAliasFilter(SensorModel):
    """Second-order Butterworth low-pass filter, ÿ + √2 ω ẏ + ω² y = ω² u with ω = 2π f, solved exactly."""

    id: ClassVar[str] = "anti_alias_filter"
    looks_like: ClassVar[str] = "this signal alone is late, and has no content above some frequency"
    confused_with: ClassVar[tuple[str, ...]] = ("sensor_lag", "sensor_delay")

    cutoff_frequency: float = par(1e3, "Hz", (1e-2, 1e7), "cutoff frequency f (gain 1/√2)", plausible=(20.0, 2e4))

    def record(self, time, values):
        """The recorded signal (samples, …) for the true signal `values` (samples, …) at `time` (samples,) [s]."""
        # two lags with complex conjugate poles p, p*: H = 2 Re[c·(−p)/(s − p)], c = (1 − j)/2
        values = jnp.asarray(values)
        component = jnp.asarray(jnp.pi * 2.0**0.5 * self.cutoff_frequency, values.dtype)
        pole = jax.lax.complex(-component, component)
        output = _first_order_response(jnp.asarray(time).astype(pole.dtype), values.astype(pole.dtype), pole)
        return jnp.real(output) + jnp.imag(output)


@struct
class Sampling(SensorModel):
    """Sample and hold: y(t) = u(k Δ), where k Δ is the last multiple of Δ up to t, counted from the first sample."""

    id: ClassVar[str] = "sampling"
    looks_like: ClassVar[str] = "this signal alone is a staircase of equal intervals, late by half an interval"
    confused_with: ClassVar[tuple[str, ...]] = ("sensor_delay",)

    sample_interval: float = par(1e-3, "s", (1e-7, 10.0), "sample interval Δ", plausible=(1e-4, 20e-3))

    def record(self, time, values):
        """The recorded signal (samples, …) for the true signal `values` (samples, …) at `time` (samples,) [s]."""
        # tolerance for rounding, so that 3·0.1 ms counts as 0.3 ms
        count = jnp.floor((time - time[0]) / self.sample_interval + 1e-9)
        return _interpolate(time[0] + count * self.sample_interval, time, values)


@struct
class Quantisation(SensorModel):
    """Quantisation by an analogue-to-digital converter: y = q round(u/q), q in the SI unit of the signal.

    Its derivative by u is taken as 1, the mean slope of the staircase, so that gradients pass through it.
    """

    id: ClassVar[str] = "quantisation"
    looks_like: ClassVar[str] = "this signal alone takes few values, all multiples of one step"
    memoryless: ClassVar[bool] = True

    resolution: float = par(1e-3, "-", (1e-15, 1e12), "quantisation step q, in the SI unit of the signal")

    def record(self, time, values):
        """The recorded signal (samples, …) for the true signal `values` (samples, …) at `time` (samples,) [s]."""
        values = jnp.asarray(values)
        steps = jax.lax.stop_gradient(jnp.round(values / self.resolution))
        return self.resolution * steps + (values - jax.lax.stop_gradient(values))


SENSOR_MODELS: tuple[type[SensorModel], ...] = (
    SensorLag, SensorDelay, SensorGain, SensorOffset, AntiAliasFilter, Sampling, Quantisation
)  # fmt: skip


def record(chain: tuple[SensorModel, ...], time, values) -> Any:
    """Pass a true signal through a measurement chain.

    Args:
        chain: sensor models in the order in which the signal passes them, the first one next to the process.
        time: time stamps (samples,) [s], increasing.
        values: the true signal (samples, …), SI.

    Returns:
        The recorded signal (samples, …), SI.
    """
    for sensor in chain:
        values = sensor.record(time, values)
    return values


def _first_order_response(time, values, pole):
    """The solution of ẏ = p (y − u), y = u at the start, for u linear between samples; the pole p may be complex.

    With the difference d = y − u, and Δu over a step h:   d ← e^{ph} d + Δu (1 − e^{ph})/(p h)
    """
    values = jnp.asarray(values)
    steps = jnp.diff(time) * pole
    decay, gain = jnp.exp(steps), -jnp.expm1(steps) / steps

    def advance(difference, row):
        decay, gain, increment = row
        difference = decay * difference + gain * increment
        return difference, difference

    start = jnp.zeros_like(values[0])
    differences = jax.lax.scan(advance, start, (decay, gain, jnp.diff(values, axis=0)))[1]
    return values + jnp.concatenate([start[None], differences])


def _interpolate(at_times, time, values):
    """The trace at the times `at_times` (samples,) by linear interpolation; first and last value held outside."""
    values = jnp.asarray(values)
    columns = values.reshape(len(values), -1)
    result = jax.vmap(lambda column: jnp.interp(at_times, time, column), in_axes=1, out_axes=1)(columns)
    return result.reshape(values.shape)
