"""Files and folders that no other user of the computer can change: the user's settings, and a secret."""

import contextlib
import os
import secrets
import stat
from pathlib import Path

from edhas_jax.core.atomic_file import atomic_write
from edhas_jax.core.regular_file import read_regular_file

VARIABLE = "EDHAS_CONFIG"  # names another folder for the settings
SECRET_FILE = "secret"
SECRET_BYTES = 32
MAX_BYTES = 10_000_000  # of a file of settings


def settings_folder() -> Path | None:
    """The user's folder for settings: `EDHAS_CONFIG`, or edhas_jax in `XDG_CONFIG_HOME` or ~/.config.

    None if the user has no home.
    """
    if os.environ.get(VARIABLE):
        return Path(os.environ[VARIABLE])
    if os.environ.get("XDG_CONFIG_HOME"):
        return Path(os.environ["XDG_CONFIG_HOME"]) / "edhas_jax"
    try:
        return Path.home() / ".config" / "edhas_jax"
    except RuntimeError:
        return None


def foreign_access(path: Path, secret: bool = False) -> str:
    """Why somebody else may have written a file or folder (or read it, if it is secret); empty if nobody can.

    Args:
        path: the file or folder; a symbolic link counts as foreign.
        secret: whether others must not be able to read it either.
    """
    try:
        status = os.lstat(path)
    except OSError as error:
        return f"cannot be looked at: {error.strerror}"
    if not hasattr(os, "geteuid"):
        return ""  # Windows: the folders of a user are private to begin with
    if stat.S_ISLNK(status.st_mode):
        return "is a symbolic link"
    if status.st_uid != os.geteuid():
        return "belongs to another user"
    if status.st_mode & (0o077 if secret else 0o022):
        return "is open to other users; " + ("chmod go-rwx" if secret else "chmod go-w") + " closes it"
    return ""


def make_private_folder(path: Path) -> bool:
    """Make a folder that only this user can read or change; whether it is one."""
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.mkdir(mode=0o700, exist_ok=True)
    return path.is_dir() and not foreign_access(path, secret=True)


def read_private_file(path: Path, secret: bool = False) -> bytes | None:
    """The content of a file that nobody else can have written; None if it is missing or somebody can.

    Raises:
        OSError: it cannot be read.
    """
    if not os.path.lexists(path) or foreign_access(path, secret) or foreign_access(path.parent):
        return None
    return read_regular_file(path, MAX_BYTES)


def write_private_file(path: Path, data: bytes) -> None:
    """Write a file that only this user can read or change.

    Raises:
        OSError: it cannot be written.
    """
    make_private_folder(path.parent)
    with atomic_write(path) as beside:
        descriptor = os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with open(descriptor, "wb") as file:
            file.write(data)


def user_secret() -> bytes | None:
    """Random bytes that only this user knows, made at the first call; None where they cannot be kept."""
    folder = settings_folder()
    if folder is None:
        return None
    path = folder / SECRET_FILE
    try:
        known = read_private_file(path, secret=True)
        if known is None or len(known) != SECRET_BYTES:
            write_private_file(path, secrets.token_bytes(SECRET_BYTES))
            known = read_private_file(path, secret=True)
    except OSError:
        return None
    return known if known is not None and len(known) == SECRET_BYTES else None
