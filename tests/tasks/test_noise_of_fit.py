"""A fit does not go on with a noise that it refutes itself."""

from pathlib import Path

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax import Rig, drive, par, state
from edhas_jax.machine.components.set_points import Recorded
from edhas_jax.measurements.campaign import BenchRun, Campaign, Channel, Use
from edhas_jax.simulation.run import Simulation, simulate

NOISE, STATED = 2e-3, 9e-3  # V
TIME = 0.01 * np.arange(2400)


class Oscillator(Rig):
    """A mass on a spring, in volts."""

    time_step, duration = 2e-3, 24.0

    force = drive("V", "force", 0.0)
    natural_frequency: float = par(9.0, "Hz", (1.0, 40.0), "natural frequency")
    damping_ratio: float = par(0.1, "-", (1e-3, 1.0), "damping ratio")

    position = state("V", "position")
    velocity = state("V/s", "velocity")

    def equations(self, y, s):
        """Newton's law."""
        w = 2.0 * np.pi * self.natural_frequency
        return {
            "position": y.velocity,
            "velocity": w**2 * (s.force - y.position) - 2.0 * self.damping_ratio * w * y.velocity,
        }


@pytest.fixture(scope="module")
def campaign():
    """A broadband record that is nowhere quiet, with a fifth of the noise that is stated."""
    rng = np.random.default_rng(0)
    frequencies = np.arange(0.1, 20.0, 0.1)
    phases = rng.uniform(0.0, 2.0 * np.pi, len(frequencies))
    force = 0.05 * np.cos(2.0 * np.pi * np.outer(TIME, frequencies) + phases).sum(axis=1)
    drives = {"force": Recorded(values=force, interval=0.01)}
    machine = edhas.change(Oscillator(**drives), natural_frequency=9.3, damping_ratio=0.08)
    signals = simulate(machine, Simulation(duration=24.0, step=1e-4, sample_rate=100.0)).signals
    position = np.interp(TIME, signals["time"], signals["position"]) + NOISE * rng.standard_normal(len(TIME))
    lines = np.arange(len(TIME)) + 2
    run = BenchRun("run", Path("run.csv"), Use.FIT, {}, TIME, {"position": position}, lines, drives=drives)
    uncertain = {"natural_frequency": 0.05, "damping_ratio": 0.3}
    channels = {"position": Channel("V", STATED)}
    return Campaign("oscillator", Path("."), Oscillator(**drives), uncertain, channels, (run,), ())


def test_a_fit_goes_on_with_the_noise_that_it_leaves(campaign):
    found = edhas.fit(campaign, starts=1)
    used = found.fit.problem.campaign.channels["position"]
    assert used.noise == used.fitted_noise == pytest.approx(NOISE, rel=0.05)
    assert found.rms_residuals()["calibrated"]["fit"]["overall"] == pytest.approx(1.0, abs=0.01)
    assert found.findings()[0].startswith(f"The fit leaves only {used.noise:.3g} V of position (0.009 V stated")
    error = found.fit.standard_errors["natural_frequency"]
    assert found.fit.values["natural_frequency"] == pytest.approx(9.3, abs=4.0 * error)


def test_a_diagnosis_goes_on_with_the_noise_that_it_leaves(campaign):
    found = edhas.diagnose(campaign, library=())
    used = found.campaign.channels["position"]
    assert used.fitted_noise == pytest.approx(NOISE, rel=0.1)
    assert found.errors()["after"]["fit"]["overall"] == pytest.approx(1.0, abs=0.05)
