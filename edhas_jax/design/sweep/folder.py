"""Folders of sweeps on disk: chunks that are whole or not there, a manifest, and the table when all is done."""


import contextlib
import dataclasses
import datetime
import errno
import hashlib
import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from edhas_jax.config.run_folder import ResultFileError
from edhas_jax.config.writer import config_kind, dump_config
from edhas_jax.core.atomic_file import PARTIAL_SUFFIX, atomic_write
from edhas_jax.core.units import format_quantity
from edhas_jax.design.batch.batch import Chunk
from edhas_jax.design.sweep.chunk_task import Answer, device, effect_code, versions
from edhas_jax.design.sweep.config import Sweep
from edhas_jax.design.sweep.table import TABLE, frame_of, table_of
from edhas_jax.machine.parameters import COMPONENT_KINDS, find_parameter, list_parameters
from edhas_jax.simulation.metrics import METRICS
from edhas_jax.simulation.run import Simulation

FORMAT = 1
MANIFEST, DESIGNS, CHUNKS, LOCK = "manifest.json", "designs.parquet", "chunks", ".lock"


class SweepError(ResultFileError):
    """A sweep cannot be run, written or read."""


class SweepFolder:
    """The folder of one sweep while it is run; as a context it keeps other processes out.

    Raises:
        SweepError: something else is in the folder, another sweep, or it cannot be written.
    """

    def __init__(self, sweep: Sweep, path: Path | str, chunks: list[Chunk]):
        self.path, self._sweep, self._chunks = Path(path), sweep, chunks
        self.identity = describe(sweep)
        self.hash = fingerprint(self.identity)
        self.table: pd.DataFrame | None = None  # when the sweep is finished already
        self._lock = None

    def __enter__(self) -> "SweepFolder":
        with self._writing():
            manifest = self._claim()
            self._lock = _lock(self.path)
            if manifest is None:
                self._begin()
            elif manifest["state"] == "finished":
                with contextlib.suppress(FileNotFoundError, ValueError, pa.ArrowException):
                    self.table = frame_of(pq.read_table(self.path / TABLE))
            for stale in (self.path / CHUNKS).glob(f".*{PARTIAL_SUFFIX}"):
                stale.unlink(missing_ok=True)
        return self

    def __exit__(self, *_) -> None:
        if self._lock is not None:
            self._lock.close()

    def _claim(self) -> dict | None:
        """The manifest of this very sweep, or None in a folder that is still empty."""
        if not (self.path / MANIFEST).exists():
            if self.path.exists() and (not self.path.is_dir() or any(n.name != LOCK for n in self.path.iterdir())):
                raise SweepError(f"{self.path}: is not the folder of a sweep; name another with --out")
            (self.path / CHUNKS).mkdir(parents=True, exist_ok=True)
            return None
        manifest = read_manifest(self.path)
        if manifest["hash"] != self.hash:
            told = "\n".join(f"  {line}" for line in differences(manifest["identity"], self.identity))
            raise SweepError(f"{self.path}: holds another sweep; nothing was changed. What differs:\n{told}\n"
                             "Name another folder with --out, or remove this one")  # fmt: skip
        (self.path / CHUNKS).mkdir(exist_ok=True)
        return manifest

    def _begin(self) -> None:
        sweep = self._sweep
        with atomic_write(self.path / DESIGNS) as file:
            pq.write_table(table_of(sweep.machine, sweep.designs), file)
        axes = {a.name: ({"values": list(a.values)} if a.values else
                         {"from": a.low, "to": a.high, "count": a.count, "spacing": "log" if a.log else "linear"})
                for a in sweep.axes}  # fmt: skip
        self._manifest({
            "format": FORMAT, "name": sweep.name, "state": "unfinished", "hash": self.hash,
            "sweep": {"kind": sweep.kind, "seed": sweep.seed, "parameters": axes or list(sweep.designs)},
            "designs": len(sweep), "chunks": len(self._chunks),
            **{k: v for k, v in versions().items()}, **device(),
            "begun": _now(), "finished": None, "computed_on": [],
            "identity": self.identity, "machine": machine_text(sweep),
        })  # fmt: skip

    def _manifest(self, manifest: dict) -> None:
        text = json.dumps(manifest, indent=2, ensure_ascii=False) + "\n"
        with atomic_write(self.path / MANIFEST) as file:
            file.write_text(text, encoding="utf-8")

    def finished(self) -> dict[int, dict[str, np.ndarray]]:
        """The chunks that are on disk and whole, by number: the metrics of their designs."""
        found = {}
        for number, chunk in enumerate(self._chunks):
            read = read_chunk(self.path / CHUNKS / f"{number:06d}.parquet", self.hash)
            if read is not None and np.array_equal(read.pop("design"), chunk.rows):
                found[number] = read
        return found

    def check_space(self, designs: int) -> None:
        """Refuse to begin what would fill the disk."""
        needed = designs * 2 * 8 * (len(self._sweep.designs) + len(METRICS) + 4) + 2**20
        free = shutil.disk_usage(self.path).free
        if free < needed:
            raise SweepError(f"{self.path}: the result needs about {needed / 1e6:.0f} MB, and the disk has "
                             f"{free / 1e6:.0f} MB left; nothing was computed")  # fmt: skip

    def write(self, answer: Answer) -> None:
        """Add a chunk; it appears under its name when it is whole."""
        columns = {"design": self._chunks[answer.number].rows, **answer.metrics}
        told = {"hash": self.hash, "versions": json.dumps(answer.versions), "device": json.dumps(answer.device)}
        data = pa.table(dict(columns)).replace_schema_metadata(told)
        with self._writing(), atomic_write(self.path / CHUNKS / f"{answer.number:06d}.parquet") as file:
            pq.write_table(data, file)

    def complete(self, chunks: Mapping[int, Mapping[str, np.ndarray]]) -> pd.DataFrame:
        """Write the table of all designs and close the manifest."""
        metrics: dict[str, np.ndarray] = {}
        for number, columns in chunks.items():
            for name, column in columns.items():
                metrics.setdefault(name, np.full(len(self._sweep), np.nan))[self._chunks[number].rows] = column
        data = table_of(self._sweep.machine, self._sweep.designs, metrics)
        devices = {_metadata(self.path / CHUNKS / f"{n:06d}.parquet")[b"device"].decode() for n in chunks}
        with self._writing():
            with atomic_write(self.path / TABLE) as file:
                pq.write_table(data, file)
            on = [json.loads(d) for d in sorted(devices)]
            self._manifest(read_manifest(self.path) | {"state": "finished", "finished": _now(), "computed_on": on})
        return frame_of(data)

    @contextlib.contextmanager
    def _writing(self):
        try:
            yield
        except OSError as error:
            what = "cannot be written: " + (error.strerror or str(error))
            if error.errno in (errno.ENOSPC, errno.EDQUOT):
                what = ("the disk is full. What is finished is kept and readable; "
                        "make room, and the same command goes on from there")  # fmt: skip
            raise SweepError(f"{self.path}: {what}") from None


