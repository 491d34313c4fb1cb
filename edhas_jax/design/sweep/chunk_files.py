"""Files of finished chunks, `chunks/NUMBER-CHECKSUM.parquet`: each is complete or absent, and read only if intact."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from edhas_jax.core.atomic_file import PARTIAL_SUFFIX, atomic_write
from edhas_jax.core.checksums import digest, read_checked
from edhas_jax.design.sweep.chunk_job import ChunkResult

CHUNKS_FOLDER = "chunks"
_NAME = re.compile(r"(\d{6,8})-([0-9a-f]{16})\.parquet")


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
    name = f"{result.number:06d}-{digest(content)}.parquet"
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
        match = _NAME.fullmatch(path.name)
        if match is not None:
            yield int(match[1]), path, read_chunk_file(path)


def read_chunk_file(path: Path) -> ChunkFile | None:
    """The content of a chunk file; None if it is damaged or was changed."""
    try:
        content = read_checked(path, _NAME.fullmatch(path.name)[2])
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
    return bool(_NAME.fullmatch(name)) or name.startswith(".") and name.endswith(PARTIAL_SUFFIX)
