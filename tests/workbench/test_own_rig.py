"""A rig of one's own in a browser: its code, quantities without a unit, runs without a cycle, an effect beside it."""

import numpy as np
import pytest

from edhas_jax.core.trusted_code import trust
from tests.workbench.conftest import wait_until
from tests.workbench.test_calibrate import curve
from tests.workbench.test_loop import error_shown, mark, tab

CODE = '''"""A tank whose inlet saturates."""
import jax.numpy as jnp

from edhas_jax import Effect, Rig, drive, par, slot, state


class Tank(Rig):
    """level' = gain u - level / tau + what an effect adds."""

    time_step, duration = 5e-3, 12.0
    command = drive("-", "command of the valve", 0.0)
    gain: float = par(1.0, "1/s", (0.01, 100.0), "speed of the level per command")
    tau: float = par(2.0, "s", (0.1, 100.0), "time constant")
    level = state("-", "level of the oil")
    inlet = slot("valve", "1/s", "flow beyond that in proportion to the command", "command", 0.1)

    def equations(self, y, s):
        return {"level": self.inlet.apply(self.gain * s.command, s) - y.level / self.tau}


class SaturatingInlet(Effect, rig=Tank):
    """The flow through the valve saturates."""

    limit: float = par(1.0, "-", (0.1, 10.0), "command at which the flow saturates", plausible=(0.2, 5.0))

    def inlet(self, s, z):
        return s.gain * (self.limit * jnp.tanh(s.command / self.limit) - s.command)
'''
CAMPAIGN = """name: tank
rig: tank.py:Tank
drives: {command: u}
uncertain: {gain: 0.3, tau: 0.3}
signals:
  level: {column: level, unit: "-", noise: 0.01}
runs:
  - {file: run1.csv, use: fit}
"""
GAIN, TAU, LIMIT, NOISE = 1.2, 2.2, 0.7, 0.01


def write_record(path):
    """A record of the tank with its saturation, from the exact solution for a constant flow between two samples."""
    dt, n = 0.02, 600
    time = dt * np.arange(n)
    command = 1.5 * np.sin(2.0 * np.pi * 0.3 * time)
    middle = 1.5 * np.sin(2.0 * np.pi * 0.3 * (time + 0.5 * dt))
    flow, level, keep = GAIN * LIMIT * np.tanh(middle / LIMIT), np.zeros(n), np.exp(-dt / TAU)
    for k in range(n - 1):
        level[k + 1] = flow[k] * TAU + keep * (level[k] - flow[k] * TAU)
    level += NOISE * np.random.default_rng(0).standard_normal(n)
    rows = "".join(f"{t:.3f},{u:.6f},{x:.5f}\n" for t, u, x in zip(time, command, level, strict=True))
    path.write_text(f"time [s],u,level\n{rows}")


@pytest.fixture
def tank(tmp_path, monkeypatch):
    """A campaign whose rig was not allowed to run yet, and a folder of settings of its own."""
    settings, folder = tmp_path / "settings", tmp_path / "tank"
    settings.mkdir(mode=0o700)
    monkeypatch.setenv("EDHAS_CONFIG", str(settings))
    folder.mkdir()
    (folder / "tank.py").write_text(CODE)
    (folder / "campaign.yaml").write_text(CAMPAIGN)
    write_record(folder / "run1.csv")
    return folder


def titles(page, name):
    """The titles of the axes of a plot."""
    return mark(page, name).evaluate(
        "plot => Object.entries(plot.layout).filter(([k]) => /axis/.test(k)).map(([, axis]) => axis.title?.text)"
    )


def test_from_code_that_may_not_run_to_an_effect_of_ones_own(tank, workbench, look):
    page = look(workbench(tank).address)
    page.get_by_text("is Python code that was not allowed to run").first.wait_for()
    trust(tank / "tank.py")  # as `edhas trust` does in a terminal: the page follows
    mark(page, "overlay").locator(".main-svg").first.wait_for()
    assert "-" not in titles(page, "overlay"), "a number without a unit"

    tab(page, "Calibrate")
    page.get_by_role("button", name="Calibrate", exact=True).click()
    mark(page, "job-done").wait_for()
    wait_until(lambda: mark(page, "trajectory").evaluate("plot => plot.data.map(row => row.name)")
               == ["measured", "as given", "calibrated"], "the curve of the finished fit")  # fmt: skip
    x, _ = curve(page, "trajectory", "calibrated")
    ends = mark(page, "trajectory").evaluate("plot => plot._fullLayout.xaxis.range")
    assert ends == pytest.approx([x[0], x[-1]], abs=1e-6), "no space beside a record"

    tab(page, "Diagnose")
    page.get_by_role("button", name="Try your own").wait_for()
    wait_until(lambda: not page.get_by_role("button", name="Try it").is_visible(), "no effect of the library fits")
    page.get_by_label("an effect of your own").fill("tank.py:SaturatingInlet")
    page.get_by_role("button", name="Try your own").click()
    page.get_by_role("button", name="Run tank.py").click()
    card = mark(page, "card-tank.py:SaturatingInlet")
    card.get_by_text("an effect of your own, tank.py:SaturatingInlet").wait_for()
    command = mark(page, "command").inner_text()
    assert command.startswith(f"edhas add {tank} {tank}/tank.py:SaturatingInlet --out")
    card.get_by_role("button", name="Add", exact=True).click()
    calibrated, added = error_shown(page, "calibrated"), error_shown(page, "saturating_inlet")
    assert calibrated > 2.0 > 1.2 > added > 0.8
    page.set_viewport_size({"width": 390, "height": 900})
    chip, place = card.get_by_text("in the model").bounding_box(), card.bounding_box()
    assert chip["x"] + chip["width"] <= place["x"] + place["width"], "cut off on a narrow page"
    page.set_viewport_size({"width": 1280, "height": 900})

    tab(page, "Compare")
    mark(page, "traces").locator(".main-svg").first.wait_for()
    assert not page.get_by_label("driven by").is_visible(), "its drives are always those of the records"

    tab(page, "Design")
    mark(page, "cycle").locator(".main-svg").first.wait_for()
    assert mark(page, "cycle").evaluate("plot => plot.layout.xaxis.title.text") == "time, s"
