"""What a search reports of a finished stage can be read again."""

import math
import types

import pytest

from edhas_jax.diagnosis.search.finished_stage import BEST, CALIBRATED, read_stages, stage_sentence
from edhas_jax.measurements.campaign import Use


def model(fit, holdout):
    return types.SimpleNamespace(rms_over_noise={Use.FIT: fit, Use.HOLDOUT: holdout}.get)


def test_the_calibrated_model_and_the_latest_best_set_are_read():
    sentences = [
        "checking the data",
        stage_sentence(CALIBRATED, model(7.98, 7.78)),
        "screening 1 of 25: coil_heating",
        stage_sentence(f"{BEST}sensor_lag on voltage", model(4.0, 3.5)),
        stage_sentence(f"{BEST}inverter_dead_time", model(1.014, 0.97)),
    ]
    expected = {"calibrated": {"fit": 7.98, "holdout": 7.78}, "+ inverter_dead_time": {"fit": 1.01, "holdout": 0.97}}
    assert read_stages(sentences) == expected


@pytest.mark.parametrize("holdout, uses", [(math.nan, ["fit"]), (0.9, ["fit", "holdout"])])
def test_without_held_out_runs_there_is_nothing_of_them(holdout, uses):
    assert list(read_stages([stage_sentence(CALIBRATED, model(2.0, holdout))])["calibrated"]) == uses
