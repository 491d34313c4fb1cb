"""The links of the generator's sensor chains, each by what it does to a known signal."""

import numpy as np
import pytest

from studies.hidden_effects.generators.chains import DrawnLink, Place, draw_links, typical_noise
from studies.hidden_effects.generators.content import CONTENT
from studies.hidden_effects.generators.hidden_case import Split
from studies.hidden_effects.generators.visibility import whitening_filter

LINKS = {link.id: link for split in Split for link in CONTENT[split].links}
NUMBERED = [  # by split and number: the output of tests says nothing of what judges
    pytest.param(link, id=f"{split.value} {k}") for split in Split for k, link in enumerate(CONTENT[split].links)
]


def at(place: Place) -> list:
    """The links that act in a place."""
    return [of for of in NUMBERED if of.values[0].place is place]


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
    """Gain and delay of three lags in a row, and of a smoother that looks ahead."""
    gain, delay = gain_and_delay(LINKS["three_poles"], 0.4e-3, 50.0)
    assert gain == pytest.approx(np.hypot(1.0, 2 * np.pi * 50 * 0.4e-3) ** -3.0, abs=0.005)
    assert delay == pytest.approx(3.0 * 0.4e-3, rel=0.06)
    gain, delay = gain_and_delay(LINKS["smoothing_software"], 0.4e-3, 200.0)
    assert gain == pytest.approx(np.exp(-0.5 * (2 * np.pi * 200 * 0.4e-3) ** 2), abs=0.005) and abs(delay) < 1e-6
    gain, _ = gain_and_delay(LINKS["compensated_transducer"], 5e-3, 300.0)
    assert gain == pytest.approx(1.25, abs=0.01)


@pytest.mark.parametrize("link", at(Place.SIGNAL))
def test_a_filter_leaves_a_steady_signal(link):
    """On a fine grid of time and on that of a slow machine; a slow sine passes it too, a little late."""
    low, high = link.plausible
    for parameter in (low, high):
        for interval in (INTERVAL, 20 * INTERVAL) if high < 1.0 else (INTERVAL,):
            np.testing.assert_allclose(link.act(interval, np.full(200, 3.0), parameter), 3.0)
        gain, delay = gain_and_delay(link, parameter, 5.0)
        assert gain == pytest.approx(1.0, abs=0.02) and abs(delay) < 2e-3


def test_clocks():
    times = 2e-4 * np.arange(1001)
    lost = LINKS["buffer_overrun"].act(times, 1e-4) - times
    assert lost[:400].max() == 0.0 and lost[402:] == pytest.approx(1e-4)
    wandering = LINKS["unsteady_clock"].act(times, 1e-4) - times
    assert 0.8e-4 < np.abs(wandering).max() <= 1e-4 and wandering[0] == 0.0
    for link in (link for link in LINKS.values() if link.place is Place.CLOCK):
        off = np.abs(link.act(times, link.plausible[1]) - times)
        assert 0.0 < off.max() < 1e-3, link.id


@pytest.mark.parametrize(
    ("name", "parameter"),
    [("slow_noise", 0.3), ("heavy_tails", 0.1), ("growing_noise", 2.0)],
)
def test_correlated_noise_has_unit_variance_and_is_whitened(name, parameter):
    link, rng = LINKS[name], np.random.default_rng(0)
    noise = np.array([link.act(rng, 500, parameter) for _ in range(200)])
    assert noise.std() == pytest.approx(1.0, abs=0.02)
    correlation = np.mean(noise[:, 1:] * noise[:, :-1])
    expected = {"slow_noise": 0.3 * 0.88}
    assert correlation == pytest.approx(expected.get(name, 0.0), abs=0.02)
    record = typical_noise([DrawnLink(link, parameter, ("current",))])
    white = np.convolve(record, whitening_filter(record), mode="valid")
    assert white.std() == pytest.approx(1.0, abs=0.02)
    assert max(abs(np.corrcoef(white[k:], white[: len(white) - k])[0, 1]) for k in (1, 2, 5, 10)) < 0.02


