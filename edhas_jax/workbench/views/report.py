"""Report: the next experiment, and the HTML files that one sends."""

import dataclasses
import urllib.parse
from pathlib import Path

from nicegui import ui

from edhas_jax.workbench.views.elements import Block, Button, Head, Quiet, Strong
from edhas_jax.workbench.workspace import CALIBRATED, DIAGNOSED, RESULTS

REPORTS = {"diagnosis": DIAGNOSED, "calibration": CALIBRATED, "comparison": "compared"}


class ReportView:
    """Next experiment and reports."""

    def __init__(self, page):
        self._page, self._shown = page, ""

    async def build(self) -> None:
        """Build the view."""
        Head("Next experiment")
        self._next = ui.column().classes("gap-1")
        Head("Reports").classes("mt-4")
        Quiet("One HTML file each, with its figures in it: send the file.")
        pack = Button("Campaign and results as one file", on_click=self._pack, icon="archive")
        pack.tooltip("a ZIP file; `edhas workbench` on the unpacked folder opens on the same run and signal")
        self._list = ui.column().classes("gap-1 w-full")
        self._frame = ui.column().classes("w-full mt-3")
        await self.refresh()

    async def refresh(self) -> None:
        """Follow the folder."""
        self._show_next()
        self._list.clear()
        inside = self._page.workspace.inside
        paths = {name: inside(Path(RESULTS, folder, "report.html")) for name, folder in REPORTS.items()}
        found = {name: path for name, path in paths.items() if path.is_file()}
        with self._list:
            if not found:
                ui.label("None yet: calibrate, diagnose, or let “Compare” write one.")
            for name, path in found.items():
                with ui.row().classes("items-center gap-3"):
                    Strong(name).classes("min-w-28")
                    Quiet(f"{RESULTS}/{REPORTS[name]}/report.html")
                    Quiet(f"{path.stat().st_size / 1e6:.2f} MB").classes("gt-xs")
                    Button("Show", on_click=lambda _, name=name: self._show(name))
                    ui.link("Open", self._address(name), new_tab=True)
        if found and self._shown not in found:
            self._show(next(iter(found)))
        if self._frame.default_slot.children:  # it follows the colours of the page
            self._frame.default_slot.children[0].style(replace=self._colours())

    def _pack(self) -> None:
        """Hand the browser everything, to be opened with the run, signal and model of this page."""
        workspace = self._page.workspace
        address = dataclasses.replace(self._page.place, view="Overview").address
        packed = self._page.attempt(lambda: workspace.packed(address))
        if packed is not None:
            ui.download.content(packed, f"{workspace.folder.name}.zip")

    def _show_next(self) -> None:
        diagnosis = self._page.workspace.result(DIAGNOSED)
        experiment = None if diagnosis is None else diagnosis.get("next_experiment")
        self._next.clear()
        with self._next.props("data-mark=next"):
            if diagnosis is None:
                Quiet("A diagnosis says which run would decide between the suspects that remain.")
            elif experiment is None:
                ui.label("No run is needed: there are no rivals that a run would have to distinguish.")
            else:
                ui.label(experiment["sentence"])
                words = [f"{name}: {text}" for name, text in experiment["conditions"].items()]
                words = ["file: next_run.csv", "use: fit", *words]
                Quiet("Its entry in campaign.yaml, once it is measured:")
                Block(f"  - {{{', '.join(words)}}}")

    def _address(self, name: str) -> str:
        return f"/results/{urllib.parse.quote(REPORTS[name])}/report.html"

    def _show(self, name: str) -> None:
        self._shown = name
        self._frame.clear()
        with self._frame:
            frame = ui.element("iframe").classes("wb-report").props("sandbox=allow-scripts")
            frame.props["src"] = self._address(name)
            frame.props["title"] = f"report of the {name}"
            frame.style(self._colours())

    def _colours(self) -> str:
        """A report follows the colours that its frame prefers."""
        return f"color-scheme: {'dark' if self._page.dark else 'light'}"
