"""An attack with inputs whose right answer is known: `python -m tests.fuzz.families --inputs 600`.

A family is a function that draws an `Input`: files, commands, and a check of what they answer. A command runs in a
process apart with limits of memory and time. Each input ends in one class of `CLASSES`; only the first three are right.
"""

import argparse
import collections
import gzip
import io
import json
import random
import re
import shutil
import sys
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import h5py
import nptdms
import numpy as np
import openpyxl
import pandas as pd
import scipy.io
import yaml

from tests.fuzz.interrupts import OWN, RIG
from tests.fuzz.worker import READ, REOPEN, Outcome, Worker

CLASSES = ("right", "refused", "remarked", "tracebacks", "hangs", "silent", "unclear")
TIME_LIMIT = 60.0  # s for one command, of which a loaded machine needs a third
READ_TOLERANCE = 1e-6  # of the largest value: what is read is what was written
TAU, GAIN = 0.1, 2e6  # s, Pa/V of the plant
FITTED_TOLERANCE = 0.02  # of TAU: noise of 5 kPa allows a tenth of it
UNITS = {"Pa": 1.0, "kPa": 1e3, "bar": 1e5}
N, DT = 201, 0.01  # samples of a record, and their interval [s]


@dataclass(frozen=True)
class Input:
    """Files by name, commands in their order, and a check of the last answer: a sentence where it is wrong."""

    files: dict[str, bytes | str]
    commands: list[list[str]]
    wrong: Callable[[Path, list[Outcome]], str] = lambda folder, outcomes: ""


def plant(u: np.ndarray, t: np.ndarray, before: np.ndarray | None = None) -> np.ndarray:
    """Pressure [Pa] of the lag from 1 bar, exact for an input that is a straight line between two samples.

    Args:
        u: command just after each sample [V].
        t: times [s].
        before: command just before each sample [V], where it steps; by default `u`.
    """
    p = np.empty(len(t))
    p[0] = 1e5
    before = u if before is None else before
    for k, h in enumerate(np.diff(t)):
        slope = (before[k + 1] - u[k]) / h
        steady = GAIN * (u[k] - slope * TAU)
        p[k + 1] = steady + GAIN * slope * h + (p[k] - steady) * np.exp(-h / TAU)
    return p


