"""Processor cores, precision and caches: what the package needs of its process, for its own calls only.

Importing the package changes no setting of JAX: what its calls need they get by `double_precision` and `jit`. Only the
command line, whose process is its own, calls `keep_xla_programs`.
"""

import contextlib
import functools
import glob
import hashlib
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
from threadpoolctl import threadpool_limits

from edhas_jax.core.private_file import foreign_access, make_private_folder

CORES_VARIABLE, MAX_CORES = "EDHAS_CORES", 1024


class CoresError(ValueError):
    """`EDHAS_CORES` is not a number of cores."""


def cores() -> int:
    """The processor cores that this process may use; `EDHAS_CORES` sets another number.

    Raises:
        CoresError: it is not a whole number from 1 to `MAX_CORES`.
    """
    text = os.environ.get(CORES_VARIABLE, "").strip()
    if not text:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if not re.fullmatch(r"[0-9]{1,9}", text) or not 1 <= int(text) <= MAX_CORES:
        shown = text if len(text) < 20 else text[:20] + "…"
        raise CoresError(f"{CORES_VARIABLE}={shown}: a whole number from 1 to {MAX_CORES} belongs here")
    return int(text)


def single_threaded_algebra(f: Callable) -> Callable:
    """A decorator: the libraries of linear algebra use one thread while the function runs.

    The matrices of a fit are small and the loop engine uses the cores: threads of the libraries gain nothing, and where
    something else runs on the machine they wait for each other a hundred times as long as the product takes.
    """
    return threadpool_limits.wrap(limits=1, user_api="blas")(f)


def double_precision():
    """A context in which JAX has 64-bit numbers, whatever the process has set; it holds for the calling thread."""
    if hasattr(jax, "enable_x64"):
        return jax.enable_x64(True)
    from jax.experimental import enable_x64  # its place before JAX 0.8

    return enable_x64(True)


def jit(f: Callable | None = None, **options: Any) -> Callable:
    """`jax.jit`, traced and called in double precision whatever the process has set; usable as a decorator."""
    if f is None:
        return functools.partial(jit, **options)
    compiled = jax.jit(f, **options)

    @functools.wraps(f)
    def call(*args, **kwargs):
        with double_precision():
            return compiled(*args, **kwargs)

    return call


def platform() -> str:
    """The platform on which JAX computes in this thread: that of its default device, "cpu" in a callback."""
    device = jax.config.jax_default_device
    return jax.default_backend() if device is None else getattr(device, "platform", device)


def eval_shape(f: Callable, *args: Any) -> Any:
    """`jax.eval_shape` in double precision."""
    with double_precision():
        return jax.eval_shape(f, *args)


def keep_xla_programs() -> None:
    """Keep compiled XLA programs in the cache folder, for a process that runs nothing but this package.

    A folder that the user has set for JAX is left as it is. JAX does not check who wrote what it loads, so programs are
    kept only in a folder that no other user can read or change.
    """
    cache = cache_folder()
    if cache is None or jax.config.jax_compilation_cache_dir:
        return
    with contextlib.suppress(OSError):
        cache.mkdir(mode=0o700, parents=True, exist_ok=True)
    folder = cache / "xla"
    if not foreign_access(cache) and make_private_folder(folder):
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.05)


def drop_damaged_program(warning: str) -> bool:
    """Remove the kept XLA programs that a warning of JAX calls unreadable, which JAX itself would leave for ever.

    Returns:
        Whether the warning is of that kind.
    """
    found = re.search(r"persistent compilation cache entry for '([^']+)'", warning)
    folder = jax.config.jax_compilation_cache_dir
    if found is None or folder is None:
        return False
    for file in Path(folder).glob(f"{glob.escape(found[1])}-*"):
        with contextlib.suppress(OSError):
            file.unlink()
    return True


def cache_folder() -> Path | None:
    """The folder where compiled programs are kept, `EDHAS_CACHE` or one in the user's home.

    None if it is `off`, or if the user has no home.
    """
    named = os.environ.get("EDHAS_CACHE")
    if named:
        return None if named == "off" else Path(named)
    with contextlib.suppress(RuntimeError):
        return Path.home() / ".cache" / "edhas_jax"
    return None


@functools.cache
def code_hash(packages: tuple[str, ...]) -> str:
    """A hash of the source of some packages of edhas_jax, given as folders or files relative to its root."""
    root, digest = Path(__file__).parents[1], hashlib.sha256()
    for package in packages:
        for path in sorted((root / package).rglob("*.py")) or [root / package]:
            digest.update(path.read_bytes())
    return digest.hexdigest()
