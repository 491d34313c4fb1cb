"""Which command runs a file is told by its sections."""

import pytest

from edhas_jax.config.file_kind import command_of
from edhas_jax.config.templates import TASKS, task_template
from tests.support import CONFIGS, ROOT

COMMANDS = {
    "actuator": "simulate", "controller_antsmc": "simulate", "paper": "simulate", "paper_calibrated": "simulate",
    "paper_calibrated_step": "simulate", "paper_step": "simulate", "sensitivity": "sensitivity", "size_pump": "size",
    "size_robust": "size", "sweep_clearance": "sweep", "sweep_pumps": "sweep",
}  # fmt: skip


def test_every_documented_file_is_run_by_its_command():
    found = {path.stem: command_of(path.read_text(encoding="utf-8")) for path in CONFIGS.glob("*.yaml")}
    assert found == COMMANDS
    assert {kind: command_of(task_template(kind, "x")) for kind in TASKS} == {kind: kind for kind in TASKS}


@pytest.mark.parametrize(
    "text",
    [
        (ROOT / "studies/demo/campaign/campaign.yaml").read_text(encoding="utf-8"),
        "parameters: {coil_resistance: {free: false}}\nsignals: {current: 2}\n",  # choices for a fit
        "place: mover_friction\nnodes: [0, 1]\nvalues: [0, 1]\n",  # a law
        "# sweep: none\nnotes:\n  rig: pump_bench\n  objective: none\n", "", "- a\n- b\n",
    ],
)  # fmt: skip
def test_other_files_are_run_by_none_of_them(text):
    assert command_of(text) is None
