"""Data: files become a campaign; what is wrong with them is said all at once, each with a remedy."""

import asyncio
from pathlib import Path
from typing import Any

import numpy as np
from nicegui import ui

from edhas_jax.core.atomic_file import atomic_write
from edhas_jax.core.literal_text import file_name
from edhas_jax.machine.rigs import RIGS
from edhas_jax.measurements.campaign_draft import CampaignDraft, DraftRun
from edhas_jax.measurements.column_guess import GuessedColumn, Role
from edhas_jax.measurements.tables.table_reader import MAX_BYTES
from edhas_jax.workbench.calculator import CalculationError
from edhas_jax.workbench.figures import lines_figure, record_figure
from edhas_jax.workbench.workspace import CAMPAIGN_FILE

ROLES = [role.value for role in Role]
USES = {"fit": "fit", "holdout": "hold out"}
CONDITIONS = {
    "actuator_bench": ("frequency", "amplitude"), "pump_bench": ("frequency", "amplitude", "load_orifice_area"),
    "actuator_system": ("target", "load_force"),
}  # fmt: skip
UNITS = {"frequency": "10 Hz", "amplitude": "3.5 mm", "load_orifice_area": "4.2 mm^2", "target": "10 mm", "load_force": "0 N"}
SEVERITIES = {"error": "wb-bad", "warning": "", "note": ""}
MAX_FILE_PLOTS, WIDTH, MAX_REMARKS = 6, 700, 200


