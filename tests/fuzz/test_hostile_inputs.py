"""No input makes the program print a traceback, hang, crash or run code that came with it.

300 inputs, always the same, with the other tests; `make fuzz` makes 5,000 new ones.
"""

import os
import re
import shutil
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.fuzz import damage
from tests.fuzz.worker import REOPEN, Outcome, Worker
from tests.support import CONFIGS, DATA

INPUTS = int(os.environ.get("EDHAS_FUZZ_INPUTS", "300"))
SHARES = {
    "configurations": 0.25, "settings": 0.2, "campaign descriptions": 0.15, "recordings": 0.2, "comparisons": 0.01,
    "design tables": 0.09, "sweep folders": 0.05, "run folders": 0.05,
}  # fmt: skip
MAX_MESSAGE_LINES = 10
COMPARISON_TIME_LIMIT = 60.0  # s, for it compiles a model and draws pictures
STATUSES = (0, 1, 2, 3)
EVIL = """
from pathlib import Path
Path(__file__).with_name("code_ran").touch()
import edhas_jax as edhas
class Evil(edhas.Effect):
    id = "evil"
class X:
    pass
"""


def share_of_inputs(kind: str):
    """Hypothesis settings that give a kind of input its share of `INPUTS`."""
    return settings(
        max_examples=max(round(INPUTS * SHARES[kind]), 1), deadline=None,
        derandomize="EDHAS_FUZZ_INPUTS" not in os.environ, database=None, suppress_health_check=list(HealthCheck),
        print_blob=False,
    )  # fmt: skip


@pytest.fixture(scope="module")
def worker(tmp_path_factory):
    """One process for all commands, with folders of its own for what the user has allowed."""
    home = tmp_path_factory.mktemp("home")
    process = Worker({"XDG_CONFIG_HOME": str(home / "config"), "MPLBACKEND": "Agg"})
    yield process
    process.stop()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder in which every input is written, beside a file with code that must not run."""
    return tmp_path_factory.mktemp("inputs")


def prepare(folder: Path) -> Path:
    """An empty folder again, but for the code that must not run."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for name in ("evil.py", "notes.py"):
        (folder / name).write_text(EVIL)
    return folder


def check(outcome: Outcome, folder: Path) -> Outcome:
    """What holds after every command."""
    assert not outcome.uncaught, outcome.uncaught
    assert outcome.status in STATUSES, outcome
    assert not list(folder.rglob("code_ran")), "code that came with the input ran"
    assert "Traceback" not in outcome.message + outcome.output
    assert not re.search(r"\b\w*Warning: ", outcome.message), outcome.message  # written for developers
    if outcome.status == 2:
        lines = outcome.message.strip().splitlines()
        assert lines and lines[-1].strip(), "wrong input without a message"
        assert any(line.startswith(("edhas", "usage: edhas")) for line in lines), outcome.message
        if not lines[0].startswith("usage:"):
            assert len(lines) <= MAX_MESSAGE_LINES, outcome.message
    return outcome


def written(folder: Path, name: str, text: bytes | str) -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8", "surrogatepass"))
    return path


def csv(rows: list[list[str]]) -> str:
    return "".join(",".join(row) + "\n" for row in rows)


def documents(text: str, names=()):
    """A YAML document damaged as a tree or as a text."""
    return st.one_of(
        damage.damaged_trees(yaml.safe_load(text), names).map(damage.yaml_text), damage.damaged_texts(text)
    )


def test_the_undamaged_inputs_work(worker, folder):
    prepare(folder)
    written(folder, "machine.yaml", MACHINE)
    written(folder, "run0.csv", csv(ROWS))
    written(folder, "campaign.yaml", CAMPAIGN)
    for command in (
        ["parameters", "machine.yaml"],
        ["effects", "--config", "machine.yaml"],
        ["campaign", "check", "."],
        simulation(),
    ):
        assert check(worker.run(command, folder), folder).status == 0


