"""Folder of a sweep: a file per finished chunk, a manifest, and the table of all designs at the end."""

import contextlib
import datetime
import errno
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from edhas_jax.config.result_files import LOCK_FILE, lock_folder
from edhas_jax.core.atomic_file import PARTIAL_SUFFIX, atomic_write
from edhas_jax.core.checksums import digest_of_file
from edhas_jax.design.batch.batch import Chunk, engine_of_designs
from edhas_jax.design.sweep.chunk_files import (
    CHUNKS_FOLDER,
    each_chunk_file,
    is_chunk_name,
    read_chunk_file,
    write_chunk_file,
)
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
    open_listed_file,
    read_manifest,
    write_manifest,
)
from edhas_jax.design.sweep.table import TABLE_FILE, sweep_table
from edhas_jax.design.sweep.table_windows import windows, write_table

DESIGNS_FILE = "designs.parquet"
OWN_NAMES = (MANIFEST_FILE, DESIGNS_FILE, TABLE_FILE, CHUNKS_FOLDER, LOCK_FILE)


class SweepFolder:
    """The folder of one sweep while it is run; a context manager that locks it against other processes.

    Attributes:
        path: the folder.
        identity: everything the results depend on.
        hash: a short hash of it.
        is_finished: whether the table of all designs is there and intact.
        remarks: what was found damaged or incomplete and is made anew, a sentence each.

    Raises:
        SweepError: the folder holds something else or another sweep, or cannot be written.
    """

    def __init__(self, sweep: Sweep, path: Path | str, chunks: list[Chunk]):
        self.path, self._sweep, self._chunks = Path(path), sweep, chunks
        on_gpu = any(chunk.many_lanes for chunk in chunks)
        self._engine = engine_of_designs(sweep.machine, sweep.designs, sweep.settings.precision, on_gpu)
        self.identity = sweep_identity(sweep, self._engine)
        self.hash = identity_hash(self.identity)
        self.is_finished = False
        self.remarks: list[str] = []
        self._lock, self._devices = None, {}
        self._files: dict[int, Path] = {}

    def __enter__(self) -> "SweepFolder":
        with contextlib.ExitStack() as stack, self._report_write_errors():
            manifest = self._matching_manifest()
            self._lock = lock_folder(self.path)
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
        chunks = [chunk.sweep for _, _, chunk in each_chunk_file(self.path) if chunk is not None]
        of_this_sweep = chunks.count(self.hash)
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
        """Check the table of a finished sweep, and write the designs anew if they are damaged."""
        if not self._is_intact(manifest, DESIGNS_FILE):
            self.remarks.append(f"{self.path / DESIGNS_FILE}: is missing or damaged and is written anew")
            write_manifest(self.path, manifest | {"files": manifest.get("files", {}) | self._write_designs()})
        if manifest["state"] == "finished":
            self.is_finished = self._is_intact(manifest, TABLE_FILE)
            if not self.is_finished:
                self.remarks.append(f"{self.path / TABLE_FILE}: is missing, damaged or not the table of this sweep, "
                                    "and is written anew from the finished chunks")  # fmt: skip

    def _is_intact(self, manifest: dict, name: str) -> bool:
        file = open_listed_file(self.path, manifest, name)
        if file is not None:
            file.close()
        return file is not None

    def _write_designs(self) -> dict[str, str]:
        """Write the table of designs; its name and checksum."""
        with atomic_write(self.path / DESIGNS_FILE) as file:
            pq.write_table(sweep_table(self._sweep.machine, self._sweep.designs), file)
            with file.open("rb") as written:
                return {DESIGNS_FILE: digest_of_file(written)}

    def _create(self) -> None:
        """Write the designs and the manifest of a sweep that begins."""
        sweep = self._sweep
        files = self._write_designs()
        write_manifest(self.path, {
            "format": FORMAT_VERSION, "name": sweep.name, "state": "unfinished", "hash": self.hash,
            "sweep": sweep_description(sweep),
            "designs": len(sweep), "chunks": len(self._chunks),
            **self.identity["versions"], **device(self._engine),
            "begun": _now(), "finished": None, "computed_on": [],
            "identity": self.identity, "machine": machine_text(sweep), "files": files,
        })  # fmt: skip

    def finished(self) -> set[int]:
        """The numbers of the finished chunks; a damaged one is not finished."""
        damaged = set()
        for number, path, file in each_chunk_file(self.path):
            rows = None if file is None else file.columns.get("design")
            usable = rows is not None and number < len(self._chunks) and file.sweep == self.hash
            if usable and np.array_equal(rows, self._chunks[number].rows):
                self._files[number] = path
                self._devices[number] = file.device
            elif number < len(self._chunks):
                damaged.add(number)
        for number in sorted(damaged - set(self._files)):
            self.remarks.append(f"{self.path / CHUNKS_FOLDER}: chunk {number} is damaged or was changed; its "
                                f"{len(self._chunks[number].rows):,} designs are computed again")  # fmt: skip
        return set(self._files)

    def check_space(self, designs: int) -> None:
        """Raise SweepError if the results of so many designs would fill the disk."""
        needed = designs * 2 * 8 * (len(self._sweep.designs) + len(self._sweep.machine.metrics) + 4) + 2**20
        free = shutil.disk_usage(self.path).free
        if free < needed:
            raise SweepError(f"{self.path}: the result needs about {needed / 1e6:.0f} MB, and the disk has "
                             f"{free / 1e6:.0f} MB left; nothing was computed")  # fmt: skip

    def write(self, result: ChunkResult) -> None:
        """Write the file of a chunk, which appears under its name only when it is complete."""
        with self._report_write_errors():
            path = write_chunk_file(self.path, self.hash, self._chunks[result.number].rows, result)
        self._files[result.number] = path
        self._devices[result.number] = dict(result.device)

    def complete(self) -> None:
        """Write the table of all designs from the finished chunks, and mark the manifest as finished."""
        designs = sweep_table(self._sweep.machine, self._sweep.designs)
        rows = [chunk.rows for chunk in self._chunks]
        used = [json.loads(d) for d in sorted({json.dumps(device) for device in self._devices.values()})]
        with self._report_write_errors():
            with atomic_write(self.path / TABLE_FILE) as file:
                write_table(designs, windows(rows, self._results_of, len(self._sweep)), file)
                with file.open("rb") as written:
                    checksum = digest_of_file(written)
            manifest = read_manifest(self.path)
            files = manifest["files"] | {TABLE_FILE: checksum}
            changes = {"state": "finished", "finished": _now(), "computed_on": used, "files": files}
            write_manifest(self.path, manifest | changes)

    def _results_of(self, number: int) -> dict[str, np.ndarray]:
        """The results of a finished chunk."""
        file = read_chunk_file(self._files[number])
        if file is None:
            raise SweepError(f"{self._files[number]}: was changed or removed while the sweep ran; "
                             "the same command computes its designs again")  # fmt: skip
        return {name: column for name, column in file.columns.items() if name != "design"}

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


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
