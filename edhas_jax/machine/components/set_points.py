"""Set points as functions of time: sine, step, chirp and recorded signal, and two forms of them for batches.

`value_and_rate(t)` gives the set point and its time derivative, in SI.
"""

import jax.numpy as jnp
import numpy as np

from edhas_jax.core.structs import par, replace, struct

ROUNDING = 4.0  # relative rounding errors of a time n·h and of the time of a step, up to which both count as equal
MOST_INNER_STEPS = 4  # within one interval; each adds a comparison to the code of a time loop


@struct
class Sine:
    """A sine with a smooth ramp of its amplitude: a s(t/T) sin(2π f t), s(τ) = τ³ (10 − 15 τ + 6 τ²) on [0, 1]."""

    amplitude: float = par(3.5e-3, "m", (0.0, 10.0), "amplitude of the set point")
    frequency: float = par(10.0, "Hz", (1e-3, 2e3), "frequency")
    ramp_time: float = par(0.1, "s", (0.0, 100.0), "time of the soft start; 0 starts at full amplitude")

    def value_and_rate(self, t):
        """Value and rate at time t [s]."""
        omega = 2.0 * jnp.pi * self.frequency
        ramped = self.ramp_time > 0.0
        tau = jnp.where(ramped, jnp.clip(t / jnp.where(ramped, self.ramp_time, 1.0), 0.0, 1.0), 1.0)
        rate = jnp.where(ramped, 30.0 * jnp.square(tau * (1.0 - tau)) / jnp.where(ramped, self.ramp_time, 1.0), 0.0)
        scale = tau * tau * tau * (10.0 - tau * (15.0 - 6.0 * tau))
        sine, cosine = jnp.sin(omega * t), jnp.cos(omega * t)
        return self.amplitude * scale * sine, self.amplitude * (scale * omega * cosine + rate * sine)


@struct
class Step:
    """A step by `step_size` at `step_time`, from `step_from`; its rate is taken as 0."""

    step_size: float = par(1e-3, "m", (-10.0, 10.0), "height of the step")
    step_time: float = par(0.0, "s", (0.0, 1e4), "time of the step")
    step_from: float = par(0.0, "m", (-10.0, 10.0), "value before the step")

    def value_and_rate(self, t):
        """Value and rate at time t [s]."""
        value = self.step_from + jnp.where(t >= self.step_time, self.step_size, 0.0)
        return value, jnp.zeros_like(value)


@struct
class Chirp:
    """A sine whose frequency changes linearly from f_0 to f_1 within `sweep_time` and then stays at f_1."""

    amplitude: float = par(1e-3, "m", (0.0, 10.0), "amplitude of the set point")
    start_frequency: float = par(1.0, "Hz", (0.0, 2e3), "frequency at the start")
    end_frequency: float = par(60.0, "Hz", (0.0, 2e3), "frequency at the end of the sweep")
    sweep_time: float = par(1.0, "s", (1e-3, 1e4), "time from the one to the other")

    def value_and_rate(self, t):
        """Value and rate at time t [s]."""
        within = jnp.minimum(t, self.sweep_time)
        slope = (self.end_frequency - self.start_frequency) / self.sweep_time
        cycles = within * (self.start_frequency + 0.5 * slope * within) + self.end_frequency * (t - within)
        omega = 2.0 * jnp.pi * (self.start_frequency + slope * within)
        phase = 2.0 * jnp.pi * cycles
        return self.amplitude * jnp.sin(phase), self.amplitude * omega * jnp.cos(phase)


@struct
class Steps:
    """A signal that is constant between its steps.

    Attributes:
        times: of the steps [s], increasing, (n,), n ≥ 1; a step has taken place at its time.
        levels: before the first step and after each, (n + 1,), SI.
    """

    times: object
    levels: object

    def level(self, t):
        """The signal at time t [s]."""
        t = jnp.asarray(t)
        rounding = ROUNDING * jnp.finfo(jnp.result_type(t, float)).eps
        place = jnp.searchsorted(jnp.asarray(self.times), t + rounding * jnp.abs(t), side="right")
        return jnp.asarray(self.levels)[place]


@struct
class Recorded:
    """A recorded signal replayed: cubic Hermite interpolation of samples at equal steps, held after the last.

    Attributes:
        values: the samples, (n,), n ≥ 2, SI; without the `steps`, which are added.
        interval: time between two samples [s].
        start: time of the first sample [s], before which it is held.
        steps: the steps of the signal; None where it has none.
    """

    values: object
    interval: object
    start: object = 0.0
    steps: Steps | None = None

    @classmethod
    def held(cls, time: np.ndarray, values: np.ndarray) -> "Recorded":
        """Samples (n,) at the increasing times (n,) [s], each held until the next, as a computer gives set points."""
        time, values = np.asarray(time, float), np.asarray(values, float)
        changes, flat, steps = np.flatnonzero(np.diff(values)) + 1, values[[0, 0]], None
        if len(changes):
            flat, steps = np.zeros(2), Steps(times=time[changes], levels=values[[0, *changes]])
        return cls(values=flat, interval=float(np.median(np.diff(time))), start=float(time[0]), steps=steps)

    def sampled(self, time: np.ndarray) -> np.ndarray:
        """The signal at times (n,) [s], without tracing and straight between the samples."""
        index = (time - float(self.start)) / float(self.interval)
        values = np.interp(index, np.arange(len(self.values)), np.asarray(self.values, float))
        if self.steps is None:
            return values
        return values + np.asarray(self.steps.levels)[np.searchsorted(self.steps.times, time, side="right")]

    def value_and_rate(self, t):
        """Value and rate at time t [s]; the rate is that between the steps."""
        last = len(self.values) - 1
        position = jnp.clip((t - self.start) / self.interval, 0.0, float(last))
        inside = (t >= self.start) & (t <= self.start + float(last) * self.interval)
        whole = jnp.clip(jnp.floor(position), 0.0, last - 1.0)
        k, u = whole.astype(int), position - whole
        samples = jnp.asarray(self.values)
        before, left, right, after = (samples[jnp.clip(k + j, 0, last)] for j in (-1, 0, 1, 2))
        left_slope = jnp.where(k > 0, 0.5 * (right - before), right - left)
        right_slope = jnp.where(k < last - 1, 0.5 * (after - left), right - left)
        rise = right - left
        c2, c3 = 3.0 * rise - 2.0 * left_slope - right_slope, left_slope + right_slope - 2.0 * rise
        value = left + u * (left_slope + u * (c2 + u * c3))
        rate = (left_slope + u * (2.0 * c2 + 3.0 * u * c3)) / self.interval
        return value if self.steps is None else value + self.steps.level(t), jnp.where(inside, rate, 0.0)


