"""Suspects as cards: what each is, how certain, what it would change; one tries, adds or rejects them."""

import time
from collections.abc import Awaitable, Callable
from typing import Any

from nicegui import ui

from edhas_jax.diagnosis.report.conclusions import Outcome
from edhas_jax.machine.effects import LIBRARY
from edhas_jax.machine.interface.slots import SLOTS
from edhas_jax.workbench.standing import is_of_present_inputs, sizes_text
from edhas_jax.workbench.views.elements import Button, Choice, Head, MainButton, Quiet, Strong, dialog
from edhas_jax.workbench.views.law_curve import show_law_curve
from edhas_jax.workbench.views.matrix import error_matrix
from edhas_jax.workbench.workspace import DIAGNOSED, effect_id

MAX_CARDS = 12
KINDS = {kind.id: kind for kind in LIBRARY}


class Suspects:
    """The cards, and the fields to try any effect of the library or of one's own.

    Args:
        page: the window.
        on_change: called after something was tried or decided.
    """

    def __init__(self, page, on_change: Callable[[], Awaitable[None]]):
        self._page, self._on_change = page, on_change
        Head("Suspects").classes("mt-4")
        with ui.row().classes("items-end gap-3"):
            with ui.row().classes("items-end gap-3") as self._of_library:
                self._effect = Choice({}, label="any effect of the library", with_input=True).classes("min-w-64")
                Button("Try it", on_click=lambda: self._try(self._effect.value), icon="science")
            self._own = ui.input("an effect of your own, FILE.py:Class").props("dense outlined").classes("min-w-72")
            Button("Try your own", on_click=self._try_own, icon="science")
        self._cards = ui.element("div").classes("wb-cards mt-3")
        self._shown: Any = None  # all that the cards are made of

    def refresh(self) -> None:
        """Follow the folder; cards that would be the same stay, so that no click on one is lost."""
        diagnosis, workspace = self._page.workspace.result(DIAGNOSED) or {}, self._page.workspace
        decisions, summary = workspace.decisions(), self._page.summary
        rows = {candidate_name(row): row for row in diagnosis.get("candidates", [])[:MAX_CARDS]}
        for name in (*decisions.added, *decisions.rejected, *self._tried_alone()):
            rows.setdefault(name, {"effect": name})
        if summary is not None:
            names = {slot["name"] for slot in summary["slots"]}
            free = [k.id for k in LIBRARY if {s.name for s in k.slots} <= names and k.id not in summary["effects"]]
            self._effect.follow({name: name.replace("_", " ") for name in free}, self._effect.value)
            self._of_library.set_visibility(bool(free))
        tried = workspace.tried()
        is_present = [is_of_present_inputs(workspace, row) for row in tried.values()]
        shown = rows, decisions, tried, is_present, summary
        if shown == self._shown:
            return
        self._shown = shown
        self._cards.clear()
        with self._cards:
            for name, row in rows.items():
                self._card(name, row, decisions)
            if not rows:
                Quiet("None yet: diagnose, or try any effect.")

    def _tried_alone(self) -> list[str]:
        """The names of effects that were tried in addition to those that are in the model."""
        added = set(self._page.workspace.decisions().added)
        return [data["named"][-1] for data in self._page.workspace.tried().values() if data["named"][-1] not in added]

    def _card(self, name: str, row: dict[str, Any], decisions) -> None:
        kind = KINDS.get(row["effect"])
        is_sensor = bool(row.get("signal"))
        card = ui.card().classes("wb-card")
        card.props["data-mark"] = f"card-{name}"
        tried = self._page.workspace.tried().get(self._chain_name(name, decisions))
        if tried is None and name not in (*decisions.added, *decisions.rejected) and is_quiet(row):
            card.classes("wb-grey")
        with card:
            with ui.row().classes("items-center w-full no-wrap"):
                Strong(effect_id(name).replace("_", " ")).classes("wb-wrap")
                ui.space()
                if name in decisions.added:
                    ui.label("in the model").classes("wb-chip wb-good whitespace-nowrap")
                elif name in decisions.rejected:
                    ui.label("rejected").classes("wb-chip wb-bad whitespace-nowrap")
                elif row.get("probability") is not None:
                    ui.label(status_text(row)).classes("wb-chip")
            place = "sensor" if is_sensor else row.get("slot") or (kind.slots[0].location if kind else "")
            summary = _summary(kind, name, row)
            Quiet(f"{place.replace('_', ' ')} · {summary}" if place else summary)
            if tried is None:  # one size is shown, that of the present model where it was fitted
                self._found(row)
            if kind is not None and kind.looks_like:
                Quiet(f"Looks like: {kind.looks_like}")
            if name in decisions.rejected:
                ui.label(f"Rejected: {decisions.rejected[name]}")
            self._tried_matrix(tried)
            self._buttons(name, is_sensor, decisions, tried)

    def _found(self, row: dict[str, Any]) -> None:
        """What the diagnosis has found of a suspect."""
        if row.get("parameters"):
            ui.label(sizes_text(row["parameters"]).replace("_", " "))
        if row.get("evidence"):
            ui.label(f"evidence: {row['evidence']}")
        if row.get("holdout_error") is not None:
            ui.label(f"residual over noise with it {row['holdout_error']:.2f} on runs not used")

    def _tried_matrix(self, found: dict[str, Any] | None) -> None:
        """What falls where, if the effect was tried on the present model."""
        if found is None or self._page.summary is None:
            return
        if not is_of_present_inputs(self._page.workspace, found):
            ui.label("Tried before the campaign changed; try it again.").props("data-mark=tried-before")
        if found.get("needs_no_effect"):
            ui.label(found["needs_no_effect"]).props("data-mark=tried-needless")
        old, new = found["before"]["error"], found["error"]
        for use, title in (("fit", "runs used"), ("holdout", "runs not used")):
            if new.get(use) is not None:
                Strong(f"{title}: {old[use]:.2f} → {new[use]:.2f}").props(f"data-mark=tried-{use}")
        ui.label(sizes_text(found["parameters"]).replace("_", " "))
        runs = self._page.summary["runs"].items()
        notes = {run: "not used" if row["use"] == "holdout" else "used" for run, row in runs}
        with ui.expansion("what falls where").classes("w-full").props("dense"):
            error_matrix(found["error_by_run"], list(self._page.summary["signals"]), notes,
                         before=found["before"]["error_by_run"])  # fmt: skip

    def _buttons(self, name: str, is_sensor: bool, decisions, tried: dict[str, Any] | None) -> None:
        with ui.row().classes("gap-1 mt-auto"):
            if is_sensor:
                Quiet("Not a part of the machine: correct the sensor or its column.")
            elif name in decisions.added:
                Button("Take out", on_click=lambda: self._decide(name))
                model = f"with {self._chain_name(name, decisions)}"
                Button("Compare", on_click=lambda: self._page.go(view="Compare", model=model), icon="show_chart")
            else:
                Button("Try", on_click=lambda: self._try(name), icon="science")
                Button("Add", on_click=lambda: self._add(name), icon="add")
            if name in decisions.added and tried is not None and not is_of_present_inputs(self._page.workspace, tried):
                Button("Try again", on_click=lambda: self._try(name), icon="science")
            if tried is not None and not is_sensor:
                Button("Law", on_click=lambda: show_law_curve(self._page, tried["named"]))
            if name in decisions.rejected:
                Button("Reconsider", on_click=lambda: self._decide(name))
            elif name not in decisions.added:
                Button("Reject", on_click=lambda: self._ask_reason(name), icon="block")

    def _chain(self, name: str, decisions) -> list[str]:
        added = [n for n in decisions.added if n != name]
        if name in decisions.added:
            added = list(decisions.added[: decisions.added.index(name)])
        return [*added, name]

    def _chain_name(self, name: str, decisions) -> str:
        return "+".join(map(effect_id, self._chain(name, decisions)))

    async def _try(self, name: str | None) -> bool:
        """Fit the model with one more effect; whether that was possible."""
        if not name:
            self._page.tell("Choose an effect first.")
            return False
        if not self._page.has_campaign():
            return False
        chain = self._chain(name, self._page.workspace.decisions())
        began = time.perf_counter()
        found = await self._page.ask("campaign.try_effects", chain)
        if found is None:
            return False
        session = self._page.session
        self._page.did(f"try {name}", session.command_try(chain), session.python_try(chain))
        self._page.note(f"{name.replace('_', ' ')} tried in {time.perf_counter() - began:.1f} s")
        await self._on_change()
        return True

    async def _add(self, name: str) -> None:
        decisions = self._page.workspace.decisions()
        found = self._page.workspace.tried().get(self._chain_name(name, decisions))
        is_present = found is not None and is_of_present_inputs(self._page.workspace, found)
        if not is_present and not await self._try(name):
            return
        await self._decide(name, is_added=True)

    async def _decide(self, name: str, **decision: Any) -> None:
        self._page.attempt(lambda: self._page.session.decide(name, **decision))
        self._page.show_state()
        await self._on_change()

    def _ask_reason(self, name: str) -> None:
        with dialog(self._page, f"Why is it not {name.replace('_', ' ')}?") as asked:
            reason = ui.input("reason, which is remembered").classes("w-80")

            async def reject() -> None:
                asked.close()
                await self._decide(name, reason=reason.value.strip() or "no reason given")

            with ui.row():
                MainButton("Reject", on_click=reject)
                Button("Keep", on_click=asked.close)

    def _try_own(self) -> None:
        """Ask before code of a file runs; the click names the file."""
        spec = (self._own.value or "").strip()
        source, colon, name = spec.rpartition(":")
        if not colon or not source.endswith(".py") or not name.isidentifier():
            self._page.tell(
                "Write the file and the class of the effect, such as my_effects.py:SealDrag; slots: " + ", ".join(SLOTS)
            )
            return
        path = self._page.attempt(lambda: self._page.workspace.inside(source))
        if path is None:
            return
        if not path.is_file():
            self._page.tell(f"{source}: no such file in {self._page.workspace.folder.name}")
            return
        with dialog(self._page, f"{source} is Python code that will run on this computer.") as asked:
            Quiet("Read it first. It may run until the workbench ends.")

            async def run() -> None:
                asked.close()
                self._page.attempt(lambda: self._page.session.allow(spec))
                await self._try(f"{path.relative_to(self._page.workspace.folder)}:{name}")

            with ui.row():
                MainButton(f"Run {source}", on_click=run)
                Button("Do not run it", on_click=asked.close)


def candidate_name(row: dict[str, Any]) -> str:
    """The name of a candidate of `diagnosis.json`."""
    return f"{row['effect']} on {row['signal']}" if row.get("signal") else str(row["effect"])


def status_text(row: dict[str, Any]) -> str:
    """What a diagnosis says of a candidate, in the words that it uses everywhere."""
    probability = f"probability {row['probability']:.2f}"
    return f"{row['outcome']}, {probability}" if row.get("outcome") else probability


def is_quiet(row: dict[str, Any]) -> bool:
    """Whether a candidate of `diagnosis.json` is probably nothing, and shown in grey."""
    if row.get("probability") is None:  # the engineer has chosen it
        return False
    return row.get("outcome") not in {o.value for o in Outcome if not o.is_quiet}


def _summary(kind, name: str, row: dict[str, Any]) -> str:
    if row.get("signal"):
        return f"a fault of the sensor of {row['signal'].replace('_', ' ')}"
    return f"an effect of your own, {name}" if kind is None else (kind.__doc__ or "").strip().splitlines()[0]
