"""Machine: where something is missing; the equations, effects and suspects of each part."""

from nicegui import ui

from edhas_jax.core.units import unit_text
from edhas_jax.machine.effects import LIBRARY
from edhas_jax.workbench.views.elements import Head, Strong, bullets
from edhas_jax.workbench.views.schematic import Schematic, parts_of
from edhas_jax.workbench.views.suspects import candidate_name, is_quiet, status_text
from edhas_jax.workbench.workspace import DIAGNOSED, effect_id


class MachineView:
    """The schematic, coloured by the probability that something is missing, and the part that was clicked."""

    def __init__(self, page):
        self._page, self._part = page, ""

    async def build(self) -> None:
        """Build the view."""
        Head("Equations, effects and suspects of each part")
        self._note = ui.label("Click a part; a darker colour is a higher probability that something is missing there.")
        self._note.classes("wb-quiet")
        with ui.element("div").classes("wb-two mt-2"):
            with ui.column().classes("gap-2"):
                self._schematic = Schematic(self._page, self._choose)
                self._parts = ui.row().classes("gap-1")
            self._detail = ui.column().classes("gap-2")
        await self.refresh()

    async def refresh(self) -> None:
        """Follow the folder and the place."""
        self._schematic.refresh()
        if self._page.summary is None:
            self._note.set_text("There is no campaign in this folder yet.")
            return
        parts = parts_of(self._page.summary)
        self._parts.clear()
        with self._parts:
            for part in parts:
                button = ui.button(part.replace("_", " "), on_click=lambda _, part=part: self._choose(part))
                button.props("no-caps dense outline size=sm")
        chosen = self._page.place.part
        if chosen not in parts:
            chosen = self._part or next(iter(self._page.standing().where), parts[0])
        self._show(chosen)

    def _choose(self, part: str) -> None:
        self._page.move(part=part)
        self._show(part)

    def _show(self, part: str) -> None:
        self._part = part
        summary, workspace = self._page.summary, self._page.workspace
        diagnosis = workspace.result(DIAGNOSED) or {}
        self._detail.clear()
        with self._detail:
            title = part.replace("_", " ").capitalize()
            p = self._page.standing().where.get(part)
            Head(title + (f": {p:.0%}" if p is not None else "")).props("data-mark=part")
            slots = [slot for slot in summary["slots"] if slot["location"] == part]
            names = {slot["name"] for slot in summary["slots"]}
            if slots:
                Strong("Terms of its equations that an effect can change")
                titles = (f"{s['name'].replace('_', ' ')} [{unit_text(s['unit'])}]".removesuffix(" []") for s in slots)
                bullets(f"{title}: {slot['doc']}" for title, slot in zip(titles, slots, strict=True))
            here = [k for k in LIBRARY if k.slots[0].location == part and {s.name for s in k.slots} <= names]
            added = [effect_id(name) for name in workspace.decisions().added]
            mounted = [kind for kind in here if kind.id in (*summary["effects"], *added)]
            self._list_effects("In the model", mounted)
            Strong("Suspects")
            suspects = [c for c in diagnosis.get("candidates", []) if c.get("slot") == part]
            if not suspects:
                ui.label("None was fitted here." if diagnosis else "A diagnosis has not been made yet.")
            said = ("in the model" if c["effect"] in added else status_text(c) for c in suspects)
            bullets((f"{candidate_name(c)}: {text}" for c, text in zip(suspects, said, strict=True)),
                    (is_quiet(c) and c["effect"] not in added for c in suspects))  # fmt: skip
            self._list_effects("Others of the library", [k for k in here if k not in mounted])

    @staticmethod
    def _list_effects(title: str, kinds) -> None:
        if not kinds:
            return
        Strong(title)
        bullets(f"{kind.id}: {(kind.__doc__ or '').strip().splitlines()[0]}" for kind in kinds)
