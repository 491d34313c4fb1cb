"""The law of an effect as a curve estimated from the runs, with the law of the library over it."""

from nicegui import ui

from edhas_jax.workbench.figure_parts import chart_figure
from edhas_jax.workbench.views.elements import Button, Quiet, dialog

HEIGHT = 380.0  # px


async def show_law_curve(page, names: list[str]) -> None:
    """Estimate the curve of the last of some effects, and show it in a dialog.

    Args:
        page: the window.
        names: the effects of the model, the last of which is drawn.
    """
    found = await page.ask("campaign.law_curve", names)
    if found is None:
        return
    effect = found["effect"].replace("_", " ")
    with dialog(page, f"{effect}: estimated curve and law of the library", "law", is_wide=True) as shown:
        ui.plotly(chart_figure(found["chart"], HEIGHT, page.dark).plain).classes("w-full")
        if found["sentence"] is not None:
            ui.label(found["sentence"])
        Quiet("The curve assumes no formula: it is fitted to the runs together with all other unknowns. Band: 95 %.")
        Button("Close", on_click=shown.close)
