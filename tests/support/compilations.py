"""How many programs were compiled: by XLA in this process, and loops as machine code in a cache folder."""

from pathlib import Path

import jax

_xla_programs = 0


def _count(event: str, duration: float, **_) -> None:
    global _xla_programs
    _xla_programs += event == "/jax/core/compile/backend_compile_duration"


jax.monitoring.register_event_duration_secs_listener(_count)


def compilations(cache: Path) -> int:
    """Programs that XLA has compiled or loaded in this process, and object files in a cache folder.

    Only differences count. A test that expects none also has to show that the count rises when one is expected: another
    machine or another signal to record.
    """
    return _xla_programs + len(list(cache.glob("*.o")))
