"""The mapper: what the columns of dropped files are, and the campaign file that grows from it."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

from nicegui import ui

from edhas_jax.machine.rigs import RIGS
from edhas_jax.measurements.campaign_draft import DRIVE_CONDITIONS, CampaignDraft, DraftRun
from edhas_jax.measurements.table_guess import GuessedColumn, Role
from edhas_jax.workbench.data_calculations import signals_of
from edhas_jax.workbench.figures import lines_figure
from edhas_jax.workbench.views.elements import Block, Button, Choice, Head, MainButton, Quiet, Strong, Toggle
from edhas_jax.workbench.views.plot import Plot
from edhas_jax.workbench.views.table import cell, table_of

ROLES = [role.value for role in Role]
USES = {"fit": "fit", "holdout": "hold out"}
CONDITIONS = {
    "actuator_bench": ("frequency", "amplitude"), "pump_bench": ("frequency", "amplitude", "load_orifice_area"),
    "actuator_system": ("target", "load_force"),
}  # fmt: skip
# below the fields, so that an empty one does not look filled in
HINTS = {
    "frequency": "such as 10 Hz", "amplitude": "such as 3.5 mm", "target": "such as 10 mm",
    "load_orifice_area": "empty: nominal", "load_force": "empty: nominal",
    "start": "empty: first sample", "window": "such as {from: 0.2 s, to: 1.5 s}",
}  # fmt: skip
MAX_FILE_PLOTS, WIDTH, MAX_REMARKS = 6, 700, 200


class Mapper:
    """Files that were dropped, their columns and their runs.

    Args:
        page: the window.
        on_write: called with the text of the campaign file.
    """

    def __init__(self, page, on_write: Callable[[str], Awaitable[None]]):
        self._page, self._on_write = page, on_write
        self._rig = "pump_bench"
        self._files: dict[str, dict[str, Any]] = {}  # tables of the files, by name
        self._runs: dict[str, dict[str, str]] = {}  # their entries
        self._sines: dict[str, dict[str, Any] | None] = {}  # what drove each run, by its record
        self._fields: dict[str, dict[str, ui.input]] = {}
        self._offers: dict[str, ui.row] = {}
        self._columns: list[dict[str, Any]] = []
        self._mapper = ui.column().classes("w-full gap-3 mt-3")

    async def add(self, name: str) -> None:
        """Add a file of the folder.

        Raises:
            CalculationError: it holds no table that can be used.
        """
        table = await self._page.session.calculator.call("data.table", name, self._rig, WIDTH)
        self._files = dict(sorted((self._files | {name: table}).items()))  # they arrive in any order
        self._runs = dict(sorted({name: {"use": "fit"}, **self._runs}.items()))
        self._columns = self._columns or table["columns"]
        self._sines[name] = table["sine"]
        self._build_mapper()

    async def _read_sines(self) -> None:
        """Read frequency and amplitude again, after it was changed what the columns are."""
        for name in list(self._files):
            self._sines[name] = await self._page.ask("data.sine", name, self._columns)
        self._update_draft()

    def _build_mapper(self) -> None:
        self._mapper.clear()
        with self._mapper:
            with ui.row().classes("items-end gap-4"):
                Head("What the columns are")
                rig = Choice(list(RIGS), value=self._rig, label="machine", on_change=self._choose_rig)
                rig.classes("min-w-44")
            with table_of("column", "is", "signal of the model", "unit", "from … to", "missing") as table:
                table.props("data-mark=mapper")
                for row in self._columns:
                    self._column_row(row)
            self._draft_problems = ui.column().classes("gap-0")
            with ui.element("div").classes("wb-two"):
                with ui.column().classes("gap-2 w-full"):
                    Head("Runs")
                    for name in self._files:
                        self._run_row(name)
                with ui.column().classes("gap-1 w-full"):
                    Head("campaign.yaml, as it will be")
                    self._text = Block("").props("data-mark=draft")
                    self._write_button = MainButton("Write campaign.yaml", on_click=self._write)
            Head("The records")
            self._curves = Plot("curves")
        self._update_draft()
        self.draw_curves()

    def _column_row(self, row: dict[str, Any]) -> None:
        with ui.element("tr"):
            cell(row["column"], "font-semibold")
            with ui.element("td"):
                role = ui.select(ROLES, value=row["role"]).props("dense borderless options-dense").classes("min-w-28")
            with ui.element("td"):
                options = {"": "–"} | {name: name.replace("_", " ") for name in signals_of(self._rig)}
                signal = ui.select(options, value=row["signal"] if row["signal"] in options else "")
                signal.props("dense borderless options-dense").classes("min-w-44")
            with ui.element("td"):
                unit = ui.input(value=row["unit"]).props("dense borderless debounce=300").classes("w-20")
                unit.props["aria-label"] = f"unit of {row['column']}"
                if not row["unit_stated"] and row["unit"]:
                    unit.props("hint=assumed hide-bottom-space")
            cell(f"{row['span'][0]:.5g} … {row['span'][1]:.5g}", "n")
            cell(str(row["missing"] or ""), "n")

        async def change(key: str, value: str) -> None:
            row[key] = value or ""
            if key == "signal" and value:
                row["role"] = Role.SIGNAL.value
                role.set_value(row["role"])
            self._update_draft()
            await self._read_sines()

        role.on_value_change(lambda e: change("role", e.value))
        signal.on_value_change(lambda e: change("signal", e.value))
        unit.on_value_change(lambda e: change("unit", e.value))

    def _run_row(self, name: str) -> None:
        entries = self._runs[name]

        def change(key: str, value: str) -> None:
            entries[key] = value or ""
            self._update_draft()

        with ui.element("div").classes("wb-card w-full"):
            with ui.row().classes("items-center gap-3 w-full"):
                Strong(name)
                Quiet(f"{self._files[name]['samples']:,} samples")
                Toggle(USES, value=entries["use"], on_change=lambda e: change("use", e.value))
            with ui.row().classes("gap-2"):
                fields = {}
                for key in (*CONDITIONS[self._rig], "start", "window"):
                    fields[key] = field = ui.input(key.replace("_", " "), value=entries.get(key, ""))
                    field.props("dense outlined stack-label").classes("w-60" if key == "window" else "w-36")
                    field.props["hint"] = HINTS[key]
                    field.on_value_change(lambda e, key=key: change(key, e.value))
            self._fields[name] = fields
            self._offers[name] = ui.row().classes("items-center gap-2").props("data-mark=offer")
            for line, sentence in self._files[name]["remarks"][:MAX_REMARKS]:
                Quiet(f"line {line}: {sentence}" if line else sentence)

    def _show_offer(self, name: str, wanted: tuple[str, ...]) -> None:
        """Offer what a record says on how its run was driven, where that is not written already."""
        row, sine, entries = self._offers[name], self._sines.get(name), self._runs[name]
        row.clear()
        for key in DRIVE_CONDITIONS[self._rig]:
            self._fields[name][key].set_visibility(key in wanted)
        found = {} if sine is None else {k: v for k, v in sine["conditions"].items() if k in wanted}
        missing = {key: text for key, text in found.items() if not entries.get(key, "").strip()}
        if not missing:
            return

        async def use() -> None:
            await asyncio.sleep(0)  # the click has to end before its button goes
            for key, text in missing.items():
                self._fields[name][key].set_value(text)

        with row:
            ui.label(f"The record says {' and '.join(found.values())}, as read from {sine['column']}.")
            Button("Use", on_click=use).props["aria-label"] = f"use for {name}"

    def _draft(self) -> CampaignDraft:
        columns = [
            GuessedColumn(row["column"], Role(row["role"]), row["signal"] if row["role"] == Role.SIGNAL.value else "",
                          row["unit"].strip(), row["unit_stated"])
            for row in self._columns
        ]  # fmt: skip
        runs = [
            DraftRun(name, entries["use"], {k: v for k, v in entries.items() if k != "use" and v.strip()})
            for name, entries in self._runs.items()
        ]
        return CampaignDraft(self._page.workspace.folder.name, self._rig, columns, runs)

    def _update_draft(self) -> None:
        draft = self._draft()
        self._text.set_text(draft.text())
        for name in self._files:
            self._show_offer(name, draft.drive_conditions)
        problems = draft.problems()
        problems += [f"Column {row['column']} is a signal: choose which one." for row in self._columns
                     if row["role"] == Role.SIGNAL.value and not row["signal"]]  # fmt: skip
        self._draft_problems.clear()
        with self._draft_problems:
            for problem in problems:
                ui.label(problem)
        self._write_button.set_enabled(not problems)

    async def _choose_rig(self, event) -> None:
        self._rig = event.value
        for name in list(self._files):
            found = await self._page.ask("data.table", name, self._rig, WIDTH)
            if found is not None:
                self._files[name], self._sines[name] = found, found["sine"]
        self._columns = next(iter(self._files.values()))["columns"]
        self._build_mapper()

    def draw_curves(self) -> None:
        """Draw the records of the columns that are used."""
        if not self._files:
            return
        used = [row["column"] for row in self._columns if row["role"] not in (Role.TIME.value, Role.UNUSED.value)]
        panels = []
        for column in used[:MAX_FILE_PLOTS]:
            curves = [(name, t["curves"][column]["x"], t["curves"][column]["y"])
                      for name, t in self._files.items() if column in t["curves"]]  # fmt: skip
            unit = next(row["unit"] for row in self._columns if row["column"] == column)
            panels.append((column, unit, curves))
        if panels:
            self._curves.show(lines_figure(panels, "sample", self._page.dark))

    async def _write(self) -> None:
        workspace = self._page.workspace
        if workspace.has_campaign:
            self._page.tell("campaign.yaml exists in this folder already: copy the entries of the runs into it, below")
            return
        await self._on_write(self._draft().text())