def record(chance: random.Random) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time [s], command [V] and pressure [Pa] with noise of a record."""
    t = DT * np.arange(N)
    u = 1.0 + 0.3 * np.sin(2.0 * np.pi * chance.uniform(1.0, 4.0) * t)
    noise = np.random.default_rng(chance.randrange(10**9)).standard_normal(N)
    return t, np.round(u, 4), np.round(plant(np.round(u, 4), t) + 5e3 * noise, 0)


def campaign(file="run.csv", unit="Pa", **changes) -> str:
    """The description of a campaign of one run."""
    data = {
        "name": "lag", "rig": "rig.py:Lag", "uncertain": {"gain": 0.1, "tau": 0.5},
        "drives": {"command": {"column": "u", "unit": "V"}},
        "signals": {"pressure": {"column": "p", "unit": unit, "noise": 5e3 / UNITS[unit]}},
        "runs": [{"file": file, "use": "fit", "first": "1 bar"}],
    }  # fmt: skip
    return yaml.safe_dump(data | changes, sort_keys=False)


CHECK = ["campaign", "check", ".", *OWN, "--json"]
FIT = ["fit", ".", *OWN, "--out", "result", "--json"]


def read_as(t, u, p) -> Callable[[Path, list[Outcome]], str]:
    """A check that the campaign was read with these samples, within `READ_TOLERANCE`."""

    def wrong(folder, outcomes):
        found = json.loads(outcomes[-1].output)
        for name, values in (("time", t - t[0]), ("command", u), ("pressure", p)):
            read = np.array(found[name], float)
            if read.shape != values.shape:
                return f"{name}: {read.size} samples, written {values.size}"
            off = np.nanmax(np.abs(read - values)) / np.max(np.abs(values))
            if not off <= READ_TOLERANCE:
                return f"{name} is off by {off:.3g} of its largest value"
        return ""

    return wrong


def fitted(folder: Path, outcomes: list[Outcome]) -> str:
    """A check that the fit finds the time constant of the plant."""
    unknowns = json.loads((folder / "result" / "summary.json").read_text())["summary"]["unknowns"]
    value = next(row["value"] for row in unknowns if row["name"] == "tau")
    return "" if abs(value - TAU) <= FITTED_TOLERANCE * TAU else f"tau {value:.4g} s, of the plant {TAU} s"


def csv_text(columns: dict[str, list[str]], separator: str) -> str:
    """A table of texts; a cell that holds the separator is quoted."""
    rows = [list(columns), *zip(*columns.values(), strict=True)]
    return "".join(separator.join(f'"{c}"' if separator in c else c for c in row) + "\n" for row in rows)


def plain_csv(t, u, p, unit="Pa") -> str:
    """The table as most programs write it."""
    columns = {"time [s]": t, "u [V]": u, f"p [{unit}]": p / UNITS[unit]}
    return csv_text({n: [f"{x:.5f}" for x in v] for n, v in columns.items()}, ",")


def thousands(chance):
    """Separators of thousands and decimal marks of several countries."""
    group, mark = chance.choice(((",", "."), (".", ","), (" ", ","), ("\u00a0", ","), ("'", "."), ("", ","), ("", ".")))
    digits, unit, scale = chance.choice(((3, "kPa", 1e3), (0, "Pa", 1.0), (1, "Pa", 1.0)))
    t, u, p = record(chance)

    def written(value, places, grouped=True):
        text = f"{value:,.{places}f}" if grouped else f"{value:.{places}f}"
        return text.replace(",", "\0").replace(".", mark).replace("\0", group)

    columns = {
        "time [s]": [written(x, 2, False) for x in t], "u [V]": [written(x, 4, False) for x in u],
        f"p [{unit}]": [written(x / scale, digits) for x in p],
    }  # fmt: skip
    text = csv_text(columns, chance.choice((";", "\t", ",")))
    return Input({"run.csv": text, "campaign.yaml": campaign(unit=unit)}, [CHECK, [READ]], read_as(t, u, p))


def steps(chance):
    """The command steps: two rows at one time."""
    t = DT * np.arange(N)
    after, before = np.ones(N), np.ones(N)
    rows = []
    jumps = sorted(chance.sample(range(10, N - 20), chance.randint(1, 4)))
    for k in jumps:
        after[k:] = before[k + 1 :] = round(chance.uniform(0.3, 2.0), 3)
    p = plant(after, t, before) + 5e3 * np.random.default_rng(chance.randrange(10**9)).standard_normal(N)
    for k in range(N):
        rows += [f"{t[k]:.2f},{before[k]:.4f},{p[k]:.0f}"] if k in jumps else []
        rows.append(f"{t[k]:.2f},{after[k]:.4f},{p[k]:.0f}")
    return Input(
        {"run.csv": "time [s],u [V],p [Pa]\n" + "\n".join(rows) + "\n", "campaign.yaml": campaign()},
        [CHECK, FIT], fitted,
    )  # fmt: skip


def rates(chance):
    """Channels of different rates in one table: empty cells, or a held value, or a column of time for each."""
    t, u, p = record(chance)
    every = chance.choice((2, 5, 10))
    how = chance.choice(("empty", "nan", "two times"))
    blank = {"empty": "", "nan": "NaN"}.get(how, "")
    columns = {"time [s]": [f"{x:.2f}" for x in t], "u [V]": [f"{x:.4f}" for x in u]}
    if how == "two times":
        slow = [*map("{:.2f}".format, t[::every]), *[""] * (N - len(t[::every]))]
        columns |= {"time p [s]": slow, "p [Pa]": [*map("{:.0f}".format, p[::every]), *[""] * (N - len(t[::every]))]}
    else:
        columns["p [Pa]"] = [f"{x:.0f}" if k % every == 0 else blank for k, x in enumerate(p)]
    return Input({"run.csv": csv_text(columns, ","), "campaign.yaml": campaign()}, [CHECK, FIT], fitted)


def _mat(t, u, p, chance) -> bytes:
    shape = chance.choice(("rows", "columns", "matrix", "struct", "ints", "bomb"))
    data = {"time": t, "u": u, "p": p}
    if shape in ("rows", "columns"):
        data = {n: v.reshape((1, -1) if shape == "rows" else (-1, 1)) for n, v in data.items()}
    elif shape == "matrix":
        data = {"data": np.stack(list(data.values()), 1)}
    elif shape == "struct":
        data = {"log": {n: v.reshape(-1, 1) for n, v in data.items()}}
    elif shape == "ints":
        data["p"] = p.astype(np.int32)
    else:
        data["more"] = np.zeros(30_000_000)
    file = io.BytesIO()
    scipy.io.savemat(file, data, do_compression=True)
    return file.getvalue()


def _hdf5(t, u, p, chance) -> bytes:
    shape, file = chance.choice(("flat", "columns", "group", "bomb", "external", "text")), io.BytesIO()
    with h5py.File(file, "w") as tree:
        place = tree.create_group("log") if shape == "group" else tree
        for name, values in {"time": t, "u": u, "p": p}.items():
            place[name] = values[:, None] if shape == "columns" else values
        if shape == "bomb":
            tree.create_dataset("more", (2_000_000_000,), "f8", chunks=(1_000_000,), compression="gzip", fillvalue=0.0)
        elif shape == "external":
            del tree["p"]
            tree.create_dataset("p", (N,), "f8", external=[("/etc/passwd", 0, 8 * N)])
        elif shape == "text":
            del tree["p"]
            tree["p"] = [f"{x:.0f}" for x in p]
    return file.getvalue()


def _xlsx(t, u, p, chance) -> bytes:
    shape, file = chance.choice(("plain", "title", "text", "far", "sheets")), io.BytesIO()
    book = openpyxl.Workbook()
    sheet = book.active
    if shape == "title":
        sheet.append(["Logger 3000"])
        sheet.merge_cells("A1:C1")
    elif shape == "sheets":
        sheet.append(["about"])
        sheet = book.create_sheet("data")
    sheet.append(["time [s]", "u [V]", "p [Pa]"])
    for row in zip(t.tolist(), u.tolist(), p.tolist(), strict=True):
        sheet.append([f"{x:.4f}" for x in row] if shape == "text" else row)
    if shape == "far":
        sheet.cell(1_000_000, 16_000, 1.0)
    book.save(file)
    return file.getvalue()


def _tdms(t, u, p, chance) -> bytes:
    file, shape = io.BytesIO(), chance.choice(("time", "increment", "no offset"))
    timing = {"wf_increment": DT} | ({"wf_start_offset": 0.0} if shape == "increment" else {})
    channels = {"u [V]": u, "p [Pa]": p} if shape != "time" else {"time [s]": t, "u [V]": u, "p [Pa]": p}
    with nptdms.TdmsWriter(file) as writer:
        writer.write_segment(
            [nptdms.ChannelObject("log", n, v, {} if shape == "time" else timing) for n, v in channels.items()]
        )
    return file.getvalue()


def _parquet(t, u, p, chance) -> bytes:
    shape, file = chance.choice(("plain", "float32", "bomb", "index")), io.BytesIO()
    frame = pd.DataFrame({"time": t, "u": u, "p": p})
    if shape == "float32":
        frame["p"] = frame["p"].astype("float32")  # whole numbers of up to seven digits
    elif shape == "bomb":
        frame = pd.concat([frame, pd.DataFrame({"time": np.zeros(20_000_000)})], ignore_index=True)
    elif shape == "index":
        frame = frame.set_index("time")
    frame.to_parquet(file, compression="zstd")
    return file.getvalue()


def containers(chance):
    """Shapes of the other formats, and small files that expand to gigabytes."""
    t, u, p = record(chance)
    suffix, write = chance.choice(
        ((".mat", _mat), (".h5", _hdf5), (".xlsx", _xlsx), (".tdms", _tdms), (".parquet", _parquet))
    )
    data, file = write(t, u, p, chance), "run" + chance.choice((suffix, suffix, suffix, ".csv"))
    if chance.random() < 0.15:
        data = gzip.compress(data) if chance.random() < 0.5 else data[: chance.randrange(len(data))]
    return Input({file: data, "campaign.yaml": campaign(file)}, [CHECK, [READ]], read_as(t, u, p))


EQUATIONS = (
    "x = y.pressure / 0.0", "x = 1.0 / (y.pressure - y.pressure)", "jax.debug.print('{}', y.pressure)", "print(1)",
    "jax.pure_callback(lambda v: v, y.pressure, y.pressure)", "import sys; sys.exit(0)", "raise KeyboardInterrupt",
    "raise BaseException('x')", "x = jnp.sqrt(-y.pressure)", "x = float('nan')", "s.set(nothing=1.0)",
    "s.set(pressure=1.0)", "s.set(command=1.0)", "x = s.nothing", "x = y.nothing", "x = y.pressure * 1e200 * 1e200",
    "assert y.pressure > 0", "if y.pressure > 0: pass", "while True: pass", "return None",
    "return {}", "return {'pressure': 'fast'}", "return {'pressure': float('nan')}", "return {'pressure': 1e400}",
    "return {'pressure': y.pressure, 'more': 0.0}", "return 1.0", "return {'pressure': jnp.ones(3)}",
)  # fmt: skip
DECLARATIONS = (
    ("1e-3, 1.0", "0, 1.0"), ("1e-3, 1.0", "'fast', 1.0"), ("1e-3, 1.0", "float('nan'), 1.0"),
    ("1e-3, 1.0", "1e-3, -1"), ('valve", 1.0)', "valve\", 'one')"), ('valve", 1.0)', 'valve", None)'),
    ('valve", 1.0)', "valve\", float('nan'))"), ("2e6, ", "'big', "), ("2e6, ", "1e300, "), ('"Pa/V"', '"Pa per V"'),
    ('"first")', '"nothing")'), ("(1e4, 1e8)", "(1e8, 1e4)"), ("(1e4, 1e8)", "(0, float('inf'))"),
    ("(1e4, 1e8)", "'wide'"), ("class Lag(Rig)", "class Lag"), ("return {", "retrun {"),
)  # fmt: skip


def equations(chance):
    """Own rigs with hostile equations or declarations; a run that is valid has finite pressures."""
    rig = RIG.replace("from edhas_jax", "import jax\nimport jax.numpy as jnp\nfrom edhas_jax", 1)
    if chance.random() < 0.6:
        rig = rig.replace("        return {", f"        {chance.choice(EQUATIONS)}\n        return {{", 1)
    else:
        rig = rig.replace(*chance.choice(DECLARATIONS), 1)
    command = chance.choice((["check", "rig.py:Lag"], ["simulate", "m.yaml", *OWN, "--no-figure", "--out", "result"]))

    def wrong(folder, outcomes):
        if command[0] == "check":
            return "" if "Lag" in rig and outcomes[-1].output else "nothing was printed"
        table = folder / "result" / "timeseries.parquet"
        if not table.exists():
            return "status 0, and nothing was written"
        return "" if np.isfinite(pd.read_parquet(table).to_numpy()).all() else "values that are not finite"

    return Input({"rig.py": rig, "m.yaml": "rig: rig.py:Lag\n"}, [command], wrong)


KINDS = (None, True, [], {}, [[1]], {"a": 1}, 0, -1, 3.7, 1e300, float("nan"), "x", "1 parsec", "-1 s", [1, 2], "0 s")


def keys(chance):
    """Values of the wrong kind in a campaign, which are refused or do not matter."""
    t, u, p = record(chance)
    data = yaml.safe_load(campaign())
    data |= {"accuracy": {"trigger": "1 ms", "signals": {"pressure": {"gain": 0.01}}}, "without": [], "effects": []}
    data["signals"]["pressure"]["limits"] = ["0 Pa", "10 MPa"]
    places = []

    def walk(node, path):
        for key in node if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else ():
            places.append((node, key))
            walk(node[key], (*path, key))

    walk(data, ())
    node, key = chance.choice(places)
    node[key] = chance.choice(KINDS)
    return Input({"run.csv": plain_csv(t, u, p), "campaign.yaml": yaml.safe_dump(data, sort_keys=False)}, [CHECK])


def zeros(chance):
    """An uncertain parameter whose value is 0, with a relative or an absolute standard deviation."""
    t, u, p = record(chance)
    zero = '    zero: float = par(0.0, "V", (-1.0, 1.0), "of the valve")\n'
    rig = RIG.replace("    pressure = state", f"{zero}    pressure = state", 1)
    rig = rig.replace("self.gain * s.command", "self.gain * (s.command - self.zero)")
    spread = chance.choice((0.1, "0.05 V", "50 mV", {"value": "0 V", "spread": 0.1}, "10 %", 0, "0 V"))
    described = campaign(uncertain={"zero": spread, "tau": 0.5})
    return Input(
        {"rig.py": rig, "run.csv": plain_csv(t, u + 0.05, p), "campaign.yaml": described}, [CHECK, FIT], fitted
    )


def limits(chance):
    """Limits of a sensor in the wrong unit, or the wrong way round."""
    t, u, p = record(chance)
    unit, low, high, good = chance.choice((
        ("bar", "0 bar", "40 bar", True), ("bar", "0 Pa", "40 Pa", False), ("kPa", "0 kPa", "40 kPa", False),
        ("Pa", "0 bar", "40 bar", True), ("bar", "40 bar", "0 bar", False), ("Pa", "0 V", "10 V", False),
        ("bar", 0, 40, True), ("kPa", "0 bar", "4 bar", False),
    ))  # fmt: skip
    data = yaml.safe_load(campaign(unit=unit))
    data["signals"]["pressure"]["limits"] = [low, high]
    files = {"run.csv": plain_csv(t, u, p, unit), "campaign.yaml": yaml.safe_dump(data, sort_keys=False)}
    return Input(files, [CHECK], lambda *_: "" if good else f"limits {low} … {high} of up to {p.max():.3g} Pa")


def fmus(chance):
    """An exported unit: inputs of any name, and the configured drive as the start of its input."""
    level = round(chance.uniform(0.1, 3.0), 3)
    name = chance.choice(("command", "command", "command", "gain", "tau", "nothing", "pressure", "", "command_rate"))
    command = ["export", "m.yaml", *OWN, "--out", "unit.fmu", "--sources-only", "--input", name]

    def wrong(folder, outcomes):
        with zipfile.ZipFile(folder / "unit.fmu") as unit:
            text = unit.read("modelDescription.xml").decode()
        start = re.search(r'name="command"[^>]*>\s*<Real[^>]*start="([^"]+)"', text)
        if name != "command" or (start and abs(float(start[1]) - level) < 1e-9):
            return ""
        return f"the input starts at {start and start[1]}, configured is {level}"

    return Input({"m.yaml": f"rig: rig.py:Lag\ncommand: {level} V\n"}, [command], wrong)


def results(chance):
    """A result folder with a changed byte: refused, or opened as what was written."""
    t, u, p = record(random.Random(0))
    where, bit = chance.random(), chance.randrange(8)
    name = chance.choice(("fit.json", "config.yaml", "summary.json", "files.json"))

    def damage(folder):
        path = folder / "result" / name
        if path.exists():
            data = bytearray(path.read_bytes())
            data[int(where * len(data))] ^= 1 << bit
            path.write_bytes(data)

    def wrong(folder, outcomes):
        return "" if outcomes[-1].output == outcomes[1].output else f"a changed bit of {name} was accepted"

    files = {"run.csv": plain_csv(t, u, p), "campaign.yaml": campaign()}
    return Input(files, [FIT, [REOPEN, "result"], damage, [REOPEN, "result"]], wrong)


FAMILIES = (thousands, steps, rates, containers, equations, keys, zeros, limits, fmus, results)


def judged(case: Input, folder: Path, worker: Worker) -> tuple[str, str]:
    """Run one input in an empty folder: its class, and what is wrong."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name, content in ({"rig.py": RIG} | case.files).items():
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    outcomes = []
    for command in case.commands:
        if callable(command):
            command(folder)
            continue
        outcome = worker.run(command, folder, TIME_LIMIT)
        outcomes.append(outcome)
        if outcome.uncaught:
            kind = "hangs" if outcome.uncaught.startswith("no answer") else "tracebacks"
            places = re.findall(r'File "[^"]*/(edhas_jax/[^"]*)", line (\d+)', outcome.uncaught)
            return kind, " at ".join([outcome.uncaught.strip().splitlines()[-1], *map(":".join, places[-1:])])
        if "Traceback" in outcome.message + outcome.output:
            return "tracebacks", outcome.message
        if outcome.status == 2:
            return "refused", outcome.message
        if outcome.status not in (0, 1, 3, 4):
            return "unclear", f"status {outcome.status}"
    wrong = case.wrong(folder, outcomes)
    if not wrong:
        return "right", ""
    return ("remarked" if any(outcome.status for outcome in outcomes) else "silent"), wrong


