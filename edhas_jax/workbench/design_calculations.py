"""Runs of a machine with changed parameters, and results of sweeps, for the page."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from edhas_jax.config.machine_config import Config, read_config
from edhas_jax.config.writer import dump_config
from edhas_jax.core.plot_style import time_unit
from edhas_jax.core.units import format_result
from edhas_jax.design.batch.batch import runs_designs
from edhas_jax.design.sweep.pareto_front import non_dominated
from edhas_jax.design.sweep.run import open_sweep
from edhas_jax.machine.interface.metrics import in_order, metrics_of_batch
from edhas_jax.machine.parameters import list_parameters, set_parameters, short_names
from edhas_jax.measurements.campaign_reader import read_campaign
from edhas_jax.simulation.metrics import RunTooShortError
from edhas_jax.simulation.run import Simulation, simulate
from edhas_jax.workbench.figure_parts import title_of
from edhas_jax.workbench.workspace import DESIGNS, RESULTS, Workspace, WorkspaceError

AS_GIVEN_FILE = "as_given.yaml"
CYCLES_SHOWN = 1.0
SLIDER_FACTOR = 2.0  # a slider goes from half to twice the value where no plausible range is known


class DesignCalculations:
    """Keeps the configuration that is being changed.

    Args:
        workspace: the folder.
        say: called with a sentence on the progress.
    """

    def __init__(self, workspace: Workspace, say: Callable[[str], None]):
        self._workspace, self._say = workspace, say
        self._config: tuple[tuple, Config] | None = None

    def campaign_machine(self) -> str:
        """Write the campaign's own model, under the conditions of its first run, as a configuration; its path."""
        self._workspace.require_files_inside()
        campaign = read_campaign(self._workspace.folder)
        machine = campaign.machine_of(campaign.runs[0])
        name = Path(RESULTS, DESIGNS, AS_GIVEN_FILE)
        head = f"# the model of the campaign under the conditions of {campaign.runs[0].name}\n"
        self._workspace.write(name, head + dump_config(machine, Simulation()))
        return str(name)

    def open(self, name: str) -> dict[str, Any]:
        """The parameters of a configuration with their ranges, and the metrics that its runs have."""
        machine = self._read(name).machine
        names = short_names(machine)
        parameters = []
        for p, value, path in list_parameters(machine):
            value = float(value)
            low, high = p.plausible or sorted((value / SLIDER_FACTOR, value * SLIDER_FACTOR))
            low, high = max(min(low, value), p.span[0]), min(max(high, value), p.span[1])
            parameters.append({
                "name": names[path, p.name], "value": value, "unit": p.unit, "doc": p.doc,
                "range": (low, high) if high > low else None,
            })  # fmt: skip
        return {
            "parameters": parameters, "sweepable": runs_designs(machine),
            "metrics": in_order(metrics_of_batch(machine), lambda name: machine.metrics[name].rank),
        }  # fmt: skip

    def simulate(self, name: str, values: Mapping[str, float]) -> dict[str, Any]:
        """Run a machine with some parameters changed: its last cycle, its leading metrics, its status.

        Args:
            name: the configuration below the folder.
            values: changed parameters by name (SI).
        """
        config = self._read(name)
        machine = set_parameters(config.machine, dict(values))
        run, declared = simulate(machine, config.simulation), machine.metrics
        time = run.signals["time"]
        is_cycle = machine.cycle is not None
        first = time[-1] - CYCLES_SHOWN / float(machine.reference.frequency) if is_cycle else 0.0
        inside = time >= max(first, 0.0) - 1e-12
        factor, unit = time_unit(float(time[-1] - max(first, 0.0)))
        signals = {
            n: machine.signals[n].shown(v[inside])
            for n, v in run.signals.items() if n in machine.signals and n != "time"
        }  # fmt: skip
        try:
            found = run.metrics
            leading = [n for n in in_order(found, lambda n: declared[n].rank) if declared[n].rank]
            metrics = {n: format_result(found[n].value, *found[n][1:3]) for n in leading or found}
        except RunTooShortError:
            metrics = {}
        return {
            "time": factor * (time[inside] - time[inside][0]), "signals": signals, "metrics": metrics,
            "time_title": title_of("time within the last cycle" if is_cycle else "time", unit),
            "units": {n: machine.signals[n].display_unit for n in signals},
            "status": run.status.name.lower(), "reason": run.reason, "step": run.step_note,
        }  # fmt: skip

    def sweep(self, folder: str) -> dict[str, Any]:
        """The designs of a sweep with their metrics, in the units in which they are shown, and in SI."""
        result = open_sweep(self._workspace.inside(folder))
        columns = (*result.parameters, *result.metrics)
        return {
            "parameters": list(result.parameters), "metrics": list(result.metrics),
            "shown": {n: result.shown(n) for n in columns},
            "si": {n: result.frame[n].to_numpy(float) for n in result.parameters},
            "units": {n: result.fields[n][1] for n in columns},
            "status": list(result.frame["status"]),
        }  # fmt: skip

    def pareto_front(self, folder: str, first: str, second: str, signs: tuple[float, float]) -> np.ndarray:
        """Rows of the designs of a sweep that no other dominates in two metrics; sign +1 where more is better."""
        result = open_sweep(self._workspace.inside(folder))
        x, y = signs[0] * result.shown(first), signs[1] * result.shown(second)
        good = np.flatnonzero((result.frame["status"] == "ok").to_numpy() & np.isfinite(x) & np.isfinite(y))
        if not len(good):
            raise WorkspaceError("every design has failed")
        return good[non_dominated(x[good], y[good])]

    def _read(self, name: str) -> Config:
        path = self._workspace.inside(name)
        key = str(path), path.stat().st_mtime_ns if path.is_file() else 0, tuple(self._workspace.allowed)
        if self._config is None or self._config[0] != key:
            self._config = key, read_config(path, trust=self._workspace.allowed)
        return self._config[1]
