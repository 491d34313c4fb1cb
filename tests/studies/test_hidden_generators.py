"""The generators of hidden cases: determinism, the split between tuning and judging, visible sizes, other laws."""

import numpy as np
import pytest

from studies.hidden_effects.generators.content import CONTENT
from studies.hidden_effects.generators.drawing import draw_case
from studies.hidden_effects.generators.hidden_case import Family, Split


def test_a_case_is_drawn_from_family_split_and_number_alone():
    one, again = (draw_case(Family.OTHER_LAWS, Split.TUNING, 1) for _ in range(2))
    assert one.hidden == again.hidden and one.hidden[0].law != one.hidden[0].candidate
    other = draw_case(Family.OTHER_LAWS, Split.TUNING, 2)
    for a, b in zip(one.campaign.runs, again.campaign.runs, strict=True):
        np.testing.assert_array_equal(a.signals["current"], b.signals["current"])
        assert np.abs(a.signals["current"] - other.campaign.runs[0].signals["current"][: len(a.time)]).max() > 0.1


@pytest.mark.parametrize("what", ["laws", "crumbs", "links", "benches"])
def test_tuning_and_judging_have_nothing_in_common(what):
    tuning, judging = ({item.id for item in getattr(CONTENT[split], what)} for split in Split)
    assert tuning and judging and not tuning & judging
    assert len(tuning) == len(getattr(CONTENT[Split.TUNING], what))  # every name once
    assert len(judging) == len(getattr(CONTENT[Split.JUDGING], what))