def read_manifest(path: Path) -> dict:
    """The manifest of a sweep's folder.

    Raises:
        SweepError: there is none, or none that this version reads.
    """
    try:
        manifest = json.loads((path / MANIFEST).read_text(encoding="utf-8"))
        if manifest["format"] > FORMAT:
            raise SweepError(f"{path}: written by a later version ({manifest['edhas_jax']}); this one reads {FORMAT}")
        if not {"hash", "identity", "state"} <= manifest.keys():
            raise ValueError("keys are missing")
        return manifest
    except FileNotFoundError:
        raise SweepError(f"{path}: is not the folder of a sweep: {MANIFEST} is missing") from None
    except (NotADirectoryError, ValueError, KeyError, TypeError) as error:
        if isinstance(error, SweepError):
            raise
        raise SweepError(f"{path}: {MANIFEST} is damaged or not one of a sweep: {error}") from None


def read_chunk(path: Path, wanted_hash: str) -> dict[str, np.ndarray] | None:
    """The columns of a chunk's file; None when it is missing, damaged or of another sweep."""
    try:
        if _metadata(path).get(b"hash", b"").decode() != wanted_hash:
            return None
        data = pq.read_table(path)
    except (OSError, ValueError, pa.ArrowException):
        return None
    return {name: data[name].to_numpy() for name in data.column_names}