MACHINE = (CONFIGS / "paper.yaml").read_text() + "controller: {kind: position}\n"
MACHINE_KEYS = (
    "controller", "sampling", "amplifier", "target", "reference", "effects", "parameters", "simulation", "rig",
    "effect_options",
)  # fmt: skip


@share_of_inputs("configurations")
@given(documents(MACHINE, MACHINE_KEYS), st.sampled_from((["parameters"], ["effects", "--config"])))
def test_configurations(worker, folder, text, command):
    prepare(folder)
    written(folder, "machine.yaml", text)
    check(worker.run([*command, "machine.yaml"], folder), folder)


UNITS = {
    "frequency": "Hz", "amplitude": "mm", "coil_resistance": "ohm", "mover_mass": "g", "stop_stiffness": "MN/m",
    "position_gain": "kV/m", "velocity_gain": "V*s/m", "ramp_time": "ms", "duration": "ms", "sample_rate": "kHz",
    "step": "us", "supply_voltage": "V", "static_friction": "N", "sliding_damping": "N*s/m", "": "",
    "nothing_like_it": "m",
}  # fmt: skip
POSSIBLE = st.builds(
    lambda name, exponent: f"{name}={10**exponent:.3g} {UNITS[name]}", st.sampled_from(sorted(UNITS)),
    st.floats(-3.0, 3.0),
)  # fmt: skip
HOSTILE = st.tuples(
    st.sampled_from(sorted(UNITS)),
    st.one_of(st.sampled_from(damage.NUMBERS + damage.QUANTITIES + damage.TEXTS), st.text(max_size=8)),
).map("=".join)
SETTINGS = st.lists(st.one_of(POSSIBLE, POSSIBLE, HOSTILE, st.text(max_size=8)), min_size=1, max_size=2)


def simulation(*values: str) -> list[str]:
    """The command that simulates 5 ms of the actuator with these settings."""
    options = [part for value in ("duration=5 ms", *values) for part in ("--set", value)]
    return ["simulate", str(CONFIGS / "actuator.yaml"), "--no-figure", "--out", "result", *options]


@share_of_inputs("settings")
@given(SETTINGS)
def test_settings_of_a_simulation(worker, folder, values):
    prepare(folder)
    check(worker.run(simulation(*values), folder), folder)


ROWS = [line.split(",") for line in (DATA / "campaign_bench" / "run3.csv").read_text().splitlines()[:300]]
CAMPAIGN = """
name: bench
rig: pump_bench
uncertain: {coil_resistance: 0.02, coulomb_friction: 0.25}
signals:
  voltage: {unit: V, noise: 0.02}
  current: {unit: A, noise: 0.02}
  piston_position: {unit: mm, noise: 0.005}
  outlet_pressure: {unit: MPa, noise: 0.0015}
  outlet_flow: {unit: L/min, noise: 0.012}
runs:
  - {file: run0.csv, use: fit, frequency: 20 Hz, amplitude: 3.5 mm, load_orifice_area: 4.2 mm^2}
"""
CAMPAIGN_KEYS = (
    "controller", "effects", "without", "parameters", "amplifier", "reference", "uncertain", "sensors", "samples",
    "use", "trigger",
)  # fmt: skip


@share_of_inputs("campaign descriptions")
@given(documents(CAMPAIGN, CAMPAIGN_KEYS))
def test_campaign_descriptions(worker, folder, text):
    prepare(folder)
    written(folder, "run0.csv", csv(ROWS))
    written(folder, "campaign.yaml", text)
    check(worker.run(["campaign", "check", "."], folder), folder)


@share_of_inputs("recordings")
@given(st.one_of(damage.damaged_tables(ROWS), damage.damaged_texts(csv(ROWS[:60]))))
def test_recordings(worker, folder, data):
    prepare(folder)
    written(folder, "run0.csv", data)
    written(folder, "campaign.yaml", CAMPAIGN)
    check(worker.run(["campaign", "check", "."], folder), folder)


