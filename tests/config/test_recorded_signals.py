"""Recorded set points: read from tables, resampled where uneven, written back into a configuration."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
import yaml

from edhas_jax import Rig, drive, state
from edhas_jax.config.machine_config import ConfigError, build_config, read_config
from edhas_jax.config.writer import dump_config
from edhas_jax.core.structs import replace
from edhas_jax.machine.components.set_points import Recorded
from edhas_jax.machine.rigs import PumpBench
from tests.config.test_config import same


class Pack(Rig):
    """A shaft whose drives have units of all kinds."""

    time_step, duration = 1e-2, 1.0

    torque = drive("N*m", "torque of the motor", 6.0)
    opening = drive("-", "opening of a valve", 0.5)
    oil = drive("K", "temperature of the oil", 313.15)
    speed = state("rad/s", "speed of the shaft")

    def equations(self, y, s):
        return {"speed": s.torque - s.opening * y.speed * s.oil / 300.0}


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


def test_columns_that_are_not_wanted_may_hold_anything(tmp_path):
    """Semicolons, decimal commas, a column of words and one with gaps, as a recorder writes them."""
    (tmp_path / "bench.csv").write_text("time [ms];u [mm];remark;v [mm]\n0;0;start;\n1,5;1;;7\n3;2;OK;overload\n")
    data = {"rig": "pump_bench", "reference": {"kind": "recorded", "file": "bench.csv", "column": "u"}}
    recorded = build_config(data, base_dir=tmp_path).machine.reference
    assert recorded.interval == pytest.approx(1.5e-3) and recorded.values == pytest.approx([0.0, 1e-3, 2e-3])
    data["reference"]["column"] = "v"
    with pytest.raises(ConfigError, match="`v`: .overload. is not a number"):
        build_config(data, base_dir=tmp_path)


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
    with pytest.raises(ConfigError, match="one such as V is needed"):
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


@pytest.mark.parametrize(
    ("name", "header", "expected"),
    [
        ("torque", "torque [N*m]", [6.0, 3.0]),
        ("torque", "torque [kN*mm]", [6.0, 3.0]),
        ("opening", "opening", [6.0, 3.0]),
        ("opening", "opening [-]", [6.0, 3.0]),
        ("opening", "opening [%]", [0.06, 0.03]),
        ("oil", "oil [degC]", [279.15, 276.15]),
    ],
)
def test_a_drive_of_any_unit_is_recorded(tmp_path, name, header, expected):
    (tmp_path / "bench.csv").write_text(f"time [s],{header}\n0,6\n1,3\n")
    m = build_config({"rig": Pack, name: {"kind": "recorded", "file": "bench.csv"}}, base_dir=tmp_path).machine
    np.testing.assert_allclose(getattr(m, name).values, expected, rtol=1e-14)


def test_another_unit_or_none_is_refused_with_the_usual_unit_of_the_drive(tmp_path):
    (tmp_path / "bench.csv").write_text("time [s],a [bar],b\n0,6,6\n1,3,3\n")
    for column, sentence in (("a", r"has the unit bar; one such as N·m is needed"), ("b", "one such as N·m is needed")):
        with pytest.raises(ConfigError, match=sentence):
            section = {"kind": "recorded", "file": "bench.csv", "column": column}
            build_config({"rig": Pack, "torque": section}, base_dir=tmp_path)


def test_between_samples_a_record_is_held_or_a_line_and_two_rows_at_one_time_are_a_step(tmp_path):
    (tmp_path / "bench.csv").write_text("time [s],u [N*m]\n0,0\n1,1\n2,2\n2,5\n2,7\n3.5,7\n4,7\n")
    section, at = {"kind": "recorded", "file": "bench.csv"}, np.array([-1.0, 0.5, 1.0, 1.999, 2.0, 3.0, 9.0])
    for between, expected in (
        ("line", [0.0, 0.5, 1.0, 1.999, 7.0, 7.0, 7.0]),
        ("hold", [0.0, 0.0, 1.0, 1.0, 7.0, 7.0, 7.0]),
    ):
        data = {"rig": Pack, "torque": section | {"between": between}}
        config = build_config(data, base_dir=tmp_path)
        recorded = config.machine.torque
        atol = 0.13 if between == "line" else 0.0  # a cubic rounds the corner before the step
        np.testing.assert_allclose([recorded.value_and_rate(t)[0] for t in at], expected, atol=atol)
        np.testing.assert_allclose(recorded.sampled(at[at < 4.0]), expected[:-1], atol=atol)
        written = build_config(yaml.safe_load(dump_config(config.machine)) | {"rig": Pack})
        assert same(written.machine, config.machine)
    with pytest.raises(ConfigError, match="torque.between: one of line, hold belongs here; got linear"):
        build_config({"rig": Pack, "torque": section | {"between": "linear"}}, base_dir=tmp_path)
