"""The first screen in a browser, and the ways to and from it: addresses, keys, saved files, narrow and dark pages."""

import csv
import json
import os
import re

import pytest

from edhas_jax.workbench.jobs import process_start
from edhas_jax.workbench.place import Place
from tests.workbench.conftest import wait_until
from tests.workbench.test_loop import mark, tab

pytestmark = pytest.mark.filterwarnings("ignore")  # of the browser's driver
STAGES = "as given", "calibrated", "diagnosed"


def cells(page, stage):
    """The cells of a matrix by run and signal: the value, and whether the cell is marked as worse."""
    found = {}
    for button in mark(page, f"matrix-{stage}").locator("td button").all():
        run, signal, value = re.match(r"(\w+), (\w+): ([\d.]+) times", button.get_attribute("aria-label")).groups()
        found[run, signal] = float(value), "worse" in (button.get_attribute("class") or "")
    return found


def is_in_view(page, name):
    """Whether the beginning of an element is in the window."""
    box = mark(page, name).bounding_box()
    return box is not None and -5 <= box["y"] < page.viewport_size["height"] - 50


def plot_title(page, name):
    """Run and signal that stand above the first panel of a plot."""
    text = mark(page, name).locator(".annotation-text").first.text_content()
    return re.match(r"(\w+) · ([\w ]+?)\s{2,}", text.replace("\xa0", " ")).groups()


def test_matrices_staircase_worst_signal_and_a_click_on_a_cell(diagnosed_folder, workbench, look):
    page = look(workbench(diagnosed_folder).address, height=700)
    mark(page, "overlay").locator(".main-svg").first.wait_for()
    of_stages = [cells(page, stage) for stage in STAGES]
    assert not any(is_worse for _, is_worse in of_stages[0].values())
    for before, after in zip(of_stages, of_stages[1:], strict=False):
        assert all(is_worse == (after[at][0] > 1.05 * before[at][0]) for at, (_, is_worse) in after.items())
    assert of_stages[1]["run3", "current"][1]  # calibration has paid for the voltage with the current
    largest = [max(value for value, _ in stage.values()) for stage in of_stages]
    assert largest[2] < 0.15 * largest[1], "what is left is the sensor that is off, as recorded"
    file = diagnosed_folder / "workbench/diagnosed/diagnosis.json"
    errors = json.loads(file.read_text())["error"]
    shown = mark(page, "staircase").inner_text()
    for state in ("before", "calibrated", "after"):
        assert all(f"{errors[state][use]['overall']:.2f}" in shown for use in ("fit", "holdout"))
    assert plot_title(page, "overlay") == ("run3", "voltage")  # the worst of the runs not used
    assert "calibrated" in mark(page, "overlay").inner_text() and "diagnosed" in mark(page, "overlay").inner_text()

    page.evaluate("scrollTo(0, 0)")
    mark(page, "matrix-as given").get_by_role("button", name=re.compile("^run1, current")).click()
    wait_until(lambda: plot_title(page, "overlay") == ("run1", "current"), "the signal of the cell")
    wait_until(lambda: is_in_view(page, "overlay"), "the plot in view")
    assert Place.read(page.evaluate("location.hash")) == Place("Overview", "run1", "current")
    mark(page, "schematic").locator("[data-part=coil]").first.click(position={"x": 12, "y": 8})
    (where,) = (row for row in json.loads(file.read_text())["where"] if row["slot"] == "coil")
    title = f"Coil: {100.0 * where['probability']:.0f}%"
    wait_until(lambda: mark(page, "part").all_inner_texts()[:1] == [title], "the part in the view Machine")


def test_the_staircase_grows_with_the_search_that_runs(campaign_folder, workbench, look):
    jobs = campaign_folder / "workbench" / "jobs"
    jobs.mkdir(parents=True)
    record = {
        "number": 1, "title": "diagnose", "arguments": ["diagnose"], "began": 0.0, "pid": os.getpid(),
        "started": process_start(os.getpid()), "ended": None, "status": "running",
    }  # fmt: skip
    (jobs / "1.json").write_text(json.dumps(record))
    page = look(workbench(campaign_folder).address)
    mark(page, "overlay").locator(".main-svg").first.wait_for()
    assert mark(page, "staircase").count() == 0 and mark(page, "no-verdict").is_visible()
    found = ["calibrated; residual over noise 7.98 on the runs used, 7.78 on others",
             "found: inverter_dead_time; residual over noise 1.01 on the runs used, 0.97 on others"]  # fmt: skip
    for count, text in ((1, "7.78"), (2, "0.97")):
        lines = [json.dumps({"at": 1.0, "what": what}) + "\n" for what in ("checking the data", *found[:count])]
        (jobs / "1.progress").write_text("".join(lines))
        mark(page, "staircase").get_by_text(text, exact=True).wait_for()
    assert "inverter" in mark(page, "staircase").inner_text()


