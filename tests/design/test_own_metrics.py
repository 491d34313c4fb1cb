"""Metrics that a rig of one's own declares: the same in a run, a batch, its derivatives and a sweep."""

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax import Final, Mean, Peak, Rig, Simulation, WholeRun, drive, metric, par, state
from edhas_jax.design.batch.batch import BatchSettings, run_designs
from edhas_jax.design.gradient.fixed_point import GradientSettings

CURRENT = Mean(lambda m, s: s.current)


class Winding(Rig):
    """A voltage on resistance and inductance: i = (u/R) (1 − e^(−t R/L))."""

    time_step, duration = 1e-4, 0.05
    voltage = drive("V", "voltage", 12.0)
    resistance: float = par(2.0, "ohm", (0.1, 10.0), "resistance")
    inductance: float = par(0.02, "H", (1e-3, 1.0), "inductance")
    current = state("A", "current")

    loss = metric("W", "mean loss", Mean(lambda m, s: m.resistance * s.current**2), rank=1)
    evenness = metric("-", "mean over largest current", (CURRENT, Peak(lambda m, s: s.current)), lambda m, x, y: x / y,
                      shown="%", rank=2)  # fmt: skip
    stored = metric("J", "energy at the end", Final(lambda m, s: 0.5 * m.inductance * s.current**2))
    half = metric("s", "time to half of the last current",
                  WholeRun(lambda m, s: np.interp(0.5 * s.current[-1], s.current, s.time)))  # fmt: skip

    def equations(self, y, s):
        return {"current": (s.voltage - self.resistance * y.current) / self.inductance}


SETTINGS = BatchSettings(step=1e-4, duration=0.05, sample_rate=1000.0)
RATE = Simulation(duration=0.05, sample_rate=1000.0, step=0.5e-4)


def closed_form(r, inductance=0.02, u=12.0, end=0.05):
    """Loss, evenness, stored energy and half time."""
    tau, i = inductance / r, u / r
    decay = np.exp(-end / tau)
    mean = i * (1 - tau / end * (1 - decay))
    square = i**2 * (1 - 2 * tau / end * (1 - decay) + tau / (2 * end) * (1 - decay**2))
    last = i * (1 - decay)
    return r * square, mean / last, 0.5 * inductance * last**2, -tau * np.log(1 - 0.5 * last / i)


def test_a_run_has_them_in_closed_form():
    metrics = edhas.simulate(Winding(), RATE).metrics
    found = [metrics[n].value for n in ("loss", "evenness", "stored", "half")]
    assert found == pytest.approx(closed_form(2.0), rel=2e-3), "linear between samples at a tenth of the time constant"
    assert str(metrics["evenness"]).endswith(" %") and metrics["loss"].doc == "mean loss"


def test_a_batch_has_those_of_each_single_run():
    resistance = np.array([1.0, 2.0, 4.0])
    table = run_designs(Winding(), {"resistance": resistance}, SETTINGS)
    assert "half" not in table, "it needs all samples at once"
    for k, r in enumerate(resistance):
        single = edhas.simulate(edhas.change(Winding(), resistance=r), RATE).metrics
        for name in ("loss", "evenness", "stored", "rms_current", "largest_current"):
            assert table[name][k] == pytest.approx(single[name].value, rel=1e-9), name


def test_derivatives_count_the_parameter_in_the_metric_itself():
    frame = edhas.gradient(Winding(), ["loss", "evenness", "stored"], ["resistance", "inductance"],
                           settings=GradientSettings(run=SETTINGS)).frame  # fmt: skip
    for name, value in (("resistance", 2.0), ("inductance", 0.02)):
        ends = [run_designs(Winding(), {name: np.array([value * (1 + d)])}, BatchSettings(0.5e-4, duration=0.05,
                sample_rate=1000.0)) for d in (-1e-5, 1e-5)]  # fmt: skip
        for row in frame[frame["parameter"] == name].itertuples():
            difference = (ends[1][row.metric][0] - ends[0][row.metric][0]) / (2e-5 * value)
            assert row.derivative == pytest.approx(difference, rel=1e-3), (name, row.metric)


@pytest.mark.parametrize("through_files", [False, True])
def test_a_sweep_knows_their_units_and_shows_them_first(through_files, tmp_path):
    folder = tmp_path / "swept" if through_files else None
    axes = {"resistance": (1.0, 4.0, 4), "inductance": (0.01, 0.02, 3)}
    table = edhas.sweep(Winding(), folder=folder, settings=SETTINGS, **axes)
    assert table.loss.attrs["units"] == "W" and table.evenness.attrs["shown"] == "%"
    assert table.result().leading[:3] == ["loss", "evenness", "mean_voltage"]
    assert "loss" in table.plot_heat().get_suptitle()
