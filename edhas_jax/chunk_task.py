"""One chunk of a sweep as a message: all that a worker needs to compute it, and what it answers."""

import dataclasses
import functools
import hashlib
import os
import sys
from collections.abc import Mapping
from pathlib import Path

import jax
import jaxlib
import llvmlite
import numpy as np

import edhas_jax
from edhas_jax import backend
from edhas_jax.batch import BatchSettings, Chunk, run_chunk
from edhas_jax.config import build
from edhas_jax.system import Rig
from edhas_jax.yaml_text import read_yaml

# what the numbers of a design depend on
MODEL = (
    "components", "effects", "native", "batch.py", "circuit.py", "control.py", "cycle.py", "cycle_loop.py",
    "cycle_xla.py", "elimination.py", "extremes.py", "integrate.py", "linearize.py", "loop_cache.py", "mechanics.py",
    "oil.py", "signals.py", "slots.py", "system.py",
)  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Task:
    """A chunk to compute: the machine as configuration text, the values (SI) of its designs, how they are run."""

    number: int
    machine: str
    values: Mapping[str, np.ndarray]
    steps_per_cycle: int
    settings: BatchSettings


@dataclasses.dataclass(frozen=True)
class Answer:
    """The metrics (SI) of a chunk's designs, and what they were computed with."""

    number: int
    metrics: Mapping[str, np.ndarray]
    versions: Mapping[str, str]
    device: Mapping[str, str]


def compute(task: Task) -> Answer:
    """Run one chunk; a text says which machine, so that every process builds the same."""
    rows = np.arange(len(next(iter(task.values.values()))))
    metrics = run_chunk(_machine(task.machine), task.values, Chunk(rows, task.steps_per_cycle), task.settings)
    return Answer(task.number, metrics, versions(), device())


@functools.lru_cache(maxsize=8)
def _machine(text: str) -> Rig:
    return build(read_yaml(text)[0]).machine


@functools.cache
def versions() -> dict[str, str]:
    """The versions that decide about results, with a hash of the model's own code."""
    return {
        "edhas_jax": edhas_jax.__version__,
        "model code": backend.code_hash(MODEL)[:12],
        "jax": jax.__version__,
        "jaxlib": jaxlib.__version__,
        "llvmlite": llvmlite.__version__,
    }


def device() -> dict[str, str]:
    """What this process computes on, and with which compiler flags."""
    return {
        "platform": jax.default_backend(),
        "device": str(jax.devices()[0].device_kind),
        "loops": "machine code" if backend.native_loops() else "XLA",
        "xla_flags": os.environ.get("XLA_FLAGS", ""),
    }


def effect_code(machine: Rig) -> dict[str, str]:
    """For each effect of a machine, and its controller if it is the user's: `library`, or a hash of the file."""
    found = {effect.id: _code_of(effect) for effect in machine.effects}
    controller = _code_of(machine.controller)
    return found if controller == "library" else found | {"controller": controller}


def _code_of(part) -> str:
    module = sys.modules[type(part).__module__]
    own = module.__name__.startswith("edhas_jax.")
    return "library" if own else hashlib.sha256(Path(module.__file__).read_bytes()).hexdigest()[:12]