def test_every_run_and_signal_has_an_address_and_keys_and_back_go_there(diagnosed_folder, workbench, look):
    address = workbench(diagnosed_folder).address
    page = look(f"{address}{Place('Compare', 'run2', 'current', 'as given').address}")
    mark(page, "traces").locator(".main-svg").first.wait_for()
    assert plot_title(page, "traces") == ("run2", "current") and "as given" in mark(page, "traces").inner_text()

    def shows(*title):
        wait_until(lambda: plot_title(page, "traces") == title, f"the plot of {' '.join(title)}")

    page.locator("body").click(position={"x": 2, "y": 300})
    for key, title in (("n", ("run3", "current")), ("n", ("run1", "current")), ("p", ("run3", "current"))):
        page.keyboard.press(key)
        shows(*title)
    page.keyboard.press("Shift+S")
    wait_until(lambda: plot_title(page, "traces")[1] != "current", "another signal")
    page.go_back()
    shows("run3", "current")
    page.go_back()
    shows("run1", "current")
    page.keyboard.press("5")
    page.get_by_role("button", name="Diagnose", exact=True).wait_for()
    page.go_back()
    shows("run1", "current")
    page.reload(wait_until="commit")
    mark(page, "traces").locator(".main-svg").first.wait_for()
    shows("run1", "current")
    page.keyboard.press("?")
    mark(page, "keys").get_by_text("next and previous run").wait_for()
    page.keyboard.press("Escape")
    mark(page, "keys").wait_for(state="detached")


def test_plots_and_tables_are_saved(diagnosed_folder, workbench, look):
    page = look(workbench(diagnosed_folder).address)
    mark(page, "overlay").locator(".main-svg").first.wait_for()

    def saved(what, kind):
        page.get_by_role("button", name=f"Save {what}").click()
        with page.expect_download() as download:
            page.get_by_text(kind, exact=True).click()
        assert download.value.suggested_filename == f"{what}.{kind.lower()}"
        page.get_by_text(kind, exact=True).wait_for(state="detached")
        return download.value.path().read_bytes()

    for what in ("overlay", "matrices"):
        assert saved(what, "PNG").startswith(b"\x89PNG") and b"<svg" in saved(what, "SVG")[:1000]
    rows = list(csv.reader(saved("overlay", "CSV").decode().splitlines()))
    models = "measured", "calibrated by the diagnosis", "diagnosed"
    names = ["time [s]", *(f"{name} voltage [V]" for name in models)]
    assert rows[0] == names and len(rows) == 402
    rows = list(csv.reader(saved("matrices", "CSV").decode().splitlines()))
    shown = {(stage, *at): value for stage in STAGES for at, (value, _) in cells(page, stage).items()}
    assert {tuple(row[:3]): round(float(row[3]), 2) for row in rows[1:]} == shown


def test_a_narrow_page_shows_matrix_and_errors_and_a_dark_one_a_dark_report(diagnosed_folder, workbench, look):
    page = look(workbench(diagnosed_folder).address, width=390, dark=None)
    mark(page, "overlay").locator(".main-svg").first.wait_for()
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    for name in ("error-before", "error-calibrated", "error-diagnosed", "matrix-as given"):
        box = mark(page, name).bounding_box()
        assert box["x"] >= 0 and box["x"] + box["width"] <= 390 and is_in_view(page, name)
    tab(page, "Report")

    def paper():
        body = page.frame_locator("iframe").locator("body")
        return sum(map(int, body.evaluate("e => getComputedStyle(e).color").strip("rgb()").split(",")))

    assert paper() < 200  # dark ink
    page.get_by_role("button", name="Light or dark page").click()
    wait_until(lambda: paper() > 600, "light ink on a dark page")