def _metadata(path: Path) -> dict[bytes, bytes]:
    return pq.read_schema(path).metadata or {}


def _lock(path: Path):
    """Keep a second process out as long as this one lives; where files cannot be locked, nobody is kept out."""
    try:
        import fcntl
    except ImportError:
        return None
    file = (path / LOCK).open("w")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        raise SweepError(f"{path}: is being computed by another process; wait for it, or stop it") from None
    except OSError:
        pass
    return file


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")




def describe(sweep: Sweep) -> dict[str, Any]:
    """All that the numbers depend on: parameters, effects, designs, settings and versions."""
    varied = {(path, p.name) for p, path in (find_parameter(sweep.machine, name) for name in sweep.designs)}
    digest = hashlib.sha256()
    for name, values in sweep.designs.items():
        digest.update(name.encode() + np.ascontiguousarray(values, "<f8").tobytes())
    settings = dataclasses.asdict(sweep.settings)
    return {
        "rig": sweep.machine.name,
        "kinds": {s: config_kind(s, getattr(sweep.machine, s)) for s in COMPONENT_KINDS if hasattr(sweep.machine, s)},
        "effects": effect_code(sweep.machine),
        "parameters": {
            f"{path}.{p.name}": [float(v), p.unit]
            for p, v, path in list_parameters(sweep.machine)
            if (path, p.name) not in varied
        },
        "designs": {"count": len(sweep), "names": list(sweep.designs), "sha256": digest.hexdigest()},
        "settings": settings | {"precision": sweep.settings.precision.value},
        "versions": versions(),
    }


def fingerprint(identity: Mapping[str, Any]) -> str:
    """One short text for a description."""
    return hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()[:16]


def machine_text(sweep: Sweep) -> str:
    """The machine of a sweep as configuration text, every parameter written out."""
    return dump_config(sweep.machine, Simulation(precision=sweep.settings.precision))


def differences(there: Mapping[str, Any], here: Mapping[str, Any]) -> list[str]:
    """In which parameters, effects, designs, settings and versions two descriptions differ, one line each."""
    told = []
    if there["rig"] != here["rig"]:
        return [f"rig: {there['rig']} there, {here['rig']} here"]
    told += _lines("", there["kinds"], here["kinds"], str)
    told += _lines("effect ", there["effects"], here["effects"], str)
    told += _lines("parameter ", there["parameters"], here["parameters"], lambda v: format_quantity(*v))
    old, new = there["designs"], here["designs"]
    if old["names"] != new["names"]:
        told.append(f"varied parameters: {', '.join(old['names'])} there, {', '.join(new['names'])} here")
    elif old["count"] != new["count"]:
        told.append(f"number of designs: {old['count']:,} there, {new['count']:,} here")
    elif old["sha256"] != new["sha256"]:
        told.append("table of designs: other values")
    told += _lines("setting ", there["settings"], here["settings"], str)
    return told + _lines("version of ", there["versions"], here["versions"], str)


def _lines(what: str, there: Mapping, here: Mapping, text) -> list[str]:
    def tell(values, name):
        return text(values[name]) if name in values else "none"

    names = dict.fromkeys([*there, *here])
    return [f"{what}{n}: {tell(there, n)} there, {tell(here, n)} here" for n in names if there.get(n) != here.get(n)]
