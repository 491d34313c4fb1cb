"""One chunk of a sweep as a self-contained job: what a worker process needs to compute it, and its result."""

import dataclasses
import functools
from collections.abc import Mapping

import numpy as np

from edhas_jax.config.machine_config import build_config
from edhas_jax.config.yaml_with_lines import parse_yaml
from edhas_jax.core.trusted_code import TrustedCode
from edhas_jax.design.batch.batch import BatchSettings, Chunk, engine_of_designs, run_chunk
from edhas_jax.design.sweep.identity import device, versions
from edhas_jax.machine.rigs import Rig


@dataclasses.dataclass(frozen=True)
class ChunkJob:
    """A chunk to compute.

    Attributes:
        number: of the chunk in the sweep.
        machine: the machine as configuration text, so that every process builds the same.
        code: the user's code that the machine needs, with the content that has run where the sweep was read.
        values: by parameter the values (SI) of its designs, shape (designs,).
        steps_per_cycle: integration steps per cycle of the set point.
        settings: settings of the batch.
        many_lanes: as of the `Chunk`.
    """

    number: int
    machine: str
    code: TrustedCode
    values: Mapping[str, np.ndarray]
    steps_per_cycle: int
    settings: BatchSettings
    many_lanes: bool = False


@dataclasses.dataclass(frozen=True)
class ChunkResult:
    """The results of a chunk.

    Attributes:
        number: of the chunk in the sweep.
        metrics: by metric the values (SI) of its designs, shape (designs,), with status, cycles and residual.
        versions: versions of the libraries and of the model code.
        device: processor and compiler flags.
    """

    number: int
    metrics: Mapping[str, np.ndarray]
    versions: Mapping[str, str]
    device: Mapping[str, str]


def compute_chunk(job: ChunkJob) -> ChunkResult:
    """Run all designs of one chunk in this process."""
    rows = np.arange(len(next(iter(job.values.values()))))
    machine = _build_machine(job.machine, job.code)
    metrics = run_chunk(machine, job.values, Chunk(rows, job.steps_per_cycle, job.many_lanes), job.settings)
    engine = engine_of_designs(machine, job.values, job.settings.precision, job.many_lanes)
    return ChunkResult(job.number, metrics, versions(engine), device(engine))


@functools.lru_cache(maxsize=8)
def _build_machine(text: str, code: TrustedCode) -> Rig:
    return build_config(parse_yaml(text)[0], trust=code).machine