@share_of_inputs("comparisons")
@given(damage.damaged_tables(ROWS))
def test_compared_recordings(worker, folder, data):
    prepare(folder)
    written(folder, "run0.csv", data)
    written(folder, "campaign.yaml", CAMPAIGN)
    check(worker.run(["compare", ".", "--out", "result"], folder, COMPARISON_TIME_LIMIT), folder)


SWEEP = f"""
name: tiny
base: {CONFIGS / "actuator.yaml"}
sweep: {{kind: table, file: designs.csv}}
batch: {{step: 100 us, tolerance: 5 %, max_cycles: 4}}
"""
DESIGNS = [
    ["frequency [Hz]", "coil_resistance [ohm]", "stop_stiffness [N/m]"],
    ["20", "1", "1e6"],
    ["30", "2", "1e6"],
    ["40", "3", "2e6"],
]


@share_of_inputs("design tables")
@given(damage.damaged_tables(DESIGNS), documents(SWEEP, ("parameters", "free", "seed", "count")), st.booleans())
def test_design_tables(worker, folder, data, description, damage_the_table):
    prepare(folder)
    written(folder, "designs.csv", data if damage_the_table else csv(DESIGNS))
    written(folder, "sweep.yaml", SWEEP if damage_the_table else description)
    check(worker.run(["sweep", "sweep.yaml", "--out", "result"], folder), folder)


@pytest.fixture(scope="module")
def finished_sweep(worker, tmp_path_factory):
    """A folder with a sweep that is finished, and the content of its table."""
    folder = prepare(tmp_path_factory.mktemp("finished") / "sweep")
    written(folder, "designs.csv", csv(DESIGNS))
    written(folder, "sweep.yaml", SWEEP)
    assert check(worker.run(["sweep", "sweep.yaml", "--out", "result"], folder, 60.0), folder).status == 0
    return folder, table_of(folder)


def table_of(folder: Path) -> pa.Table:
    return pa.parquet.read_table(folder / "result" / "table.parquet")


@share_of_inputs("sweep folders")
@given(st.data())
def test_damaged_sweep_folders(worker, folder, finished_sweep, data):
    source, table = finished_sweep
    shutil.rmtree(folder)
    shutil.copytree(source, folder)
    damage_files(folder / "result", data)
    check(worker.run(["plot", "sweep", "result", "--out", "picture.png"], folder), folder)
    resumed = check(worker.run(["sweep", "sweep.yaml", "--out", "result"], folder), folder)
    if resumed.status == 0:
        assert table_of(folder).equals(table), "a damaged result was accepted"


def damage_files(folder: Path, data) -> None:
    """One bit of one or two files flipped, or the file cut, emptied or removed."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    for path in data.draw(st.lists(st.sampled_from(files), min_size=1, max_size=2, unique=True)):
        content = path.read_bytes()
        what = data.draw(st.sampled_from(("bit", "bit", "bit", "cut", "empty", "gone")))
        at = data.draw(st.integers(0, max(len(content) - 1, 0)))
        if what == "gone":
            path.unlink()
        elif what == "bit" and content:
            path.write_bytes(
                content[:at] + bytes([content[at] ^ (1 << data.draw(st.integers(0, 7)))]) + content[at + 1 :]
            )
        else:
            path.write_bytes(content[: at if what == "cut" else 0])


@pytest.fixture(scope="module")
def finished_run(worker, tmp_path_factory):
    """A folder with a run, and what reading it gives."""
    folder = prepare(tmp_path_factory.mktemp("finished") / "run")
    assert check(worker.run(simulation(), folder), folder).status == 0
    return folder, check(worker.run([REOPEN, "result"], folder), folder).output


@share_of_inputs("run folders")
@given(st.data())
def test_damaged_run_folders(worker, folder, finished_run, data):
    source, metrics = finished_run
    shutil.rmtree(folder)
    shutil.copytree(source, folder)
    damage_files(folder / "result", data)
    reopened = check(worker.run([REOPEN, "result"], folder), folder)
    if reopened.status == 0:
        assert reopened.output == metrics, "a damaged result was accepted"
