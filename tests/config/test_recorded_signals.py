"""Recorded set points: read from tables, resampled where uneven, written back into a configuration."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
import yaml

from edhas_jax.config.machine_config import ConfigError, build_config, read_config
from edhas_jax.config.writer import dump_config
from edhas_jax.core.structs import replace
from edhas_jax.machine.components.set_points import Recorded
from edhas_jax.machine.rigs import PumpBench
from tests.config.test_config import same


def write_recording(path: Path, time, **columns) -> None:
    frame = pd.DataFrame({"time [s]": time} | {name.replace("__", " [") + "]": v for name, v in columns.items()})
    frame.to_parquet(path) if path.suffix == ".parquet" else frame.to_csv(path, index=False)


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_recorded_reference(tmp_path, suffix):
    time = 0.25 + 1e-3 * np.arange(200)
    write_recording(tmp_path / f"bench.{suffix}", time, reference_position__mm=np.sin(40 * time), voltage__V=time)
    text = f"rig: pump_bench\nreference: {{kind: recorded, file: bench.{suffix}, column: reference_position}}\n"
    (tmp_path / "a.yaml").write_text(text)
    config = read_config(tmp_path / "a.yaml")
    r = config.machine.reference
    assert isinstance(r, Recorded)
    assert r.interval == pytest.approx(1e-3)
    assert r.start == 0.25
    assert np.allclose(r.values, 1e-3 * np.sin(40 * time), atol=1e-12)
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep/b.yaml").write_text(dump_config(config), encoding="utf-8")
    assert same(read_config(tmp_path / "deep/b.yaml").machine, config.machine)


def test_unequal_samples_are_resampled(tmp_path):
    rng = np.random.default_rng(0)
    time = np.cumsum(1e-3 * (1.0 + 0.2 * rng.uniform(-1, 1, 500)))
    write_recording(tmp_path / "bench.csv", time, reference_position__m=1e-3 * np.sin(20 * time))
    data = {"rig": "pump_bench", "reference": {"kind": "recorded", "file": "bench.csv"}}
    m = build_config(data, base_dir=tmp_path).machine
    even = m.reference.start + m.reference.interval * np.arange(m.reference.values.shape[0])
    assert even[-1] <= time[-1] + 1e-12
    assert np.allclose(m.reference.values, 1e-3 * np.sin(20 * even), atol=1e-6)


def test_open_loop_replays_amperes_through_a_current_amplifier(tmp_path):
    time = 1e-3 * np.arange(50)
    write_recording(tmp_path / "bench.csv", time, current__mA=1e3 * time, reference_position__mm=time)
    data = {
        "rig": "actuator_bench",
        "controller": {"kind": "open_loop"},
        "amplifier": {"kind": "current", "amplifier_gain": "2 A/V"},
        "reference": {"kind": "recorded", "file": "bench.csv", "column": "current"},
    }
    assert np.allclose(build_config(data, base_dir=tmp_path).machine.reference.values, time / 2.0)
    gained = build_config(data, ["amplifier_gain=4 A/V"], base_dir=tmp_path).machine
    assert np.allclose(gained.reference.values, time / 4.0)
    with pytest.raises(ConfigError, match="a voltage"):
        build_config(data | {"amplifier": {"kind": "voltage"}}, base_dir=tmp_path)


def test_samples_without_a_file_are_written_out():
    values = jnp.asarray(np.random.default_rng(0).normal(size=100))
    machine = replace(PumpBench(), reference=Recorded(values=values, interval=1 / 3000, start=0.1))
    text = dump_config(machine)
    config = build_config(yaml.safe_load(text))
    assert same(config.machine, machine)
    assert np.array_equal(config.machine.reference.values, values)
    assert dump_config(config) == text
    with pytest.raises(ConfigError, match="reference.samples: not as a run writes them"):
        build_config({"rig": "pump_bench", "reference": {"kind": "recorded", "samples": "AAAA"}})
