"""Which Python files of the user may run: those that the caller names, and those that were allowed once by content.

A configuration or campaign that one is given may name Python code. That code runs only if the user has named it too, in
the command or in the call, or has allowed it before with `edhas trust FILE`.
"""

import dataclasses
import hashlib
import os
import shlex
from collections.abc import Iterable
from pathlib import Path

from edhas_jax.core.private_file import foreign_access, read_private_file, settings_folder, write_private_file
from edhas_jax.core.regular_file import read_regular_file
from edhas_jax.core.source_location import display_path

TRUSTED_FILE = "trusted_code"  # in the folder of the settings; a line per file: hash of its content, its path
MAX_CODE_BYTES = 10_000_000


class TrustError(ValueError):
    """A file cannot be allowed to run, or the list of such files cannot be read or written."""


@dataclasses.dataclass(frozen=True)
class TrustedCode:
    """What may run, apart from the program itself.

    Attributes:
        files: absolute paths of files.
        modules: names of modules.
        hashes: SHA-256 of the content of files.
        remembered: whether files that were allowed once may run as well.
    """

    files: frozenset[str] = frozenset()
    modules: frozenset[str] = frozenset()
    hashes: frozenset[str] = frozenset()
    remembered: bool = True

    @classmethod
    def of(cls, named: "Trust") -> "TrustedCode":
        """What the caller has named: "my_effects.py", "my_effects.py:SealDrag", "package.module"."""
        if isinstance(named, TrustedCode):
            return named
        texts = [str(name) for name in ([named] if isinstance(named, str | Path) else named)]
        sources = [text.rpartition(":")[0] if _names_class(text) else text for text in texts]
        files = frozenset(os.path.realpath(s) for s in sources if s.endswith(".py"))
        return cls(files, frozenset(s for s in sources if not s.endswith(".py")))

    @property
    def names_nothing(self) -> bool:
        """Whether the caller has named no code at all."""
        return not (self.files or self.modules or self.hashes)

    def allows_file(self, path: Path, content: bytes) -> bool:
        """Whether a file with this content may run."""
        digest = content_hash(content)
        if os.path.realpath(path) in self.files or digest in self.hashes:
            return True
        return self.remembered and digest in remembered_files()

    def allows_module(self, name: str) -> bool:
        """Whether a module may be imported."""
        return name in self.modules


Trust = TrustedCode | Iterable[str | Path] | str | Path  # as arguments name it, see `TrustedCode.of`


def content_hash(content: bytes) -> str:
    """The hash by which the content of a file is known."""
    return hashlib.sha256(content).hexdigest()


def trust(file: Path | str) -> Path:
    """Allow a Python file to run from now on, wherever a configuration or campaign names it, until its content changes.

    Args:
        file: the file.

    Returns:
        The list of allowed files, which was changed.

    Raises:
        TrustError: the file cannot be read or is no Python file, or the list cannot be written.
    """
    path = Path(file)
    if path.suffix != ".py":
        raise TrustError(f"{path}: a Python file (.py) belongs here")
    try:
        digest = content_hash(read_regular_file(path, MAX_CODE_BYTES))
    except OSError as error:
        raise TrustError(f"{path}: cannot be read: {error.strerror or error}") from None
    own = os.path.realpath(path)
    kept = {known: where for known, where in remembered_files().items() if where != own}
    return _write_list(kept | {digest: own})


def distrust(file: Path | str) -> Path:
    """Withdraw what `trust` allowed: the file at this path runs no more, whatever its content was then.

    Args:
        file: the file; it need not exist any more.

    Returns:
        The list of allowed files, which was changed.

    Raises:
        TrustError: the file is not on the list, or the list cannot be written.
    """
    own, known = os.path.realpath(file), remembered_files()
    kept = {digest: where for digest, where in known.items() if where != own}
    if len(kept) == len(known):
        raise TrustError(f"{file}: was not allowed to run; `edhas trust` lists the files that are")
    return _write_list(kept)


def remembered_files() -> dict[str, str]:
    """The files that were allowed once: absolute path by hash of the content.

    Raises:
        TrustError: the list cannot be read, or other users can change it.
    """
    path = trusted_list()
    if path is None or not os.path.lexists(path):
        return {}
    foreign = foreign_access(path) or foreign_access(path.parent)
    if foreign:
        where = path if foreign_access(path) else path.parent
        raise TrustError(f"{where}: {foreign}; the list of files that may run is not used")
    try:
        lines = (read_private_file(path) or b"").decode("utf-8", "surrogateescape").splitlines()
    except OSError as error:
        raise TrustError(f"{path}: cannot be read: {error.strerror or error}") from None
    pairs = (line.partition("  ") for line in lines)
    return {digest: where for digest, _, where in pairs if len(digest) == 64}


def untrusted_sentence(path: Path, name: str, option: str) -> str:
    """What to type so that a file may run.

    Args:
        path: the file.
        name: the class that is wanted of it.
        option: the option of the command line that names such a class, such as "--effect".
    """
    shown = shlex.quote(display_path(path))
    changed = os.path.realpath(path) in remembered_files().values()
    what = "has changed since it was allowed to run" if changed else "is Python code that was not allowed to run"
    return (f"{display_path(path)}: {what}; read it, then type `edhas trust {shown}` once, or add "
            f"`{option} {shown}:{name}` to the command (in Python: trust=[\"{display_path(path)}\"])")  # fmt: skip


def _names_class(text: str) -> bool:
    source, colon, name = text.rpartition(":")
    return bool(colon) and name.strip().isidentifier() and bool(source)


def trusted_list() -> Path | None:
    """The file that lists what was allowed once; None if the user has no folder for settings."""
    folder = settings_folder()
    return None if folder is None else folder / TRUSTED_FILE


def _write_list(files: dict[str, str]) -> Path:
    path = trusted_list()
    if path is None:
        raise TrustError("there is no folder for settings; name one with EDHAS_CONFIG=FOLDER")
    text = "".join(f"{digest}  {where}\n" for digest, where in files.items() if "\n" not in where)
    try:
        write_private_file(path, text.encode("utf-8", "surrogateescape"))
    except OSError as error:
        raise TrustError(f"{path}: cannot be written: {error.strerror or error}") from None
    return path
