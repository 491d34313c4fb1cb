"""Folder of a sweep: a file per finished chunk, a manifest, and the table of all designs at the end."""

import contextlib
import datetime
import errno
import json
import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import TextIO

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from edhas_jax.config.run_folder import ResultFileError
from edhas_jax.core.atomic_file import PARTIAL_SUFFIX, atomic_write
from edhas_jax.core.regular_file import FileKindError, read_regular_file, require_regular_file
from edhas_jax.design.batch.batch import Chunk
from edhas_jax.design.sweep.chunk_job import ChunkResult
from edhas_jax.design.sweep.config import Sweep
from edhas_jax.design.sweep.identity import (
    device,
    identity_differences,
    identity_hash,
    machine_text,
    sweep_identity,
    versions,
)
from edhas_jax.design.sweep.table import TABLE_FILE, sweep_table, to_frame
from edhas_jax.simulation.metrics import METRICS

FORMAT_VERSION = 1
MAX_MANIFEST_BYTES = 500_000_000  # the samples of a recording may be in it
MANIFEST_FILE, DESIGNS_FILE, CHUNKS_FOLDER, LOCK_FILE = "manifest.json", "designs.parquet", "chunks", ".lock"


class SweepError(ResultFileError):
    """A sweep cannot be run, written or read."""


class SweepFolder:
    """The folder of one sweep while it is run; a context manager that locks it against other processes.

    Attributes:
        path: the folder.
        identity: everything the results depend on.
        hash: a short hash of it.
        table: the finished table, a row per design in SI; None before the sweep is finished.

    Raises:
        SweepError: the folder holds something else or another sweep, or cannot be written.
    """

    def __init__(self, sweep: Sweep, path: Path | str, chunks: list[Chunk]):
        self.path, self._sweep, self._chunks = Path(path), sweep, chunks
        self.identity = sweep_identity(sweep)
        self.hash = identity_hash(self.identity)
        self.table: pd.DataFrame | None = None
        self._lock = None

    def __enter__(self) -> "SweepFolder":
        with self._report_write_errors():
            manifest = self._matching_manifest()
            self._lock = _lock(self.path)
            if manifest is None:
                self._create()
            elif manifest["state"] == "finished":
                with contextlib.suppress(FileNotFoundError, ValueError, pa.ArrowException):
                    self.table = to_frame(pq.read_table(self.path / TABLE_FILE))
            for stale in (self.path / CHUNKS_FOLDER).glob(f".*{PARTIAL_SUFFIX}"):
                stale.unlink(missing_ok=True)
        return self

    def __exit__(self, *_) -> None:
        if self._lock is not None:
            self._lock.close()

    def _matching_manifest(self) -> dict | None:
        """The manifest of this same sweep; None in an empty folder."""
        if not (self.path / MANIFEST_FILE).exists():
            if self.path.exists() and (not self.path.is_dir() or any(n.name != LOCK_FILE for n in self.path.iterdir())):
                raise SweepError(f"{self.path}: is not the folder of a sweep; name another with --out")
            (self.path / CHUNKS_FOLDER).mkdir(parents=True, exist_ok=True)
            return None
        manifest = read_manifest(self.path)
        if manifest["hash"] != self.hash:
            lines = "\n".join(f"  {line}" for line in identity_differences(manifest["identity"], self.identity))
            raise SweepError(f"{self.path}: holds another sweep; nothing was changed. What differs:\n{lines}\n"
                             "Name another folder with --out, or remove this one")  # fmt: skip
        (self.path / CHUNKS_FOLDER).mkdir(exist_ok=True)
        return manifest

    def _create(self) -> None:
        """Write the designs and the manifest of a sweep that begins."""
        sweep = self._sweep
        with atomic_write(self.path / DESIGNS_FILE) as file:
            pq.write_table(sweep_table(sweep.machine, sweep.designs), file)
        axes = {a.name: ({"values": list(a.values)} if a.values else
                         {"from": a.low, "to": a.high, "count": a.count, "spacing": "log" if a.log else "linear"})
                for a in sweep.axes}  # fmt: skip
        self._write_manifest({
            "format": FORMAT_VERSION, "name": sweep.name, "state": "unfinished", "hash": self.hash,
            "sweep": {"kind": sweep.kind, "seed": sweep.seed, "parameters": axes or list(sweep.designs)},
            "designs": len(sweep), "chunks": len(self._chunks),
            **versions(), **device(),
            "begun": _now(), "finished": None, "computed_on": [],
            "identity": self.identity, "machine": machine_text(sweep),
        })  # fmt: skip

    def _write_manifest(self, manifest: dict) -> None:
        text = json.dumps(manifest, indent=2, ensure_ascii=False) + "\n"
        with atomic_write(self.path / MANIFEST_FILE) as file:
            file.write_text(text, encoding="utf-8")

    def finished(self) -> dict[int, dict[str, np.ndarray]]:
        """The finished chunks by number: by metric the values (SI) of their designs."""
        chunks = {}
        for number, chunk in enumerate(self._chunks):
            columns = read_chunk(self._chunk_file(number), self.hash)
            if columns is not None and np.array_equal(columns.pop("design"), chunk.rows):
                chunks[number] = columns
        return chunks

    def _chunk_file(self, number: int) -> Path:
        return self.path / CHUNKS_FOLDER / f"{number:06d}.parquet"

    def check_space(self, designs: int) -> None:
        """Raise SweepError if the results of so many designs would fill the disk."""
        needed = designs * 2 * 8 * (len(self._sweep.designs) + len(METRICS) + 4) + 2**20
        free = shutil.disk_usage(self.path).free
        if free < needed:
            raise SweepError(f"{self.path}: the result needs about {needed / 1e6:.0f} MB, and the disk has "
                             f"{free / 1e6:.0f} MB left; nothing was computed")  # fmt: skip

    def write(self, result: ChunkResult) -> None:
        """Write the file of a chunk, which appears under its name only when it is complete."""
        columns = {"design": self._chunks[result.number].rows, **result.metrics}
        metadata = {"hash": self.hash, "versions": json.dumps(result.versions), "device": json.dumps(result.device)}
        data = pa.table(dict(columns)).replace_schema_metadata(metadata)
        with self._report_write_errors(), atomic_write(self._chunk_file(result.number)) as file:
            pq.write_table(data, file)

    def complete(self, chunks: Mapping[int, Mapping[str, np.ndarray]]) -> pd.DataFrame:
        """Write the table of all designs and mark the manifest as finished; returns the table in SI."""
        metrics: dict[str, np.ndarray] = {}
        for number, columns in chunks.items():
            for name, column in columns.items():
                metrics.setdefault(name, np.full(len(self._sweep), np.nan))[self._chunks[number].rows] = column
        data = sweep_table(self._sweep.machine, self._sweep.designs, metrics)
        devices = {_metadata(self._chunk_file(n))[b"device"].decode() for n in chunks}
        with self._report_write_errors():
            with atomic_write(self.path / TABLE_FILE) as file:
                pq.write_table(data, file)
            used = [json.loads(d) for d in sorted(devices)]
            changes = {"state": "finished", "finished": _now(), "computed_on": used}
            self._write_manifest(read_manifest(self.path) | changes)
        return to_frame(data)

    @contextlib.contextmanager
    def _report_write_errors(self):
        try:
            yield
        except OSError as error:
            what = "cannot be written: " + (error.strerror or str(error))
            if error.errno in (errno.ENOSPC, errno.EDQUOT):
                what = ("the disk is full. Finished chunks are kept and readable; "
                        "make room, and the same command resumes the sweep")  # fmt: skip
            raise SweepError(f"{self.path}: {what}") from None


