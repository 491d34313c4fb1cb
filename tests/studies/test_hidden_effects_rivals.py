"""The rival methods of the benchmark of hidden effects, on constructed residuals and features."""

import dataclasses
import types

import numpy as np
import pytest

from studies.hidden_effects.answers import NOTHING, UNKNOWN, Verdict
from studies.hidden_effects.naming import answer_of_names, credible_set, unknown_where_unexplained
from studies.hidden_effects.rivals.bic_refits import schwarz_weights
from studies.hidden_effects.rivals.correlation import correlation
from studies.hidden_effects.signatures import Signatures, SignatureTable
from studies.hidden_effects.whitening import whitened

NAMES = ("eddy_drag", "backlash", "supply_sag", "seal_friction", "hose_compliance", "sensor_gain on current")
RUNS, SIGNALS, SAMPLES, PARAMETERS = 4, 2, 500, 3


def table(sizes=None, of_parameters=0.0):
    """A table with signatures at the sizes 1 and 2, and a residual of unit noise with some of them in it.

    Args:
        sizes: size of each suspect in the residual.
        of_parameters: how much of the first parameter every signature contains.
    """
    rng = np.random.default_rng(5)
    count = RUNS * SIGNALS * SAMPLES
    slopes = rng.standard_normal((count, PARAMETERS))
    shapes = 0.2 * rng.standard_normal((len(NAMES), count)) + of_parameters * slopes[:, 0]
    residual = rng.standard_normal(count) + sum(size * shapes[NAMES.index(n)] for n, size in (sizes or {}).items())
    suspects = [
        Signatures(types.SimpleNamespace(name=n), np.array([[0.0], [1.0]]), np.array([shape, 2.0 * shape]))
        for n, shape in zip(NAMES, shapes, strict=True)
    ]
    return SignatureTable(
        np.tile(np.repeat(np.arange(SIGNALS), SAMPLES), RUNS), ("current", "voltage"), residual, slopes,
        np.zeros(PARAMETERS), np.ones(PARAMETERS, bool), tuple(suspects),
    )  # fmt: skip


def test_correlation_names_what_is_in_the_residual():
    assert correlation(table()).named == () and correlation(table()).verdict is Verdict.ADEQUATE
    found = correlation(table({"hose_compliance": 2.0, "backlash": 1.0}))
    assert found.named == ("hose_compliance", "backlash") and found.place == "outlet"
    assert set(found.ranked[:2]) == {"hose_compliance", "backlash"} and len(found.ranked) == len(NAMES)
    assert found.verdict is Verdict.MISSING_EFFECT


def test_correlation_names_neither_negative_sizes_nor_what_parameters_explain():
    assert correlation(table({"hose_compliance": -2.0})).named == ()
    whole = table(of_parameters=0.3)
    shifted = dataclasses.replace(whole, residual=whole.residual + whole.slopes @ [0.5, -0.4, 0.3])
    assert correlation(shifted).named == ()


def test_whitened_noise_is_white_and_of_unit_size():
    rng = np.random.default_rng(1)
    coefficients, noise = (0.6, -0.2), np.zeros(40000)
    innovations = rng.standard_normal(40000)
    for t in range(2, 40000):
        noise[t] = 0.6 * noise[t - 1] - 0.2 * noise[t - 2] + innovations[t]
    found = whitened(noise / noise.std(), coefficients)
    assert np.isnan(found[:2]).all()
    white = found[100:]
    assert white.std() == pytest.approx(1.0, abs=0.02)
    assert abs(np.mean(white[1:] * white[:-1])) < 0.02 and abs(np.mean(white[2:] * white[:-2])) < 0.02
    both = whitened(np.stack([noise, 2.0 * noise], axis=1), coefficients)
    np.testing.assert_allclose(both[2:, 1], 2.0 * both[2:, 0])
    np.testing.assert_array_equal(whitened(noise, ()), noise)


def test_names_that_leave_most_of_the_misfit_are_not_an_answer():
    rng = np.random.default_rng(0)
    before, half, noise = (size * rng.standard_normal(20000) for size in (3.0, 2.5, 1.05))
    named = answer_of_names(("eddy_drag",), ("eddy_drag",))
    assert unknown_where_unexplained(named, before, noise) == named
    unknown = unknown_where_unexplained(named, before, half)
    assert unknown.first == UNKNOWN and unknown.place == "mover" and unknown.answer_set == (UNKNOWN,)
    nothing = answer_of_names((), ("hose_compliance",))
    assert unknown_where_unexplained(nothing, noise, noise) == nothing
    assert unknown_where_unexplained(nothing, before, before).place == "outlet"


def test_weights_of_models_and_the_smallest_set():
    weights = schwarz_weights({"a": 10.0, NOTHING: 14.0, "b": 11.0})
    assert list(weights) == ["a", "b", NOTHING] and sum(weights.values()) == pytest.approx(1.0)
    assert weights["b"] / weights["a"] == pytest.approx(np.exp(-0.5))
    assert credible_set({"a": 0.6, "b": 0.36, "c": 0.04}) == ("a", "b")
    assert credible_set({"a": 0.6, "b": 0.3, "c": 0.1}) == ("a", "b", "c")
