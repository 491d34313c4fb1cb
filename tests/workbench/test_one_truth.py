"""The page says what command, report and JSON say, before and after an effect is added; nothing stale stays unsaid."""

import json
import re

import pytest

import edhas_jax as edhas
from edhas_jax.commands.cli import main
from edhas_jax.core import html_page
from edhas_jax.measurements.replay import Replay
from edhas_jax.workbench.standing import sizes_text
from edhas_jax.workbench.workspace import Workspace
from tests.workbench.conftest import wait_until
from tests.workbench.test_loop import choose, mark, tab

pytestmark = pytest.mark.filterwarnings("ignore")  # of the browser's driver
SIGNALS = "voltage", "current", "piston_position"
PLAIN, CORRECTED = "residual over noise", "residual over noise with the bench corrected"


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


def shown(page, name):
    """Residual over noise by run and signal, as a matrix of the page says it to a screen reader."""
    labels = mark(page, name).get_by_role("button").evaluate_all("all => all.map(one => one.ariaLabel)")
    found = {}
    for label in filter(None, labels):
        run, signal, value = re.fullmatch(r"(\w+), (\w+): ([\d.]+) times the noise.*", label).groups()
        found.setdefault(run, {})[signal] = value
    return found


def rounded(matrix):
    """A matrix as it is shown."""
    return {run: {name: f"{value:.2f}" for name, value in row.items()} for run, row in matrix.items()}


def choose_model(page, name):
    """Compare another model."""
    page.get_by_role("combobox", name="model", exact=True).click()
    page.get_by_role("option", name=name, exact=True).click()


def cells(matrix):
    """The cells of a matrix as they are drawn."""
    return [f"{value:.2f}" if value < 10.0 else f"{value:.0f}" for row in matrix.values() for value in row.values()]


def printed_tables(text):
    """The tables of residual over noise, a row for each run, in the printed output of a command."""
    rows = re.findall(r"^ (run\d) +([\d.]+) +([\d.]+) +([\d.]+) *$", text, re.MULTILINE)
    tables = [dict((run, list(values)) for run, *values in rows[k : k + 3]) for k in range(0, len(rows), 3)]
    return [{run: dict(zip(SIGNALS, values, strict=True)) for run, values in table.items()} for table in tables]


