"""The page says what command, report and JSON say, before and after an effect is added; nothing stale stays unsaid."""

import json
import re

import pytest

from edhas_jax.workbench.workspace import Workspace
from tests.workbench.conftest import wait_until
from tests.workbench.test_loop import mark, tab

pytestmark = pytest.mark.filterwarnings("ignore")  # of the browser's driver


def fill_of(page, part):
    """The colour of a part of the machine."""
    return mark(page, "schematic").locator(f"[data-part={part}]").first.evaluate(
        "element => getComputedStyle(element.querySelector('rect') ?? element).fill"
    )


def test_one_verdict_in_page_command_report_and_json_and_all_of_the_page_follows_an_added_effect(
    diagnosis_of_campaign, diagnosed_folder, workbench, look
):
    folder, printed = diagnosed_folder, diagnosis_of_campaign[1]
    data = json.loads((folder / "workbench/diagnosed/diagnosis.json").read_text())
    said, plain = data["conclusions"], " ".join(printed.split())
    assert data["effects"] == ["inverter_dead_time"] and said[0].endswith("is missing.")
    report = (folder / "workbench/diagnosed/report.html").read_text()
    for sentence in said:
        assert sentence in plain and sentence in report
    page = look(workbench(folder).address)
    mark(page, "verdict").wait_for()
    assert mark(page, "verdict").inner_text().splitlines() == said
    tab(page, "Diagnose")
    wait_until(lambda: mark(page, "verdict").inner_text().splitlines() == said[:1], "the verdict in one sentence")
    errors = [data["error"][state]["holdout"]["overall"] for state in ("before", "calibrated", "after")]
    for name, value in zip(("before", "calibrated", "diagnosed"), errors, strict=True):
        assert mark(page, f"error-{name}").inner_text().endswith(f"{value:.2f}")
    found = {row["effect"]: row for row in data["candidates"]}["inverter_dead_time"]
    card = mark(page, "card-inverter_dead_time")
    text = card.inner_text()
    assert f"missing, probability {found['probability']:.2f}" in text and f"evidence: {found['evidence']}" in text
    assert found["evidence"].startswith(("clear (", "strong (", "overwhelming ("))
    assert "grey" not in card.get_attribute("class")
    for row in data["candidates"]:
        name = " on ".join(filter(None, (row["effect"], row.get("signal"))))
        is_grey = "wb-grey" in mark(page, f"card-{name}").get_attribute("class")
        assert is_grey == (row["outcome"] == "tried")
    tab(page, "Machine")
    mark(page, "schematic").locator("[data-part=coil]").first.wait_for()
    red, fine = fill_of(page, "coil"), fill_of(page, "mover")
    assert red != fine

    tab(page, "Diagnose")
    card.get_by_role("button", name="Add", exact=True).click()
    mark(page, "error-inverter_dead_time").wait_for()
    size = re.search(r"dead time voltage (\d+\.\d+ ± \d\.\d+ V)", card.inner_text())[1]
    wait_until(lambda: "is in the model" in mark(page, "verdict").inner_text(), "the verdict with the effect")
    now = mark(page, "verdict").inner_text()
    assert now.startswith(f"inverter_dead_time (dead_time_voltage {size}) is in the model. Nothing else is missing")
    assert "is missing." not in now and "fine" in mark(page, "verdict").get_attribute("class")
    assert mark(page, "error-diagnosed").count() == 0
    tab(page, "Machine")
    wait_until(lambda: fill_of(page, "coil") == fill_of(page, "mover") == fine, "the colour of the coil")
    assert mark(page, "command").inner_text().startswith("edhas add ")
    tab(page, "Compare")
    wait_until(lambda: mark(page, "command").inner_text().startswith("edhas compare "), "the command of this view")
    mark(page, "traces").get_by_text("(measured − model) / noise").first.wait_for()
    tab(page, "Data")
    page.get_by_role("cell", name="5 µm").first.wait_for()
    assert mark(page, "command").inner_text() == ""

    file = folder / "campaign.yaml"
    file.write_text(file.read_text().replace("frequency: 10 Hz", "frequency: 10.01 Hz"))
    changed = mark(page, "changed")
    for sentence in ("The diagnosis was made before campaign.yaml changed", "The model with inverter_dead_time was"):
        changed.get_by_text(sentence).wait_for()
    tab(page, "Diagnose")
    card.get_by_role("button", name="Try again").click()
    changed.get_by_text("The model with inverter_dead_time was fitted").wait_for(state="detached")
    assert "The diagnosis was made before campaign.yaml changed: diagnose again." in changed.inner_text()


def test_a_campaign_that_changes_while_a_job_runs_is_said(campaign_folder, workbench, look):
    page = look(workbench(campaign_folder).address)
    tab(page, "Calibrate")
    page.get_by_role("button", name="Calibrate", exact=True).click()
    mark(page, "job-running").wait_for()
    file = Workspace(campaign_folder).campaign_file
    text = file.read_text()
    file.write_text(text.replace("frequency: 10 Hz", "frequency: 10.01 Hz"))
    mark(page, "job-changed").get_by_text("campaign.yaml changed after this has begun").wait_for()
    mark(page, "job-done").wait_for()
    sentence = "The calibration was made before campaign.yaml changed: calibrate again."
    mark(page, "changed").get_by_text(sentence).wait_for()
    file.write_text(text)
    mark(page, "changed").wait_for(state="hidden")


@pytest.mark.parametrize("again", [False, True])
def test_a_page_whose_workbench_has_ended_says_so(campaign_folder, workbench, look, again):
    server = workbench(campaign_folder)
    page = look(server.address)
    mark(page, "matrix").first.wait_for()
    server.stop()
    if again:  # on the same port, with another token
        workbench(campaign_folder, "--port", re.search(r":(\d+)/", server.address)[1])
    note = mark(page, "ended")
    note.wait_for()
    assert f"edhas workbench {campaign_folder}" in note.inner_text()
    asked = []
    page.on("request", lambda request: asked.append(request.url))
    page.wait_for_timeout(8000)
    assert not asked, "it goes on trying"
    look.complaints.clear()  # of connections that were refused
