"""The noise of a sensor is measured without a model: level, correlation and the resolution of the recorder."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.measurements.campaign import BenchRun, Campaign, CampaignError, Channel, Use
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from edhas_jax.measurements.checks.noise_correlation import (
    Autocovariance,
    autocorrelation_of,
    autoregression,
    filter_map,
    restore,
)
from edhas_jax.measurements.checks.noise_measurement import (
    measure_noise,
    noise_as_json,
    noise_sentence,
    recorder_resolution,
    with_measured_noise,
    without_refuted_noise,
)
from edhas_jax.measurements.checks.noise_records import fast_noise

INTERVAL, RAMP = 2e-4, 0.1
FREQUENCIES = (10.0, 20.0, 13.7, 30.0)  # Hz; the cycles of the last two are no whole numbers of samples
NOISE = 0.02


def periodic(time, frequency, drift=0.2):
    """A signal with a sharp fall in every cycle, which settles slowly."""
    phase = np.mod(frequency * time, 1.0)
    return 3.0 * np.sin(2.0 * np.pi * phase) + 2.0 * np.exp(-40.0 * phase) + drift * np.exp(-time / 0.1)


def step_response(time):
    """A signal that does not repeat, and comes to rest."""
    return 5.0 * np.exp(-time / 0.05) * np.sin(2.0 * np.pi * 15.0 * time)


def autoregressive(rng, coefficients, count):
    """Noise of standard deviation 1."""
    innovation, found = rng.standard_normal(count + 200), np.zeros(count + 200)
    for k in range(4, len(found)):
        found[k] = innovation[k] + sum(a * found[k - 1 - j] for j, a in enumerate(coefficients))
    correlation = autocorrelation_of(coefficients, 4)
    share = sum(a * r for a, r in zip(coefficients, correlation[1:], strict=False))
    return found[200:] * math.sqrt(1.0 - share)


def campaign_of(signals, conditions, stated=NOISE, rig=edhas.ActuatorBench):
    """Runs with one signal, the current."""
    runs = tuple(
        BenchRun(
            f"run{k}",
            Path(f"run{k}.csv"),
            Use.FIT,
            {**c},
            INTERVAL * np.arange(len(s)),
            {"current": s},
            np.arange(len(s)),
        )
        for k, (s, c) in enumerate(zip(signals, conditions, strict=True))
    )
    machine = rig(reference=edhas.Sine(ramp_time=RAMP))
    return Campaign("noise", Path("noise"), machine, {}, {"current": Channel("A", stated)}, runs, ())


def periodic_campaign(noise_of, cycles=4.2, stated=NOISE, seed=0):
    """Runs of all `FREQUENCIES`; `noise_of` (generator, number of samples) gives the noise."""
    rng, signals = np.random.default_rng(seed), []
    for frequency in FREQUENCIES:
        time = INTERVAL * np.arange(round((RAMP + cycles / frequency) / INTERVAL))
        signals.append(periodic(time, frequency) + noise_of(rng, len(time)))
    return campaign_of(signals, [{"frequency": f} for f in FREQUENCIES], stated)


def aperiodic_campaign(noise_of, stated=NOISE, runs=3, seed=0):
    """Runs with a step as set point."""
    rng, time = np.random.default_rng(seed), INTERVAL * np.arange(3000)
    signals = [step_response(time) + noise_of(rng, len(time)) for _ in range(runs)]
    campaign = campaign_of(signals, [{}] * runs, stated)
    return dataclasses.replace(campaign, machine=edhas.ActuatorBench(reference=edhas.Step()))


def white(rng, count):
    return NOISE * rng.standard_normal(count)


def used_channel(campaign):
    return with_measured_noise(campaign).channels["current"]


@pytest.mark.parametrize("seed", range(4))
def test_level_of_white_noise_lies_within_its_statistical_error(seed):
    found = measure_noise(periodic_campaign(white, seed=seed), "current")
    standard_error = NOISE / math.sqrt(2.0 * found.samples)
    assert found.samples > 2500
    assert found.low == found.high == pytest.approx(NOISE, abs=3.5 * standard_error)
    assert found.correlation == ()


@pytest.mark.parametrize("coefficients", [(0.3,), (-0.4,), (0.9, -0.35)])
def test_autoregressive_noise_is_recovered(coefficients):
    campaign = periodic_campaign(lambda rng, n: NOISE * autoregressive(rng, coefficients, n), cycles=6.2)
    found = measure_noise(campaign, "current")
    assert found.low == pytest.approx(NOISE, rel=0.06)
    correlation = autocorrelation_of(found.correlation, 5)
    assert correlation == pytest.approx(autocorrelation_of(coefficients, 5), abs=0.08)


def test_slow_noise_above_a_white_one_is_predicted_at_low_frequencies():
    """Power over that of the innovations of the model, at 1 … 5 % of half the sample rate."""
    share, decay = 0.3, 0.88

    def mixed(rng, count):
        slow = autoregressive(rng, (decay,), count)
        return NOISE * (math.sqrt(share) * slow + math.sqrt(1.0 - share) * rng.standard_normal(count))

    turn = np.exp(-1j * np.pi * np.linspace(0.01, 0.05, 9))
    power = 1.0 - share + share * (1.0 - decay**2) / np.abs(1.0 - decay * turn) ** 2
    ratios = []
    for seed in range(8):
        a = measure_noise(periodic_campaign(mixed, cycles=6.2, seed=seed), "current").correlation
        innovation = 1.0 - np.dot(a, autocorrelation_of(a, len(a))[1:])
        response = 1.0 - sum(one * turn ** (k + 1) for k, one in enumerate(a))
        ratios.append(np.mean(power * np.abs(response) ** 2) / innovation)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.25)  # 1.38 with four coefficients


def test_white_noise_after_a_filter_keeps_its_level_and_its_innovations():
    # two poles of a filter of 900 Hz with damping 0.7, sampled at 5 kHz
    decay, angle = 2.0 * np.pi * 900.0 * 0.7 * INTERVAL, 2.0 * np.pi * 900.0 * math.sqrt(1.0 - 0.49) * INTERVAL
    coefficients = (2.0 * math.exp(-decay) * math.cos(angle), -math.exp(-2.0 * decay))
    campaign = periodic_campaign(lambda rng, n: NOISE * autoregressive(rng, coefficients, n), cycles=6.2)
    found = measure_noise(campaign, "current")
    assert found.low == pytest.approx(NOISE, rel=0.06)

    def innovation(a):
        return 1.0 - sum(one * r for one, r in zip(a, autocorrelation_of(a, len(a))[1:], strict=True))

    assert innovation(found.correlation) == pytest.approx(innovation(coefficients), rel=0.1)


def test_white_noise_is_almost_never_called_correlated():
    rng = np.random.default_rng(2)
    found, count = 0, 1500
    for _ in range(500):
        values = rng.standard_normal(count)
        products = np.array([values[: count - lag] @ values[lag:] / (count - lag) for lag in range(13)])
        found += autoregression(Autocovariance(products, count)) != ()
    assert found <= 4  # 0.5 are expected


def test_autocovariance_is_restored_after_a_filter():
    coefficients, filtered_by = (0.6, 0.2), np.array([-0.2, -0.3, 1.0, -0.3, -0.2])
    gain = np.correlate(filtered_by, filtered_by, "full")
    exact = 4.0 * autocorrelation_of(coefficients, 200)
    after = filter_map(gain, 200) @ exact
    assert restore(after, gain) == pytest.approx(exact[:13], rel=0.02)


@pytest.mark.parametrize("step", [0.3, 1.0, 4.0])
def test_resolution_of_the_recorder_is_found_and_is_part_of_the_noise(step):
    campaign = periodic_campaign(white)
    step *= NOISE
    runs = [
        dataclasses.replace(run, signals={"current": np.round(run.signals["current"] / step) * step})
        for run in campaign.runs
    ]
    found = used_channel(dataclasses.replace(campaign, runs=tuple(runs)))
    assert found.resolution == pytest.approx(step, rel=1e-6)
    assert found.measured_noise == pytest.approx(math.hypot(NOISE, step / math.sqrt(12.0)), rel=0.05)
    assert found.measured_noise >= step / math.sqrt(12.0)


def test_resolution_is_found_in_text_of_six_digits_with_an_offset():
    rng, step = np.random.default_rng(3), 20.0 / 4096
    values = 1.7 + step * np.round(rng.normal(0.0, 0.5, 2000) / step)
    written = np.array([float(f"{v:.6g}") for v in values])
    assert recorder_resolution([written]) == pytest.approx(step, rel=1e-4)
    assert recorder_resolution([rng.normal(size=2000)]) == 0.0


def test_steps_that_grow_with_the_value_are_part_of_the_noise():
    """Numbers with two digits: the error is uniform within the step of each decade."""
    rng = np.random.default_rng(4)
    values = rng.uniform(1.0, 400.0, 4000)
    written = np.array([float(f"{v:.2g}") for v in values])
    error = np.sqrt(np.mean(np.square(written - values)))
    assert recorder_resolution([written[:2000], written[2000:]]) / math.sqrt(12.0) == pytest.approx(error, rel=0.03)


@pytest.mark.parametrize("factor", [0.5, 0.7, 1.5, 10.0])
def test_misstated_noise_is_said_and_the_measured_one_used(factor):
    campaign = with_measured_noise(periodic_campaign(white, stated=factor * NOISE))
    channel = campaign.channels["current"]
    assert channel.noise == channel.measured_noise == pytest.approx(NOISE, rel=0.05)
    assert noise_sentence(campaign).startswith(
        f"Stated and measured noise differ: current {factor * NOISE:.3g} A stated"
    )


def test_slightly_misstated_noise_is_used_as_measured_without_a_word():
    campaign = with_measured_noise(periodic_campaign(white, stated=0.85 * NOISE))
    assert campaign.channels["current"].noise == pytest.approx(NOISE, rel=0.05)
    assert noise_sentence(campaign) is None


def test_correctly_stated_noise_stays_as_stated():
    assert used_channel(periodic_campaign(white)).noise == NOISE


def test_one_run_that_does_not_repeat_its_cycles_does_not_matter():
    campaign = periodic_campaign(white)
    hum = 0.2 * np.sin(2.0 * np.pi * 217.0 * campaign.runs[1].time)
    disturbed = dataclasses.replace(campaign.runs[1], signals={"current": campaign.runs[1].signals["current"] + hum})
    runs = (campaign.runs[0], disturbed, *campaign.runs[2:])
    found = used_channel(dataclasses.replace(campaign, runs=runs))
    assert found.measured_noise == pytest.approx(NOISE, rel=0.06) and found.correlation == ()


def test_spikes_do_not_change_the_level():
    def with_spikes(rng, count):
        return white(rng, count) + np.where(rng.random(count) < 0.004, rng.uniform(0.1, 2.0, count), 0.0)

    found = measure_noise(periodic_campaign(with_spikes), "current")
    assert found.low == pytest.approx(NOISE, rel=0.05) and found.correlation == ()


@pytest.mark.parametrize("factor", [0.3, 2.0])
def test_white_noise_of_runs_without_cycles_is_measured_where_the_signal_rests(factor):
    channel = used_channel(aperiodic_campaign(white, stated=factor * NOISE))
    assert channel.noise == pytest.approx(NOISE, rel=0.04) and channel.correlation == ()


def test_correlated_noise_of_runs_without_cycles_has_bounds_that_hold_the_level():
    campaign = aperiodic_campaign(lambda rng, n: NOISE * autoregressive(rng, (0.4,), n))
    found = measure_noise(campaign, "current")
    assert found.low < 0.8 * NOISE
    assert found.high == pytest.approx(NOISE, rel=0.1)
    channel = used_channel(campaign)
    assert channel.noise == NOISE and channel.correlation == pytest.approx((0.4,), abs=0.1)


def test_noise_that_is_not_stated_is_measured():
    assert used_channel(periodic_campaign(white, stated=math.nan)).noise == pytest.approx(NOISE, rel=0.05)
    campaign = with_measured_noise(aperiodic_campaign(white, stated=math.nan))
    assert campaign.channels["current"].noise == pytest.approx(NOISE, rel=0.05)
    assert campaign.channels["current"].stated_noise is None and noise_sentence(campaign) is None
    row = noise_as_json(campaign)["current"]
    assert row["stated"] is None and row["measured"] == row["used"] == campaign.channels["current"].noise


def test_noise_that_is_neither_stated_nor_measurable_has_to_be_stated():
    short = campaign_of([np.sin(np.arange(60.0))], [{"frequency": 10.0}], math.nan)
    with pytest.raises(CampaignError, match="current: its noise is not stated.* state `noise:`"):
        checked_campaign(short)


def test_fast_part_of_a_signal_without_noise_is_nothing():
    smooth = campaign_of([step_response(INTERVAL * np.arange(3000))], [{}])
    assert fast_noise(smooth.runs[0], "current") < 1e-3 * NOISE


def broadband_campaign(stated):
    """A steep resonance under a multisine up to a third of half the sample rate, as an own rig would have it."""
    rng, time = np.random.default_rng(0), INTERVAL * np.arange(6000)
    frequencies = np.arange(2.0, 0.33 * 0.5 / INTERVAL, 2.0)
    gain = 1.0 / np.abs(1.0 - (frequencies / 200.0) ** 2 + 0.02j * frequencies / 200.0)
    phases = rng.uniform(0.0, 2.0 * np.pi, len(frequencies))
    signal = np.zeros(len(time))
    for f, g, phase in zip(frequencies, gain, phases, strict=True):
        signal += g * np.cos(2.0 * np.pi * f * time + phase)
    signal += stated * rng.standard_normal(len(time))
    campaign = campaign_of([signal], [{}], stated)
    return dataclasses.replace(campaign, machine=edhas.ActuatorBench(reference=edhas.Step()))


def test_the_content_of_a_broadband_record_is_no_noise():
    campaign = broadband_campaign(stated=0.002)
    assert fast_noise(campaign.runs[0], "current") > 2.5 * 0.002, "the fast part is signal"
    channel = used_channel(campaign)
    assert channel.noise == 0.002 and channel.measured_noise is None and not channel.is_noise_seen


@pytest.mark.parametrize("model_error", [0.0, 0.03])
def test_a_fit_refutes_a_noise_above_what_it_leaves(model_error):
    campaign = aperiodic_campaign(white, stated=NOISE)
    channel = dataclasses.replace(
        campaign.channels["current"], noise=math.hypot(3.0 * NOISE, model_error), sensor_noise=3.0 * NOISE,
        stated_noise=3.0 * NOISE, model_error=model_error,
    )  # fmt: skip
    campaign = dataclasses.replace(campaign, channels={"current": channel})
    left = NOISE * np.random.default_rng(1).standard_normal((3, 3000)) / channel.noise
    residuals = {run.name: {"current": row} for run, row in zip(campaign.runs, left, strict=True)}
    lowered = without_refuted_noise(campaign, residuals, 900)
    used = lowered.channels["current"]
    # 900 numbers fitted to 9000 samples have taken a tenth of the squares
    assert used.sensor_noise == used.fitted_noise == pytest.approx(NOISE / math.sqrt(0.9), rel=0.03)
    assert used.noise == pytest.approx(math.hypot(used.sensor_noise, model_error))
    said = f"The fit leaves only {used.fitted_noise:.3g} A of current (0.06 A stated): the noise cannot be larger"
    assert noise_sentence(lowered).startswith(said) and str(lowered.remarks[0]).endswith(noise_sentence(lowered))
    scale = channel.noise / NOISE
    as_large = {run: {"current": scale * of["current"]} for run, of in residuals.items()}
    assert without_refuted_noise(campaign, as_large, 900) is campaign


def test_stated_and_used_noise_are_told_alike_with_an_error_of_the_model():
    campaign = aperiodic_campaign(white, stated=2.0 * NOISE)
    channels = {"current": dataclasses.replace(campaign.channels["current"], model_error=0.1)}
    checked = checked_campaign(dataclasses.replace(campaign, channels=channels))
    sentences = {r.sentence for r in checked.remarks if "measured" in r.sentence} | {noise_sentence(checked)}
    assert len(sentences) == 1 and sentences.pop().endswith("The measured noise is used.")
