"""Steps: what was done, with the command and the Python line that do the same."""

import datetime

from nicegui import ui

from edhas_jax.workbench.views.elements import Block, Head, Quiet, Strong


class StepsView:
    """The list of steps, the last one on top."""

    def __init__(self, page):
        self._page = page

    async def build(self) -> None:
        """Build the view."""
        Head("What was done here")
        Quiet("Each step can be done again in a terminal, or in Python after `import edhas_jax as edhas`.")
        self._body = ui.column().classes("w-full gap-4 mt-3")
        await self.refresh()

    async def refresh(self) -> None:
        """Follow the folder."""
        self._body.clear()
        with self._body:
            for step in reversed(self._page.workspace.steps()):
                with ui.column().classes("w-full gap-1"):
                    when = datetime.datetime.fromtimestamp(step.at).strftime("%Y-%m-%d %H:%M")
                    Strong(f"{step.what} · {when}")
                    Block(step.command)
                    Block(step.python)

