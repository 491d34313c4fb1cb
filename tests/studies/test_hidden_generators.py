"""The generators of hidden cases: determinism, splits, visible sizes, disturbances, withheld effects, folders."""

import dataclasses
import json

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from edhas_jax.core.structs import replace
from edhas_jax.machine.effects import LIBRARY, CoggingForce, ConstantBiasForce, LugreFriction
from edhas_jax.machine.parameters import get_parameter, set_parameters
from edhas_jax.machine.rigs import ActuatorBench, PumpBench
from edhas_jax.measurements.campaign import Channel, Use
from edhas_jax.measurements.campaign_reader import read_campaign
from edhas_jax.measurements.synthetic_campaign import planned_campaign
from studies.hidden_effects import cases
from studies.hidden_effects.drawing import draw
from studies.hidden_effects.generators import drawing
from studies.hidden_effects.generators.benches import Bench, planned_runs
from studies.hidden_effects.generators.content import CONTENT
from studies.hidden_effects.generators.disturbances import LEFT_OVER, draw_disturbances
from studies.hidden_effects.generators.drawing import draw_case
from studies.hidden_effects.generators.folders import write_case
from studies.hidden_effects.generators.hidden_case import Family, Split
from studies.hidden_effects.generators.law_table import markdown
from studies.hidden_effects.generators.laws import Law, library_law
from studies.hidden_effects.generators.similarity import MAX_SHARE, share, shares_of_generic_terms
from studies.hidden_effects.generators.sizes import MIN_VISIBLE, draw_visible, mounted
from studies.hidden_effects.generators.tuning.unlisted_laws import ForceRipple
from studies.hidden_effects.generators.visibility import VisibilityTest
from studies.hidden_effects.published import file_of, read_kept
from tests.support import ROOT

DEVELOPMENT = tuple(split for split in Split if split is not Split.JUDGING)
# which must not share anything; practice shares all but its laws with tuning, varied its unlisted laws
COMPARED = [*((split, Split.JUDGING) for split in DEVELOPMENT), (Split.TUNING, Split.EARLIER),
            (Split.VARIED, Split.EARLIER)]  # fmt: skip
CHANNELS = {"voltage": Channel("V", 0.02), "current": Channel("A", 0.02), "piston_position": Channel("mm", 5e-6)}
ACTUATOR = Bench(
    "short runs of an actuator", ActuatorBench, (LugreFriction,), {"coil_resistance": 0.02, "coulomb_friction": 0.25},
    CHANNELS,
    planned_runs(
        {"frequency": 1.0, "amplitude": 1e-3},
        ("fit", 0.16, 15.0, 3.5), ("fit", 0.16, 25.0, 2.0), ("holdout", 0.16, 20.0, 3.0),
    ), 4e-4, 1.0,
)  # fmt: skip
PUMP = Bench(
    "short runs of a pump", PumpBench, cases.MODEL_EFFECTS, {"coil_resistance": 0.02, "load_orifice_area": 0.03},
    CHANNELS | {"outlet_pressure": Channel("MPa", 1.5e3)},
    planned_runs(
        {"frequency": 1.0, "amplitude": 1e-3, "load_orifice_area": 1e-6},
        ("fit", 0.16, 20.0, 3.5, 3.0), ("fit", 0.16, 30.0, 3.0, 1.0),
    ), 4e-4, 1.0,
)  # fmt: skip


@pytest.fixture
def short(monkeypatch):
    """One short bench of an actuator in each split."""
    for split, content in CONTENT.items():
        monkeypatch.setitem(drawing.CONTENT, split, dataclasses.replace(content, benches=(ACTUATOR,)))


def visibility(bench: Bench) -> VisibilityTest:
    machine = bench.machine()
    plan = planned_campaign("bench", machine, bench.uncertain, bench.channels, bench.runs, bench.interval)
    return VisibilityTest(plan, machine, bench.settings)


def test_a_case_is_drawn_from_family_split_and_number_alone(short):
    one, again = (draw_case(Family.SENSOR_CHAINS, Split.TUNING, 1) for _ in range(2))
    other = draw_case(Family.SENSOR_CHAINS, Split.JUDGING, 1)
    assert one.hidden == again.hidden and one.chain == again.chain and one.chain != other.chain
    for a, b, c in zip(one.campaign.runs, again.campaign.runs, other.campaign.runs, strict=True):
        np.testing.assert_array_equal(a.signals["current"], b.signals["current"])
        assert np.nanmax(np.abs(a.signals["current"] - c.signals["current"])) > 0.1