def read_manifest(path: Path) -> dict:
    """Read the manifest of a sweep's folder.

    Raises:
        SweepError: it is missing, damaged, or written by a later version.
    """
    try:
        manifest = json.loads(read_regular_file(path / MANIFEST_FILE, MAX_MANIFEST_BYTES).decode("utf-8"))
        if manifest["format"] > FORMAT_VERSION:
            later = manifest["edhas_jax"]
            raise SweepError(f"{path}: written by a later version ({later}); this one reads {FORMAT_VERSION}")
        if not {"hash", "identity", "state"} <= manifest.keys():
            raise ValueError("keys are missing")
        return manifest
    except FileNotFoundError:
        raise SweepError(f"{path}: is not the folder of a sweep: {MANIFEST_FILE} is missing") from None
    except (NotADirectoryError, FileKindError, ValueError, KeyError, TypeError) as error:
        if isinstance(error, SweepError):
            raise
        raise SweepError(f"{path}: {MANIFEST_FILE} is damaged or not one of a sweep: {error}") from None


def read_chunk(path: Path, wanted_hash: str) -> dict[str, np.ndarray] | None:
    """The columns (SI) of a chunk's file; None if it is missing, damaged or of another sweep."""
    try:
        require_regular_file(path)
        if _metadata(path).get(b"hash", b"").decode() != wanted_hash:
            return None
        data = pq.read_table(path)
    except (OSError, ValueError, pa.ArrowException):
        return None
    return {name: data[name].to_numpy() for name in data.column_names}


def _metadata(path: Path) -> dict[bytes, bytes]:
    return pq.read_schema(path).metadata or {}


def _lock(path: Path) -> TextIO | None:
    """Lock the folder for the life of this process; without effect where the file system has no locks."""
    try:
        import fcntl
    except ImportError:
        return None
    # neither follows a link to another file nor waits for a pipe
    flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK
    file = os.fdopen(os.open(path / LOCK_FILE, flags, 0o644), "r+", closefd=True)
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
