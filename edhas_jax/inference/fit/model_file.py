"""The configuration file of a fitted model, without the conditions of any run."""

from collections.abc import Collection, Mapping
from pathlib import Path
from types import MappingProxyType

from edhas_jax.config.writer import dump_config
from edhas_jax.core import structs
from edhas_jax.core.atomic_file import atomic_write
from edhas_jax.core.literal_text import one_line
from edhas_jax.inference.fit.fit import Fit
from edhas_jax.simulation.run import Simulation


def write_model_file(
    path: Path, fit: Fit, remark: str, law_files: Mapping[str, str] = MappingProxyType({}), step: float | None = None,
    without: Collection[str] = (),
) -> None:  # fmt: skip
    """Write the machine of a fit as a configuration that is sampled as fast as the fastest run.

    Args:
        path: the file; one that exists is replaced.
        fit: the fit.
        remark: what follows the name of the campaign in the first line, a comment; further lines may follow.
        law_files: files of tabulated laws by effect id, relative to the folder of the file.
        step: time step [s]; that of a simulation by default.
        without: ids of effects that are left out.

    Raises:
        OSError: the file cannot be written.
    """
    campaign = fit.problem.campaign
    rate = 1.0 / min(run.interval for run in campaign.runs)
    simulation = Simulation(sample_rate=rate) if step is None else Simulation(step=step, sample_rate=rate)
    machine = structs.replace(fit.machine, effects=tuple(e for e in fit.machine.effects if e.id not in without))
    text = f"# {one_line(campaign.name)}{remark}\n" + dump_config(machine, simulation, law_files)
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