class DataView:
    """Files, the mapping of their columns, the campaign file, the check of the data."""

    def __init__(self, page):
        self._page = page
        self._rig = "pump_bench"
        self._files: dict[str, dict[str, Any]] = {}  # tables of the files that were dropped, by name
        self._runs: dict[str, dict[str, str]] = {}  # their entries
        self._columns: list[dict[str, Any]] = []

    async def build(self) -> None:
        """Build the view."""
        ui.label("Files").classes("wb-h")
        ui.label("Drop the records of a logger: CSV or text with any separator and decimal commas, Excel, MATLAB, Parquet. "
                 "They are copied into the folder of the campaign.").classes("wb-quiet")  # fmt: skip
        upload = ui.upload(multiple=True, auto_upload=True, max_file_size=MAX_BYTES, on_upload=self._receive,
                           on_rejected=lambda: ui.notify("A file above 1 GB is not read."),
                           label="drop files here, or press +").classes("w-full max-w-xl")  # fmt: skip
        upload.props("flat bordered")
        self._refused = ui.column().classes("w-full gap-1").props("data-mark=refused")
        self._mapper = ui.column().classes("w-full gap-3 mt-3")
        self._file = ui.column().classes("w-full gap-2 mt-4")
        self._check = ui.column().classes("w-full gap-2 mt-4")
        self._build_file()
        self._build_check()

    async def refresh(self) -> None:
        """Follow the folder."""
        self._build_file()
        self._build_check()

    async def redraw(self) -> None:
        """Draw the plots again, in the colours of the page."""
        self._draw_curves()
        await self._draw_record()

    async def _receive(self, event) -> None:
        name = file_name(Path(event.file.name).name)
        path = self._page.attempt(lambda: self._page.workspace.inside(name))
        if path is None:
            return
        if name in (CAMPAIGN_FILE, "workbench") or path.suffix in (".py", ".yaml", ".yml", ".json", ".html"):
            self._refuse(name, ["is no record of a logger; a table belongs here: CSV, text, Excel, MATLAB or Parquet"])
            return
        if path.exists() and path.read_bytes() != await event.file.read():
            self._refuse(name, ["another file of this name is in the folder already; rename the new one"])
            return
        is_new = not path.exists()
        if is_new:
            with atomic_write(path) as temporary:
                await event.file.save(temporary)
        try:
            table = await self._page.session.calculator.call("data.table", name, self._rig, WIDTH)
        except CalculationError as error:
            if is_new:
                path.unlink(missing_ok=True)
            self._refuse(name, str(error).splitlines())
            return
        self._files[name] = table
        self._runs.setdefault(name, {"use": "fit"})
        if not self._columns:
            self._columns = table["columns"]
        self._build_mapper()

    def _refuse(self, name: str, lines: list[str]) -> None:
        with self._refused, ui.element("div").classes("wb-card wb-bad w-full"):
            ui.label(f"{name} is not used:").classes("font-semibold")
            for line in lines[:MAX_REMARKS]:
                ui.label(line)

    def _build_mapper(self) -> None:
        self._mapper.clear()
        with self._mapper:
            with ui.row().classes("items-end gap-4"):
                ui.label("What the columns are").classes("wb-h")
                rig = ui.select(list(RIGS), value=self._rig, label="machine").props("dense outlined options-dense")
                rig.classes("min-w-44").on_value_change(self._choose_rig)
            with ui.element("div").classes("wb-scroll"), ui.element("table").classes("wb-table").props("data-mark=mapper"):
                with ui.element("tr"):
                    for head in ("column", "is", "signal of the model", "unit", "from … to", "missing"):
                        with ui.element("th"):
                            ui.label(head)
                for row in self._columns:
                    self._column_row(row)
            self._draft_problems = ui.column().classes("gap-0")
            with ui.element("div").classes("wb-two"):
                with ui.column().classes("gap-2 w-full"):
                    ui.label("Runs").classes("wb-h")
                    for name in self._files:
                        self._run_row(name)
                with ui.column().classes("gap-1 w-full"):
                    ui.label("campaign.yaml, as it will be").classes("wb-h")
                    self._text = ui.label("").classes("wb-block").props("data-mark=draft")
                    self._write_button = ui.button("Write campaign.yaml", on_click=self._write).props("no-caps unelevated")
            ui.label("The records").classes("wb-h")
            self._curves = ui.plotly({"data": [], "layout": {"height": 200}}).classes("w-full")
        self._update_draft()
        self._draw_curves()

    def _column_row(self, row: dict[str, Any]) -> None:
        from edhas_jax.workbench.data_calculations import signals_of

        with ui.element("tr"):
            with ui.element("td"):
                ui.label(row["column"]).classes("font-semibold")
            with ui.element("td"):
                role = ui.select(ROLES, value=row["role"]).props("dense borderless options-dense").classes("min-w-28")
            with ui.element("td"):
                options = {"": "–"} | {name: name.replace("_", " ") for name in signals_of(self._rig)}
                signal = ui.select(options, value=row["signal"] if row["signal"] in options else "")
                signal.props("dense borderless options-dense").classes("min-w-44")
            with ui.element("td"):
                unit = ui.input(value=row["unit"]).props("dense borderless").classes("w-20")
                unit.props["aria-label"] = f"unit of {row['column']}"
                if not row["unit_stated"] and row["unit"]:
                    unit.props("hint=assumed hide-bottom-space")
            with ui.element("td").classes("n"):
                ui.label(f"{row['span'][0]:.5g} … {row['span'][1]:.5g}")
            with ui.element("td").classes("n"):
                ui.label(str(row["missing"] or ""))

        def change(key: str, value: str) -> None:
            row[key] = value or ""
            if key == "signal" and value:
                row["role"] = Role.SIGNAL.value
                role.set_value(row["role"])
            self._update_draft()

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
                ui.label(name).classes("font-semibold")
                ui.label(f"{self._files[name]['samples']:,} samples").classes("wb-quiet")
                use = ui.toggle(USES, value=entries["use"]).props("dense no-caps unelevated size=sm")
                use.on_value_change(lambda e: change("use", e.value))
            with ui.row().classes("gap-2"):
                for key in CONDITIONS[self._rig]:
                    field = ui.input(key.replace("_", " "), value=entries.get(key, ""), placeholder=UNITS[key])
                    field.props("dense outlined").classes("w-36").on_value_change(lambda e, key=key: change(key, e.value))
                for key, label, example in (("start", "starts at", "12.4 s"), ("window", "window", "{from: 0.2 s, to: 1.5 s}")):
                    field = ui.input(label, value=entries.get(key, ""), placeholder=example).props("dense outlined")
                    field.classes("w-36").on_value_change(lambda e, key=key: change(key, e.value))
            for line, sentence in self._files[name]["remarks"][:MAX_REMARKS]:
                ui.label(f"line {line}: {sentence}" if line else sentence).classes("wb-quiet")

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
        for name in self._files:
            found = await self._page.ask("data.table", name, self._rig, WIDTH)
            if found is not None:
                self._files[name] = found
        self._columns = next(iter(self._files.values()))["columns"]
        self._build_mapper()

    def _draw_curves(self) -> None:
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
            self._curves.update_figure(lines_figure(panels, "sample", self._page.dark))

    async def _write(self) -> None:
        workspace = self._page.workspace
        if workspace.has_campaign:
            self._page.tell("campaign.yaml exists in this folder already; change it below, or open another folder")
            return
        await self._save(self._draft().text(), "write campaign.yaml")

    def _build_file(self) -> None:
        """The campaign file as text that can be changed."""
        path = self._page.workspace.campaign_file
        self._file.clear()
        if not path.is_file():
            return
        text = self._page.attempt(lambda: path.read_text(encoding="utf-8", errors="replace"))
        with self._file:
            ui.label("campaign.yaml").classes("wb-h")
            editor = ui.textarea(value=text or "").props("outlined autogrow input-class=wb-code").classes("w-full")
            editor.props["aria-label"] = "campaign.yaml"
            with ui.row():
                save = ui.button("Save and check", on_click=lambda: self._save(editor.value, "change campaign.yaml"))
                save.props("no-caps unelevated dense")

    async def _save(self, text: str, what: str) -> None:
        workspace = self._page.workspace
        with atomic_write(workspace.campaign_file) as temporary:
            temporary.write_text(text, encoding="utf-8")
        shown = workspace.written("")
        self._page.did(what, f"edhas campaign check {shown}", f'campaign = edhas.read_campaign("{workspace.shown}")')
        await self._page.read_campaign()
        await self.refresh()
        if self._page.problems:
            self._page.tell("\n".join(self._page.problems))

    def _build_check(self) -> None:
        page = self._page
        self._check.clear()
        self._record = None
        with self._check:
            for problem in page.problems:
                ui.label(problem).classes("wb-card wb-bad w-full")
            summary = page.summary
            if summary is None:
                return
            ui.label("Check of the data").classes("wb-h")
            samples = sum(row["samples"] for row in summary["runs"].values())
            counts = f"{len(summary['runs'])} runs, {len(summary['signals'])} signals, {samples:,} samples."
            ui.label(counts).props("data-mark=check")
            if not summary["remarks"]:
                ui.label("No errors, no warnings: all data are used.")
            with ui.element("ul").classes("wb-list"):
                for severity, file, line, sentence in summary["remarks"][:MAX_REMARKS]:
                    with ui.element("li"), ui.row().classes("gap-2 items-baseline no-wrap"):
                        ui.label(severity).classes(f"wb-chip {SEVERITIES[severity]}")
                        ui.label(f"{file}{f':{line}' if line else ''}: {sentence}")
            self._noise_table(summary)
            with ui.row().classes("items-center gap-3"):
                ui.label("As recorded").classes("wb-h")
                runs, signals = list(summary["runs"]), list(summary["signals"])
                self._record_run = ui.select(runs, value=runs[0]).props("dense outlined options-dense")
                self._record_signal = ui.select(signals, value=signals[0]).props("dense outlined options-dense")
                ui.label("Red: samples left out. Grey: gaps in the time. Dashed: where the signal is cut off.").classes("wb-quiet")
            self._record = ui.plotly({"data": [], "layout": {"height": 260}}).classes("w-full").props("data-mark=record")
            for choice in (self._record_run, self._record_signal):
                choice.on_value_change(self._draw_record)
            ui.timer(0.1, self._draw_record, once=True)

    def _noise_table(self, summary: dict[str, Any]) -> None:
        with ui.element("div").classes("wb-scroll"), ui.element("table").classes("wb-table"):
            with ui.element("tr"):
                for head in ("noise, SI", "stated", "measured", "used"):
                    with ui.element("th"):
                        ui.label(head)
            for name, row in summary["noise_table"].items():
                with ui.element("tr"):
                    cells = [f"{row[key]:.3g}" if row[key] is not None and np.isfinite(row[key]) else "–"
                             for key in ("stated", "measured", "used")]  # fmt: skip
                    unit = "" if row["unit"] == "-" else f", {row['unit']}"
                    for text in (name.replace("_", " ") + unit, *cells):
                        with ui.element("td"):
                            ui.label(text)

    async def _draw_record(self) -> None:
        if self._record is None or self._page.summary is None:
            return
        await asyncio.sleep(0)
        found = await self._page.ask("data.record", self._record_run.value, self._record_signal.value, WIDTH)
        if found is not None:
            self._record.update_figure(record_figure(found, self._page.dark))
