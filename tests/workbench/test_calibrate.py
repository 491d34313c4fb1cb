"""Calibrate in a browser: choices, time windows, a fit that runs, Stop, how certain the estimates are, two models."""

import contextlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

import edhas_jax as edhas
from edhas_jax.inference.fit.calibration import STOPPED
from edhas_jax.measurements.residuals import autocorrelation, white_noise_band
from edhas_jax.workbench.jobs import CANCELLED, JobList, process_start
from edhas_jax.workbench.workspace import Workspace
from tests.workbench.conftest import wait_until
from tests.workbench.test_loop import choose, mark, tab

pytestmark = pytest.mark.filterwarnings("ignore")  # of the browser's driver


@pytest.fixture(scope="session")
def calibration_of_campaign(measured_campaign, tmp_path_factory):
    """A copy of the campaign with a calibration in it, with such wide priors that two estimates are at no limit."""
    folder = Path(shutil.copytree(measured_campaign, tmp_path_factory.mktemp("calibrated") / "bench"))
    choices = folder.parent / "choices.yaml"
    choices.write_text("parameters: {coil_resistance: {prior: 0.2}, force_constant: {prior: 0.2}}\n")
    words = "fit", folder, "--choices", choices, "--out", folder / "workbench" / "calibrated"
    command = [sys.executable, "-m", "edhas_jax.commands.cli", *map(str, words)]
    subprocess.run(command, capture_output=True, check=True)
    return folder


@pytest.fixture
def calibrated_folder(calibration_of_campaign, tmp_path):
    """A copy of the folder with the calibration."""
    return Path(shutil.copytree(calibration_of_campaign, tmp_path / "bench"))


def chosen(folder):
    path = folder / "workbench" / "choices.yaml"
    return yaml.safe_load(path.read_text(encoding="utf-8")) if path.is_file() else {}


def fill(page, label, text):
    field = page.get_by_label(label, exact=True)
    field.fill(text)
    field.press("Enter")


def curve(page, name, curve_name):
    """x and y of a curve of a plot."""
    return mark(page, name).evaluate(
        "(plot, name) => { const row = plot.data.find(row => row.name === name); return [row.x, row.y] }", curve_name
    )


def test_choices_are_checked_kept_and_used_as_in_python(campaign_folder, workbench, look):
    page = look(workbench(campaign_folder).address)
    tab(page, "Calibrate")
    mark(page, "trajectory").locator(".main-svg").first.wait_for()
    assert "edhas fit" in mark(page, "fit-command").text_content()
    assert "--choices" not in mark(page, "fit-command").text_content()
    highest = page.get_by_label("max of mover damping", exact=True)
    usual = highest.get_attribute("placeholder")
    fill(page, "max of coil resistance", "9 Ω")
    problems = mark(page, "choices-problems")
    problems.get_by_text("parameters.coil_resistance.max: must lie from").wait_for()
    page.get_by_role("button", name="Calibrate", exact=True).click()
    page.get_by_text("The choices are not right yet.").wait_for()
    assert not (campaign_folder / "workbench" / "jobs").exists(), "a fit that cannot work was started"
    fill(page, "max of coil resistance", "")
    problems.get_by_text("must lie").wait_for(state="detached")

    fill(page, "prior of mover damping", "0.5")
    wait_until(lambda: highest.get_attribute("placeholder") != usual, "the limit of the wider prior")
    fill(page, "initial value of force constant", "24 N/A")
    page.get_by_label("coulomb friction is free").click()
    fill(page, "initial value of coulomb friction", "3.5 N")
    wait_until(page.get_by_label("prior of coulomb friction", exact=True).is_disabled, "no prior of a fixed parameter")
    page.get_by_label("run3 is fitted").click()
    page.get_by_label("run1 is fitted").click()
    page.get_by_label("piston position is used").click()
    fill(page, "factor on the noise of current", "2")
    fill(page, "first time of run2", "20 ms")
    more = page.get_by_label("another parameter of the machine")
    more.click()
    more.fill("coil inductance")
    page.get_by_role("option", name=re.compile("^coil inductance = ")).click()
    page.get_by_role("button", name="Free it").click()
    problems.get_by_text("needs a prior").wait_for()
    fill(page, "prior of coil inductance", "0.1")
    problems.get_by_text("needs a prior").wait_for(state="detached")
    expected = {
        "parameters": {
            "mover_damping": {"prior": "0.5"}, "force_constant": {"value": "24 N/A"},
            "coulomb_friction": {"free": False, "value": "3.5 N"}, "coil_inductance": {"prior": "0.1"},
        },
        "runs": ["run2", "run3"], "signals": {"voltage": "1", "current": "2"}, "windows": {"run2": ["20 ms", "0.2 s"]},
    }  # fmt: skip
    wait_until(lambda: chosen(campaign_folder) == expected, "the choices in the file")
    file = campaign_folder / "workbench" / "choices.yaml"
    assert f"--choices {file}" in mark(page, "fit-command").text_content()
    second = look(page.url)  # what was chosen is in the folder, and so in every window
    tab(second, "Calibrate")
    wait_until(lambda: second.get_by_label("prior of mover damping").input_value() == "0.5", "the other window")
    page.get_by_role("button", name="Calibrate", exact=True).click()
    mark(page, "job-done").wait_for()
    written = json.loads((campaign_folder / "workbench/calibrated/fit.json").read_text())
    python = mark(page, "fit-python").text_content()
    found = eval(python.partition(".save(")[0], {"edhas": edhas})
    assert {name: row["value"] for name, row in written["calibrated"].items()} == pytest.approx(found.fit.values)
    assert "coil_inductance" in written["calibrated"] and "coulomb_friction" not in written["calibrated"]
    page.get_by_role("button", name="As in the campaign").click()
    wait_until(lambda: not file.exists(), "no choices")
    mark(page, "fit-state").get_by_text("Something else was chosen after this calibration").wait_for()
    mark(page, "row-coil_inductance").wait_for(state="detached")


