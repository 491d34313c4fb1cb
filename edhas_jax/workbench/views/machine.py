"""Machine: where something is missing; the equations, effects and suspects of each part."""

from nicegui import ui

from edhas_jax.diagnosis.report.machine_schematic import draw_parts, draw_schematic
from edhas_jax.machine.effects import LIBRARY
from edhas_jax.machine.rigs import RIGS
from edhas_jax.workbench.views.suspects import candidate_name, is_quiet, status_text
from edhas_jax.workbench.workspace import DIAGNOSED, effect_id

CLICK = "(e) => { const p = e.target.closest('[data-part]'); if (p) emit(p.dataset.part) }"


class MachineView:
    """The schematic, coloured by the probability that something is missing, and the part that was clicked."""

    def __init__(self, page):
        self._page, self._part = page, ""

    async def build(self) -> None:
        """Build the view."""
        ui.label("Where something is missing").classes("wb-h")
        self._note = ui.label("").classes("wb-quiet")
        with ui.element("div").classes("wb-two mt-2"):
            with ui.column().classes("gap-2"):
                self._drawing = ui.html("", sanitize=False).classes("wb-paper").props("data-mark=schematic")
                self._drawing.on("click", lambda event: self._choose(event.args), js_handler=CLICK)
                self._parts = ui.row().classes("gap-1")
            self._detail = ui.column().classes("gap-2")
        await self.refresh()

    async def refresh(self) -> None:
        """Follow the folder."""
        summary = self._page.summary
        if summary is None:
            self._note.set_text("There is no campaign in this folder yet.")
            return
        now = self._page.standing()
        probabilities = now.where
        rig, measured = RIGS.get(summary["rig"]), tuple(summary["signals"])
        parts = list(dict.fromkeys([*(slot["location"] for slot in summary["slots"]), "sensor"]))
        drawn = draw_parts(parts[:-1], probabilities, measured) if rig is None else None
        self._drawing.set_content(drawn or draw_schematic(rig(), probabilities, measured))
        colours = next(iter(now.verdict), "Colours come with a diagnosis.")
        self._note.set_text(f"{colours} Click a part to see its equations, effects and suspects.")
        self._parts.clear()
        with self._parts:
            for part in parts:
                button = ui.button(part.replace("_", " "), on_click=lambda _, part=part: self._choose(part))
                button.props("no-caps dense outline size=sm")
        self._choose(self._part or next(iter(probabilities), parts[0]))

    async def redraw(self) -> None:
        """The schematic is on white paper on any page."""

    def _choose(self, part: str) -> None:
        self._part = part
        summary, workspace = self._page.summary, self._page.workspace
        diagnosis = workspace.result(DIAGNOSED) or {}
        self._detail.clear()
        with self._detail:
            title = part.replace("_", " ").capitalize()
            p = self._page.standing().where.get(part)
            ui.label(title + (f": {p:.0%}" if p is not None else "")).classes("wb-h").props("data-mark=part")
            slots = [slot for slot in summary["slots"] if slot["location"] == part]
            names = {slot["name"] for slot in summary["slots"]}
            if slots:
                ui.label("Terms of its equations that an effect can change").classes("font-semibold")
                with ui.element("ul").classes("wb-list"):
                    for slot in slots:
                        with ui.element("li"):
                            unit = "" if slot["unit"] == "-" else f" [{slot['unit']}]"
                            ui.label(f"{slot['name'].replace('_', ' ')}{unit}: {slot['doc']}")
            here = [k for k in LIBRARY if k.slots[0].location == part and {s.name for s in k.slots} <= names]
            added = [effect_id(name) for name in workspace.decisions().added]
            mounted = [kind for kind in here if kind.id in (*summary["effects"], *added)]
            self._list_effects("In the model", mounted)
            ui.label("Suspects").classes("font-semibold")
            suspects = [c for c in diagnosis.get("candidates", []) if c.get("slot") == part]
            if not suspects:
                ui.label("None was fitted here." if diagnosis else "A diagnosis has not been made yet.")
            with ui.element("ul").classes("wb-list"):
                for c in suspects:
                    is_added = c["effect"] in added
                    with ui.element("li").classes("wb-grey" if is_quiet(c) and not is_added else ""):
                        ui.label(f"{candidate_name(c)}: {'in the model' if is_added else status_text(c)}")
            self._list_effects("Others of the library", [k for k in here if k not in mounted])

    @staticmethod
    def _list_effects(title: str, kinds) -> None:
        if not kinds:
            return
        ui.label(title).classes("font-semibold")
        with ui.element("ul").classes("wb-list"):
            for kind in kinds:
                with ui.element("li"):
                    ui.label(f"{kind.id}: {(kind.__doc__ or '').strip().splitlines()[0]}")
