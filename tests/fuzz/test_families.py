"""Inputs whose right answer is known are answered right, refused in a sentence or remarked upon; never wrong silently.

One input of each family here; `make fuzz INPUTS=600` makes as many new ones.
"""

import random

import pytest

from tests.fuzz.families import (
    CHECK,
    CLASSES,
    FAMILIES,
    FIT,
    Input,
    campaign,
    fitted,
    judged,
    plain_csv,
    read_as,
    record,
)
from tests.fuzz.interrupts import OWN
from tests.fuzz.worker import READ, Worker


@pytest.fixture(scope="module")
def worker(tmp_path_factory):
    process = Worker({"XDG_CONFIG_HOME": str(tmp_path_factory.mktemp("home")), "MPLBACKEND": "Agg"})
    yield process
    process.stop()


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.__name__)
def test_a_family_of_inputs(family, worker, tmp_path):
    kind, sentence = judged(family(random.Random(0)), tmp_path / "input", worker)
    assert kind in CLASSES[:3], sentence


def test_a_wrong_answer_is_noticed(worker, tmp_path):
    t, u, p = record(random.Random(0))
    files = {"run.csv": plain_csv(t, u, p), "campaign.yaml": campaign()}
    assert judged(Input(files, [CHECK, [READ]], read_as(t, u, p)), tmp_path / "input", worker) == ("right", "")
    kind, sentence = judged(Input(files, [CHECK, [READ]], read_as(t, u, 1.01 * p)), tmp_path / "input", worker)
    assert kind == "silent" and sentence.startswith("pressure is off by")
    assert judged(Input(files, [CHECK, FIT], fitted), tmp_path / "input", worker) == ("right", "")


def test_a_rig_without_slots_can_be_diagnosed(worker, tmp_path):
    files = {"run.csv": plain_csv(*record(random.Random(0))), "campaign.yaml": campaign()}
    command = ["diagnose", ".", *OWN, "--out", "result", "--quiet"]
    assert judged(Input(files, [command]), tmp_path / "input", worker) == ("right", "")