def test_a_time_window_is_drawn_in_the_plot(campaign_folder, workbench, look):
    page = look(workbench(campaign_folder).address)
    tab(page, "Calibrate")
    plot = mark(page, "trajectory")
    plot.locator(".main-svg").first.wait_for()
    page.get_by_text("drag to draw the time window").click()
    wait_until(lambda: plot.evaluate("plot => plot.layout.dragmode") == "select", "the other drag")
    box = plot.locator(".nsewdrag").first.bounding_box()
    first, last = (plot.evaluate(f"plot => plot._fullLayout.xaxis.p2d({share * box['width']})") for share in (0.3, 0.7))
    page.mouse.move(box["x"] + 0.3 * box["width"], box["y"] + 40)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 60, steps=4)
    page.mouse.move(box["x"] + 0.7 * box["width"], box["y"] + 60, steps=4)
    page.mouse.up()
    wait_until(lambda: "windows" in chosen(campaign_folder), "the window in the file")
    window = [float(text.removesuffix(" s")) for text in chosen(campaign_folder)["windows"]["run1"]]
    assert window == pytest.approx([first, last], abs=0.003)
    wait_until(lambda: plot.evaluate("plot => plot.layout.shapes.length") == 2, "what is left out in grey")
    field = page.get_by_label("first time of run1", exact=True)
    wait_until(lambda: field.input_value() == f"{window[0]:.5g} s", "the window in the fields")
    fill(page, "last time of run1", "150 ms")
    wait_until(lambda: plot.evaluate("plot => plot.layout.shapes[1].x0") == pytest.approx(0.15), "the typed end")
    page.get_by_role("button", name="Use all of the run").click()
    wait_until(lambda: chosen(campaign_folder) == {}, "no window")


