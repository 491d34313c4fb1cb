"""The measurement chain: what sensors and their electronics make of a true signal, one small struct for each link.

`record(chain, time, values)` sends a trace through the links in turn: `time` (n,) [s] increasing, `values` (n, …) in
SI; the trace is taken as linear from sample to sample, and every link as settled on the first value. Links act on what
is recorded only: the controller sees the true value. All of it can be traced, batched and differentiated.
"""

from typing import Any, ClassVar

import jax
import jax.numpy as jnp

from edhas_jax.core.structs import par, struct


@struct
class SensorLag:
    """First-order lag: τ ẏ = u − y, each sample of u standing for the interval that it ends.

    y_k = u_k + (y_{k−1} − u_k) e^{−h/τ}
    """

    id: ClassVar[str] = "sensor_lag"
    looks_like: ClassVar[str] = "this signal alone is late, and its fast parts are too small"
    confused_with: ClassVar[tuple[str, ...]] = ("sensor_delay", "anti_alias_filter")

    lag_time: float = par(2e-3, "s", (1e-7, 10.0), "time constant τ", plausible=(1e-4, 50e-3))

    def record(self, time, values):
        """The recorded trace (n, …)."""
        values = jnp.asarray(values)
        decay = jnp.exp(-jnp.diff(time) / self.lag_time)

        def one(y, row):
            decay, u = row
            y = u + decay * (y - u)
            return y, y

        later = jax.lax.scan(one, values[0], (decay, values[1:]))[1]
        return jnp.concatenate([values[:1], later])


@struct
class SensorDelay:
    """Dead time: y(t) = u(t − T), the first value held until T."""

    id: ClassVar[str] = "sensor_delay"
    looks_like: ClassVar[str] = "this signal alone is late, by the same time at every frequency"
    confused_with: ClassVar[tuple[str, ...]] = ("sensor_lag", "anti_alias_filter")

    delay_time: float = par(2e-3, "s", (0.0, 10.0), "dead time T", plausible=(1e-4, 20e-3))

    def record(self, time, values):
        """The recorded trace (n, …)."""
        return _at(time - self.delay_time, time, values)


@struct
class SensorGain:
    """A wrong scale: y = g u."""

    id: ClassVar[str] = "sensor_gain"
    looks_like: ClassVar[str] = "this signal alone is too large or too small by the same share everywhere"
    confused_with: ClassVar[tuple[str, ...]] = ("sensor_offset",)

    gain: float = par(1.05, "-", (1e-3, 1e3), "factor g", plausible=(0.9, 1.1))

    def record(self, time, values):
        """The recorded trace (n, …)."""
        return self.gain * jnp.asarray(values)


@struct
class SensorOffset:
    """A wrong zero: y = u + b, b in the SI unit of the signal."""

    id: ClassVar[str] = "sensor_offset"
    looks_like: ClassVar[str] = "this signal alone is shifted by a constant, before the run starts too"
    confused_with: ClassVar[tuple[str, ...]] = ("sensor_gain",)

    offset: float = par(0.0, "-", (-1e12, 1e12), "offset b, in the SI unit of the signal")

    def record(self, time, values):
        """The recorded trace (n, …)."""
        return jnp.asarray(values) + self.offset


@struct
class AntiAliasFilter:
    """Second-order Butterworth low-pass, ÿ + √2 ω ẏ + ω² y = ω² u with ω = 2π f, solved exactly."""

    id: ClassVar[str] = "anti_alias_filter"
    looks_like: ClassVar[str] = "this signal alone is late, and nothing of it is left above some frequency"
    confused_with: ClassVar[tuple[str, ...]] = ("sensor_lag", "sensor_delay")

    cutoff_frequency: float = par(1e3, "Hz", (1e-2, 1e7), "frequency f at which 1/√2 is left", plausible=(20.0, 2e4))

    def record(self, time, values):
        """The recorded trace (n, …)."""
        # two lags with complex conjugate poles p, p*: H = 2 Re[c·(−p)/(s − p)], c = (1 − j)/2
        values = jnp.asarray(values)
        part = jnp.asarray(jnp.pi * 2.0**0.5 * self.cutoff_frequency, values.dtype)
        pole = jax.lax.complex(-part, part)
        one = _follow(jnp.asarray(time).astype(pole.dtype), values.astype(pole.dtype), pole)
        return jnp.real(one) + jnp.imag(one)


@struct
class Sampling:
    """Sample and hold: y(t) = u(k Δ), k Δ the last multiple of Δ up to t, counted from the first sample."""

    id: ClassVar[str] = "sampling"
    looks_like: ClassVar[str] = "this signal alone moves in steps of equal length, half of one late"
    confused_with: ClassVar[tuple[str, ...]] = ("sensor_delay",)

    sample_interval: float = par(1e-3, "s", (1e-7, 10.0), "time from sample to sample Δ", plausible=(1e-4, 20e-3))

    def record(self, time, values):
        """The recorded trace (n, …)."""
        # a hair of slack: 3·0.1 ms counts as 0.3 ms
        count = jnp.floor((time - time[0]) / self.sample_interval + 1e-9)
        return _at(time[0] + count * self.sample_interval, time, values)


@struct
class Quantisation:
    """Whole steps of the converter: y = q round(u/q), q in the SI unit of the signal.

    Its slope with respect to u is taken as 1, the mean slope of the staircase, so that a fit sees through it.
    """

    id: ClassVar[str] = "quantisation"
    looks_like: ClassVar[str] = "this signal alone takes few values, all multiples of one"
    confused_with: ClassVar[tuple[str, ...]] = ()

    resolution: float = par(1e-3, "-", (1e-15, 1e12), "step q, in the SI unit of the signal")

    def record(self, time, values):
        """The recorded trace (n, …)."""
        values = jnp.asarray(values)
        steps = jax.lax.stop_gradient(jnp.round(values / self.resolution))
        return self.resolution * steps + (values - jax.lax.stop_gradient(values))


SensorModel = SensorLag | SensorDelay | SensorGain | SensorOffset | AntiAliasFilter | Sampling | Quantisation
SENSOR_MODELS: tuple[type[SensorModel], ...] = (
    SensorLag, SensorDelay, SensorGain, SensorOffset, AntiAliasFilter, Sampling, Quantisation,
)  # fmt: skip


def record(chain: tuple[SensorModel, ...], time, values) -> Any:
    """What a chain makes of a trace: `time` (n,) [s], `values` (n, …) in SI; the first link is next to the process."""
    for link in chain:
        values = link.record(time, values)
    return values


def _follow(time, values, pole):
    """The solution of ẏ = p (y − u), y = u at the start, for u linear between samples; the pole p may be complex.

    With d = y − u and Δu over a step h:   d ← e^{ph} d + Δu (1 − e^{ph})/(p h)
    """
    values = jnp.asarray(values)
    steps = jnp.diff(time) * pole
    decay, share = jnp.exp(steps), -jnp.expm1(steps) / steps

    def one(behind, row):
        decay, share, rise = row
        behind = decay * behind + share * rise
        return behind, behind

    start = jnp.zeros_like(values[0])
    behind = jax.lax.scan(one, start, (decay, share, jnp.diff(values, axis=0)))[1]
    return values + jnp.concatenate([start[None], behind])


def _at(when, time, values):
    """The trace at the times `when` (n,), its first and last value held outside."""
    values = jnp.asarray(values)
    flat = values.reshape(len(values), -1)
    found = jax.vmap(lambda column: jnp.interp(when, time, column), in_axes=1, out_axes=1)(flat)
    return found.reshape(values.shape)
