"""How long the workbench takes to answer in a browser, and pictures of its views.

    python benchmarks/workbench.py [--small] [--pictures FOLDER] [--million]

Chromium opens the workbench on the campaign of the demonstration, every run of it twice: eight runs, five signals; with
`--small` on three short runs of an actuator whose inverter has a dead time. All times are taken in the page, from the
click to the changed picture, after one run of the same kind. With `--pictures` every view is drawn in two widths, light
and dark; with `--million` a record of a million samples is opened.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from edhas_jax.core import structs  # noqa: E402
from edhas_jax.machine.effects import InverterDeadTime  # noqa: E402
from edhas_jax.measurements.instruments import Instruments  # noqa: E402
from edhas_jax.measurements.sensor_models import SensorGain  # noqa: E402
from studies.campaign_writer import write_campaign  # noqa: E402
from tests.support.synthetic_campaign import bench, empty_campaign, measured  # noqa: E402

ROOT = Path(__file__).resolve().parents[1]
PATIENCE = 1800e3  # ms
CAMPAIGNS = "campaigns"  # the folder of the campaign, as pictures show it
VIEWS = "Overview", "Data", "Compare", "Calibrate", "Diagnose", "Machine", "Report", "Design", "Steps"
EFFECT, SECOND_EFFECT = "inverter_dead_time", "coil_heating"
WIDTHS = 1280, 390
COLOURS = 256  # of a picture, which is a third as large then and looks the same
# until Plotly has drawn once more, in ms
ZOOM = """async ([low, high]) => {
  const plot = document.querySelector('[data-mark=traces]');
  const began = performance.now();
  const drawn = new Promise(done => plot.once('plotly_afterplot', done));
  plot.querySelector('.main-svg');
  const { Plotly } = await import('nicegui-plotly');
  await Plotly.relayout(plot, {'xaxis.range[0]': low, 'xaxis.range[1]': high});
  await drawn;
  return performance.now() - began;
}"""


def main() -> None:
    """Run the benchmark and print its table, then its headline figures as `key=value` pairs."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--pictures", type=Path, help="folder of the pictures")
    parser.add_argument("--small", action="store_true", help="three runs of an actuator in place of eight of a pump")
    parser.add_argument("--million", action="store_true", help="also open a record of a million samples")
    options = parser.parse_args()
    from playwright.sync_api import sync_playwright

    times = Times()
    with tempfile.TemporaryDirectory() as temporary, sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        folder = Path(temporary) / CAMPAIGNS / "bench"
        (three_runs if options.small else eight_runs)(folder)
        server, address = serve(folder)
        try:
            measure(browser, address, folder, times)
            if options.pictures is not None:
                draw(browser, address, options.pictures)
        finally:
            server.terminate()
            server.wait()
        if options.million:
            folder = Path(temporary) / CAMPAIGNS / "long"
            million_samples(folder)
            server, address = serve(folder)
            try:
                measure_million(browser, address, times)
            finally:
                server.terminate()
                server.wait()
    print(" ".join(f"{key}={seconds:.3g}" for key, seconds in times.found.items()))


def three_runs(folder: Path) -> None:
    """A campaign of an actuator bench: its inverter has a dead time, its sensor of the voltage is 1 % off."""
    truth = structs.replace(bench(), effects=(*bench().effects, InverterDeadTime(dead_time_voltage=0.8)))
    folder.parent.mkdir(parents=True)
    sensors = Instruments({"voltage": (SensorGain(gain=1.01),)})
    write_campaign(measured(empty_campaign(lengths=(401, 401, 401)), truth, sensors), folder)


def eight_runs(folder: Path) -> None:
    """The campaign of the demonstration with each of its four runs twice."""
    shutil.copytree(ROOT / "studies" / "demo" / "campaign", folder)
    path = folder / "campaign.yaml"
    lines = path.read_text(encoding="utf-8").splitlines()
    for line in [line for line in lines if "file:" in line]:
        name = re.search(r"file: (\w+)\.csv", line)[1]
        shutil.copy(folder / f"{name}.csv", folder / f"{name}_again.csv")
        lines.append(line.replace(f"{name}.csv", f"{name}_again.csv"))
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")