def test_cost_and_trajectory_follow_the_fit_that_runs(campaign_folder, workbench, look):
    jobs = campaign_folder / "workbench" / "jobs"
    jobs.mkdir(parents=True)
    record = {
        "number": 1, "title": "calibrate", "arguments": ["fit"], "began": 0.0, "pid": os.getpid(),
        "started": process_start(os.getpid()), "ended": None, "status": "running",
    }  # fmt: skip
    (jobs / "1.json").write_text(json.dumps(record))
    page = look(workbench(campaign_folder).address)
    tab(page, "Calibrate")
    mark(page, "trajectory").locator(".main-svg").first.wait_for()
    rows = [{"at": 0.0, "what": "reading"}]
    # the values that are told, not those of any fit, must be the ones that are simulated
    for number, (cost, resistance) in enumerate(((3e4, 1.42), (2e4, 1.9)), 1):
        numbers = {
            "search": "rough search", "number": number, "cost": cost, "residual_over_noise": 9.0 / number,
            "values": {"coil_resistance": resistance},
        }  # fmt: skip
        rows.append({"at": 1.0, "what": f"step {number}", "numbers": numbers})
        (jobs / "1.progress").write_text("".join(json.dumps(row) + "\n" for row in rows))
        mark(page, "cost-title").get_by_text(f"rough search, step {number}: residual over noise").wait_for()
        wait_until(
            lambda number=number: f"step {number}" in mark(page, "trajectory").inner_text(), "the present values"
        )
        assert curve(page, "cost", "rough search")[1][-1] == cost
    time, voltage = (np.array(row) for row in curve(page, "trajectory", "step 2"))
    campaign = edhas.read_campaign(campaign_folder)
    after = edhas.compare(campaign, edhas.change(campaign.machine, coil_resistance=1.9)).runs[0]
    drawn = np.interp(time, after.run.time, after.model["voltage"])
    np.testing.assert_allclose(voltage, drawn, atol=0.02)  # the noise of the sensor
    given = np.array(curve(page, "trajectory", "as given")[1])
    assert np.abs(voltage - given).max() > 0.1


def test_stop_keeps_the_best_so_far(campaign_folder, workbench, look):
    page = look(workbench(campaign_folder).address)
    tab(page, "Calibrate")
    mark(page, "trajectory").locator(".main-svg").first.wait_for()
    page.get_by_role("button", name="Calibrate", exact=True).click()
    jobs, progress = JobList(Workspace(campaign_folder)), campaign_folder / "workbench" / "jobs" / "1.progress"
    wait_until(lambda: progress.is_file() and "numbers" in progress.read_text(), "the first step", every=0.005)
    watcher = jobs.running().pid
    command = Path(f"/proc/{watcher}/task/{watcher}/children").read_text().split()[0]
    os.kill(int(command), signal.SIGSTOP)  # or it may be done before the browser has clicked
    mark(page, "cancel-job").get_by_text("Stop").click()
    wait_until(lambda: "SigPnd:\t0000000000000000\nShdPnd:\t0000000000000000"
               not in Path(f"/proc/{command}/status").read_text(), "the interruption")  # fmt: skip
    os.kill(int(command), signal.SIGCONT)
    mark(page, "job-cancelled").get_by_text("was stopped").wait_for()
    mark(page, "fit-state").get_by_text("This calibration was stopped").wait_for()
    written = json.loads((campaign_folder / "workbench/calibrated/fit.json").read_text())
    assert jobs.all()[-1].status == CANCELLED and written["stopped"] and written["findings"][0] == STOPPED
    told = [json.loads(line) for line in progress.read_text().splitlines()]
    best = [row["numbers"] for row in told if "numbers" in row][-1]
    assert written["half_chi_square"] <= best["cost"]
    page.get_by_role("button", name="Begin from the estimates").click()
    free = [name for name, row in written["calibrated"].items() if "limit" not in row]
    wait_until(lambda: set(chosen(campaign_folder).get("parameters", {})) == set(free), "the initial values")


