"""Files of a result folder: a list of what a command has written there, with checksums; all others are left alone.

A lock keeps two commands from writing one folder at the same time.
"""

import contextlib
import fnmatch
import json
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TextIO

from edhas_jax.core.atomic_file import atomic_write
from edhas_jax.core.checksums import digest, has_valid_checksum, read_checked, read_result, with_checksum

LIST_FILE, LOCK_FILE = "files.json", ".lock"
FOR_READERS = (".png", ".html")  # files that no result is read from, so that one may be moved elsewhere


class ResultFileError(ValueError):
    """A result file or folder cannot be written, or is not a valid result."""


def require_new(path: Path, overwrite: bool, what: str = "folder") -> None:
    """Refuse a folder or file that exists, unless it may be overwritten; call it before a long computation.

    Raises:
        ResultFileError: it exists and `overwrite` is false.
    """
    if path.exists() and not overwrite:
        raise ResultFileError(f"{path}: exists already; nothing was written. Name another {what} or add --overwrite")


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
        require_new(self.folder, overwrite)
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


def lock_folder(folder: Path) -> TextIO | None:
    """Lock a folder until the file that is returned is closed; None where the file system has no locks.

    Raises:
        ResultFileError: another process has locked it.
        OSError: the file of the lock cannot be made.
    """
    try:
        import fcntl
    except ImportError:
        return None
    # neither follows a link to another file nor waits for a pipe
    flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK
    file = os.fdopen(os.open(folder / LOCK_FILE, flags, 0o644), "r+", closefd=True)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        raise ResultFileError(f"{folder}: is being computed by another process; wait for it, or stop it") from None
    except OSError:
        pass
    with contextlib.suppress(FileNotFoundError):
        if os.path.samestat(os.fstat(file.fileno()), os.stat(folder / LOCK_FILE)):
            return file
    file.close()  # of a command that has just ended, and has removed it
    return lock_folder(folder)


@contextlib.contextmanager
def report_write_errors(path: Path) -> Iterator[None]:
    """Turn an error of the operating system while writing `path` into one message for the user.

    Raises:
        ResultFileError: the block raised an OSError.
    """
    try:
        yield
    except OSError as error:
        raise ResultFileError(f"{path}: cannot be written: {error.strerror or error}") from None


@contextlib.contextmanager
def locked_folder(folder: Path) -> Iterator[None]:
    """Lock a folder, which is made, and removed at the end where nothing was written into it.

    Raises:
        ResultFileError: another process has locked it, or it cannot be made.
    """
    is_new = not folder.exists()
    with report_write_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        lock = lock_folder(folder)
    try:
        yield
    finally:
        with contextlib.suppress(OSError):  # the result counts, not the lock
            (folder / LOCK_FILE).unlink(missing_ok=True)
            if is_new and holds_nothing(folder):
                folder.rmdir()
        if lock is not None:
            lock.close()


def holds_nothing(folder: Path) -> bool:
    """Whether a folder is missing, or holds nothing but a lock, which an interrupted command may have left."""
    return not folder.exists() or (folder.is_dir() and {p.name for p in folder.iterdir()} <= {LOCK_FILE})


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


def check_files(folder: Path) -> None:
    """Check that all files of a result are those that were written; without a list of them nothing is checked.

    Raises:
        ResultFileError: a file is missing, is damaged or was changed.
    """
    for name, checksum in ((read_list(folder) or {}).get("files") or {}).items():
        path = folder / name
        try:
            if read_checked(path, checksum) is not None or (path.suffix in FOR_READERS and not path.exists()):
                continue
        except OSError as error:
            raise ResultFileError(f"{path}: cannot be read: {error.strerror or error}") from None
        raise ResultFileError(f"{path}: is missing, is damaged, or was changed since it was written")
