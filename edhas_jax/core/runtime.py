"""Compiler flags, precision and compilation cache, set before JAX starts so that no user has to know them."""

import functools
import hashlib
import os
import re
from pathlib import Path

# Both belong together: wide fusions keep the step from being computed several times over, and the loop compiled as one
# function is free of a dispatch per fusion. They are undocumented options of jaxlib, checked with 0.10.2. The first can
# make the compiler abort on other JAX programs in the same process; EDHAS_XLA=plain leaves both out.
CPU_OPTIONS = "xla_cpu_use_multi_output_fusion=true,xla_cpu_small_while_loop_byte_threshold=100000000"


def cores() -> int:
    """The processor cores that this process may use; `EDHAS_CORES` sets fewer."""
    if os.environ.get("EDHAS_CORES", "").isdigit():
        return max(1, int(os.environ["EDHAS_CORES"]))
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def prepare() -> None:
    """Set the flags, 64-bit numbers and the cache of compiled programs.

    `EDHAS_XLA=plain` leaves the compiler flags alone; `EDHAS_CACHE` names another folder for the cache, or `off`;
    `EDHAS_CORES` is the number of cores to use, all by default; `EDHAS_ENGINE=xla` leaves the loops of a batch to XLA.
    Flags that the user has set are kept.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    if os.environ.get("EDHAS_XLA") != "plain":
        if "xla_backend_extra_options" not in flags:
            flags = f"{flags} --xla_backend_extra_options={CPU_OPTIONS}"
        if "xla_flags_reset" not in flags:  # flags are read anew for each program: a reverse pass wants others
            flags = f"{flags} --xla_flags_reset=true"
        if "EDHAS_CORES" in os.environ:
            flags = re.sub(r"--xla_force_host_platform_device_count=\d+", "", flags)
        if "xla_force_host_platform_device_count" not in flags:
            # one device a core: a batch runs a loop of its own on each, which no thread pool inside a loop matches;
            # never a single one, because a program for one device is compiled on another path, to other last bits
            flags = f"{flags} --xla_force_host_platform_device_count={max(2, cores())}"
        os.environ["XLA_FLAGS"] = flags.strip()

    import jax

    jax.config.update("jax_enable_x64", True)
    cache = cache_folder()
    if cache is not None and not jax.config.jax_compilation_cache_dir:
        jax.config.update("jax_compilation_cache_dir", str(cache))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.05)


def cache_folder() -> Path | None:
    """Where compiled programs are kept, if anywhere."""
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


def native_loops() -> bool:
    """Whether the package compiles loops for this processor itself: on a CPU, unless `EDHAS_ENGINE=xla`."""
    import jax

    return os.environ.get("EDHAS_ENGINE") != "xla" and jax.default_backend() == "cpu"
