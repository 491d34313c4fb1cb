"""Files of a result folder: a list of what a command has written there, with checksums; all others are left alone."""

import fnmatch
import json
from collections.abc import Sequence
from pathlib import Path

from edhas_jax.core.atomic_file import atomic_write
from edhas_jax.core.checksums import digest, has_valid_checksum, read_checked, read_result, with_checksum

LIST_FILE = "files.json"


class ResultFileError(ValueError):
    """A result file or folder cannot be written, or is not a valid result."""


class ResultFiles:
    """The files that a command writes into a folder; made before a long computation, to refuse what is not allowed.

    Args:
        folder: the folder to write, which may not exist yet.
        overwrite: whether it may exist; then only files that a command has written before are replaced or removed.
        names: names of all files that the command may write, or patterns of them such as `sized*.yaml`.

    Raises:
        ResultFileError: the folder exists and `overwrite` is false, or a file of these names is not the program's.
    """

    def __init__(self, folder: Path, overwrite: bool, names: Sequence[str]):
        self.folder, self._names, self._before = Path(folder), tuple(names), {}
        if self.folder.exists() and not overwrite:
            raise ResultFileError(
                f"{folder}: exists already; nothing was written. Name another folder or add --overwrite"
            )
        if self.folder.exists() and not self.folder.is_dir():
            raise ResultFileError(f"{folder}: is not a folder; nothing was written")
        self._listed = (read_list(self.folder) or {}).get("names", [])
        own = self._present(self._listed)
        foreign = sorted(set(self._present(self._names)) - set(own))
        if foreign:
            raise ResultFileError(f"{self.folder / foreign[0]}: was not written by edhas, so it is not overwritten; "
                                  "nothing was changed. Name another folder, or move the file")  # fmt: skip

    def begin(self) -> None:
        """Make the folder, and note which names are the program's there.

        Raises:
            OSError: it cannot be written.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        self._before = {n: (self.folder / n).stat().st_mtime_ns for n in self._present([*self._listed, *self._names])}
        _write_list(self.folder, sorted({*self._listed, *self._names}), {})

    def finish(self) -> None:
        """Remove files of an earlier result that were not written again, and list all others with their checksums.

        Raises:
            OSError: the folder cannot be written.
        """
        files = {}
        for name in self._present([*self._listed, *self._names]):
            path = self.folder / name
            if self._before.get(name) == path.stat().st_mtime_ns:
                path.unlink()
            else:
                files[name] = digest(path.read_bytes())
        _write_list(self.folder, sorted(files), files)

    def _present(self, patterns: Sequence[str]) -> list[str]:
        """The files in the folder whose names match one of the patterns."""
        if not self.folder.is_dir():
            return []
        names = [p.name for p in self.folder.iterdir() if p.is_file() and p.name != LIST_FILE]
        return [n for n in names if any(fnmatch.fnmatchcase(n, pattern) for pattern in patterns)]


def _write_list(folder: Path, names: Sequence[str], files: dict[str, str]) -> None:
    text = json.dumps(with_checksum({"names": list(names), "files": files}), indent=2, ensure_ascii=False) + "\n"
    with atomic_write(folder / LIST_FILE) as file:
        file.write_text(text, encoding="utf-8")


def read_list(folder: Path) -> dict | None:
    """The list of the files of a folder; None if it has none.

    Raises:
        ResultFileError: the list is damaged or was not written by this program.
    """
    try:
        content = read_result(folder / LIST_FILE)
        if content is None:
            return None
        listed = json.loads(content.decode("utf-8"))
        if not isinstance(listed, dict) or not has_valid_checksum(listed):
            raise ValueError("its checksum is wrong")
        return listed
    except NotADirectoryError:
        return None
    except (OSError, ValueError) as error:
        raise ResultFileError(f"{folder / LIST_FILE}: is damaged or not the list of a result: {error}") from None


def check_files(folder: Path, names: Sequence[str]) -> None:
    """Check that files of a result are those that were written; without a list of them nothing is checked.

    Raises:
        ResultFileError: a file is damaged or was changed.
    """
    listed = read_list(folder)
    if listed is None:
        return
    for name in names:
        try:
            intact = name not in listed["files"] or read_checked(folder / name, listed["files"][name]) is not None
        except OSError as error:
            raise ResultFileError(f"{folder / name}: cannot be read: {error.strerror or error}") from None
        if not intact:
            raise ResultFileError(f"{folder / name}: is damaged, or was changed since it was written")
