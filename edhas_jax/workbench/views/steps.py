"""Steps: what was done, with the command and the Python line that do the same."""

import datetime

from nicegui import ui


class StepsView:
    """The list of steps, the last one on top."""

    def __init__(self, page):
        self._page = page

    async def build(self) -> None:
        """Build the view."""
        ui.label("What was done here").classes("wb-h")
        ui.label("Each step can be done again in a terminal, or in Python after `import edhas_jax as edhas`.").classes(
            "wb-quiet"
        )
        self._body = ui.column().classes("w-full gap-4 mt-3")
        await self.refresh()

    async def refresh(self) -> None:
        """Follow the folder."""
        self._body.clear()
        with self._body:
            for step in reversed(self._page.workspace.steps()):
                with ui.column().classes("w-full gap-1"):
                    when = datetime.datetime.fromtimestamp(step.at).strftime("%Y-%m-%d %H:%M")
                    ui.label(f"{step.what} · {when}").classes("font-semibold")
                    ui.label(step.command).classes("wb-block")
                    ui.label(step.python).classes("wb-block")

    async def redraw(self) -> None:
        """Nothing to draw."""
