"""The mapper of the view Data in a browser: what a record says is offered, and nothing is written unasked."""

import numpy as np

from tests.workbench.conftest import wait_until
from tests.workbench.test_loop import choose, mark, tab


def write_record(path, frequency, end="\n", name="x [mm]"):
    """A record of a sine with noise."""
    rng, time = np.random.default_rng(0), 0.5 * np.arange(1200)
    position = 2.5 * np.sin(2e-3 * np.pi * frequency * time) + rng.normal(0.0, 0.01, len(time))
    current = 1.5 * np.cos(2e-3 * np.pi * frequency * time) + rng.normal(0.0, 0.02, len(time))
    lines = [f"t [ms],{name},i [A]"]
    lines += [f"{t:.1f},{x:.4f},{i:.4f}" for t, x, i in zip(time, position, current, strict=True)]
    path.write_text("\n".join(lines) + end)


def test_what_the_record_says_is_offered_and_written_only_after_a_click(tmp_path, workbench, look):
    records, folder = tmp_path / "records", tmp_path / "mine"
    records.mkdir()
    folder.mkdir()
    write_record(records / "run1.csv", 12.0, end="")
    write_record(records / "run2.csv", 20.0)
    page = look(workbench(folder).address)
    tab(page, "Data")
    page.locator("input[type=file]").set_input_files([str(records / f"run{k}.csv") for k in (1, 2)])
    cards = page.locator(".wb-card", has=page.get_by_label("frequency"))
    wait_until(lambda: cards.count() == 2, "the two files")
    choose(page, "machine", "actuator_bench")
    wait_until(lambda: "rig: actuator_bench" in mark(page, "draft").inner_text(), "the other machine")
    first, second = (cards.filter(has_text=f"run{k}.csv") for k in (1, 2))
    first.get_by_text("The record says 12 Hz and 2.5 mm, as read from x.").wait_for()
    second.get_by_text("The record says 20 Hz and 2.5 mm, as read from x.").wait_for()
    assert first.get_by_text("the last line has no line end").count() == 1
    for field in first.locator("input").all():
        assert not field.input_value() and not field.get_attribute("placeholder"), "nothing looks filled in"
    write = page.get_by_role("button", name="Write campaign.yaml")
    assert write.is_disabled() and "frequency" not in mark(page, "draft").inner_text()
    page.get_by_text("run1.csv was driven by a set point that no column holds: write its frequency and").wait_for()
    first.get_by_role("button", name="use for run1.csv").click()
    wait_until(
        lambda: "frequency: 12 Hz, amplitude: 2.5 mm" in mark(page, "draft").inner_text().replace('"', ""), "the entry"
    )
    wait_until(lambda: first.get_by_text("The record says").count() == 0, "the end of the offer")
    assert first.get_by_label("frequency").input_value() == "12 Hz" and write.is_disabled()
    second.get_by_label("amplitude").fill("2.4 mm")  # what is written already stays
    second.get_by_role("button", name="use for run2.csv").click()
    wait_until(lambda: "frequency: 20 Hz" in mark(page, "draft").inner_text().replace('"', ""), "the second entry")
    assert "amplitude: 2.4 mm" in mark(page, "draft").inner_text().replace('"', "")
    wait_until(write.is_enabled, "the button")
    write.click()
    mark(page, "check").wait_for()
    assert "2 runs, 2 signals, 2,400 samples" in mark(page, "check").inner_text()
    noise = page.locator("table", has=page.get_by_text("stated", exact=True)).locator("tr")
    cells = [cell.strip() for cell in noise.filter(has_text="piston position").locator("td").all_inner_texts()]
    assert cells[1] == "–" and cells[2] == cells[3] != "–", "no noise is stated"
    notes = page.locator("li", has_text="the last line has no line end")
    assert notes.count() == 1 and notes.get_by_text("note", exact=True).count() == 1
