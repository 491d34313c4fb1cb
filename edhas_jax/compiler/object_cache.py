"""Cache of machine code: object files that only this user can have written, or they are not used.

Machine code runs as the user who loads it, and damaged code ends the process. Each file therefore carries a keyed
checksum (HMAC) with a secret of the user; a file with another one is compiled anew.
"""

import hashlib
import hmac
from pathlib import Path

from edhas_jax.core.atomic_file import atomic_write
from edhas_jax.core.private_file import foreign_access, user_secret
from edhas_jax.core.regular_file import read_regular_file

CHECKSUM_BYTES = 32
MAX_BYTES = 500_000_000


class ObjectCache:
    """The object files in a folder; without a folder, or without a secret, nothing is kept.

    Args:
        folder: of the files; created when it is needed.
    """

    def __init__(self, folder: Path | None):
        self._folder, self._secret = folder, None if folder is None else user_secret()

    def read(self, text: str) -> bytes | None:
        """The machine code that was kept for a text; None if there is none, or the slightest doubt about it."""
        if self._secret is None:
            return None
        path = self._path(text)
        if foreign_access(path):
            return None
        try:
            data = read_regular_file(path, MAX_BYTES)
        except OSError:
            return None
        checksum, code = data[:CHECKSUM_BYTES], data[CHECKSUM_BYTES:]
        return code if hmac.compare_digest(checksum, self._checksum(path.name, code)) else None

    def keep(self, text: str, code: bytes) -> None:
        """Keep the machine code for a text; a folder that cannot be written is no reason to stop."""
        if self._secret is None:
            return
        path = self._path(text)
        try:
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            with atomic_write(path) as beside:
                beside.touch(mode=0o600)
                beside.write_bytes(self._checksum(path.name, code) + code)
        except OSError:
            pass

    def _path(self, text: str) -> Path:
        """The file of a text; other users have other names for it, so that they can share a folder."""
        digest = hmac.new(self._secret, text.encode(), hashlib.sha256).hexdigest()
        return self._folder / f"loop-{digest[:32]}.o"

    def _checksum(self, name: str, code: bytes) -> bytes:
        return hmac.new(self._secret, name.encode() + b"\0" + code, hashlib.sha256).digest()