def test_a_drift_that_the_bench_cannot_have_is_drawn_again(short, monkeypatch):
    oil = tuple(d for d in CONTENT[Split.JUDGING].drifts if d.parameter == "oil_viscosity")
    content = dataclasses.replace(CONTENT[Split.JUDGING], drifts=oil)
    monkeypatch.setitem(drawing.CONTENT, Split.JUDGING, content)
    with pytest.raises(RuntimeError, match="nothing visible"):  # none of the drifts acts on a bench without oil
        draw_case(Family.SETTINGS, Split.JUDGING, 0)


@pytest.mark.parametrize("what", ["laws", "unlisted", "disturbances", "links", "drifts", "sheets", "benches"])
@pytest.mark.parametrize("splits", COMPARED, ids=lambda splits: "_".join(split.value for split in splits))
def test_what_is_for_development_and_what_judges_have_nothing_in_common(what, splits):
    one, judging = ([item.id for item in getattr(CONTENT[split], what)] for split in splits)
    assert one and judging and len({*one, *judging}) == len(one) + len(judging)


def test_a_judging_law_has_the_name_of_no_other_effect():
    """Neither of another law, listed or not, nor of an effect that holds disturbances, nor of one of the library."""
    judging = [law.id for law in (*CONTENT[Split.JUDGING].laws, *CONTENT[Split.JUDGING].unlisted)]
    others = {law.id for split in DEVELOPMENT for law in (*CONTENT[split].laws, *CONTENT[split].unlisted)}
    others |= {d.kind.id for split in Split for d in CONTENT[split].disturbances} | {kind.id for kind in LIBRARY}
    assert len({*judging}) == len(judging) and not {*judging} & others


@pytest.mark.parametrize("splits", COMPARED, ids=lambda splits: "_".join(split.value for split in splits))
def test_the_benches_of_the_splits_share_no_run(splits):
    one, judging = (
        {tuple(run.conditions.items()) for bench in CONTENT[split].benches for run in bench.runs} for split in splits
    )
    assert one and judging and not one & judging


def test_every_mechanism_has_three_other_laws_of_which_two_judge():
    of_split = {split: [law.mechanism for law in CONTENT[split].laws] for split in Split}
    for mechanism in LIBRARY:
        tuning, earlier, judging = (
            of_split[split].count(mechanism) for split in (Split.TUNING, Split.EARLIER, Split.JUDGING)
        )
        assert tuning >= 1 and judging >= 2 and tuning + judging >= 3, mechanism.id
        assert earlier >= 2, mechanism.id
    for split in Split:
        assert len(CONTENT[split].disturbances) >= 10
        for law in (*CONTENT[split].laws, *CONTENT[split].unlisted):
            assert "Source:" in law.kind.__doc__, law.id


def test_what_parameters_and_the_usual_errors_of_a_bench_change_is_not_visible():
    """A deviation of one standard deviation costs at most 1; a tenth of it a hundredth. The change itself is more."""
    test = visibility(ACTUATOR)
    resistance = float(get_parameter(test.machine, "coil_resistance"))
    warm = set_parameters(test.machine, {"coil_resistance": 1.02 * resistance})
    time = [run.time for run in test.runs]

    def moved(r, by, *names):
        run = test.before[r]
        return run | {n: CubicSpline(time[r], run[n])(time[r] - by) for n in names}

    late = [test.before[0], moved(1, 20e-6, *CHANNELS)]
    shifted = [moved(r, 2e-6, "voltage") for r in range(2)]
    gain = [run | {"current": 1.003 * run["current"]} for run in test.before]
    offset = [run | {"piston_position": run["piston_position"] + 6e-6} for run in test.before]
    for change, cost in (
        (test.change(warm), 1.0), (test.change_to(gain), 1.0), (test.change_to(offset), 1.0),
        (test.change_to(late), 0.1), (test.change_to(shifted), 0.1),
    ):  # fmt: skip
        assert 0.0 < test.all.visible(change) < min(1.3 * cost, 0.7 * (change @ change))


