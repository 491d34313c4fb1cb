"""Data: files become a campaign; what is wrong with them is said all at once, each with a remedy."""

import asyncio
import math
from pathlib import Path
from typing import Any

from nicegui import ui

from edhas_jax.config.tables.table import MAX_BYTES
from edhas_jax.core.atomic_file import atomic_write
from edhas_jax.core.literal_text import file_name
from edhas_jax.core.units import format_quantity
from edhas_jax.workbench.calculator import CalculationError
from edhas_jax.workbench.figures import record_figure
from edhas_jax.workbench.views.elements import Choice, Head, MainButton, Quiet, Strong
from edhas_jax.workbench.views.mapper import Mapper
from edhas_jax.workbench.views.plot import Plot
from edhas_jax.workbench.views.table import show_table
from edhas_jax.workbench.workspace import CAMPAIGN_FILE

SEVERITIES = {"error": "wb-bad", "warning": "", "note": ""}
NO_RECORDS = ".py", ".yaml", ".yml", ".json", ".html"  # that may not be dropped
WIDTH, MAX_REMARKS = 700, 200


class DataView:
    """Files, the mapping of their columns, the campaign file, the check of the data."""

    def __init__(self, page):
        self._page = page
        self._written: int | None = None  # when the campaign file that is shown was written
        self._read: tuple = ()  # number of the reading whose check is shown, and whether the page was dark

    async def build(self) -> None:
        """Build the view."""
        Head("Files")
        Quiet("Drop the records of a logger: CSV or text with any separator and decimal commas, Excel, MATLAB, "
              "Parquet, HDF5, TDMS or MDF. They are copied into the folder of the campaign.")  # fmt: skip
        upload = ui.upload(multiple=True, auto_upload=True, max_file_size=MAX_BYTES, on_upload=self._receive,
                           on_rejected=lambda: self._page.note("A file above 1 GB is not read."),
                           label="drop files here, or press +").classes("w-full max-w-xl")  # fmt: skip
        upload.props("flat bordered")
        self._refused = ui.column().classes("w-full gap-1").props("data-mark=refused")
        self._mapper = Mapper(self._page, lambda text: self._save(text, "write campaign.yaml"))
        self._file = ui.column().classes("w-full gap-2 mt-4")
        self._check = ui.column().classes("w-full gap-2 mt-4")
        await self.refresh()

    async def refresh(self) -> None:
        """Follow the folder; what is being typed stays while the campaign file is the same."""
        path = self._page.workspace.campaign_file
        written = path.stat().st_mtime_ns if path.is_file() else 0
        if written != self._written:
            self._written = written
            self._build_file()
        if (self._page.readings, self._page.dark) != self._read:  # of a file that may have been written anew since
            self._read = self._page.readings, self._page.dark
            self._build_check()
            self._mapper.draw_curves()
            await self._draw_record()

    async def _receive(self, event) -> None:
        name = file_name(Path(event.file.name).name)
        path = self._page.attempt(lambda: self._page.workspace.inside(name))
        if path is None:
            return
        if name in (CAMPAIGN_FILE, "workbench") or path.suffix.lower() in NO_RECORDS:
            kinds = "CSV, text, Excel, MATLAB, Parquet, HDF5, TDMS or MDF"
            self._refuse(name, [f"is no record of a logger; a table belongs here: {kinds}"])
            return
        if path.exists() and path.read_bytes() != await event.file.read():
            self._refuse(name, ["another file of this name is in the folder already; rename the new one"])
            return
        is_new = not path.exists()
        if is_new:
            with atomic_write(path) as temporary:
                await event.file.save(temporary)
        try:
            await self._mapper.add(name)
        except CalculationError as error:
            if is_new:
                path.unlink(missing_ok=True)
            self._refuse(name, str(error).splitlines())

    def _refuse(self, name: str, lines: list[str]) -> None:
        with self._refused, ui.element("div").classes("wb-card wb-bad w-full"):
            Strong(f"{name} is not used:")
            for line in lines[:MAX_REMARKS]:
                ui.label(line)

    def _build_file(self) -> None:
        """The campaign file as text that can be changed."""
        path = self._page.workspace.campaign_file
        self._file.clear()
        if not path.is_file():
            return
        text = self._page.attempt(lambda: path.read_text(encoding="utf-8", errors="replace"))
        with self._file:
            Head("campaign.yaml")
            editor = ui.textarea(value=text or "").props("outlined autogrow input-class=wb-code").classes("w-full")
            editor.props["aria-label"] = "campaign.yaml"
            with ui.row():
                MainButton("Save and check", on_click=lambda: self._save(editor.value, "change campaign.yaml"))

    async def _save(self, text: str, what: str) -> None:
        workspace = self._page.workspace
        workspace.write(CAMPAIGN_FILE, text)
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
            Head("Check of the data")
            samples = sum(row["samples"] for row in summary["runs"].values())
            runs, signals = len(summary["runs"]), len(summary["signals"])
            counts = f"{runs} run{'s' * (runs != 1)}, {signals} signal{'s' * (signals != 1)}, {samples:,} samples."
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
                Head("As recorded")
                runs, signals = list(summary["runs"]), list(summary["signals"])
                self._record_run = Choice(runs, value=runs[0], on_change=self._draw_record)
                self._record_signal = Choice(signals, value=signals[0], on_change=self._draw_record)
                Quiet("Red: samples left out. Grey: gaps in the time. Dashed: where the signal is cut off.")
            self._record = Plot("record")

    def _noise_table(self, summary: dict[str, Any]) -> None:
        heads, rows = ("noise", "stated", "measured", "used"), []
        for name, row in summary["noise_table"].items():
            values = (row[key] for key in heads[1:])
            cells = ["–" if v is None or not math.isfinite(v) else format_quantity(v, row["unit"]) for v in values]
            rows.append((name.replace("_", " "), *cells))
        show_table(heads, rows)

    async def _draw_record(self) -> None:
        if self._record is None or self._page.summary is None:
            return
        await asyncio.sleep(0)
        found = await self._page.ask("data.record", self._record_run.value, self._record_signal.value, WIDTH)
        if found is not None:
            self._record.show(record_figure(found, self._page.dark))
