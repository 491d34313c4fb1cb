"""Processor cores, precision and caches: what the package needs of its process, for its own calls only.

Importing the package changes no setting of JAX: what its calls need they get by `double_precision` and `jit`. Only the
command line, whose process is its own, calls `keep_xla_programs`.
"""

import functools
import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax


def cores() -> int:
    """The processor cores that this process may use; `EDHAS_CORES` sets fewer."""
    if os.environ.get("EDHAS_CORES", "").isdigit():
        return max(1, int(os.environ["EDHAS_CORES"]))
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


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


def eval_shape(f: Callable, *args: Any) -> Any:
    """`jax.eval_shape` in double precision."""
    with double_precision():
        return jax.eval_shape(f, *args)


def keep_xla_programs() -> None:
    """Keep compiled XLA programs in the cache folder, for a process that runs nothing but this package.

    A folder that the user has set for JAX is left as it is.
    """
    cache = cache_folder()
    if cache is not None and not jax.config.jax_compilation_cache_dir:
        jax.config.update("jax_compilation_cache_dir", str(cache))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.05)


def cache_folder() -> Path | None:
    """The folder where compiled programs are kept, `EDHAS_CACHE` or one in the user's home; None if it is `off`."""
    named = os.environ.get("EDHAS_CACHE")
    return None if named == "off" else Path(named or Path.home() / ".cache" / "edhas_jax")


@functools.cache
def code_hash(packages: tuple[str, ...]) -> str:
    """A hash of the source of some packages of edhas_jax, given as folders or files relative to its root."""
    root, digest = Path(__file__).parents[1], hashlib.sha256()
    for package in packages:
        for path in sorted((root / package).rglob("*.py")) or [root / package]:
            digest.update(path.read_bytes())
    return digest.hexdigest()
