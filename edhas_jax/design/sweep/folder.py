"""Folder of a sweep: a manifest with what it is and its state, a file per finished chunk, the table of all designs.

A file of a chunk, `chunks/NUMBER-CHECKSUM.parquet`, is complete or absent, and read only if intact.
"""

import contextlib
import dataclasses
import datetime
import errno
import json
import re
import shutil
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from edhas_jax.config.result_files import LOCK_FILE, ResultFileError, lock_folder
from edhas_jax.core import checksums
from edhas_jax.core.atomic_file import PARTIAL_SUFFIX, atomic_write
from edhas_jax.core.regular_file import FileKindError, open_regular_file, read_regular_file
from edhas_jax.design.batch.batch import Chunk, engine_of_designs
from edhas_jax.design.sweep.config import Sweep
from edhas_jax.design.sweep.identity import device, identity_differences, identity_hash, machine_text, sweep_identity
from edhas_jax.design.sweep.table import TABLE_FILE, sweep_table, windows, write_table

FORMAT_VERSION = 2  # the first had no checksums
MAX_MANIFEST_BYTES = 500_000_000  # the samples of a recording may be in it
MANIFEST_FILE = "manifest.json"
CHUNKS_FOLDER = "chunks"
_CHUNK_NAME = re.compile(r"(\d{6,8})-([0-9a-f]{16})\.parquet")
DESIGNS_FILE = "designs.parquet"
OWN_NAMES = (MANIFEST_FILE, DESIGNS_FILE, TABLE_FILE, CHUNKS_FOLDER, LOCK_FILE)


class SweepError(ResultFileError):
    """A sweep cannot be run, written or read."""


class ManifestError(SweepError):
    """The folder has no manifest, or a damaged one."""


def write_manifest(folder: Path, manifest: dict[str, Any]) -> None:
    """Write the manifest with its checksum.

    Raises:
        OSError: it cannot be written.
    """
    text = json.dumps(checksums.with_checksum(manifest), indent=2, ensure_ascii=False) + "\n"
    with atomic_write(folder / MANIFEST_FILE) as file:
        file.write_text(text, encoding="utf-8")


def read_manifest(folder: Path) -> dict[str, Any]:
    """Read the manifest of a sweep's folder.

    Raises:
        ManifestError: it is missing or damaged.
        SweepError: it was written by a later version.
    """
    try:
        manifest = json.loads(read_regular_file(folder / MANIFEST_FILE, MAX_MANIFEST_BYTES).decode("utf-8"))
        later = manifest["format"] > FORMAT_VERSION
        checked = checksums.CHECKSUM_KEY in manifest or manifest["format"] == FORMAT_VERSION
        if checked and not checksums.has_valid_checksum(manifest):
            raise ValueError("its checksum is wrong; the command that made the folder repairs it")
        if later:
            raise SweepError(f"{folder}: written by a later version ({manifest['edhas_jax']}); "
                             f"this one reads {FORMAT_VERSION}")  # fmt: skip
        if not {"hash", "identity", "state"} <= manifest.keys():
            raise ValueError("keys are missing")
        return manifest
    except FileNotFoundError:
        raise ManifestError(f"{folder}: is not the folder of a sweep: {MANIFEST_FILE} is missing") from None
    except (NotADirectoryError, FileKindError, ValueError, KeyError, TypeError) as error:
        if isinstance(error, SweepError):
            raise
        raise ManifestError(f"{folder}: {MANIFEST_FILE} is damaged or not one of a sweep: {error}") from None


def open_listed_file(folder: Path, manifest: dict[str, Any], name: str) -> BinaryIO | None:
    """A file of the folder, open; None if it is missing or not the one that the manifest lists.

    Raises:
        OSError: there is such a name, but it cannot be read.
    """
    if manifest["format"] == FORMAT_VERSION:
        return checksums.open_checked(folder / name, manifest.get("files", {}).get(name))
    try:
        return open_regular_file(folder / name)
    except FileNotFoundError:
        return None


