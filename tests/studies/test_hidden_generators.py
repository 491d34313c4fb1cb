"""The generators of hidden cases: determinism, splits, visible sizes, disturbances, withheld effects, own machines."""

import dataclasses
import itertools
from collections import Counter

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from edhas_jax.core.structs import replace
from edhas_jax.machine.effects import (
    LIBRARY,
    CoggingForce,
    ConstantBiasForce,
    EntrainedAir,
    LugreFriction,
    ParasiticSpring,
    PistonLeakage,
)
from edhas_jax.machine.own_rig import check_rig
from edhas_jax.machine.parameters import get_parameter, set_parameters
from edhas_jax.machine.rigs import ActuatorBench, PumpBench
from edhas_jax.measurements.campaign import Channel, Use
from studies.hidden_effects.generators import drawing
from studies.hidden_effects.generators.benches import Bench, planned_runs
from studies.hidden_effects.generators.content import CONTENT, OWN_MACHINES
from studies.hidden_effects.generators.disturbances import LEFT_OVER, draw_disturbances
from studies.hidden_effects.generators.drawing import MIN_VISIBLE, draw
from studies.hidden_effects.generators.hidden_case import CaseKey, Family, Split, keys_of
from studies.hidden_effects.generators.law_table import markdown
from studies.hidden_effects.generators.laws import library_law
from studies.hidden_effects.generators.sensor_faults import draw_fault
from studies.hidden_effects.generators.similarity import MAX_SHARE, share, shares_of_similar_effects
from studies.hidden_effects.generators.sizes import draw_visible, mounted
from studies.hidden_effects.generators.visibility import VisibilityTest
from studies.synthetic_campaign import planned_campaign

