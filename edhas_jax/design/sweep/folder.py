"""Folder of a sweep: a file per finished chunk, a manifest, and the table of all designs at the end."""

import contextlib
import datetime
import errno
import json
import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TextIO

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from edhas_jax.core.atomic_file import PARTIAL_SUFFIX, atomic_write
from edhas_jax.core.checksums import digest
from edhas_jax.design.batch.batch import Chunk
from edhas_jax.design.sweep.chunk_files import CHUNKS_FOLDER, is_chunk_name, read_chunk_files, write_chunk_file
from edhas_jax.design.sweep.chunk_job import ChunkResult
from edhas_jax.design.sweep.config import Sweep
from edhas_jax.design.sweep.identity import (
    device,
    identity_differences,
    identity_hash,
    machine_text,
    sweep_identity,
)
from edhas_jax.design.sweep.manifest import (
    FORMAT_VERSION,
    MANIFEST_FILE,
    ManifestError,
    SweepError,
    read_listed_file,
    read_manifest,
    write_manifest,
)
from edhas_jax.design.sweep.table import TABLE_FILE, sweep_table, to_frame
from edhas_jax.simulation.metrics import METRICS

DESIGNS_FILE, LOCK_FILE = "designs.parquet", ".lock"
OWN_NAMES = (MANIFEST_FILE, DESIGNS_FILE, TABLE_FILE, CHUNKS_FOLDER, LOCK_FILE)


