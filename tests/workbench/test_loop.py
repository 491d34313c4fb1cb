"""The loop in a browser: from a dropped file to the report; cancel, resume, restart; design; hostile names."""

import contextlib
import json
import os
import re
import shutil
import signal
import urllib.error
import urllib.request
from pathlib import Path

import pytest

from edhas_jax.core.units import estimate_text
from edhas_jax.machine.rigs import ActuatorBench
from edhas_jax.workbench.jobs import CANCELLED, RUNNING, JobList
from edhas_jax.workbench.workspace import Workspace
from tests.workbench.conftest import wait_until

pytestmark = pytest.mark.filterwarnings("ignore")  # of the browser's driver


def tab(page, name):
    """Bring a view to the front."""
    page.get_by_role("tab", name=name).click()


def mark(page, name):
    """The element of a name."""
    return page.locator(f"[data-mark='{name}']")


def error_shown(page, name):
    """A residual over noise that stands above the views."""
    element = mark(page, f"error-{name}")
    element.wait_for()
    return float(re.search(r"[\d.]+$", element.inner_text())[0])


def choose(page, label, text):
    """Choose in a list with a label; lists that can be searched are typed into."""
    field = page.get_by_label(label)
    field.click()
    if field.get_attribute("readonly") is None:
        field.fill(text)
    page.get_by_role("option", name=text, exact=True).click()


def test_from_a_dropped_file_to_the_report(measured_campaign, tmp_path, workbench, look):
    folder = tmp_path / "mine"
    folder.mkdir()
    page = look(workbench(folder).address)
    tab(page, "Data")
    files = [str(measured_campaign / f"run{k}.csv") for k in (1, 2, 3)]
    page.locator("input[type=file]").set_input_files(files)
    cards = page.locator(".wb-card", has=page.get_by_label("frequency"))
    wait_until(lambda: cards.count() == 3, "the three files")
    choose(page, "machine", "actuator_bench")
    conditions = {"run1.csv": ("10 Hz", "3 mm"), "run2.csv": ("25 Hz", "2 mm"), "run3.csv": ("15 Hz", "2.5 mm")}
    wait_until(lambda: "rig: actuator_bench" in mark(page, "draft").inner_text(), "the other machine")
    for name, (frequency, amplitude) in conditions.items():
        card = cards.filter(has_text=name)
        card.get_by_label("frequency").fill(frequency)
        card.get_by_label("amplitude").fill(amplitude)
    cards.filter(has_text="run3.csv").get_by_text("hold out").click()
    entry = "file: run3.csv, use: holdout, frequency: 15 Hz"
    wait_until(lambda: entry in mark(page, "draft").inner_text().replace('"', ""), "the draft")
    page.get_by_role("button", name="Write campaign.yaml").click()
    wait_until(lambda: (folder / "campaign.yaml").is_file(), "campaign.yaml")
    mark(page, "check").wait_for()
    assert "3 runs, 2 signals, 1,203 samples" in mark(page, "check").inner_text()
    page.get_by_text("voltage: its noise is not stated").first.wait_for()
    text = (folder / "campaign.yaml").read_text()  # what no column tells
    text = text.replace("uncertain:", "parameters: {ramp_time: 50 ms}\nuncertain:", 1)
    (folder / "campaign.yaml").write_text(text.replace("unit: V}", "unit: V, noise: 0.02}"))
    wait_until(lambda: "3 runs, 3 signals" in mark(page, "check").inner_text(), "the check with the noise")

    tab(page, "Compare")
    mark(page, "matrix").first.wait_for()
    page.get_by_role("button", name=re.compile("^run3, voltage")).click()
    link = page.get_by_role("button", name=re.compile("^Voltage: the model is .* while current is positive"))
    link.click()
    mark(page, "traces").locator(".main-svg").first.wait_for()
    mark(page, "over").get_by_text("current of the model, A").wait_for()

    tab(page, "Calibrate")
    page.get_by_role("button", name="Calibrate", exact=True).click()
    mark(page, "job-done").wait_for()
    before, calibrated = error_shown(page, "before"), error_shown(page, "calibrated")
    found = json.loads((folder / "workbench/calibrated/fit.json").read_text())["calibrated"]["coil_resistance"]
    size = estimate_text(found["value"], found["std"], found["unit"], found.get("limit"))
    mark(page, "row-coil_resistance").get_by_text(size, exact=True).wait_for()
    tab(page, "Diagnose")
    page.get_by_role("button", name="Diagnose", exact=True).click()
    mark(page, "verdict").wait_for()
    assert "inverter_dead_time" in mark(page, "verdict").inner_text()
    card = mark(page, "card-inverter_dead_time")
    card.get_by_role("button", name="Try").click()
    mark(page, "tried-holdout").first.wait_for()

    def is_added():  # the card may be built anew while it is clicked
        button = card.get_by_role("button", name="Add", exact=True)
        with contextlib.suppress(Exception):
            if button.count():
                button.click(timeout=2000)
        page.wait_for_timeout(1000)
        return Workspace(folder).decisions().added == ("inverter_dead_time",)

    wait_until(is_added, "the effect in the model")
    after = error_shown(page, "inverter_dead_time")
    assert before > calibrated > 3.0 > 1.2 > after > 0.8

    tab(page, "Machine")
    mark(page, "schematic").locator("[data-part=coil]").first.click(position={"x": 12, "y": 8})
    wait_until(lambda: mark(page, "part").inner_text().startswith("Coil"), "the coil")
    tab(page, "Report")
    frame = page.frame_locator("iframe")
    frame.get_by_role("heading", name=re.compile("diagnosis")).first.wait_for()
    tab(page, "Steps")
    page.get_by_text(f"edhas add {folder} inverter_dead_time").first.wait_for()
    result = Workspace(folder)
    assert result.decisions().added == ("inverter_dead_time",)
    assert json.loads((folder / "workbench/diagnosed/diagnosis.json").read_text())["verdict"] == "missing_effect"


