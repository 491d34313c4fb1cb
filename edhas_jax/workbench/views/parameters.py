"""The uncertain parameters: which are free, their initial values, priors and limits, and what a fit has found."""

import asyncio
from collections.abc import Awaitable, Callable, Mapping, Sequence
from typing import Any

from nicegui import ui

from edhas_jax.core.units import estimate_text, format_quantity
from edhas_jax.workbench.views.elements import Button, Choice, Head, Quiet
from edhas_jax.workbench.views.save import csv_button
from edhas_jax.workbench.views.table import ChoiceTables, cell, check_box, field_table, text_field
from edhas_jax.workbench.workspace import CALIBRATED

FIELDS = {"value": "initial value", "prior": "prior", "min": "min", "max": "max"}
OF_FIXED = "value"  # the only field of a parameter that is not free
HEADS = "free", "parameter", *FIELDS.values(), "calibrated", "moved", "most like"
NOTES = (
    "An empty field is as in campaign.yaml, which is shown in grey. Free: estimated; otherwise held at its value. "
    "Prior: standard deviation of the true value around the given one, as a share (0.05) or with a unit, or “none”. "
    "Calibrated: with its standard error. Moved: in standard deviations of what was known. Most like: the parameter "
    "whose estimate is most correlated with this one."
)


class Parameters(ChoiceTables):
    """The table; see `ChoiceTables`."""

    def __init__(self, page, on_choice: Callable[[], Awaitable[None]]):
        super().__init__(page, on_choice, "parameters")
        self._fields: dict[str, dict[str, ui.input]] = {}
        self._free: dict[str, ui.checkbox] = {}

    def _build(self) -> None:
        self._fields, self._free = {}, {}
        names = self._names()
        if not names:
            return
        with self._body:
            with ui.row().classes("items-center gap-1"):
                Head("Parameters")
                csv_button("parameters", self._csv)
            with field_table(*HEADS):
                for name in names:
                    with ui.element("tr") as row:
                        row.props["data-mark"] = f"row-{name}"
                        self._build_row(name)
            with ui.row().classes("items-end gap-3"):
                others = {n: f"{n.replace('_', ' ')} = {v}" for n, v in self._others().items() if n not in names}
                self._more = Choice(others, label="another parameter of the machine", with_input=True)
                self._more.classes("min-w-80")
                Button("Free it", on_click=self._free_another, icon="add")
            Quiet(NOTES)

    def show_limits(self, limits: Mapping[str, Sequence[str]]) -> None:
        """Show in empty fields between which values parameters are sought with what is chosen now."""
        for name, ends in limits.items():
            for key, text in zip(("min", "max"), ends, strict=True):
                if name in self._fields:
                    self._fields[name][key].props["placeholder"] = text

    def _state(self) -> tuple:
        fit = self._page.workspace.result(CALIBRATED) or {}
        chosen = self._page.session.choices.read().get("parameters", {})
        return self._unknowns(), chosen, fit.get("calibrated"), fit.get("correlation")

    def _unknowns(self) -> Mapping[str, Any]:
        return (self._page.summary or {}).get("uncertain", {})

    def _others(self) -> Mapping[str, str]:
        return (self._page.summary or {}).get("parameters", {})

    def _names(self) -> list[str]:
        """The uncertain parameters, and those that were freed besides."""
        chosen = self._page.session.choices.read().get("parameters", {})
        return [*self._unknowns(), *(name for name in chosen if name in self._others())]

    def _build_row(self, name: str) -> None:
        row, title = self._page.session.choices.parameter(name), name.replace("_", " ")
        hints, fields = self._hints(name), {}
        is_free = row.get("free") is not False
        with ui.element("td"):
            if name in self._unknowns():
                self._free[name] = check_box(f"{title} is free", is_free, self._choose, name)
            else:
                remove = ui.button(icon="close", on_click=lambda: self._remove(name)).props("flat round dense size=sm")
                remove.props["aria-label"] = f"do not free {title}"
        cell(title)
        for key, head in FIELDS.items():
            with ui.element("td"):
                field = text_field(f"{head} of {title}", _field_text(row.get(key)), hints[key], self._choose, name)
                field.set_enabled(is_free or key == OF_FIXED)
                fields[key] = field
        self._fields[name] = fields
        estimate, moved, like, is_at_limit = self._found(name)
        cell(estimate).classes("wb-chip wb-bad" if is_at_limit else "")
        cell(moved)
        cell(like)

    def _hints(self, name: str) -> dict[str, str]:
        """What the campaign says, for empty fields."""
        unknown = self._unknowns().get(name)
        if unknown is None:
            return {"value": self._others()[name], "prior": "needed, such as 0.1", "min": "", "max": ""}
        unit = unknown["unit"]
        given, low, high = (format_quantity(unknown[key], unit) for key in ("given", "smallest", "largest"))
        return {"value": given, "prior": unknown["known_to"].replace(" ", "\xa0"), "min": low, "max": high}

    def _found(self, name: str) -> tuple[str, str, str, bool]:
        """What a calibration has found: estimate, how far it moved, what is most like it, whether it is at a limit."""
        fit = self._page.workspace.result(CALIBRATED) or {}
        found = fit.get("calibrated", {}).get(name)
        if found is None:
            return "", "", "", False
        estimate = estimate_text(found["value"], found.get("std"), found["unit"], found.get("limit"))
        others = {n: r for n, r in fit.get("correlation", {}).get(name, {}).items() if n != name and r is not None}
        like = max(others, key=lambda n: abs(others[n]), default="")
        moved = f"{fit['prior_pull'][name]:+.1f}"
        return estimate, moved, f"{like.replace('_', ' ')} ({others[like]:+.2f})" if like else "", "limit" in found

    def _csv(self) -> list[tuple[str, ...]]:
        rows = []
        for name in self._names():
            row, hints = self._page.session.choices.parameter(name), self._hints(name)
            texts = (_field_text(row.get(key)) or hints[key] for key in FIELDS)
            rows.append(("no" if row.get("free") is False else "yes", name, *texts, *self._found(name)[:3]))
        return [HEADS, *rows]

    async def _choose(self, name: str) -> None:
        """Keep what the row of a parameter says now."""
        choices, old = self._page.session.choices, self._page.session.choices.parameter(name)
        is_free = name not in self._free or self._free[name].value
        row: dict[str, Any] = {} if is_free else {"free": False}
        for key, field in self._fields[name].items():
            field.set_enabled(is_free or key == OF_FIXED)
            text = (field.value or "").strip()
            if not is_free and key != OF_FIXED:
                field.set_value("")
            elif text:
                row[key] = old[key] if key in old and _field_text(old[key]) == text else text
        if name in self._others() and not row:
            row = {"free": True}  # it stays in the table, and the check says that a prior is needed
        if row == old:
            return
        choices.set_parameter(name, row)
        await self._changed()

    async def _free_another(self) -> None:
        if self._more.value:
            self._page.session.choices.set_parameter(self._more.value, {"free": True})
            self.refresh()
            await self._on_choice()

    async def _remove(self, name: str) -> None:
        self._page.session.choices.set_parameter(name, {})
        await asyncio.sleep(0)  # the click has to end before its button goes
        self.refresh()
        await self._on_choice()


def _field_text(value: Any) -> str:
    """What is chosen as the text of a field; a prior such as {relative: 0.1} is its number."""
    if isinstance(value, Mapping):
        value = next(iter(value.values()), "")
    return "" if value is None else str(value)