class SweepFolder:
    """The folder of one sweep while it is run; a context manager that locks it against other processes.

    Attributes:
        path: the folder.
        identity: everything the results depend on.
        hash: a short hash of it.
        table: the finished table, a row per design in SI; None before the sweep is finished.
        remarks: what was found damaged or incomplete and is made anew, a sentence each.

    Raises:
        SweepError: the folder holds something else or another sweep, or cannot be written.
    """

    def __init__(self, sweep: Sweep, path: Path | str, chunks: list[Chunk]):
        self.path, self._sweep, self._chunks = Path(path), sweep, chunks
        self.identity = sweep_identity(sweep)
        self.hash = identity_hash(self.identity)
        self.table: pd.DataFrame | None = None
        self.remarks: list[str] = []
        self._lock, self._devices = None, {}

    def __enter__(self) -> "SweepFolder":
        with contextlib.ExitStack() as stack, self._report_write_errors():
            manifest = self._matching_manifest()
            self._lock = _lock(self.path)
            stack.callback(self.__exit__)
            if manifest is None:
                self._create()
            else:
                self._check_files(manifest)
            for folder in (self.path, self.path / CHUNKS_FOLDER):
                for stale in folder.glob(f".*{PARTIAL_SUFFIX}"):
                    stale.unlink(missing_ok=True)
            stack.pop_all()
        return self

    def __exit__(self, *_) -> None:
        if self._lock is not None:
            self._lock.close()

    def _matching_manifest(self) -> dict | None:
        """The manifest of this same sweep; None in a folder that has none yet, or one to be written anew."""
        if self.path.exists() and not self.path.is_dir():
            raise SweepError(f"{self.path}: is not the folder of a sweep; name another with --out")
        try:
            manifest = read_manifest(self.path)
        except ManifestError as error:
            self._check_restart(str(error))
            (self.path / CHUNKS_FOLDER).mkdir(parents=True, exist_ok=True)
            return None
        if manifest["hash"] != self.hash:
            lines = "\n".join(f"  {line}" for line in identity_differences(manifest["identity"], self.identity))
            raise SweepError(f"{self.path}: holds another sweep; nothing was changed. What differs:\n{lines}\n"
                             "Name another folder with --out, or remove this one")  # fmt: skip
        (self.path / CHUNKS_FOLDER).mkdir(exist_ok=True)
        return manifest

    def _check_restart(self, problem: str) -> None:
        """Check that a folder without a usable manifest is empty, or the incomplete or damaged one of this sweep."""
        names = {p.name for p in self.path.iterdir()} if self.path.exists() else set()
        files = {p.name for p in (self.path / CHUNKS_FOLDER).glob("*")}
        chunks = [chunk for chunk in read_chunk_files(self.path).values() if chunk is not None]
        of_this_sweep = sum(chunk.sweep == self.hash for chunk in chunks)
        foreign = [n for n in names if n not in OWN_NAMES and not (n.startswith(".") and n.endswith(PARTIAL_SUFFIX))]
        if not of_this_sweep and (foreign or not all(map(is_chunk_name, files))):
            raise SweepError(f"{self.path}: is not the folder of a sweep; name another with --out")
        if of_this_sweep < len(chunks):
            raise SweepError(f"{problem}, and there are chunks of another sweep; name another folder with --out")
        if MANIFEST_FILE in names:
            self.remarks.append(f"{problem}; it is written anew, and {of_this_sweep} finished chunks are kept")
        elif names - {LOCK_FILE}:
            self.remarks.append(f"{self.path}: an earlier start was interrupted before its manifest was written; "
                                "the sweep begins anew")  # fmt: skip

    def _check_files(self, manifest: dict) -> None:
        """Read the table of a finished sweep, and write the designs anew if they are damaged."""
        if read_listed_file(self.path, manifest, DESIGNS_FILE) is None:
            self.remarks.append(f"{self.path / DESIGNS_FILE}: is missing or damaged and is written anew")
            write_manifest(self.path, manifest | {"files": manifest.get("files", {}) | self._write_designs()})
        if manifest["state"] == "finished":
            content = read_listed_file(self.path, manifest, TABLE_FILE)
            if content is None:
                self.remarks.append(f"{self.path / TABLE_FILE}: is missing, damaged or not the table of this sweep, "
                                    "and is written anew from the finished chunks")  # fmt: skip
            else:
                self.table = to_frame(pq.read_table(pa.BufferReader(content)))

    def _write_designs(self) -> dict[str, str]:
        """Write the table of designs; its name and checksum."""
        with atomic_write(self.path / DESIGNS_FILE) as file:
            pq.write_table(sweep_table(self._sweep.machine, self._sweep.designs), file)
            return {DESIGNS_FILE: digest(file.read_bytes())}

    def _create(self) -> None:
        """Write the designs and the manifest of a sweep that begins."""
        sweep = self._sweep
        files = self._write_designs()
        write_manifest(self.path, {
            "format": FORMAT_VERSION, "name": sweep.name, "state": "unfinished", "hash": self.hash,
            "sweep": sweep_description(sweep),
            "designs": len(sweep), "chunks": len(self._chunks),
            **self.identity["versions"], **device(),
            "begun": _now(), "finished": None, "computed_on": [],
            "identity": self.identity, "machine": machine_text(sweep), "files": files,
        })  # fmt: skip

    def finished(self) -> dict[int, dict[str, np.ndarray]]:
        """The finished chunks by number: by metric the values (SI) of their designs; a damaged one is not finished."""
        chunks = {}
        for number, file in read_chunk_files(self.path).items():
            rows = None if file is None else file.columns.pop("design", None)
            usable = rows is not None and number < len(self._chunks) and file.sweep == self.hash
            if usable and np.array_equal(rows, self._chunks[number].rows):
                chunks[number] = file.columns
                self._devices[number] = file.device
            elif number < len(self._chunks):
                self.remarks.append(f"{self.path / CHUNKS_FOLDER}: chunk {number} is damaged or was changed; its "
                                    f"{len(self._chunks[number].rows):,} designs are computed again")  # fmt: skip
        return chunks

    def check_space(self, designs: int) -> None:
        """Raise SweepError if the results of so many designs would fill the disk."""
        needed = designs * 2 * 8 * (len(self._sweep.designs) + len(METRICS) + 4) + 2**20
        free = shutil.disk_usage(self.path).free
        if free < needed:
            raise SweepError(f"{self.path}: the result needs about {needed / 1e6:.0f} MB, and the disk has "
                             f"{free / 1e6:.0f} MB left; nothing was computed")  # fmt: skip

    def write(self, result: ChunkResult) -> None:
        """Write the file of a chunk, which appears under its name only when it is complete."""
        with self._report_write_errors():
            write_chunk_file(self.path, self.hash, self._chunks[result.number].rows, result)
        self._devices[result.number] = dict(result.device)

    def complete(self, chunks: Mapping[int, Mapping[str, np.ndarray]]) -> pd.DataFrame:
        """Write the table of all designs and mark the manifest as finished; returns the table in SI."""
        metrics: dict[str, np.ndarray] = {}
        for number, columns in chunks.items():
            for name, column in columns.items():
                metrics.setdefault(name, np.full(len(self._sweep), np.nan))[self._chunks[number].rows] = column
        data = sweep_table(self._sweep.machine, self._sweep.designs, metrics)
        used = [json.loads(d) for d in sorted({json.dumps(device) for device in self._devices.values()})]
        with self._report_write_errors():
            with atomic_write(self.path / TABLE_FILE) as file:
                pq.write_table(data, file)
                checksum = digest(file.read_bytes())
            manifest = read_manifest(self.path)
            files = manifest["files"] | {TABLE_FILE: checksum}
            changes = {"state": "finished", "finished": _now(), "computed_on": used, "files": files}
            write_manifest(self.path, manifest | changes)
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


def sweep_description(sweep: Sweep) -> dict[str, Any]:
    """The kind of a sweep, its seed and its parameters, as plain data."""
    axes = {a.name: ({"values": list(a.values)} if a.values else
                     {"from": a.low, "to": a.high, "count": a.count, "spacing": "log" if a.log else "linear"})
            for a in sweep.axes}  # fmt: skip
    return {"kind": sweep.kind, "seed": sweep.seed, "parameters": axes or list(sweep.designs)}


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
