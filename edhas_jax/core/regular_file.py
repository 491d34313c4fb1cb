"""Reading of whole files: regular files of a limited size only, so that no pipe blocks and no file fills the memory."""

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO

_KINDS = {
    stat.S_IFDIR: "is a folder, not a file",
    stat.S_IFIFO: "is a pipe, not a file",
    stat.S_IFSOCK: "is a socket, not a file",
    stat.S_IFCHR: "is a device, not a file",
    stat.S_IFBLK: "is a device, not a file",
}


class FileKindError(OSError):
    """A path names something that cannot be read as a file, or a file that is too large; `strerror` says what."""


def require_regular_file(path: Path) -> int:
    """Check that a path names a regular file, without opening it.

    Returns:
        Its size, bytes.

    Raises:
        FileKindError: it is a folder, a pipe, a socket or a device.
        OSError: there is no such file, or it may not be looked at.
    """
    try:
        status = os.stat(path)
    except ValueError:  # a NUL in the name
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path)) from None
    kind = _KINDS.get(stat.S_IFMT(status.st_mode))
    if kind:
        raise FileKindError(errno.EINVAL, kind, str(path))
    return status.st_size


def open_regular_file(path: Path) -> BinaryIO:
    """Open a regular file of any size to read it.

    Raises:
        FileKindError: it is no regular file.
        OSError: it cannot be read.
    """
    require_regular_file(path)
    # the file may have been replaced by a pipe since: then it is not waited for
    descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    file = os.fdopen(descriptor, "rb")
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        file.close()
        raise FileKindError(errno.EINVAL, "is not a file", str(path))
    return file


def read_regular_file(path: Path, limit: int) -> bytes:
    """Read a whole regular file.

    Args:
        path: the file.
        limit: size that is allowed, bytes.

    Raises:
        FileKindError: it is no regular file, or larger than `limit`.
        OSError: it cannot be read.
    """
    with open_regular_file(path) as file:
        size = os.fstat(file.fileno()).st_size
        data = file.read(limit + 1) if size <= limit else b""
    if max(size, len(data)) > limit:
        message = f"has {size / 1e6:.4g} MB; at most {limit / 1e6:.4g} MB are read"
        raise FileKindError(errno.EFBIG, message, str(path))
    return data
