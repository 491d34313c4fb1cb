"""The law of an effect as a curve estimated from the runs, with the law of the library over it."""

from nicegui import ui

from edhas_jax.workbench.figure_parts import chart_figure

HEIGHT = 380.0  # px


async def show_law_curve(page, names: list[str]) -> None:
    """Estimate the curve of the last of some effects, and show it in a dialog.

    Args:
        page: the window.
        names: the effects of the model, the last of which is drawn.
    """
    found = await page.ask("campaign.law_curve", names, page.session.allowed)
    if found is None:
        return
    effect = found["effect"].replace("_", " ")
    with page.floor, ui.dialog() as dialog, ui.card().classes("wb-problems").props("data-mark=law"):
        ui.label(f"{effect}: estimated curve and law of the library").classes("font-semibold")
        ui.plotly(chart_figure(found["chart"], HEIGHT, page.dark).plain).classes("w-full")
        if found["sentence"] is not None:
            ui.label(found["sentence"])
        ui.label("The curve assumes no formula: it is fitted to the runs together with all other unknowns. "
                 "Band: 95 %.").classes("wb-quiet")  # fmt: skip
        ui.button("Close", on_click=dialog.close).props("flat no-caps")
    dialog.on("hide", dialog.delete)
    dialog.open()