def test_the_visible_part_is_the_smallest_sum_of_squares():
    """Against a least squares solution of the stacked problem, for a change that parameters explain in part."""
    test = visibility(ACTUATOR)
    change = test.change(mounted(test.machine, library_law(CoggingForce), {"cogging_amplitude": 1.0}))
    columns = test.parameters.columns
    stacked = np.concatenate([columns, np.eye(columns.shape[1])])
    wanted = np.concatenate([change, np.zeros(columns.shape[1])])
    remainder = wanted - stacked @ np.linalg.lstsq(stacked, wanted, rcond=None)[0]
    assert test.parameters.visible(change) == pytest.approx(remainder @ remainder, rel=1e-9)
    assert test.all.visible(change) < test.parameters.visible(change) < change @ change


def test_a_large_change_of_a_known_parameter_is_not_visible_after_a_fit():
    """A linear remainder of a change by a parameter itself is an error of the linear prediction, not a mechanism."""
    test = visibility(ACTUATOR)
    name, spread = "coulomb_friction", ACTUATOR.uncertain["coulomb_friction"]
    value = float(get_parameter(test.machine, name)) * float(np.exp(-3.0 * spread))
    machine = set_parameters(test.machine, {name: value})
    change = test.change(machine)
    assert test.all.visible(change) > 3.0 * 9.0  # the three standard deviations themselves cost 9
    assert test.visible_after_fit(change) < 1.1 * 9.0
    law = mounted(test.machine, library_law(CoggingForce), {"cogging_amplitude": 1.0})
    seen = test.change(law)
    assert test.visible_after_fit(seen) == pytest.approx(test.all.visible(seen), rel=0.2)


def test_sizes_are_drawn_from_what_can_just_be_seen_on():
    test, law = visibility(ACTUATOR), library_law(CoggingForce)
    drawn = [draw_visible(test, law, np.random.default_rng(k)) for k in range(12)]
    visible = np.array([d.visible for d in drawn])
    assert (visible > MIN_VISIBLE).all() and visible.min() < 400.0 and visible.max() > 2000.0
    change = test.change(mounted(test.machine, law, drawn[0].values))
    assert test.visible_after_fit(change) == pytest.approx(drawn[0].visible, rel=1e-9)
    for p in law.free_parameters:
        assert all(p.plausible[0] <= d.values[p.name] <= p.plausible[1] for d in drawn)


@pytest.mark.parametrize("split", Split)
def test_disturbances_of_a_pump_are_not_put_into_an_actuator_alone(split):
    test, rng = visibility(ACTUATOR), np.random.default_rng(1)
    kinds = CONTENT[split].disturbances
    drawn = [found for found in (draw_disturbances(test, kinds, rng) for _ in range(3)) if found is not None]
    of_a_pump = {c.id for c in kinds if not set(c.kind.slots) <= set(test.machine.slots)}
    assert drawn and of_a_pump and all(not of_a_pump & set(found.sizes) for found in drawn)


@pytest.mark.parametrize("split", Split)
def test_disturbances_leave_the_stated_share_of_the_noise_and_each_of_them_acts(split):
    test = visibility(PUMP)
    kinds = CONTENT[split].disturbances
    for kind in kinds:
        machine = replace(test.machine, effects=(*test.machine.effects, *(k() for k in {c.kind for c in kinds})))
        effects = [replace(e, **{kind.size: kind.typical}) if type(e) is kind.kind else e for e in machine.effects]
        change = test.change(replace(machine, effects=tuple(effects)))
        assert test.parameters.visible(change) > 1e-3, kind.id
    drawn = draw_disturbances(test, kinds, np.random.default_rng(0))
    assert 0.9 * LEFT_OVER[0] < drawn.left_over < 1.1 * LEFT_OVER[1] and len(drawn.sizes) >= 3
    # the remainder after the parameters are fitted, by another way
    columns = np.concatenate([test.parameters.columns, np.eye(test.parameters.columns.shape[1])])
    wanted = np.concatenate([drawn.change, np.zeros(columns.shape[1])])
    remainder = wanted - columns @ np.linalg.lstsq(columns, wanted, rcond=None)[0]
    assert np.sqrt(remainder @ remainder / len(drawn.change)) == pytest.approx(drawn.left_over, rel=1e-6)


def test_an_effect_that_a_generic_term_equals_is_not_withheld():
    test = visibility(ACTUATOR)
    bias, ripple = library_law(ConstantBiasForce), Law(None, ForceRipple)
    found = draw_visible(test, bias, np.random.default_rng(1))
    shares = shares_of_generic_terms(test, bias, found.change)
    assert shares["mover_force_constant"] > 0.98 and max(shares.values()) > MAX_SHARE
    found = draw_visible(test, ripple, np.random.default_rng(1))
    assert max(shares_of_generic_terms(test, ripple, found.change).values()) < MAX_SHARE
    assert share(test, found.change, -3.0 * found.change) == pytest.approx(1.0)