def test_cancel_resume_restart_and_a_second_window(campaign_folder, workbench, look):
    server = workbench(campaign_folder)
    page = look(server.address)
    tab(page, "Diagnose")
    page.get_by_role("button", name="Diagnose", exact=True).click()
    jobs = JobList(Workspace(campaign_folder))
    kept = campaign_folder / "workbench" / "diagnosed" / "unfinished"
    wait_until(lambda: list(kept.glob("*.npz")), "the first finished stage", every=0.02)
    command = Path(f"/proc/{jobs.running().pid}/task/{jobs.running().pid}/children").read_text().split()[0]
    os.kill(int(command), signal.SIGSTOP)  # or it may be done before the browser has clicked
    assert list(kept.glob("*.npz")), "the diagnosis was done before it could be stopped"
    button, title = mark(page, "cancel-job").element_handle(), mark(page, "job-running").inner_text()
    wait_until(lambda: mark(page, "job-running").inner_text() != title, "the next second")
    assert button.evaluate("element => element.isConnected"), "built anew, so that a slow press would be lost"
    button.click()
    wait_until(lambda: "SigPnd:\t0000000000000000\nShdPnd:\t0000000000000000"
               not in Path(f"/proc/{command}/status").read_text(), "the interruption")  # fmt: skip
    os.kill(int(command), signal.SIGCONT)
    mark(page, "job-cancelled").wait_for()
    assert jobs.all()[-1].status == CANCELLED and list(kept.glob("*.npz"))
    page.get_by_role("button", name="Resume").click()
    wait_until(lambda: jobs.running() is not None, "the resumed job")
    page.close()
    server.stop()  # in the middle: the job goes on
    second = workbench(campaign_folder)
    one, other = look(second.address), look(second.address, width=390)
    for window in (one, other):
        tab(window, "Diagnose")
        mark(window, "verdict").wait_for()
    wait_until(lambda: jobs.all()[-1].status != RUNNING, "the end of the job")
    assert "Going on from the finished fits" in jobs.output(jobs.all()[-1])
    card = mark(one, "card-inverter_dead_time")
    card.get_by_role("button", name="Reject").click()
    one.get_by_label("reason, which is remembered").fill("the inverter was replaced")
    one.get_by_role("dialog").get_by_role("button", name="Reject").click()
    mark(other, "card-inverter_dead_time").get_by_text("Rejected: the inverter was replaced").wait_for()


