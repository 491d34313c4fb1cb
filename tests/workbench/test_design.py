"""The view Design in a browser: task files of the folder, models with an effect that was tried."""

import shutil

from edhas_jax.config.writer import dump_config
from edhas_jax.core import structs
from edhas_jax.machine.effects import InverterDeadTime
from edhas_jax.machine.rigs import ActuatorBench
from edhas_jax.simulation.run import Simulation
from tests.support import CONFIGS
from tests.workbench.conftest import wait_until
from tests.workbench.test_loop import choose, mark, tab

TASKS = {"size_pump.yaml": "size", "sensitivity.yaml": "sensitivity", "sweep_clearance.yaml": "sweep"}


def test_tasks_are_found_and_a_model_with_an_effect_can_be_chosen(tmp_path, workbench, look):
    machine, simulation = ActuatorBench(), Simulation(duration=0.3)
    (tmp_path / "mine.yaml").write_text(dump_config(machine, simulation), encoding="utf-8")
    tried = tmp_path / "workbench" / "tried"
    tried.mkdir(parents=True)
    machine = structs.replace(machine, effects=(InverterDeadTime(),))
    (tried / "inverter_dead_time.yaml").write_text(dump_config(machine, simulation), encoding="utf-8")
    for name in TASKS:
        shutil.copy(CONFIGS / name, tmp_path)
    page = look(workbench(tmp_path / "mine.yaml").address)
    tab(page, "Design")
    mark(page, "cycle").locator(".main-svg").first.wait_for()
    for name, command in TASKS.items():
        row = page.locator(".row", has=page.get_by_text(name, exact=True))
        assert row.get_by_role("button", name=f"edhas {command}", exact=True).count() == 1
    assert page.get_by_role("button", name="edhas simulate").count() == 0
    choose(page, "machine", "with inverter_dead_time")
    more = page.get_by_label("add a slider for")
    more.click()
    more.fill("dead time voltage")
    page.get_by_role("option", name="dead time voltage", exact=True).click()
    slider = mark(page, "slider-dead_time_voltage").bounding_box()
    page.mouse.move(slider["x"] + 0.2 * slider["width"], slider["y"] + 0.5 * slider["height"])
    page.mouse.down()
    places = []
    for share in (0.3, 0.4, 0.5, 0.6, 0.7, 0.8):  # while cycles are drawn, the slider stays below the mouse
        page.mouse.move(slider["x"] + share * slider["width"], slider["y"] + 0.5 * slider["height"])
        page.wait_for_timeout(200)
        thumb = mark(page, "slider-dead_time_voltage").locator(".q-slider__thumb").bounding_box()
        places.append((thumb["x"] + 0.5 * thumb["width"] - slider["x"]) / slider["width"] - share)
    page.mouse.up()
    assert max(map(abs, places)) < 0.06, places
    wait_until(lambda: "--set dead_time_voltage=" in mark(page, "command").inner_text(), "the run with the new value")
    assert "tried/inverter_dead_time.yaml" in mark(page, "command").inner_text()
