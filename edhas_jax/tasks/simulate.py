"""Simulate: one machine from rest, checked, with a summary, pictures and a folder."""

import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from edhas_jax.config.machine_config import Config, as_config
from edhas_jax.config.run_folder import save_run
from edhas_jax.core.summary import Summary, SummaryTable, Text, Tone, Toned
from edhas_jax.core.trusted_code import Trust
from edhas_jax.core.units import format_quantity, unit_text
from edhas_jax.machine.interface.metrics import SIGNAL_METRICS
from edhas_jax.machine.parameters import set_parameters
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.metrics import MetricValue, RunTooShortError
from edhas_jax.simulation.run import Run, Simulation
from edhas_jax.simulation.run import simulate as simulate_machine
from edhas_jax.simulation.validity import Status
from edhas_jax.tasks.result import with_methods

SMALLEST_SHARE = 5e-4  # of the energy; smaller entries of the energy balance are not shown


@dataclasses.dataclass(frozen=True, repr=False)
class RunResult(Run):
    """A finished run; see `Run` for its numbers."""

    def summary(self, name: str = "", note: str = "") -> Summary:
        """Status, metrics in engineering units and energy balance.

        Args:
            name: a title; empty: the rig alone.
            note: something to add to the settings, such as the computing time.
        """
        effects = ", ".join(e.id for e in self.machine.effects) or "none"
        head = f"{name}: {self.machine.name}" if name else self.machine.name
        settings = "; ".join(filter(None, (self.step_note, self.simulation.precision.value, note)))
        return Summary(
            f"{head}, effects: {effects}", (settings, self._status(), *self._metrics_tables(), *self._energy_table())
        )

    def save(self, folder: Path | str, overwrite: bool = False, figure: bool = True) -> Path:
        """Write a run folder, from which `edhas_jax.open_result` reads it; arguments and errors as of `save_run`."""
        return save_run(self, folder, overwrite, figure)

    def __repr__(self) -> str:
        return f"<RunResult: {self.summary().title}, {self.duration:g} s, {self.status}>"

    def _repr_html_(self) -> str:
        return self.summary()._repr_html_()

    def _status(self) -> Toned:
        """The status with its reason: good if all is well, a caution for a warning, bad if the run is not valid."""
        name = str(self.status)
        if self.status is Status.OK:
            return Toned(f"valid: {self.reason}", Tone.GOOD)
        head = f"valid, with a warning: {name}" if self.valid else f"not valid: {name}"
        return Toned(f"{head}: {self.reason}", Tone.CAUTION if self.valid else Tone.BAD)

    def _metrics_tables(self) -> list[SummaryTable | Text]:
        """The metrics in engineering units, those of signals in a table of their own; or why there are none."""
        try:
            metrics = self.metrics
        except RunTooShortError as error:
            return [f"no metrics: {error}"]
        of_signals = _signals_table(self, metrics)
        own = {n: m for n, m in metrics.items() if n not in [record["metric"] for record in of_signals.records]}
        rows = [(n, m.shown(), unit_text(m.display_unit), m.doc) for n, m in own.items()]
        name, records = "own metrics" if of_signals.rows else "metrics", map(_record, own, own.values())
        table = SummaryTable.of(name, ("metric", "value", "unit", "meaning"), rows, records)
        return [part for part in (of_signals, table) if part.rows]

    def _energy_table(self) -> tuple[SummaryTable, ...]:
        """The energy balance; nothing for a rig of one's own that does not state what goes in."""
        if "input" not in self.row_groups().values():
            return ()
        rows, records = [], []
        for entry in self.ledger().itertuples():
            records.append({"row": entry.Index, "group": entry.group, "energy": entry.energy, "share": entry.share})
            if abs(entry.share) >= SMALLEST_SHARE:
                share = f"{100 * entry.share:.1f} %"
                rows.append((entry.Index, entry.group, format_quantity(entry.energy, "J"), share))
        caption = f"energy balance error: {abs(self.energy_residual()):.0e} of the energy turned over"
        columns = "row", "group", "energy", "share"
        return (SummaryTable.of("energy", columns, rows, records, "energy ledger", caption),)


def _signals_table(run: Run, metrics: Mapping[str, MetricValue]) -> SummaryTable:
    """The metrics that are those of a signal: a row for each signal."""
    rows, records = [], []
    for name, about in run.machine.signals.items():
        of_signal = {f"{kind}_{name}": metrics.get(f"{kind}_{name}") for kind in SIGNAL_METRICS}
        if None not in of_signal.values():
            rows.append((name, *(m.shown() for m in of_signal.values()), unit_text(about.display_unit), about.doc))
            records += [_record(n, m) | {"meaning": about.doc} for n, m in of_signal.items()]
    return SummaryTable.of("metrics", ("signal", *SIGNAL_METRICS, "unit", "meaning"), rows, records)


def _record(name: str, metric: MetricValue) -> dict[str, Any]:
    return {"metric": name, "value": metric.value, "unit": metric.unit, "meaning": metric.doc}


def simulate(
    source: Rig | Config | Mapping[str, Any] | Path | str,
    simulation: Simulation | None = None,
    on_progress: Callable[[float], None] | None = None,
    trust: Trust = (),
    **parameters: Any,
) -> RunResult:
    """Simulate one machine from rest, and check the result.

        edhas_jax.simulate("configs/paper.yaml", frequency="20 Hz").plot()

    Args:
        source: a machine, a configuration or its file.
        simulation: settings of the run; None: those of the configuration.
        on_progress: called with the share done, 0 … 1.
        trust: Python files of your own that may run if a configuration names them.
        **parameters: by name another value, a number in SI or a text with unit.

    Returns:
        The run, with its status.

    Raises:
        ConfigError: the configuration has problems.
        ParameterError: a parameter is unknown or outside its span.
        SimulationError: the run is not finite or left the physical range; the message names the time and the state.
        TypeError: a parameter is traced by JAX: inside `jit`, `grad` or `vmap` belongs `edhas_jax.model`.
    """
    config = as_config(source, trust)
    machine = set_parameters(config.machine, parameters) if parameters else config.machine
    return with_methods(RunResult, simulate_machine(machine, simulation or config.simulation, on_progress))