@dataclasses.dataclass(frozen=True)
class ChunkResult:
    """The results of a chunk.

    Attributes:
        number: of the chunk in the sweep.
        metrics: by metric the values (SI) of its designs, shape (designs,), with status, cycles and residual.
        versions: versions of the libraries and of the model code.
        device: processor and compiler flags.
    """

    number: int
    metrics: Mapping[str, np.ndarray]
    versions: Mapping[str, str]
    device: Mapping[str, str]


class ChunkFile(NamedTuple):
    """The content of the file of a chunk.

    Attributes:
        sweep: hash of the identity of the sweep to which it belongs.
        device: on which it was computed.
        columns: `design` (row numbers) and the metrics (SI), each (designs,).
    """

    sweep: str
    device: dict[str, str]
    columns: dict[str, np.ndarray]


def write_chunk_file(folder: Path, sweep: str, rows: np.ndarray, result: ChunkResult) -> Path:
    """Write the file of a chunk into the folder of a sweep, which appears under its name only when it is complete.

    Returns:
        Its path.

    Raises:
        OSError: it cannot be written.
    """
    metadata = {"hash": sweep, "versions": json.dumps(result.versions), "device": json.dumps(result.device)}
    data = pa.table({"design": rows, **result.metrics}).replace_schema_metadata(metadata)
    buffer = pa.BufferOutputStream()
    pq.write_table(data, buffer)
    content = buffer.getvalue().to_pybytes()
    name = f"{result.number:06d}-{checksums.digest(content)}.parquet"
    with atomic_write(folder / CHUNKS_FOLDER / name) as file:
        file.write_bytes(content)
    for other in (folder / CHUNKS_FOLDER).glob(f"{result.number:06d}-*.parquet"):
        if other.name != name:
            other.unlink()
    return folder / CHUNKS_FOLDER / name


def each_chunk_file(folder: Path) -> Iterator[tuple[int, Path, ChunkFile | None]]:
    """Number, path and content of the chunk files in the folder of a sweep, one after the other.

    The content is None where the file is damaged or was changed; an intact one of the same number may follow.
    """
    for path in sorted((folder / CHUNKS_FOLDER).glob("*.parquet")):
        match = _CHUNK_NAME.fullmatch(path.name)
        if match is not None:
            yield int(match[1]), path, read_chunk_file(path)


def read_chunk_file(path: Path) -> ChunkFile | None:
    """The content of a chunk file; None if it is damaged or was changed."""
    try:
        content = checksums.read_checked(path, _CHUNK_NAME.fullmatch(path.name)[2])
        if content is None:
            return None
        data = pq.read_table(pa.BufferReader(content))
        metadata = {k.decode(): v.decode() for k, v in (data.schema.metadata or {}).items()}
        columns = {name: data[name].to_numpy() for name in data.column_names}
        return ChunkFile(metadata["hash"], json.loads(metadata["device"]), columns)
    except (OSError, ValueError, KeyError, pa.ArrowException):
        return None


def is_chunk_name(name: str) -> bool:
    """Whether a file of this name in `chunks` is one that the program writes."""
    return bool(_CHUNK_NAME.fullmatch(name)) or name.startswith(".") and name.endswith(PARTIAL_SUFFIX)


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
        with open_listed_file(self.path, manifest, name) or contextlib.nullcontext() as file:
            return file is not None

    def _write_designs(self) -> dict[str, str]:
        """Write the table of designs; its name and checksum."""
        designs = sweep_table(self._sweep.machine, self._sweep.designs)
        return self._write_table(DESIGNS_FILE, lambda file: pq.write_table(designs, file))

    def _write_table(self, name: str, write: Callable[[Path], None]) -> dict[str, str]:
        with atomic_write(self.path / name) as file:
            write(file)
            with file.open("rb") as written:
                return {name: checksums.digest_of_file(written)}

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
            parts = windows(rows, self._results_of, len(self._sweep))
            written = self._write_table(TABLE_FILE, lambda file: write_table(designs, parts, file))
            manifest = read_manifest(self.path)
            changes = {"state": "finished", "finished": _now(), "computed_on": used}
            write_manifest(self.path, manifest | changes | {"files": manifest["files"] | written})

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
