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


@pytest.mark.parametrize(
    ("name", "parameter"), [("first_order_noise", 0.6), ("slow_noise", 0.3), ("flicker_noise", 0.3)]
)
def test_correlated_noise_has_unit_variance_and_is_whitened(name, parameter):
    link, rng = LINKS[name], np.random.default_rng(0)
    noise = np.array([link.act(rng, 500, parameter) for _ in range(200)])
    assert noise.std() == pytest.approx(1.0, abs=0.02)
    correlation = np.mean(noise[:, 1:] * noise[:, :-1])
    flicker = 0.3 * np.mean(np.exp(-1.0 / np.array([4.0, 16.0, 64.0, 256.0])))
    expected = {"first_order_noise": 0.6, "slow_noise": 0.3 * 0.88, "flicker_noise": flicker}[name]
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
