"""Manifest of a sweep's folder: what the sweep is, its state, and the checksums of its files."""

import json
from pathlib import Path
from typing import Any, BinaryIO

from edhas_jax.config.run_folder import ResultFileError
from edhas_jax.core.atomic_file import atomic_write
from edhas_jax.core.checksums import CHECKSUM_KEY, has_valid_checksum, open_checked, with_checksum
from edhas_jax.core.regular_file import FileKindError, open_regular_file, read_regular_file

FORMAT_VERSION = 2  # the first had no checksums
MAX_MANIFEST_BYTES = 500_000_000  # the samples of a recording may be in it
MANIFEST_FILE = "manifest.json"


class SweepError(ResultFileError):
    """A sweep cannot be run, written or read."""


class ManifestError(SweepError):
    """The folder has no manifest, or a damaged one."""


def write_manifest(folder: Path, manifest: dict[str, Any]) -> None:
    """Write the manifest with its checksum.

    Raises:
        OSError: it cannot be written.
    """
    text = json.dumps(with_checksum(manifest), indent=2, ensure_ascii=False) + "\n"
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
        checked = CHECKSUM_KEY in manifest or manifest["format"] == FORMAT_VERSION
        if checked and not has_valid_checksum(manifest):
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
        return open_checked(folder / name, manifest.get("files", {}).get(name))
    try:
        return open_regular_file(folder / name)
    except FileNotFoundError:
        return None