def million_samples(folder: Path) -> None:
    """A campaign of one run with a million samples of a slow sine, from an actuator bench at rest for most of it."""
    folder.mkdir(parents=True)
    time_axis = np.arange(1_000_000) * 1e-4
    rng = np.random.default_rng(0)
    position = 1e-3 * np.sin(2 * np.pi * 2.0 * time_axis) + rng.normal(0.0, 5e-6, len(time_axis))
    table = np.stack([time_axis, 1e3 * position], axis=1)
    np.savetxt(folder / "run1.csv", table, "%.7g", ",", header="time [s],piston_position [mm]", comments="")
    text = """name: long
rig: actuator_bench
uncertain: {mover_damping: 0.25}
signals:
  piston_position: {unit: mm, noise: 0.005}
runs:
  - {file: run1.csv, use: fit, frequency: 2 Hz, amplitude: 1 mm}
"""
    (folder / "campaign.yaml").write_text(text, encoding="utf-8")


def serve(folder: Path) -> tuple[subprocess.Popen, str]:
    """Start a workbench above the folder of the campaigns, so that pictures show a short path; process and address."""
    home, environment = folder.parents[1], os.environ | {"PYTHONPATH": str(ROOT)}
    named = str(folder.relative_to(home))
    command = [sys.executable, "-m", "edhas_jax.commands.cli", "workbench", named, "--no-browser"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=home, env=environment)
    while (found := re.search(r"http://\S+", line := process.stdout.readline())) is None:
        assert line, "the workbench has ended"
    return process, found[0]


def window(browser, address: str, width: int = 1280, dark: bool = False):
    """A new window on the workbench."""
    scheme = "dark" if dark else "light"
    page = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme).new_page()
    page.set_default_timeout(PATIENCE)
    page.goto(address, wait_until="commit")
    return page


class Times:
    """The times that have been taken, by the keys of the last line."""

    def __init__(self):
        self.found: dict[str, float] = {}

    def row(self, key: str, what: str, seconds: float) -> None:
        """Print one time and keep it."""
        self.found[key] = seconds
        print(f"{what:70}{seconds:8.3f} s", flush=True)


def drawn(page, plot: str = "overlay") -> None:
    """Wait until measured and modelled signals are drawn, in the overview or in another plot."""
    page.locator(f"[data-mark={plot}] .main-svg").first.wait_for()


def open_compare(page) -> None:
    """Bring the view Compare to the front."""
    page.get_by_role("tab", name="Compare").click()
    drawn(page, "traces")