@struct
class RecordedInterval:
    """One interval of a time loop, which lies within interval number `index` of a `Recorded` signal, as a cubic.

    A time loop whose steps lie within the intervals of the recording needs only the present interval and no table.
    With u = t/`interval` − `index`, the signal is `value` + `slope` u + `quadratic` u² + `cubic` u³; to that come the
    `steps` within the interval, pairs of time [s] and height.
    """

    interval: object
    index: object
    value: object
    slope: object
    quadratic: object
    cubic: object
    steps: tuple = ()

    @classmethod
    def split(cls, recorded: Recorded, interval: float, count: int) -> "RecordedInterval | None":
        """The first `count` intervals of a time loop in a recording.

        Args:
            recorded: the recording.
            interval: of the time loop [s].
            count: the number of intervals.

        Returns:
            Every leaf (count,), `interval` of the recording a number; None where the recording does not start at 0, an
            interval of the loop lies in several of the recording, or holds more than `MOST_INNER_STEPS`.
        """
        values, number = np.asarray(recorded.values, float), np.arange(count)
        if not np.ptp(values):  # flat between its steps, it suits any interval
            recorded = replace(recorded, interval=interval, start=0.0)
        parts = round(float(recorded.interval) / interval)
        if float(recorded.start) != 0.0 or abs(float(recorded.interval) - parts * interval) > 1e-9 * parts * interval:
            return None
        k, last = number // max(parts, 1), len(values) - 1
        before, left, right, after = (values[np.clip(k + j, 0, last)] for j in (-1, 0, 1, 2))
        rise = right - left
        left_slope = np.where(k > 0, 0.5 * (right - before), rise)
        right_slope = np.where(k < last - 1, 0.5 * (after - left), rise)
        left_slope, right_slope = (np.where(k < last, slope, 0.0) for slope in (left_slope, right_slope))
        inner: tuple = ()
        if recorded.steps is not None:
            times, levels = (np.asarray(part, float) for part in (recorded.steps.times, recorded.steps.levels))
            at, whole = times / interval, np.round(times / interval)
            at = np.where(np.abs(at - whole) <= 1e-9 * np.maximum(np.abs(whole), 1.0), whole, at)
            first, end = np.searchsorted(at, number, side="right"), np.searchsorted(at, number + 1.0, side="left")
            most = int((end - first).max(initial=0))
            if most > MOST_INNER_STEPS:
                return None
            times, heights = np.append(times, np.inf), np.append(np.diff(levels), 0.0)
            rows = (np.where(first + j < end, first + j, len(at)) for j in range(most))
            left, inner = left + levels[first], tuple((times[row], heights[row]) for row in rows)
        return cls(
            interval=float(recorded.interval), index=k.astype(float), value=left, slope=left_slope,
            quadratic=3.0 * rise - 2.0 * left_slope - right_slope, cubic=left_slope + right_slope - 2.0 * rise,
            steps=inner,
        )  # fmt: skip

    def value_and_rate(self, t):
        """Value and rate at time t [s] within the interval."""
        u = t / self.interval - self.index
        value = self.value + u * (self.slope + u * (self.quadratic + u * self.cubic))
        for time, height in self.steps:
            value = value + jnp.where(t >= time, height, 0.0)
        return value, (self.slope + u * (2.0 * self.quadratic + 3.0 * u * self.cubic)) / self.interval


@struct
class CyclicSine:
    """A sine at a given phase of its cycle, for a batch whose designs take the same number of steps per cycle.

    Sine, cosine and ramp are then the same for all designs and computed once; the time is not used.
    """

    amplitude: object
    frequency: object
    sine: object
    cosine: object
    ramp: object
    ramp_slope: object

    @classmethod
    def at_phase(cls, sine: Sine, phase, first_cycle) -> "CyclicSine":
        """The sine at `phase` (0 … 1); the amplitude ramp takes the whole first cycle."""
        angle = 2.0 * jnp.pi * phase
        ramp = phase * phase * phase * (10.0 - phase * (15.0 - 6.0 * phase))
        return cls(
            amplitude=sine.amplitude,
            frequency=sine.frequency,
            sine=jnp.sin(angle),
            cosine=jnp.cos(angle),
            ramp=jnp.where(first_cycle, ramp, 1.0),
            ramp_slope=jnp.where(first_cycle, 30.0 * jnp.square(phase * (1.0 - phase)), 0.0),
        )

    def value_and_rate(self, t):
        """Value and rate at the phase; `t` is not used."""
        value = self.amplitude * (self.ramp * self.sine)
        slope = 2.0 * jnp.pi * self.ramp * self.cosine + self.ramp_slope * self.sine
        return value, self.amplitude * self.frequency * slope