DEVELOPMENT = (Split.TUNING, Split.VARIED)
BY_NUMBER = (Split.TUNING, Split.JUDGING)
OWN = [own for split in BY_NUMBER for own in OWN_MACHINES[split]]
OWN_NAMES = [f"{split.value} {name}" for split in BY_NUMBER for name in ("first", "second")]
CHANNELS = {"voltage": Channel("V", 0.02), "current": Channel("A", 0.02), "piston_position": Channel("mm", 5e-6)}
ACTUATOR = Bench(
    "short runs of an actuator", ActuatorBench, (LugreFriction,),
    {"coil_resistance": 0.02, "coulomb_friction": 0.25, "static_friction": 0.25}, CHANNELS,
    planned_runs(
        {"frequency": 1.0, "amplitude": 1e-3},
        ("fit", 0.16, 15.0, 3.5), ("fit", 0.16, 25.0, 2.0), ("holdout", 0.16, 20.0, 3.0),
    ), 4e-4, 1.0,
)  # fmt: skip
PUMP = Bench(
    "short runs of a pump", PumpBench, (LugreFriction, PistonLeakage, EntrainedAir),
    {"coil_resistance": 0.02, "load_orifice_area": 0.03}, CHANNELS | {"outlet_pressure": Channel("MPa", 1.5e3)},
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


@pytest.mark.parametrize("split", BY_NUMBER, ids=lambda split: split.value)
def test_the_cases_that_go_by_number_have_what_was_asked_for(split):
    """340 numbers are 100 cases of several effects and 80 of each other family; of each, some are on own machines."""
    keys = keys_of(split, [], 0, 340)
    assert Counter(key.family for key in keys) == {"p": 100, "w": 80, "n": 80, "s": 80}
    assert len(set(map(str, keys))) == 340
    own = [key for key in keys if key.number % drawing.OWN_MACHINE_EVERY == drawing.OWN_MACHINE_EVERY // 2]
    assert len(own) >= 20 and {key.family for key in own} == {"p", "w", "n", "s"}
    singles = keys_of(split, ["s"], 0, 340)
    assert len(singles) == 80 and {key.family for key in singles} == {"s"}


def test_sizes_of_single_effects_are_wanted_evenly_in_their_logarithm():
    singles = keys_of(Split.JUDGING, ["s"], 0, 340)
    wanted = [drawing._Draw(key, Family.SINGLES, 0, np.random.default_rng(0)).visible for key in singles]
    position = np.log(np.array(wanted) / MIN_VISIBLE) / np.log(drawing.LARGEST_VISIBLE / MIN_VISIBLE)
    counts = np.histogram(position, bins=8, range=(0.0, 1.0))[0]
    assert counts.sum() == 80 and counts.min() >= 7 and counts.max() <= 13


@pytest.mark.parametrize(
    ("family", "split"),
    [(family, Split.VARIED) for family in "dfh"] + [(family, Split.JUDGING) for family in "npsw"],
)
def test_a_case_is_drawn_from_its_key_alone(short, family, split):
    """Also from the attempt that has succeeded before."""
    number = next(k.number for k in keys_of(split, [family], 1, 40))
    key = CaseKey(family, split, number)
    one = draw(key)
    again = draw(key, one.truth.attempt)
    assert one.truth == again.truth and one.chain == again.chain and one.is_same(again.truth)
    for a, b in zip(one.campaign.runs, again.campaign.runs, strict=True):
        np.testing.assert_array_equal(a.signals["current"], b.signals["current"])
    names = {kind.id for kind in one.library}
    assert bool(one.truth.hidden) is (family != "n") or family in "df"
    for hidden in one.truth.hidden:
        assert hidden.visible > MIN_VISIBLE
        assert (hidden.name.partition(" on ")[0] in names or " on " in hidden.name) is not one.truth.withheld
    assert one.truth.withheld is (family in "hw")
    assert len(one.truth.hidden) in ((2, 3) if family == "p" else (0, 1))


@pytest.mark.parametrize("own", OWN, ids=OWN_NAMES)
def test_machines_of_ones_own_are_right_and_their_effects_are_no_others(own):
    (bench,) = own.benches
    check_rig(type(bench.machine()))
    laws = [*map(library_law, own.library), *own.laws, *own.unlisted]
    assert all(drawing._can_have(bench, law) for law in laws)
    assert not set(own.library) & set(LIBRARY)
    ids = [law.id for law in laws]
    assert len(set(ids)) == len(ids) and not set(ids) & {kind.id for kind in LIBRARY}
    for law in laws:
        assert "Source:" in law.kind.__doc__, law.id
        assert all(name in ids for name in law.kind.confused_with), law.id
    assert len(own.laws) >= 4 and len(own.unlisted) >= 4 and len(own.disturbances) >= 4


def test_machines_of_ones_own_that_judge_are_others():
    """They share no name of a machine, effect, law, disturbance or drift with those for development."""
    tuning, judging = (
        {name for own in OWN_MACHINES[split] for name in (
            type(own.benches[0].machine()).name, own.benches[0].id, *(kind.id for kind in own.library),
            *(item.id for item in (*own.laws, *own.unlisted, *own.disturbances, *own.drifts)))}
        for split in BY_NUMBER
    )  # fmt: skip
    assert tuning and judging and not tuning & judging


@pytest.mark.parametrize("number", [drawing.OWN_MACHINE_EVERY // 2, 18, 30, 42])
@pytest.mark.parametrize("split", BY_NUMBER, ids=lambda split: split.value)
def test_cases_of_machines_of_ones_own_name_effects_of_their_list(split, number):
    (key,) = keys_of(split, [], number, 1)
    case = draw(key)
    own = OWN_MACHINES[split][number // drawing.OWN_MACHINE_EVERY % 2]
    assert case.own_library == case.library and set(case.library) <= set(own.library)
    assert type(case.machine) is type(own.benches[0].machine())
    assert {h.name for h in case.truth.hidden}.isdisjoint({k.id for k in case.library}) or not case.truth.withheld
    assert all(np.isfinite(v).all() for run in case.campaign.runs for v in run.signals.values())


def test_a_drift_that_the_bench_cannot_have_is_left_out(short, monkeypatch):
    drifts = tuple(d for d in CONTENT[Split.TUNING].drifts if d.parameter in ("oil_viscosity", "force_constant"))
    assert len(drifts) == 2
    monkeypatch.setitem(drawing.CONTENT, Split.VARIED, dataclasses.replace(CONTENT[Split.VARIED], drifts=drifts))
    for number in range(3):  # the actuator has no oil
        (first, *_) = draw(CaseKey("e", Split.VARIED, number)).settings
        assert first.startswith("force constant of sessions")


@pytest.mark.parametrize("what", ["laws", "unlisted", "disturbances", "links", "drifts", "sheets", "benches"])
@pytest.mark.parametrize("split", DEVELOPMENT, ids=lambda split: split.value)
def test_what_is_for_development_and_what_judges_have_nothing_in_common(what, split):
    one, judging = ([item.id for item in getattr(CONTENT[s], what)] for s in (split, Split.JUDGING))
    assert one and judging and len({*one, *judging}) == len(one) + len(judging)


def test_a_judging_law_has_the_name_of_no_other_effect():
    """Neither of another law, listed or not, nor of an effect that holds disturbances, nor of one of the library."""
    judging = [law.id for law in (*CONTENT[Split.JUDGING].laws, *CONTENT[Split.JUDGING].unlisted)]
    others = {law.id for split in DEVELOPMENT for law in (*CONTENT[split].laws, *CONTENT[split].unlisted)}
    others |= {d.kind.id for split in Split for d in CONTENT[split].disturbances} | {kind.id for kind in LIBRARY}
    assert len({*judging}) == len(judging) and not {*judging} & others


def test_the_benches_of_the_splits_share_no_run():
    tuning, varied, judging = (
        {tuple(run.conditions.items()) for bench in CONTENT[split].benches for run in bench.runs} for split in Split
    )
    assert tuning and varied and judging and not (tuning | varied) & judging


def test_a_mechanism_with_other_laws_has_four_of_which_two_judge():
    tuning, judging = (Counter(law.mechanism for law in CONTENT[split].laws) for split in BY_NUMBER)
    mechanisms = tuning.keys() | judging.keys()
    assert mechanisms <= set(LIBRARY) and len(mechanisms) >= 30
    for mechanism in mechanisms:
        assert tuning[mechanism] >= 2 and judging[mechanism] >= 2, mechanism.id
    library = {kind.id for kind in LIBRARY}
    for split in Split:
        assert len(CONTENT[split].disturbances) >= 10
        for law in (*CONTENT[split].laws, *CONTENT[split].unlisted):
            assert "Source:" in law.kind.__doc__, law.id
            assert set(law.kind.confused_with) <= library, law.id
    for split in BY_NUMBER:
        assert markdown(split).count("\n") == 1 + sum(
            len((*content.laws, *content.unlisted)) for content in (CONTENT[split], *OWN_MACHINES[split])
        )


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


@pytest.mark.parametrize("wanted", [150.0, 5000.0])
def test_a_law_or_a_fault_of_a_sensor_can_be_as_visible_as_wanted(wanted):
    test, rng = visibility(ACTUATOR), np.random.default_rng(0)
    found = [draw_visible(test, library_law(CoggingForce), rng, wanted=wanted) for _ in range(4)]
    faults = [draw_fault(test, rng, wanted, MIN_VISIBLE) for _ in range(8)]
    sizes = [d.visible for d in found if d] + [hidden.visible for f in faults if f for hidden in f[1]]
    assert len(sizes) > 6 and all(wanted / 1.3 < size < 1.3 * wanted for size in sizes)
    assert len({f[1][0].name.partition(" on ")[0] for f in faults if f}) > 1


def test_disturbances_of_a_pump_are_not_put_into_an_actuator_alone():
    test, rng = visibility(ACTUATOR), np.random.default_rng(1)
    for split in Split:
        kinds = CONTENT[split].disturbances
        drawn = [found for found in (draw_disturbances(test, kinds, rng) for _ in range(3)) if found is not None]
        of_a_pump = {c.id for c in kinds if not set(c.kind.slots) <= set(test.machine.slots)}
        assert drawn and of_a_pump and all(not of_a_pump & set(found.sizes) for found in drawn)


BENCHES = [(PUMP, CONTENT[split].disturbances) for split in Split]
BENCHES += [(own.benches[0], own.disturbances) for own in OWN]


@pytest.mark.parametrize(("bench", "kinds"), BENCHES, ids=[*(split.value for split in Split), *OWN_NAMES])
def test_disturbances_leave_the_stated_share_of_the_noise_and_each_of_them_acts(bench, kinds):
    test = visibility(bench)
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


def test_an_effect_that_another_one_equals_is_not_withheld():
    test = visibility(ACTUATOR)
    found = draw_visible(test, library_law(ConstantBiasForce), np.random.default_rng(1))
    shares = shares_of_similar_effects(test, found.law, found.change, LIBRARY)
    assert shares and set(shares) <= set(ConstantBiasForce.confused_with) and max(shares.values()) < MAX_SHARE
    imitation = dataclasses.replace(found.law, kind=ParasiticSpring)  # easily confused with the cogging force
    change = test.change(mounted(test.machine, library_law(CoggingForce),
                                 {"cogging_amplitude": 1.0, "cogging_pitch": 20e-3, "cogging_phase": 0.0}))  # fmt: skip
    assert shares_of_similar_effects(test, imitation, change, LIBRARY)["cogging_force"] > MAX_SHARE
    assert share(test, found.change, -3.0 * found.change) == pytest.approx(1.0)


def test_small_campaigns_are_small(short):
    for number in range(3):
        case = draw(CaseKey("f", Split.VARIED, number))
        assert 2 <= len(case.campaign.runs) <= 4 and 2 <= len(case.campaign.channels) <= 3
        assert case.campaign.runs_for(Use.FIT)
        assert max(run.time[-1] for run in case.campaign.runs) <= 0.16


def test_nulls_are_wrong_in_everything_but_effects(short):
    """Over some nulls every difficulty occurs, and no law of a mechanism is mounted."""
    cases = [draw(key) for key in itertools.islice(iter(keys_of(Split.JUDGING, ["n"], 1, 80)), 5)]
    laws = {law.kind for law in (*CONTENT[Split.JUDGING].laws, *CONTENT[Split.JUDGING].unlisted)}
    for case in cases:
        mounted_kinds = {type(effect) for effect in case.machine.effects}
        assert not case.truth.hidden and not case.truth.withheld and not mounted_kinds & laws
        assert case.truth.right_answers == {"nothing"}
    assert any(c.chain for c in cases) and any(c.settings for c in cases) and any(c.disturbances for c in cases)