def measure(browser, address: str, folder: Path, times: Times) -> None:
    """Times of the campaign of eight runs; what is left behind is calibrated, diagnosed and has one effect added."""
    page = window(browser, address)
    drawn(page)
    other = window(browser, address)
    drawn(other)
    began = time.perf_counter()
    other.reload(wait_until="commit")
    drawn(other)
    times.row("open_s", "open the campaign", time.perf_counter() - began)
    open_compare(other)
    spans = [other.evaluate(ZOOM, [0.01 * k, 0.01 * k + 0.05]) for k in range(6)]
    times.row("zoom_s", "zoom", 1e-3 * float(np.median(spans[1:])))
    other.context.close()
    page.get_by_role("tab", name="Calibrate").click()
    page.get_by_role("button", name="Calibrate", exact=True).click()
    page.locator("[data-mark=job-done]").wait_for()
    open_compare(page)
    began = time.perf_counter()
    page.get_by_label("model", exact=True).click()
    page.get_by_role("option", name="calibrated", exact=True).click()
    page.locator("[data-mark=command]").get_by_text("--model").wait_for()
    drawn(page, "traces")
    times.row("compare_s", "compare another model", time.perf_counter() - began)
    page.get_by_role("tab", name="Diagnose").click()
    for key, name, what in (
        ("first_try_s", EFFECT, "the first try"), ("try_s", SECOND_EFFECT, "another try"),
    ):  # fmt: skip
        field = page.get_by_label("any effect of the library")
        field.fill(name.replace("_", " "))
        page.wait_for_timeout(500)  # until the list is filtered: its entries move
        page.get_by_role("option", name=name.replace("_", " "), exact=True).click()
        began = time.perf_counter()
        page.get_by_role("button", name="Try it").click()
        page.locator(f"[data-mark='card-{name}'] [data-mark=tried-holdout]").wait_for()
        times.row(key, what, time.perf_counter() - began)
    page.locator(f"[data-mark='card-{EFFECT}']").get_by_role("button", name="Add").click()
    page.get_by_role("button", name="Diagnose", exact=True).click()
    page.locator("[data-mark=verdict]").wait_for()
    jobs = folder / "workbench" / "jobs"
    while any('"running"' in path.read_text(encoding="utf-8") for path in jobs.glob("*.json")):
        time.sleep(0.2)  # the verdict is there before the pictures of the report
    page.get_by_role("tab", name="Design").click()
    page.locator("[data-mark=cycle] .main-svg").first.wait_for()
    for k in range(4):
        command = page.locator("[data-mark=command]").inner_text()
        began = time.perf_counter()
        box = page.locator("[data-mark=slider-frequency]").bounding_box()
        page.mouse.click(box["x"] + (0.2 + 0.15 * k) * box["width"], box["y"] + 0.5 * box["height"])
        while page.locator("[data-mark=command]").inner_text() == command:
            time.sleep(0.01)
        if k == 3:
            times.row("slider_s", "slider to picture", time.perf_counter() - began)
    page.get_by_role("button", name=re.compile("^Sweep")).click()
    page.locator("[data-mark=heat] .main-svg").first.wait_for()
    page.context.close()
    assert (folder / "workbench" / "diagnosed" / "diagnosis.json").is_file()


def measure_million(browser, address: str, times: Times) -> None:
    """Opening and zooming of a long record."""
    began = time.perf_counter()
    page = window(browser, address)
    drawn(page)
    took = time.perf_counter() - began
    times.row("open_million_s", "open a record of a million samples: reading, check and simulation", took)
    open_compare(page)
    spans = [page.evaluate(ZOOM, [10.0 * k, 10.0 * k + 1.0]) for k in range(6)]
    times.row("zoom_million_s", "zoom in a record of a million samples", 1e-3 * float(np.median(spans[1:])))
    page.context.close()


def draw(browser, address: str, folder: Path) -> None:
    """Pictures of every view: workbench_view_width.png, with _dark."""
    folder.mkdir(parents=True, exist_ok=True)
    for width in WIDTHS:
        for dark in (False, True):
            page = window(browser, address, width, dark)
            drawn(page)
            for view in VIEWS:
                page.get_by_role("tab", name=view).click()
                if view == "Design":
                    page.locator("[data-mark=cycle] .main-svg").first.wait_for()
                if view == "Compare":  # a model that deviates
                    page.get_by_label("model", exact=True).click()
                    page.get_by_role("option", name="calibrated by the diagnosis", exact=True).click()
                    page.locator("[data-mark=bench-corrected]").wait_for()
                page.wait_for_timeout(3000)
                height = page.evaluate("document.documentElement.scrollHeight")
                page.set_viewport_size({"width": width, "height": max(900, height)})
                page.wait_for_timeout(1000)
                name = f"workbench_{view.lower()}_{width}{'_dark' if dark else ''}.png"
                page.screenshot(path=str(folder / name))
                picture = Image.open(folder / name).convert("RGB").quantize(COLOURS, Image.Quantize.FASTOCTREE)
                picture.save(folder / name, optimize=True)
                page.set_viewport_size({"width": width, "height": 900})
            page.context.close()


if __name__ == "__main__":
    main()
