"""The verdict, above every view: its first sentence, and all of it in the overview."""

from typing import Any

from nicegui import ui

from edhas_jax.workbench.standing import Standing
from edhas_jax.workbench.views.elements import Quiet

NONE_YET = "A diagnosis has not been made yet: it says what is missing, where, and how certain that is."


class Verdict:
    """The band with the verdict.

    Args:
        on_click: called when a sentence is clicked.
    """

    def __init__(self, on_click):
        self._on_click, self._shown = on_click, None
        self._body = ui.column().classes("w-full wb-band gap-1")

    def show(self, now: Standing, is_whole: bool, is_shown: bool) -> None:
        """Show the verdict, if it has changed.

        Args:
            now: where the model stands.
            is_whole: whether all sentences are shown.
            is_shown: whether there is something to judge, in the view in front.
        """
        self._body.set_visibility(is_shown and (is_whole or bool(now.verdict)))
        said: Any = now.verdict, now.before, now.is_fine, is_whole
        if said == self._shown:
            return
        self._shown = said
        self._body.clear()
        with self._body:
            if not now.verdict:
                Quiet(NONE_YET).props("data-mark=no-verdict")
                return
            with ui.column().classes("gap-0 wb-verdict" + (" fine" if now.is_fine else "")).props("data-mark=verdict"):
                for sentence in now.verdict if is_whole else now.verdict[:1]:
                    button = ui.element("button").classes("wb-said").props("type=button")
                    button.on("click", self._on_click)
                    with button:
                        ui.label(sentence)
            if now.before and is_whole:
                earlier = ui.expansion("what the diagnosis said of the model before").classes("w-full wb-quiet")
                with earlier.props("dense data-mark=verdict-before"):
                    for sentence in now.before:
                        ui.label(sentence)