def test_a_slider_a_heat_map_and_the_cycle_of_a_cell(tmp_path, workbench, look):
    from edhas_jax.config.writer import dump_config
    from edhas_jax.simulation.run import Simulation

    (tmp_path / "mine.yaml").write_text(dump_config(ActuatorBench(), Simulation(duration=0.3)), encoding="utf-8")
    page = look(workbench(tmp_path / "mine.yaml").address)
    tab(page, "Design")
    mark(page, "cycle").locator(".main-svg").first.wait_for()
    slider = mark(page, "slider-frequency").bounding_box()
    page.mouse.click(slider["x"] + 0.7 * slider["width"], slider["y"] + 0.5 * slider["height"])
    wait_until(lambda: "--set frequency=" in mark(page, "command").inner_text(), "the run with the new value")
    page.get_by_role("button", name=re.compile("^Sweep")).click()
    heat = mark(page, "heat")
    heat.locator(".main-svg").first.wait_for()
    mark(page, "front").locator(".main-svg").first.wait_for()

    def cell_clicked():  # the plot may be drawn once more in between
        cells = heat.locator(".nsewdrag").first
        cells.scroll_into_view_if_needed()
        box = cells.bounding_box()
        page.mouse.click(box["x"] + 0.9 * box["width"], box["y"] + 0.1 * box["height"])
        page.wait_for_timeout(1000)
        return "--set coil_resistance=" in mark(page, "command").inner_text()

    wait_until(cell_clicked, "the cycle of the cell")


def test_names_with_markup_are_shown_as_they_are(campaign_folder, workbench, look):
    evil = '<img src=x onerror="window.hit=1"><script>window.hit=1</script>'
    path = campaign_folder / "campaign.yaml"
    shutil.copy(campaign_folder / "run1.csv", campaign_folder / "<b>run<b>.csv")
    text = path.read_text().replace("file: run1.csv", 'file: "<b>run<b>.csv"')
    path.write_text(re.sub(r"^name: .*$", f"name: '{evil}'", text, flags=re.MULTILINE))
    page = look(workbench(campaign_folder).address)
    for name in ("Compare", "Calibrate", "Diagnose", "Machine", "Report", "Steps", "Data"):
        tab(page, name)
    tab(page, "Compare")
    mark(page, "matrix").first.wait_for()
    assert page.evaluate("window.hit") is None
    assert evil in page.locator("header").inner_text()
    page.get_by_text("<b>run<b>", exact=True).first.wait_for()


def test_a_foreign_campaign_runs_no_code_until_a_click_names_the_file(campaign_folder, workbench, look):
    witness = campaign_folder / "it-ran"
    code = f"""import edhas_jax as edhas
open({str(witness)!r}, "w").close()

class Push(edhas.Effect):
    push: float = edhas.par(1.0, "N", (-100.0, 100.0), "force", plausible=(0.1, 10.0))

    def mover_force(self, s, z):
        return self.push
"""
    (campaign_folder / "push.py").write_text(code)
    page = look(workbench(campaign_folder).address)
    tab(page, "Diagnose")
    page.get_by_label("an effect of your own").fill("push.py:Push")
    page.get_by_role("button", name="Try your own").click()
    question = page.get_by_role("dialog")
    question.get_by_text("push.py is Python code").wait_for()
    assert not witness.exists()
    question.get_by_role("button", name="Run push.py").click()
    mark(page, "tried-fit").first.wait_for()
    assert witness.exists()


def test_requests_from_elsewhere_get_one_sentence(campaign_folder, workbench):
    address = workbench(campaign_folder).address
    base, token = address.split("/?token=")

    def status(path="/", **headers):
        request = urllib.request.Request(base + path, headers=headers)
        try:
            return urllib.request.urlopen(request, timeout=60).status
        except urllib.error.HTTPError as error:
            return error.code

    assert status(f"/?token={token}") == 200
    assert status() == status("/?token=wrong") == status(f"/?token={token}", Origin="http://evil.example") == 403
    assert status(f"/?token={token}", Host="evil.example") == 421
    port = base.rpartition(":")[2]
    cookie = {"Cookie": f"edhas_workbench_{port}={token}"}
    names = "../campaign.yaml", "%2e%2e/campaign.yaml", "jobs/1.json", "/etc/passwd"
    for path in (f"/results/{name}" for name in names):
        assert status(path, **cookie) == 404, path


