"""A campaign with a hidden effect, a workbench on it, and a browser that looks at it."""

import os
import re
import shutil
import subprocess
import sys
import time
import types
from pathlib import Path

import pytest

from edhas_jax.core import structs
from edhas_jax.machine.effects import InverterDeadTime
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.sensor_models import SensorGain
from studies.campaign_writer import write_campaign
from tests.support import ROOT
from tests.support.synthetic_campaign import bench, empty_campaign, measured

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
DEAD_TIME = 0.8  # V, of the inverter of the bench; the model has none
PATIENCE = float(os.environ.get("PATIENCE", 1200.0))  # s, for a machine that is busy with other things
HIDDEN_PLOT = "Resize must be passed a displayed plot"  # Plotly's error where the page changes while it draws a plot
OWN = re.compile(r"(https?|wss?)://(127\.0\.0\.1|localhost)[:/]|data:|blob:|about:")


@pytest.fixture(scope="session")
def measured_campaign(tmp_path_factory):
    """The folder of a campaign of a bench: its inverter has a dead time, its sensor of the voltage is 1 % off."""
    truth = structs.replace(bench(), effects=(*bench().effects, InverterDeadTime(dead_time_voltage=DEAD_TIME)))
    folder = tmp_path_factory.mktemp("measured") / "bench"
    sensors = Instruments({"voltage": (SensorGain(gain=1.01),)})
    write_campaign(measured(empty_campaign(lengths=(401, 401, 401)), truth, sensors), folder)
    return folder


@pytest.fixture
def campaign_folder(measured_campaign, tmp_path):
    """A copy of that folder."""
    return Path(shutil.copytree(measured_campaign, tmp_path / "bench"))


@pytest.fixture(scope="session")
def diagnosis_of_campaign(measured_campaign, tmp_path_factory):
    """A copy of that folder with a diagnosis in it, and what the command has printed."""
    folder = Path(shutil.copytree(measured_campaign, tmp_path_factory.mktemp("diagnosed") / "bench"))
    words = "diagnose", folder, "--out", folder / "workbench" / "diagnosed"
    command = [sys.executable, "-m", "edhas_jax.commands.cli", *map(str, words)]
    return folder, subprocess.run(command, capture_output=True, text=True, check=True).stdout


@pytest.fixture
def diagnosed_folder(diagnosis_of_campaign, tmp_path):
    """A copy of the folder with the diagnosis."""
    return Path(shutil.copytree(diagnosis_of_campaign[0], tmp_path / "bench"))


@pytest.fixture
def workbench():
    """`workbench(folder, *options)` serves it; the result has `address`, `stop()`. All are stopped at the end."""
    started = []

    def start(folder, *options):
        environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"}
        command = [sys.executable, "-m", "edhas_jax.commands.cli", "workbench", str(folder), "--no-browser", *options]
        streams = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
        process = subprocess.Popen(command, text=True, env=environment, **streams)
        started.append(process)
        printed = ""
        while (found := re.search(r"http://\S+", printed)) is None:
            line = process.stdout.readline()
            assert line, f"the workbench has ended:\n{printed}"
            printed += line

        def stop():
            process.terminate()
            process.wait(PATIENCE)

        return types.SimpleNamespace(address=found[0], stop=stop, process=process)

    yield start
    for process in started:
        if process.poll() is None:
            process.kill()
        process.wait(PATIENCE)
        process.stdout.close()


@pytest.fixture(scope="module")
def browser():
    """Chromium; tests that need it are skipped with a sentence where there is none.

    For one file each: the event loop of its driver runs until then, and other files have one of their own.
    """
    playwright = pytest.importorskip("playwright.sync_api", reason="no playwright: pip install playwright")
    pytest.importorskip("nicegui", reason="no nicegui: pip install 'edhas_jax[workbench]'")
    if CHROMIUM is None:
        pytest.skip("no Chromium here: apt-get install chromium")
    with playwright.sync_playwright() as driver:
        found = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield found
        found.close()


@pytest.fixture
def look(browser):
    """`look(address)` opens a window; at the end no console may hold an error, and no request may have left."""
    complaints, elsewhere, contexts = [], [], []

    def note(message):
        if message.type == "error":
            complaints.append(f"{message.text} {message.location}")

    def open_window(address, width=1280, height=900, dark=False):
        # None: that of the browser, so that frames may have another one than the window
        scheme = {True: "dark", False: "light", None: "null"}[dark]
        context = browser.new_context(viewport={"width": width, "height": height}, color_scheme=scheme)
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(1e3 * PATIENCE)
        page.on("console", note)
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: elsewhere.append(request.url) if not OWN.match(request.url) else None)
        page.on("websocket", lambda socket: elsewhere.append(socket.url) if not OWN.match(socket.url) else None)
        page.goto(address, wait_until="commit")
        return page

    open_window.complaints = complaints
    yield open_window
    for context in contexts:
        context.close()
    assert not elsewhere, "requests that left this machine"
    assert not [text for text in complaints if HIDDEN_PLOT not in text], "errors in the console"


def wait_until(true, what, seconds=PATIENCE, every=0.2):
    """Wait until something is true."""
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, f"{what} did not happen within {seconds:.0f} s"
        time.sleep(every)
