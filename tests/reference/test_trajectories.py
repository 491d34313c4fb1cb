"""Agreement with the trajectories of an independent solver, at the default step."""

import pytest

from tests.support.reference import DATA, EXCEPTIONS, cases, differences, mean_flow_error, rms, trajectory

NRMSE, MEAN_FLOW = 5e-3, 1e-3


@pytest.mark.parametrize("name", cases())
def test_every_signal_is_within_half_a_percent(name, run):
    time = trajectory(name)["time"]
    for signal, difference in differences(name, run(name)).items():
        exempt = EXCEPTIONS.get((name, signal))
        assert rms(difference if exempt is None else difference[time < exempt.event]) <= NRMSE, signal


@pytest.mark.parametrize("name", [n for n in cases() if "outlet_flow" in trajectory(n)])
def test_mean_flow_is_within_a_tenth_of_a_percent(name, run):
    assert abs(mean_flow_error(name, run(name))) <= MEAN_FLOW


@pytest.mark.parametrize(("name", "signal"), EXCEPTIONS)
def test_an_exception_is_bounded_and_still_needed(name, signal, run):
    exempt = EXCEPTIONS[name, signal]
    difference = differences(name, run(name))[signal]
    later = trajectory(name)["time"] >= exempt.event
    assert rms(difference) <= exempt.whole
    assert rms(difference[later]) > 10.0 * rms(difference[~later]), "no exception any more: strike it off the list"


def test_every_trajectory_has_its_file():
    assert {f.stem for f in DATA.glob("*.parquet")} == set(cases())
    assert len(cases()) == 17
