"""Files of a model with a free curve: the curve as a tabulated law, and the configuration that mounts it."""

from pathlib import Path
from typing import NamedTuple

from edhas_jax.config.law_file import write_law_file
from edhas_jax.core.literal_text import file_name, one_line
from edhas_jax.diagnosis.laws.curve_fit import CurveFit
from edhas_jax.inference.fit.model_file import write_model_file


class ModelFiles(NamedTuple):
    """The law file, and the configuration that names it."""

    law: Path
    model: Path


def write_curve_model(folder: Path | str, found: CurveFit) -> ModelFiles:
    """Write a model with a curve so that `edhas compare --model` and `edhas simulate` take it.

    Args:
        folder: where the two files are written; it is made if it does not exist.
        found: the fitted model; without the conditions of any run.

    Returns:
        The files, named after the curve; those that exist are replaced.

    Raises:
        OSError: a file cannot be written.
    """
    folder, campaign, curve = Path(folder), found.fit.problem.campaign, found.curve
    folder.mkdir(parents=True, exist_ok=True)
    name = file_name(curve.name)
    law, model = folder / f"{name}.yaml", folder / f"{file_name(campaign.name)}_{name}.yaml"
    write_law_file(law, curve.table(f"estimated from the runs of the campaign {one_line(campaign.name)}"))
    remark = f" with {curve.name}, fitted; without the conditions of any run"
    write_model_file(model, found.fit, remark, {curve.name: law.name})
    return ModelFiles(law, model)
