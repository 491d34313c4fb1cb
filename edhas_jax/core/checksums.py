"""Checksums of result files, so that a file that was damaged or changed is not taken for a result."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

from edhas_jax.core.regular_file import open_regular_file, read_regular_file, require_regular_file

CHECKSUM_KEY = "checksum"


def digest(content: bytes) -> str:
    """The checksum of the content of a file: 16 hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()[:16]


def read_result(path: Path) -> bytes | None:
    """The content of a regular file of any size; None if it is missing.

    Raises:
        OSError: there is such a name, but it is no regular file, or cannot be read.
    """
    try:
        return read_regular_file(path, require_regular_file(path))
    except FileNotFoundError:
        return None


def read_checked(path: Path, wanted: str | None) -> bytes | None:
    """The content of a file if it has the checksum `wanted`; None if it is missing or has another content.

    Raises:
        OSError: there is such a name, but it is no regular file, or cannot be read.
    """
    content = read_result(path)
    return content if content is not None and digest(content) == wanted else None


def digest_of_file(file: BinaryIO) -> str:
    """The digest of an open file of any size; the file is rewound afterwards."""
    file.seek(0)
    found = hashlib.file_digest(file, "sha256").hexdigest()[:16]
    file.seek(0)
    return found


def open_checked(path: Path, wanted: str | None) -> BinaryIO | None:
    """As `read_checked`, for a file that is too large to be read as a whole: open, at its beginning."""
    try:
        file = open_regular_file(path)
    except FileNotFoundError:
        return None
    if digest_of_file(file) == wanted:
        return file
    file.close()
    return None


def with_checksum(content: Mapping[str, Any]) -> dict[str, Any]:
    """The content of a JSON file with its checksum as last entry."""
    bare = {name: value for name, value in content.items() if name != CHECKSUM_KEY}
    return bare | {CHECKSUM_KEY: _digest_of_json(bare)}


def has_valid_checksum(content: Mapping[str, Any]) -> bool:
    """Whether the content of a JSON file has its own checksum."""
    bare = {name: value for name, value in content.items() if name != CHECKSUM_KEY}
    return content.get(CHECKSUM_KEY) == _digest_of_json(bare)


def _digest_of_json(content: Mapping[str, Any]) -> str:
    return digest(json.dumps(content, sort_keys=True).encode())