@pytest.mark.parametrize("link", at(Place.NOISE))
def test_noise_has_unit_variance(link):
    rng = np.random.default_rng(0)
    for parameter in link.plausible:
        noise = np.array([link.act(rng, 1000, parameter) for _ in range(300)])
        assert noise.std() == pytest.approx(1.0, abs=0.02) and abs(noise.mean()) < 0.02


def test_hum_has_its_share_of_the_variance():
    link, rng = LINKS["line_noise"], np.random.default_rng(0)
    noise = np.array([link.act(rng, 1000, 0.4) for _ in range(100)])
    assert noise.std() == pytest.approx(1.0, abs=0.02)
    power = np.mean(np.abs(np.fft.rfft(noise, axis=1)) ** 2, axis=0) / (0.5 * 1000**2)
    assert np.argmax(power) == 17 and power[17] == pytest.approx(0.4, rel=0.05)


def test_values_that_are_sent_when_they_change():
    rng = np.random.default_rng(1)
    sent = LINKS["send_on_delta"].act(rng, SAMPLES, 0.01, 2.0)
    steps = np.abs(np.diff(sent))
    assert np.abs(sent - SAMPLES).max() <= 0.02 and steps[steps > 0.0].min() > 0.02


def test_sensors_within_their_accuracy():
    """A gain that drifts by 0.2 % over the record, and a hysteresis of 0.1 % of the range."""
    rng = np.random.default_rng(0)
    ratio = LINKS["drifting_gain"].act(rng, np.full(101, 2.0), 0.01, 2e-3) / 2.0
    assert abs(ratio[-1] - ratio[0]) == pytest.approx(2e-3) and ratio[50] == pytest.approx(1.0)
    rising = np.linspace(-1.0, 1.0, 101)
    late = LINKS["sensor_hysteresis"].act(rng, np.concatenate([rising, rising[::-1]]), 1e-6, 1e-3)
    assert late[50] == pytest.approx(-1e-3, rel=1e-3) and late[151] == pytest.approx(1e-3, rel=1e-3)


def test_a_companding_converter_is_finer_near_zero():
    rounded = LINKS["companding_converter"].act(np.random.default_rng(0), SAMPLES, 0.01, 1.0)
    small = np.abs(SAMPLES) < 0.05
    assert np.abs(rounded - SAMPLES)[small].max() < 0.3 * np.abs(rounded - SAMPLES).max()
    assert np.abs(rounded - SAMPLES).max() < 0.05


@pytest.mark.parametrize("link", at(Place.SAMPLES))
def test_samples_stay_near_what_they_were(link):
    """On the average within a few times the noise, and not all as they were."""
    for parameter in link.plausible:
        off = link.act(np.random.default_rng(0), SAMPLES, 0.01, parameter) - SAMPLES
        assert 0.0 < np.sqrt(np.mean(off**2)) < 0.03 and off.shape == SAMPLES.shape


def test_statements_of_the_noise():
    rng = np.random.default_rng(0)
    assert np.isnan(LINKS["noise_not_stated"].act(rng, 1.0))
    found = {round(LINKS["noise_of_a_data_sheet"].act(rng, 1.0), 3) for _ in range(20)}
    assert found == {round(10**-0.5, 3), round(10**0.5, 3)}


def test_links_of_a_chain_act_in_different_places():
    for split in Split:
        for seed in range(20):
            chain = draw_links(CONTENT[split].links, ("voltage", "current"), np.random.default_rng(seed))
            places = [link.link.place for link in chain]
            assert 1 <= len(chain) <= 3 and len(set(places)) == len(places)
            assert all(link.signals for link in chain)
            assert all(set(link.signals) == {"voltage", "current"} for link in chain if link.link.everywhere)
            for link in chain:
                assert link.link.plausible[0] <= link.value <= link.link.plausible[1]
