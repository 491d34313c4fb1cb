"""A campaign file that is being made from the columns of a logger's files, as text."""

import dataclasses
from collections.abc import Mapping, Sequence

from edhas_jax.core.literal_text import one_line, yaml_text
from edhas_jax.machine.parameters import has_parameter
from edhas_jax.machine.rigs import RIGS, Rig
from edhas_jax.measurements.table_guess import GuessedColumn, Role

# relative standard deviations that are usual for a machine that is known from drawings and data sheets, on which dry
# friction does not stand: where it is taken as known, its error is found as an effect that the machine does not have
USUAL_UNCERTAINTY = {
    "coil_resistance": 0.02, "force_constant": 0.02, "mover_damping": 0.25, "coulomb_friction": 0.3,
    "static_friction": 0.3, "piston_clearance": 0.1, "load_orifice_area": 0.03, "cylinder_sliding_friction": 0.3,
    "cylinder_breakaway_friction": 0.3,
}  # fmt: skip
# what says how a run was driven, by rig
DRIVE_CONDITIONS = {
    "actuator_bench": ("frequency", "amplitude"), "pump_bench": ("frequency", "amplitude"),
    "actuator_system": ("target",),
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class DraftRun:
    """A run of a draft: its file, its use ("fit" or "holdout"), and what else its entry says, as text by key."""

    file: str
    use: str = "fit"
    entries: Mapping[str, str] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True)
class CampaignDraft:
    """A campaign that is being made.

    Attributes:
        name: name of the campaign.
        rig: the rig.
        columns: what the columns of the files are.
        runs: the runs.
    """

    name: str
    rig: str
    columns: Sequence[GuessedColumn]
    runs: Sequence[DraftRun]

    def _of(self, role: Role) -> list[GuessedColumn]:
        return [column for column in self.columns if column.role is role]

    @property
    def drive_conditions(self) -> tuple[str, ...]:
        """The conditions that say how each run was driven; none where the set point was recorded."""
        return () if self._of(Role.SET_POINT) else DRIVE_CONDITIONS[self.rig]

    def problems(self) -> list[str]:
        """What is still missing, all at once, each with what to do."""
        out = []
        if not self._of(Role.TIME):
            out.append("No column is the time: choose “time” for one of them.")
        names = [c.signal for c in self._of(Role.SIGNAL)]
        if not names:
            out.append("No column is a signal of the model: choose a signal for at least one of them.")
        for name in dict.fromkeys(n for n in names if names.count(n) > 1):
            out.append(f"{name} has {names.count(name)} columns: keep one of them.")
        out += [f"Column {c.column} has no unit: write the unit it is recorded in."
                for c in self.columns if c.role in (Role.TIME, Role.SIGNAL) and not c.unit]  # fmt: skip
        if len(self._of(Role.SET_POINT)) > 1:
            out.append("Several columns are the set point: keep one of them.")
        if not self.runs:
            out.append("There is no run: drop a file.")
        elif all(run.use == "holdout" for run in self.runs):
            out.append("All runs are held out: choose “fit” for at least one of them.")
        for run in self.runs:
            missing = [n for n in self.drive_conditions if not run.entries.get(n, "").strip()]
            if missing:
                names = " and ".join(missing)
                out.append(f"{run.file} was driven by a set point that no column holds: write its {names}.")
        return out

    def text(self) -> str:
        """The text of `campaign.yaml`."""
        lines = [f"name: {yaml_text(self.name)}", f"rig: {self.rig}"]
        lines.append("uncertain:   # relative standard deviation of the true value; adapt to what you know")
        lines += uncertainty_lines(RIGS[self.rig])
        for c in self._of(Role.TIME)[:1]:
            lines.append(f"time: {{column: {yaml_text(c.column)}, unit: {yaml_text(c.unit)}}}")
        for c in self._of(Role.SET_POINT)[:1]:
            lines.append(f"reference: {yaml_text(c.column)}   # the recorded set point")
        lines.append("signals:   # the noise of each is measured in the records")
        for c in self._of(Role.SIGNAL):
            lines.append(f"  {c.signal}: {{column: {yaml_text(c.column)}, unit: {yaml_text(c.unit)}}}")
        lines.append("runs:")
        for run in self.runs:
            words = [f"file: {yaml_text(run.file)}", f"use: {run.use}"]
            is_driven = DRIVE_CONDITIONS[self.rig] if not self.drive_conditions else ()  # by the recorded set point
            words += [f"{n}: {_entry(text)}" for n, text in run.entries.items() if text.strip() and n not in is_driven]
            lines.append(f"  - {{{', '.join(words)}}}")
        return "\n".join([*lines, ""])


def uncertainty_lines(rig: type[Rig]) -> list[str]:
    """The entries of `uncertain` that are usual for the machine of a campaign, with its refined effects."""
    machine = rig(effects=tuple(effect() for effect in rig.usual_effects))
    return [f"  {name}: {spread:g}" for name, spread in USUAL_UNCERTAINTY.items() if has_parameter(machine, name)]


def _entry(text: str) -> str:
    """A quantity, or a mapping such as a window, as it is typed."""
    text = one_line(text).strip()
    return text if text.startswith("{") and text.endswith("}") else yaml_text(text)
