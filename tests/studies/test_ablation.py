"""The study of the parts of the diagnosis: each part exists and comes back, and answers are counted."""

import pytest

from edhas_jax.diagnosis.search import set_search
from edhas_jax.diagnosis.search.linear_model import FlooredModel
from edhas_jax.diagnosis.search.set_search import SetSearch
from edhas_jax.diagnosis.search.signatures import SignatureTable
from studies.hidden_effects.ablation import Part, file_name, table, without
from studies.hidden_effects.answers import Answer, HiddenEffect, Law, Truth, Verdict
from studies.hidden_effects.store import Record


@pytest.mark.parametrize("part", list(Part))
def test_a_part_is_left_out_as_long_as_the_context_lasts(part):
    def state():
        return [dict(vars(of)) for of in (SetSearch, SignatureTable, FlooredModel, set_search)]

    before = state()
    with without(part):
        during = state()
    assert state() == before
    assert sum(kept[n] is not now[n] for kept, now in zip(before, during, strict=True) for n in now) >= 1


def _answer(*names):
    return Answer(Verdict.MISSING_EFFECT if names else Verdict.ADEQUATE, names)


def test_answers_without_a_part_are_counted_as_changed_better_and_worse():
    spring = Truth("b", "varied", 0, (HiddenEffect("spring", ("mover",), Law.LIBRARY, {}, 100.0),))
    name = file_name(Part.EXCHANGES)
    records = [
        Record(spring, {"ours": _answer("spring"), name: _answer("spring")}),
        Record(spring, {"ours": _answer("spring"), name: _answer()}),
        Record(spring, {"ours": _answer("leak", "spring"), name: _answer("spring")}),
        Record(spring, {"ours": _answer("leak"), name: _answer("lag")}),
        Record(spring, {"ours": _answer("spring")}),  # not run without it
    ]
    lines, last = table(records, [Part.EXCHANGES])
    assert lines[-1].endswith("| 4 | 3 | 1 | 1 |")
    assert last == "cases=5 exchanges_better=1 exchanges_worse=1"
