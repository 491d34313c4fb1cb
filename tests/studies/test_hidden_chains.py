"""The links of the generator's sensor chains, each by what it does to a known signal."""

import numpy as np
import pytest

from studies.hidden_effects.generators.chains import DrawnLink, Place, draw_links, late_signals, typical_noise
from studies.hidden_effects.generators.content import CONTENT
from studies.hidden_effects.generators.hidden_case import Split
from studies.hidden_effects.generators.visibility import whitening_filter

LINKS = {link.id: link for split in Split for link in CONTENT[split].links}
INTERVAL = 4e-5
TIME = INTERVAL * np.arange(25001)
SAMPLES = np.sin(np.linspace(0.0, 60.0, 40000))


def gain_and_delay(link, parameter, frequency):
    """Amplitude over that of the input, and delay [s], of a sine behind a link that acts on signals."""
    response = link.act(INTERVAL, np.sin(2.0 * np.pi * frequency * TIME), parameter)[5000:]
    turn = np.exp(-2j * np.pi * frequency * TIME[5000:])
    phasor = 2j * np.mean(response[:20000] * turn[:20000])
    return abs(phasor), -np.angle(phasor) / (2.0 * np.pi * frequency)


def test_filters():
    """Gain and delay of the Butterworth and RC filters and of the mean over a window, at a frequency they all pass."""
    assert gain_and_delay(LINKS["second_order_filter"], 900.0, 900.0)[0] == pytest.approx(1.0 / np.sqrt(2.0), abs=0.01)
    gain, delay = gain_and_delay(LINKS["second_order_filter"], 900.0, 50.0)
    assert gain == pytest.approx(1.0, abs=0.01) and delay == pytest.approx(np.sqrt(2.0) / (2 * np.pi * 900), rel=0.02)
    gain, delay = gain_and_delay(LINKS["first_order_filter"], 0.2e-3, 50.0)
    assert gain == pytest.approx(1.0 / np.hypot(1.0, 2 * np.pi * 50 * 0.2e-3), abs=0.002)
    assert delay == pytest.approx(0.2e-3, rel=0.12)
    gain, delay = gain_and_delay(LINKS["moving_average"], 0.8e-3, 500.0)
    assert gain == pytest.approx(np.sinc(500 * 0.8e-3), abs=0.01) and delay == pytest.approx(0.38e-3, abs=0.01e-3)
    for name in ("second_order_filter", "first_order_filter", "moving_average"):
        steady = LINKS[name].act(INTERVAL, np.full(200, 3.0), np.mean(LINKS[name].plausible))
        np.testing.assert_allclose(steady, 3.0)


def test_clocks():
    times = 2e-4 * np.arange(1001)
    np.testing.assert_allclose(LINKS["trigger_early"].act(times, 1e-4), times - 1e-4)
    np.testing.assert_allclose(LINKS["trigger_late"].act(times, 1e-4), times + 1e-4)
    # a clock that is 0.1 % fast shows 1.001 s when 1 s has passed
    assert LINKS["clock_fast"].act(np.array([1.001]), 1e-3) == pytest.approx(1.0)


def test_the_filters_of_the_judging_cases():
    """The resonance of the transducer at its frequency, and gain and delay of three means in a row."""
    transducer, decimation = LINKS["underdamped_transducer"], LINKS["decimation_filter"]
    assert gain_and_delay(transducer, 800.0, 800.0)[0] == pytest.approx(1.0 / (2.0 * 0.25), rel=0.03)
    gain, delay = gain_and_delay(transducer, 800.0, 50.0)
    assert gain == pytest.approx(1.0, abs=0.01) and delay == pytest.approx(2.0 * 0.25 / (2 * np.pi * 800), rel=0.03)
    gain, delay = gain_and_delay(decimation, 0.4e-3, 500.0)
    assert gain == pytest.approx(np.sinc(500 * 0.4e-3) ** 3, abs=0.01) and delay == pytest.approx(0.54e-3, abs=0.01e-3)
    for link in (transducer, decimation):
        np.testing.assert_allclose(link.act(INTERVAL, np.full(200, 3.0), np.mean(link.plausible)), 3.0)


def test_the_clocks_of_the_judging_cases():
    times = 2e-4 * np.arange(1001)
    late = LINKS["clock_warms_up"].act(times, 2e-3) - times
    assert late[500] == pytest.approx(1e-5) and late[1000] == pytest.approx(4e-5)  # with the square of time
    skewed = LINKS["interleaved_converters"].act(times, 3e-5) - times
    np.testing.assert_allclose(skewed[:4], [0.0, 3e-5, 0.0, 3e-5], atol=1e-12)


