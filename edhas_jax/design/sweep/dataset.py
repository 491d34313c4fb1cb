"""The result of a sweep as an xarray Dataset: a dimension per parameter of a grid, units, and its own pictures."""

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from edhas_jax.config.result_files import ResultFileError, report_write_errors
from edhas_jax.core.atomic_file import atomic_write
from edhas_jax.core.source_location import first_line
from edhas_jax.core.summary import Summary
from edhas_jax.design.sweep.figures import draw_sweep
from edhas_jax.design.sweep.table import CONVERGENCE_COLUMNS, OUTCOMES, Field, SweepResult, summary_of_parts

DESIGN = "design"  # the dimension of designs that are no grid
KEPT = ("name", "machine", "edhas_jax", "jax", "engine", "date")  # of what made the sweep, where it is known


class SweepData(xr.Dataset):
    """The metrics of the designs of a sweep in SI, with everything that an xarray Dataset can do.

    A grid has a dimension per parameter, other designs have the dimension `design`. Every variable has the attributes
    `units` and `long_name`, and `shown` with the unit it is drawn in. `status` says how each design ended; metrics are
    NaN where it is not "ok".
    """

    __slots__ = ()

    def result(self) -> SweepResult:
        """The same as a table with a row per design."""
        frame = self.to_dataframe().reset_index().drop(columns=DESIGN, errors="ignore")
        fields = {n: _field(v.attrs) for n, v in self.variables.items() if "units" in v.attrs}
        parameters = tuple(n for n, v in self.variables.items() if v.attrs.get("role") == "parameter")
        metrics = tuple(n for n, v in self.variables.items() if v.attrs.get("role") == "metric")
        sweep = json.loads(self.attrs["sweep"])
        frame["reason"] = frame["status"].map(OUTCOMES)
        return SweepResult(frame, parameters, metrics, fields, {"name": self.attrs.get("name", ""), "sweep": sweep})

    def summary(self) -> Summary:
        """How many designs ended with which status, and the range of each parameter and metric."""
        return summary_of_parts([self.result()])

    def plot_heat(self, metric: str | None = None, x: str | None = None, y: str | None = None, **options: Any):
        """A matplotlib figure: a metric over two parameters; arguments as of `draw_sweep`.

        Raises:
            FigureError: a name is unknown, or fewer than two parameters vary.
        """
        return draw_sweep(self.result(), "heat", metric, x, y, **options)

    def plot_parallel(self, metric: str | None = None, slices: Sequence[str] = ()):
        """A matplotlib figure: every design a line over all parameters, coloured by a metric.

        Raises:
            FigureError: a name is unknown, or the sweep lacks what the picture needs.
        """
        return draw_sweep(self.result(), "parallel", metric, slices=slices)

    def plot_pareto(self, objectives: Sequence[str] | None = None, slices: Sequence[str] = ()):
        """A matplotlib figure: two metrics, such as ("mean_flow:max", "copper_loss:min"), and the best compromises.

        Raises:
            FigureError: a name is unknown, or the sweep lacks what the picture needs.
        """
        return draw_sweep(self.result(), "pareto", objectives=objectives, slices=slices)

    def save(self, path: Path | str, overwrite: bool = False) -> Path:
        """Write the sweep into a NetCDF file (`.nc`), which `edhas_jax.open_result` and other programs read.

        Raises:
            ResultFileError: the file exists and `overwrite` is false, has another suffix, or cannot be written.
        """
        path = Path(path)
        if path.suffix != ".nc":
            raise ResultFileError(f"{path}: a file .nc belongs here")
        if os.path.lexists(path) and not overwrite:
            raise ResultFileError(f"{path}: exists already; nothing was written. Name another file, or overwrite=True")
        with report_write_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            with atomic_write(path) as file:
                self.to_netcdf(file, engine="scipy")
        return path


def to_dataset(result: SweepResult) -> SweepData:
    """The result of a sweep, finished or not, as a Dataset."""
    frame, sweep = result.frame, result.manifest["sweep"]
    levels = {n: pd.unique(frame[n]) for n in result.parameters}
    shape = tuple(len(values) for values in levels.values())
    is_grid = sweep["kind"] == "grid" and np.prod(shape) == len(frame)
    dims = tuple(levels) if is_grid else (DESIGN,)

    def shaped(name: str):
        return frame[name].to_numpy().reshape(shape if is_grid else (len(frame),))

    coordinates = {}
    for name in result.parameters:
        values = levels[name] if is_grid else frame[name].to_numpy()
        coordinates[name] = ((name,) if is_grid else dims, values, _attributes(result, name, "parameter"))
    roles = dict.fromkeys(result.metrics, "metric") | {n: "account" for n in CONVERGENCE_COLUMNS if n in frame}
    variables = {n: (dims, shaped(n), _attributes(result, n, role)) for n, role in roles.items()}
    variables["status"] = (dims, shaped("status").astype(str), {"long_name": "outcome of the run"})
    made = {n: str(result.manifest[n]) for n in KEPT if result.manifest.get(n)}
    return SweepData(variables, coordinates, made | {"sweep": json.dumps(sweep)})


def open_dataset(path: Path | str) -> SweepData:
    """Read the file of a sweep.

    Raises:
        ResultFileError: it is not one, or it is damaged.
    """
    try:
        data = xr.load_dataset(path, engine="scipy")
        if "sweep" not in data.attrs or "status" not in data:
            raise ValueError("it is not the file of a sweep")
    except Exception as error:  # a damaged file raises whatever its bytes lead to
        raise ResultFileError(f"{path}: cannot be read: {first_line(error) or type(error).__name__}") from None
    data["status"] = data["status"].astype(str)
    return SweepData(data.data_vars, data.coords, data.attrs)


def _attributes(result: SweepResult, name: str, role: str) -> Mapping[str, str | int]:
    unit, shown, doc, rank = result.fields[name]
    known = {"units": "1" if unit == "-" else unit, "shown": shown, "long_name": doc, "role": role}
    return known | ({"rank": rank} if rank else {})


def _field(attributes: Mapping[str, Any]) -> Field:
    unit = "-" if attributes["units"] == "1" else attributes["units"]
    return Field(unit, attributes.get("shown", unit), attributes.get("long_name", ""), int(attributes.get("rank", 0)))
