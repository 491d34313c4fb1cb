"""The numbers of an exported unit are doubles, whatever precision the process has set."""

import shutil

import jax
import pytest

import edhas_jax as edhas
from edhas_jax.config.machine_config import build_config
from tests.support.fmu_unit import Unit, difference

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")

CONFIG = {
    "rig": "actuator_bench", "reference": {"kind": "sine", "frequency": "30 Hz", "ramp_time": "20 ms"},
    "simulation": {"duration": "0.06 s", "sample_rate": "2 kHz"},
}  # fmt: skip
SAMPLES = 121
ROUNDING = 1e-10  # share of the range of a signal


def test_a_unit_exported_from_a_process_in_single_precision_equals_the_simulation(tmp_path):
    """The command line and most users' processes leave JAX at its single precision."""
    with jax.enable_x64(False):
        unit = Unit(tmp_path / "machine.fmu", build_config(CONFIG))
    run = edhas.simulate(unit.config.machine, unit.config.simulation)
    assert difference(unit.run(unit.instance(), SAMPLES), run.signals) < ROUNDING
