"""Single precision agrees with double precision."""

import numpy as np
import pytest

from edhas_jax.simulation.metrics import metric_window
from edhas_jax.simulation.run_settings import Precision
from tests.support.reference import rms


@pytest.mark.parametrize("name", ["pump_10hz", "pump_30hz"])
def test_float32_agrees_with_float64(name, run):
    double, single = run(name), run(name, precision=Precision.FLOAT32)
    assert single.step == pytest.approx(double.step, rel=1e-6)
    for signal, values in double.signals.items():
        assert rms(single.signals[signal] - values) <= 1e-2 * max(np.ptp(values), 1e-30), signal
    assert single.metrics["mean_flow"].value == pytest.approx(double.metrics["mean_flow"].value, rel=1e-3)
    assert metric_window(double.machine, double.signals["time"][-1])[0] > 0.0
    assert abs(single.energy_residual()) < 1e-3