def test_a_case_that_is_written_can_be_read(short, tmp_path):
    case = draw_case(Family.SENSOR_CHAINS, Split.JUDGING, 1)
    runs = list(case.campaign.runs)
    gap = runs[0].signals["current"].copy()
    gap[5:9] = np.nan
    runs[0] = dataclasses.replace(runs[0], signals=runs[0].signals | {"current": gap})
    case = dataclasses.replace(case, campaign=dataclasses.replace(case.campaign, runs=tuple(runs)))
    truth = json.loads(write_case(case, tmp_path / "case").read_text(encoding="utf-8"))
    assert truth["number"] == 1 and truth["chain"] == list(case.chain)
    read = read_campaign(tmp_path / "case")
    assert {r.sentence for r in read.remarks} == {"current: 4 missing samples up to line 10; left out"}
    for written, found in zip(runs, read.runs, strict=True):
        assert found.conditions == pytest.approx(written.conditions) and found.use is written.use
        for name, values in written.signals.items():
            np.testing.assert_allclose(found.signals[name], values, rtol=1e-5, atol=1e-9)
    assert {n: c.noise for n, c in read.channels.items()} == pytest.approx(
        {n: c.noise for n, c in case.campaign.channels.items()}, rel=1e-5
    )


def test_small_campaigns_are_small(short):
    for number in range(3):
        case = draw_case(Family.SMALL_CAMPAIGNS, Split.TUNING, number)
        assert 2 <= len(case.campaign.runs) <= 4 and 2 <= len(case.campaign.channels) <= 3
        assert case.campaign.runs_for(Use.FIT)
        assert max(run.time[-1] for run in case.campaign.runs) <= 0.16


def test_the_cases_of_the_first_family_are_those_that_were_published():
    """Their hidden effects and parameters, which the published rates belong to."""
    case = draw_case(Family.LIBRARY_LAWS, Split.TUNING, 2)
    old = cases.draw_case(2)
    assert [h.candidate for h in case.hidden] == ["eddy_drag"]
    assert case.hidden[0].values == old.hidden[0].values == pytest.approx(EDDY_DRAG_OF_CASE_2, rel=1e-12)
    np.testing.assert_allclose(case.campaign.runs[0].signals["current"][:4], FIRST_CURRENTS_OF_CASE_2, atol=1e-4)
    judging = draw_case(Family.LIBRARY_LAWS, Split.JUDGING, 1)
    assert judging.campaign.name == f"hidden{cases.FIRST_TEST_CASE + 1}" == "hidden40001"
    earlier = draw_case(Family.LIBRARY_LAWS, Split.EARLIER, 1)
    assert earlier.campaign.name == f"hidden{cases.FIRST_EARLIER_CASE + 1}" == "hidden11001"


@pytest.mark.parametrize("name", ["a30000", "c00418", "d00415", "f00423"])
def test_cases_of_the_earlier_judging_set_are_those_that_were_answered(name):
    """What is hidden, its size, and what else differs are what the kept answers of commit a73dad3 belong to."""
    (kept,) = (case for key, case in read_kept(file_of(Split.EARLIER)).items() if str(key) == name)
    drawn, stored = draw(kept.key).truth, kept.record.truth
    assert (drawn.description, drawn.withheld) == (stored.description, stored.withheld)
    assert [(h.name, h.law) for h in drawn.hidden] == [(h.name, h.law) for h in stored.hidden] != []
    for one, other in zip(drawn.hidden, stored.hidden, strict=True):
        assert one.visible == pytest.approx(other.visible, rel=0.01)
        assert one.values == pytest.approx(other.values, rel=1e-4)


def test_the_page_of_laws_is_the_table_of_the_generators():
    page = (ROOT / "docs" / "hidden_laws.md").read_text(encoding="utf-8")
    assert page.endswith("\n\n" + markdown() + "\n")


EDDY_DRAG_OF_CASE_2 = {"eddy_coefficient": 10.381834595344278, "eddy_velocity": 0.2958035822167992}
FIRST_CURRENTS_OF_CASE_2 = [0.11317212, -0.03198343, -0.00956769, -0.01257468]