@pytest.mark.parametrize(
    "stage, file, state",
    [("diagnosed", "config.yaml", "after"), ("calibrated by the diagnosis", "config_calibrated.yaml", "calibrated")],
)
def test_errors_as_recorded_and_with_the_bench_corrected_are_the_same_in_page_command_files_and_python(
    diagnosed_folder, workbench, look, tmp_path, capsys, stage, file, state
):
    made, out = diagnosed_folder / "workbench/diagnosed", tmp_path / "compared"
    data = json.loads((made / "diagnosis.json").read_text())
    (gain,) = (row for row in data["bench"] if row["kind"] == "gain")
    assert gain["name"] == "voltage" and 0.003 < gain["value"] < 0.011, "the sensor that is off"
    stated = data if state == "after" else json.loads((made / "config_calibrated.json").read_text())
    errors = data["error"][state]["holdout"]
    assert stated["error_by_run"]["run3"] == pytest.approx({name: errors[name] for name in SIGNALS}), "held out alone"

    found = edhas.compare(diagnosed_folder, made / file)
    plain, corrected = found.rms_over_noise(), found.bench_corrected
    assert corrected == stated["error_by_run"] and found.matrices() == {PLAIN: plain, CORRECTED: corrected}
    assert plain["run3"]["voltage"] > 1.5 * corrected["run3"]["voltage"]
    picture = found.plot()
    panels = [axes for axes in picture.axes if axes.get_title(loc="left")]
    drawn = [sorted(text.get_text() for text in axes.texts) for axes in panels]
    assert [axes.get_title(loc="left") for axes in panels] == [PLAIN, CORRECTED]
    assert drawn == [sorted(cells(matrix)) for matrix in (plain, corrected)]
    assert html_page.image(picture, PLAIN) in found.report()
    assert main(["compare", str(diagnosed_folder), "--model", str(made / file), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert CORRECTED in " ".join(said.split())
    assert printed_tables(said) == [rounded(plain), rounded(corrected)]
    saved = edhas.open_result(out)
    tables = [part for part in saved.summary().parts if hasattr(part, "records")]
    assert [table.title for table in tables] == [PLAIN, CORRECTED]
    for table, matrix in zip(tables, (plain, corrected), strict=True):
        assert {row["run"]: {name: row[name] for name in SIGNALS} for row in table.records} == matrix
    figures = saved.table("figures").set_index(["run", "signal"])["residual_over_noise_with_the_bench_corrected"]
    assert figures.to_dict() == pytest.approx({(run, n): v for run, row in corrected.items() for n, v in row.items()})

    page = look(workbench(diagnosed_folder).address)
    tab(page, "Compare")
    choose_model(page, stage)
    mark(page, "command").get_by_text(file).wait_for()
    mark(page, "bench-corrected").wait_for()
    wait_until(lambda: shown(page, "bench-corrected") == rounded(corrected), "the errors with the bench corrected")
    assert shown(page, "as-recorded") == rounded(plain)
    assert page.get_by_text(CORRECTED.capitalize(), exact=True).count() == 1
    choose(page, "driven by", "measured voltage")
    mark(page, "bench-corrected").wait_for(state="detached")
    assert edhas.compare(diagnosed_folder, made / file, replay=Replay.VOLTAGE).bench_corrected == {}


def test_size_errors_and_a_probable_nothing_are_the_same_in_page_command_files_and_python(
    diagnosed_folder, workbench, look, tmp_path, capsys
):
    names, out = ["inverter_dead_time", "coil_heating"], tmp_path / "added"
    assert main(["add", str(diagnosed_folder), *names, "--out", str(out)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    needless = "The model without coil_heating is as good: residual over noise "
    sentence = re.search(re.escape(needless) + r".*? on the held-out runs\.", said)[0]
    data = json.loads((out / "result.json").read_text())
    found = edhas.add(diagnosed_folder, names)
    assert [model.needs_no_effect for model in found.models] == ["", "", sentence]
    assert [row["needs_no_effect"] for row in data["models"]] == ["", "", sentence]
    for row, model in zip(data["models"], found.models, strict=True):
        assert row["error"] == pytest.approx(model.as_json()["error"])
    compared = edhas.compare(diagnosed_folder, out / "config.yaml")
    assert compared.bench_corrected == data["error_by_run"] == data["models"][-1]["error_by_run"]

    page = look(workbench(diagnosed_folder).address)
    tab(page, "Diagnose")
    for name, row in zip(names, data["models"][1:], strict=True):
        card = mark(page, f"card-{name}")
        if name == "coil_heating":  # no suspect of this diagnosis
            field = page.get_by_label("any effect of the library")
            field.fill("coil heating")
            page.wait_for_timeout(500)  # until the list is filtered: its entries move
            page.get_by_role("option", name="coil heating", exact=True).click()
            page.get_by_role("button", name="Try it").click()
        else:
            card.get_by_role("button", name="Add", exact=True).click()
        card.locator("[data-mark=tried-holdout]").wait_for()
        text = card.inner_text()
        assert f"→ {row['error']['fit']:.2f}" in text and f"→ {row['error']['holdout']:.2f}" in text
        assert sizes_text({n: v for n, v in row["parameters"].items() if n.startswith(name)}).replace("_", " ") in text
    assert mark(page, "tried-needless").inner_text() == sentence
    tried = json.loads((diagnosed_folder / "workbench/tried/inverter_dead_time+coil_heating.json").read_text())
    assert tried["needs_no_effect"] == sentence
    tab(page, "Compare")
    choose_model(page, "with inverter_dead_time+coil_heating")
    mark(page, "bench-corrected").wait_for()
    wait_until(lambda: shown(page, "bench-corrected") == rounded(data["error_by_run"]), "the errors of that model")


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