def attack(inputs: int, seed: int, families=FAMILIES) -> list[tuple[str, int, str, str]]:
    """Run so many inputs of each family in turn; family, number, class and sentence of each."""
    found = []
    with tempfile.TemporaryDirectory() as home:
        worker = Worker({"XDG_CONFIG_HOME": f"{home}/config", "MPLBACKEND": "Agg"})
        try:
            for number in range(inputs):
                family = families[number % len(families)]
                case = family(random.Random(f"{seed} {family.__name__} {number}"))
                found.append((family.__name__, number, *judged(case, Path(home) / "input", worker)))
        finally:
            worker.stop()
    return found


def main() -> int:
    """Read the command line, print a table, what is not right, and a last line for programs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=600)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--families", nargs="+", choices=[f.__name__ for f in FAMILIES])
    options = parser.parse_args()
    chosen = [f for f in FAMILIES if not options.families or f.__name__ in options.families]
    found = attack(options.inputs, options.seed, chosen)
    counts = collections.Counter((name, kind) for name, _, kind, _ in found)
    for name, number, kind, sentence in found:
        if kind not in CLASSES[:3]:
            print(f"{kind}: {name} {number}: {sentence.strip()[:300]}")
    print(f"{'':12}" + "".join(f"{kind:>11}" for kind in CLASSES))
    for family in chosen:
        print(f"{family.__name__:12}" + "".join(f"{counts[family.__name__, kind]:11}" for kind in CLASSES))
    totals = collections.Counter(kind for _, _, kind, _ in found)
    print(" ".join([f"inputs={len(found)}", *(f"{kind}={totals[kind]}" for kind in CLASSES)]))
    return 1 if any(totals[kind] for kind in CLASSES[3:]) else 0


if __name__ == "__main__":
    sys.exit(main())
