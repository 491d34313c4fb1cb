"""Which runs and signals a fit uses, within what time windows, and with what weights."""

from collections.abc import Awaitable, Callable
from typing import Any

from nicegui import ui

from edhas_jax.core.units import unit_text
from edhas_jax.workbench.views.elements import Head, Quiet
from edhas_jax.workbench.views.table import ChoiceTables, cell, check_box, field_table, text_field

NOTES = (
    "Runs that are not fitted are held out. Of a run with a time window only the samples in it are used; it is "
    "simulated from its start all the same. A factor of 2 on the noise of a signal leaves its samples a quarter of "
    "their weight in χ²."
)


class RunsAndSignals(ChoiceTables):
    """Two tables with check boxes and fields; see `ChoiceTables`."""

    def __init__(self, page, on_choice: Callable[[], Awaitable[None]]):
        super().__init__(page, on_choice, "runs-and-signals")
        self._fitted: dict[str, ui.checkbox] = {}
        self._windows: dict[str, tuple[ui.input, ui.input]] = {}
        self._used: dict[str, ui.checkbox] = {}
        self._factors: dict[str, ui.input] = {}

    def _build(self) -> None:
        summary = self._page.summary
        self._fitted, self._windows, self._used, self._factors = {}, {}, {}, {}
        with self._body, ui.element("div").classes("wb-two"):
            with ui.column().classes("gap-1"):
                Head("Runs")
                self._build_runs(summary)
            with ui.column().classes("gap-1"):
                Head("Signals")
                self._build_signals(summary)
        with self._body:
            Quiet(NOTES)

    def _state(self) -> tuple:
        chosen = self._page.session.choices.read()
        summary = self._page.summary or {}
        return summary.get("runs"), summary.get("signals"), *(chosen.get(k) for k in ("runs", "signals", "windows"))

    def _build_runs(self, summary: dict[str, Any]) -> None:
        chosen = self._page.session.choices.read()
        usual = [n for n, run in summary["runs"].items() if run["use"] == "fit"]
        fitted = chosen.get("runs", usual)
        with field_table("fitted", "run", "from", "to", "conditions"):
            for name, run in summary["runs"].items():
                with ui.element("tr"):
                    with ui.element("td"):
                        self._fitted[name] = check_box(f"{name} is fitted", name in fitted, self._choose_runs)
                    cell(name)
                    window = chosen.get("windows", {}).get(name) or ("", "")
                    hints = "0 s", f"{run['end']:.4g} s"
                    fields = []
                    for text, hint, what in zip(window, hints, ("first", "last"), strict=False):
                        with ui.element("td"):
                            fields.append(text_field(f"{what} time of {name}", text, hint, self._choose_window, name))
                    self._windows[name] = tuple(fields)
                    cell(summary["conditions"].get(name, ""), "wb-quiet")

    def _build_signals(self, summary: dict[str, Any]) -> None:
        chosen = self._page.session.choices.read().get("signals")
        with field_table("used", "signal", "factor on its noise", "noise"):
            for name, unit in summary["signals"].items():
                title = name.replace("_", " ")
                is_used = chosen is None or name in chosen
                with ui.element("tr"):
                    with ui.element("td"):
                        self._used[name] = check_box(f"{title} is used", is_used, self._choose_signals)
                    cell(title)
                    with ui.element("td"):
                        factor = str((chosen or {}).get(name, ""))
                        factor = "" if factor in ("1", "1.0") else factor
                        field = text_field(f"factor on the noise of {title}", factor, "1", self._choose_signals)
                        self._factors[name] = field
                    cell(f"{summary['noise'][name]:.4g} {unit_text(unit)}")

    async def _choose_runs(self) -> None:
        usual = [n for n, run in self._page.summary["runs"].items() if run["use"] == "fit"]
        fitted = [name for name, box in self._fitted.items() if box.value]
        await self._write("runs", None if fitted == usual else fitted)

    async def _choose_signals(self) -> None:
        rows = {n: (self._factors[n].value or "").strip() or "1" for n, box in self._used.items() if box.value}
        is_usual = len(rows) == len(self._used) and all(factor in ("1", "1.0") for factor in rows.values())
        await self._write("signals", None if is_usual else rows)

    async def _choose_window(self, name: str) -> None:
        first, last = ((field.value or "").strip() for field in self._windows[name])
        end = self._page.summary["runs"][name]["end"]
        window = (first or "0 s", last or f"{end!r} s") if first or last else None
        choices, data = self._page.session.choices, self._page.session.choices.read()
        if list(window or ()) != list(data.get("windows", {}).get(name) or ()):
            choices.set_window(name, window)
            await self._changed()

    async def _write(self, key: str, value: Any) -> None:
        choices, data = self._page.session.choices, self._page.session.choices.read()
        if data.get(key) != value:
            choices.write(data | {key: value})
            await self._changed()
