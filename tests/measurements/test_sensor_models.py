"""Sensor models against closed-form solutions, and their derivatives against finite differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from edhas_jax.core.structs import owner_id, parameters, replace
from edhas_jax.diagnosis.candidates.candidate import SENSOR_FAULTS
from edhas_jax.measurements.sensor_models import (
    SENSOR_MODELS,
    AntiAliasFilter,
    Quantisation,
    Sampling,
    SensorDelay,
    SensorGain,
    SensorLag,
    SensorOffset,
    record,
)

TIME = np.linspace(0.0, 0.05, 501)
UNEVEN = np.sort(np.random.default_rng(1).uniform(0.0, 0.05, 200))
SINE = np.sin(2 * np.pi * 60.0 * TIME)


@pytest.mark.parametrize("time", [TIME, UNEVEN])
def test_a_lag_follows_a_step_exactly(time):
    tau, since = 3e-3, time - time[0]
    step = np.where(since > 0.0, 7.0, 0.0)  # held from the first sample on
    exact = 7.0 * (1.0 - np.exp(-since / tau))
    assert np.allclose(SensorLag(lag_time=tau).record(time, step), exact, rtol=0, atol=1e-13)


def test_the_error_of_a_lag_on_a_ramp_is_of_first_order_in_the_sample_interval():
    tau, errors = 3e-3, []
    for count in (101, 201, 401):
        time = np.linspace(0.0, 0.05, count)
        exact = time - tau * (1.0 - np.exp(-time / tau))
        errors.append(np.abs(SensorLag(lag_time=tau).record(time, time) - exact).max())
    assert np.allclose(np.array(errors[:-1]) / errors[1:], 2.0, rtol=0.05)


def test_a_lag_starts_at_the_true_value_and_vanishes_with_its_time():
    assert SensorLag().record(TIME, 3.0 + SINE)[0] == 3.0
    assert np.allclose(SensorLag(lag_time=1e-7).record(TIME, SINE), SINE, atol=1e-4)


def test_a_lag_of_a_sine_has_its_gain_and_phase():
    tau, omega, time = 2e-3, 2 * np.pi * 60.0, np.linspace(0.0, 0.1, 10_001)
    exact = np.imag(np.exp(1j * omega * time) / (1 + 1j * omega * tau))
    late = time > 20 * tau
    got = SensorLag(lag_time=tau).record(time, np.sin(omega * time))
    assert np.allclose(got[late], exact[late], atol=2e-3)


def test_the_derivative_of_a_lag_is_that_of_the_closed_form():
    tau, step = 3e-3, np.where(TIME > 0.0, 7.0, 0.0)
    _, slope = jax.jvp(lambda x: SensorLag(lag_time=x).record(TIME, step), (tau,), (1.0,))
    assert np.allclose(slope, -7.0 * TIME / tau**2 * np.exp(-TIME / tau), atol=1e-9)


@pytest.mark.parametrize("time", [TIME, UNEVEN])
def test_the_filter_follows_a_ramp_exactly(time):
    f, since = 80.0, time - time[0]
    w = 2 * np.pi * f / np.sqrt(2)
    # y = t − 1/w + e^{−wt} cos(wt)/w solves ÿ + 2w ẏ + 2w² y = 2w² t from rest
    exact = since - 1 / w + np.exp(-w * since) * np.cos(w * since) / w
    assert np.allclose(AntiAliasFilter(cutoff_frequency=f).record(time, since), exact, rtol=0, atol=1e-14)


@pytest.mark.parametrize(("ratio", "gain"), [(0.1, 0.99995), (1.0, np.sqrt(0.5)), (10.0, 0.0099995)])
def test_the_filter_has_the_gain_of_a_butterworth(ratio, gain):
    f, time = 50.0, np.linspace(0.0, 1.0, 40_001)
    got = np.asarray(AntiAliasFilter(cutoff_frequency=f).record(time, np.sin(2 * np.pi * ratio * f * time)))
    late = time >= 0.8
    assert np.sqrt(2 * np.mean(got[late] ** 2)) == pytest.approx(gain, rel=1e-3)


def test_a_delay_shifts_and_holds_the_first_value():
    got = SensorDelay(delay_time=4e-3).record(TIME, 1.0 + 5.0 * TIME)
    assert np.allclose(got, 1.0 + 5.0 * np.maximum(TIME - 4e-3, 0.0), atol=1e-14)
    assert np.allclose(SensorDelay(delay_time=0.0).record(TIME, SINE), SINE, atol=1e-15)


def test_gain_offset_and_their_order():
    chain = (SensorGain(gain=1.1), SensorOffset(offset=0.5))
    assert np.allclose(record(chain, TIME, SINE), 1.1 * SINE + 0.5)
    assert np.allclose(record(chain[::-1], TIME, SINE), 1.1 * (SINE + 0.5))
    assert record((), TIME, SINE) is SINE


def test_sampling_holds_the_last_sample():
    got = Sampling(sample_interval=1e-3).record(TIME, SINE)
    assert np.allclose(got, SINE[10 * (np.arange(501) // 10)], atol=1e-12)


def test_quantisation_rounds_and_lets_slopes_through():
    q = Quantisation(resolution=0.25)
    assert np.allclose(q.record(TIME, SINE), 0.25 * np.round(SINE / 0.25))
    _, slope = jax.jvp(lambda a: q.record(TIME, a * SINE), (1.0,), (1.0,))
    assert np.allclose(slope, SINE)


@pytest.mark.parametrize("sensor", [SensorLag, SensorDelay, SensorGain, SensorOffset, AntiAliasFilter])
def test_derivatives_agree_with_finite_differences(sensor):
    (p,) = parameters(sensor)
    at = max(p.default, 1e-3) * 1.0137
    smooth = 1.0 + np.cos(400.0 * TIME)

    def trace(x):
        return sensor(**{p.name: x}).record(TIME, smooth)

    value, slope = jax.jvp(trace, (at,), (1.0,))
    step = 1e-5 * at
    near = (trace(at + step) - trace(at - step)) / (2 * step)
    assert np.isfinite(np.asarray(value)).all()
    assert np.allclose(slope, near, rtol=1e-5, atol=1e-5 * np.abs(near).max())


@pytest.mark.parametrize("sensor", SENSOR_MODELS)
def test_a_batch_of_traces_gives_the_same_as_each_alone(sensor):
    both = np.stack([SINE, 2.0 + SINE**2], axis=1).reshape(501, 1, 2)
    batch = jax.jit(lambda one, v: one.record(TIME, v))(sensor(), both)
    assert batch.shape == both.shape
    for k in range(2):
        assert np.allclose(batch[:, 0, k], sensor().record(TIME, both[:, 0, k]), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("sensor", SENSOR_MODELS)
def test_single_precision_is_preserved(sensor):
    single = jax.tree.map(jnp.float32, sensor())
    assert single.record(jnp.asarray(TIME, jnp.float32), jnp.asarray(SINE, jnp.float32)).dtype == jnp.float32


def test_sensor_models_declare_what_a_diagnosis_needs():
    assert [owner_id(sensor) for sensor in SENSOR_MODELS[:4]] == [
        "sensor_lag",
        "sensor_delay",
        "sensor_gain",
        "sensor_offset",
    ]
    for sensor in SENSOR_MODELS:
        (p,) = parameters(sensor)
        assert p.span[0] <= p.default <= p.span[1] and sensor.looks_like
        if p.plausible:
            assert p.span[0] <= p.plausible[0] <= p.default <= p.plausible[1] <= p.span[1]
    for fault in SENSOR_FAULTS:  # a range of its own, or a share of that of the signal
        (p,) = parameters(fault)
        assert (p.plausible is None) != (fault.plausible_share is None)
    assert replace(SensorLag(), lag_time=1e-3).lag_time == 1e-3