def test_correlations_region_profile_and_autocorrelation(calibrated_folder, workbench, look):
    folder = calibrated_folder
    fit = json.loads((folder / "workbench/calibrated/fit.json").read_text())
    page = look(workbench(folder).address, height=1400)
    tab(page, "Calibrate")
    mark(page, "autocorrelation").locator(".main-svg").first.wait_for()
    matrix = mark(page, "correlations").evaluate("plot => plot.data[0].z")
    assert matrix == [list(row.values()) for row in fit["correlation"].values()]
    at_limit = next(name for name, row in fit["calibrated"].items() if "limit" in row)
    assert "limit" in mark(page, f"row-{at_limit}").inner_text()
    one, other = "mover damping", "force constant"
    mark(page, "ellipse").locator(".main-svg").first.wait_for()  # of the two that are most correlated

    def pick(label, name):
        page.get_by_label(label, exact=True).click()
        page.get_by_role("option", name=name, exact=True).click()
        page.locator(".q-menu").wait_for(state="detached")

    pick("together with", at_limit.replace("_", " "))
    page.get_by_text("is at a limit, so it has no standard error").wait_for()
    pick("parameter", one)
    pick("together with", other)
    mark(page, "ellipse").locator(".main-svg").first.wait_for()
    rows = [fit["calibrated"][name.replace(" ", "_")] for name in (one, other)]
    around = np.array(curve(page, "ellipse", "95 % of both together"))
    off = [(points - row["value"]) / row["std"] for points, row in zip(around, rows, strict=True)]
    correlation = fit["correlation"]["mover_damping"]["force_constant"]
    # χ² of two at every point of the ellipse
    rise = (off[0] ** 2 - 2.0 * correlation * off[0] * off[1] + off[1] ** 2) / (1.0 - correlation**2)
    np.testing.assert_allclose(rise, 5.991, rtol=1e-6)

    page.get_by_role("button", name="Profile", exact=True).click()
    mark(page, "profile").locator(".main-svg").first.wait_for()
    x, up = (np.array(row) for row in curve(page, "profile", "all others fitted anew"))
    assert up.min() == pytest.approx(0.0, abs=0.05) and x[up.argmin()] == pytest.approx(rows[0]["value"], rel=1e-3)
    assert up[0] > 4.0 and up[-1] > 4.0
    assert "--profile mover_damping" in mark(page, "command").inner_text()
    interval = r"mover damping: [\d.]+ to [\d.]+ N·?s/m with 95 % by the profile of χ²\."
    assert re.fullmatch(interval, mark(page, "confidence-note").inner_text())

    title = mark(page, "residual-title")
    assert title.inner_text() == "Autocorrelation of the residual of voltage, run1, calibrated"
    model = edhas.compare(folder, folder / "workbench/calibrated/config.yaml").runs[0]
    lags, values = curve(page, "autocorrelation", "autocorrelation")
    np.testing.assert_allclose(values, autocorrelation(model.residuals["voltage"], len(values))[1:], atol=1e-3)
    assert lags[0] == pytest.approx(0.5)  # ms, of a record at 2 kHz
    band = mark(page, "autocorrelation").evaluate("plot => plot.layout.shapes[0].y1")
    assert band == pytest.approx(white_noise_band(model.residuals["voltage"])) == pytest.approx(1.96 / np.sqrt(401))
    choose(page, "signal", "current")
    wait_until(lambda: "residual of current" in title.inner_text(), "the other signal")


def test_any_two_models_are_overlaid_a_kept_fit_among_them(calibrated_folder, workbench, look):
    page = look(workbench(calibrated_folder).address)
    tab(page, "Calibrate")
    page.get_by_label("keep this fit as").fill("first try")
    page.get_by_role("button", name="Keep", exact=True).click()
    kept = calibrated_folder / "workbench" / "fits"
    wait_until(lambda: list(kept.glob("*/config.yaml")), "the kept fit")
    name = f"fit {next(kept.iterdir()).name}"
    page.get_by_label("keep this fit as").fill("first try")
    page.get_by_role("button", name="Keep", exact=True).click()
    page.get_by_text("is there already; choose another name").wait_for()
    page.get_by_role("button", name="Close").click()
    tab(page, "Compare")
    mark(page, "traces").locator(".main-svg").first.wait_for()
    choose(page, "over another model", "as given")
    page.get_by_text("“as given” → “calibrated”").wait_for()

    def drawn():
        with contextlib.suppress(Exception):  # while the plot is built anew
            return set(mark(page, "traces").evaluate("plot => plot.data.map(row => row.legendgroup)"))

    wait_until(lambda: drawn() == {"measured", "as given", "calibrated"}, "both models")
    cell = mark(page, "matrix").get_by_role("button", name=re.compile("^run1, voltage"))
    assert " → " in cell.inner_text()
    page.get_by_role("combobox", name="model", exact=True).click()
    page.get_by_role("option", name=name, exact=True).click()
    wait_until(lambda: drawn() == {"measured", "as given", name}, "the kept fit over the one as given")
    choose(page, "over another model", "none")
    wait_until(lambda: drawn() == {"measured", "(measured − model) / noise", name}, "one model")
