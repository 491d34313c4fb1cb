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
from edhas_jax.config.machine_config import build_config
from edhas_jax.config.yaml_with_lines import parse_yaml
from edhas_jax.core import runtime
from edhas_jax.design.batch.batch import BatchSettings, Chunk, run_chunk
from edhas_jax.machine.rigs import Rig

# the packages that can change a number of a design
MODEL_PACKAGES = ("core", "compiler", "machine", "simulation", "config", "design/batch")


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
    return build_config(parse_yaml(text)[0]).machine


@functools.cache
def versions() -> dict[str, str]:
    """The versions that decide about results, with a hash of the model's own code."""
    return {
        "edhas_jax": edhas_jax.__version__,
        "model code": runtime.code_hash(MODEL_PACKAGES)[:12],
        "jax": jax.__version__,
        "jaxlib": jaxlib.__version__,
        "llvmlite": llvmlite.__version__,
    }


def device() -> dict[str, str]:
    """What this process computes on, and with which compiler flags."""
    return {
        "platform": jax.default_backend(),
        "device": str(jax.devices()[0].device_kind),
        "loops": "machine code" if runtime.native_loops() else "XLA",
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
