"""The gallery of real machines on records of the same shape that are made here, with a known spring."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from studies.real_machines.gallery import main
from tests.support.headline import headline

FREQUENCY, DAMPING, HARDENING, INTERVAL = 68.0, 0.05, 4e6, 1.0 / 610.0


def write_record(file, seed, scale):
    """A record of an oscillator with a cubic spring that noise below 150 Hz drives; `scale` its amplitude over time."""
    rng, count = np.random.default_rng(seed), 700
    time = INTERVAL * np.arange(count)
    spectrum = np.fft.rfft(rng.standard_normal(count)) * (np.fft.rfftfreq(count, INTERVAL) < 150.0)
    force = scale(time) * np.fft.irfft(spectrum, count)
    w = 2.0 * np.pi * FREQUENCY

    def rates(t, y):
        pull = w**2 * (np.interp(t, time, force) - y[0]) - 2.0 * DAMPING * w * y[1]
        return [y[1], pull - HARDENING * y[0] ** 3]

    position = solve_ivp(rates, (0.0, time[-1]), [0.0, 0.0], t_eval=time, rtol=1e-7, atol=1e-9).y[0]
    reading = position + rng.normal(0.0, 5e-4, count)
    header = "time [s],V1 [V],V2 [V]"
    np.savetxt(file, np.column_stack([time, force, reading]), delimiter=",", header=header, comments="")


@pytest.fixture(scope="module")
def gallery(tmp_path_factory):
    folder = tmp_path_factory.mktemp("records")
    (folder / "silverbox").mkdir()
    write_record(folder / "silverbox" / "multisine.csv", 1, lambda t: 0.02 + 0.0 * t)
    write_record(folder / "silverbox" / "arrow.csv", 2, lambda t: 0.04 * t / t[-1])
    return folder


def test_the_spring_is_found_and_explains_the_record_that_was_not_used(gallery, tmp_path, capsys):
    main([str(gallery), "--out", str(tmp_path)])
    found = headline(capsys)
    assert found["machines"] == "1" and found["right_place"] == "1"
    assert float(found["silverbox_last"]) < 0.25 * float(found["silverbox_fitted"])
    page = (tmp_path / "page.md").read_text(encoding="utf-8")
    assert "most likely it acts on spring" in page and "cubic_spring" in page
    assert (tmp_path / "silverbox.png").stat().st_size > 10_000