@pytest.mark.parametrize(
    ("name", "parameter"),
    [("first_order_noise", 0.6), ("slow_noise", 0.3), ("flicker_noise", 0.3), ("differenced_noise", 0.6),
     ("telegraph_noise", 0.3)],
)  # fmt: skip
def test_correlated_noise_has_unit_variance_and_is_whitened(name, parameter):
    link, rng = LINKS[name], np.random.default_rng(0)
    noise = np.array([link.act(rng, 500, parameter) for _ in range(200)])
    assert noise.std() == pytest.approx(1.0, abs=0.02)
    correlation = np.mean(noise[:, 1:] * noise[:, :-1])
    flicker = 0.3 * np.mean(np.exp(-1.0 / np.array([4.0, 16.0, 64.0, 256.0])))
    expected = {
        "first_order_noise": 0.6, "slow_noise": 0.3 * 0.88, "flicker_noise": flicker,
        "differenced_noise": -0.6 / (1.0 + 0.6**2), "telegraph_noise": 0.3 * (1.0 - 2.0 * 0.02),
    }[name]  # fmt: skip
    assert correlation == pytest.approx(expected, abs=0.02)
    record = typical_noise([DrawnLink(link, parameter, ("current",))])
    white = np.convolve(record, whitening_filter(record), mode="valid")
    assert white.std() == pytest.approx(1.0, abs=0.02)
    assert max(abs(np.corrcoef(white[k:], white[: len(white) - k])[0, 1]) for k in (1, 2, 5, 10)) < 0.02


def test_spikes_bursts_and_missing_samples():
    rng = np.random.default_rng(1)
    off = np.abs(LINKS["spikes"].act(rng, SAMPLES, 0.01, 2e-3) - SAMPLES)
    assert np.mean(off > 0.0) == pytest.approx(2e-3, rel=0.3) and off[off > 0.0].min() >= 0.1 - 1e-12
    off = LINKS["bursts"].act(rng, SAMPLES, 0.01, 1e-3) - SAMPLES
    changed = np.flatnonzero(off)
    assert 2e-3 < len(changed) / len(SAMPLES) < 5e-3 and np.mean(np.diff(changed) == 1) > 0.5
    missing = np.isnan(LINKS["missing_samples"].act(rng, SAMPLES, 0.01, 2e-3))
    assert 2e-3 * 3.5 < missing.mean() < 2e-3 * 5.5


def test_glitches_and_lost_stretches():
    rng = np.random.default_rng(2)
    off = LINKS["ringing_glitches"].act(rng, SAMPLES, 0.01, 5e-4) - SAMPLES
    first = np.flatnonzero(off)[0]
    assert 0.08 <= abs(off[first]) <= 0.3 and off[first + 1] == pytest.approx(-0.6 * off[first])
    assert 8 * 5e-4 * 0.5 < np.mean(off != 0.0) < 8 * 5e-4 * 1.5
    lost = np.flatnonzero(np.isnan(LINKS["lost_stretch"].act(rng, SAMPLES, 0.01, 0.03)))
    assert len(lost) == 0.03 * len(SAMPLES) and (np.diff(lost) == 1).all()


def test_a_converter_that_changes_its_range_and_a_curved_characteristic():
    rounded = LINKS["gain_ranging_converter"].act(np.random.default_rng(0), SAMPLES, 0.01, 1000.0)
    small = np.abs(SAMPLES) < 0.2
    assert np.abs(rounded - SAMPLES).max() <= 0.5e-3 + 1e-12
    assert np.abs(rounded - SAMPLES)[small].max() <= 0.125e-3 + 1e-12
    curved = LINKS["curved_characteristic"].act(np.random.default_rng(0), np.array([-10.0, 0.0, 5.0]), 0.01, 2e-3)
    np.testing.assert_allclose(curved, [-10.0 + 0.02, 0.0, 5.0 + 0.005])


def test_a_converter_of_twelve_bits():
    rounded = LINKS["twelve_bits"].act(np.random.default_rng(0), SAMPLES, 0.01, 2.0)
    step = np.diff(np.unique(rounded)).min()
    assert step == pytest.approx(2.0 * 2.0 * np.abs(SAMPLES).max() / 4096)
    assert np.abs(rounded - SAMPLES).max() <= 0.5 * step + 1e-12


def test_links_of_a_chain_act_in_different_places():
    for split in Split:
        for seed in range(20):
            chain = draw_links(CONTENT[split].links, ("voltage", "current"), np.random.default_rng(seed))
            places = [link.link.place for link in chain]
            assert 1 <= len(chain) <= 3 and len(set(places)) == len(places)
            assert all(link.signals for link in chain)
            shifting = [link for link in chain if link.link.place in (Place.SIGNAL, Place.CLOCK)]
            assert sorted(late_signals(chain)) == sorted({name for link in shifting for name in link.signals})
            assert all(set(link.signals) == {"voltage", "current"} for link in chain if link.link.everywhere)
            for link in chain:
                assert link.link.plausible[0] <= link.value <= link.link.plausible[1]
