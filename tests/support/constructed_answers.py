"""Constructed cases and answers of the benchmark of hidden effects, for tests of its rates and its report."""

from studies.hidden_effects.answers import Answer, HiddenEffect, Law, Truth, Verdict, places_of


def truth(*names, withheld=False, law=Law.LIBRARY, visible=500.0, **more):
    """A case in which effects are hidden."""
    hidden = tuple(HiddenEffect(n, places_of(n), law, {"size": 2.0}, visible) for n in names)
    return Truth("b", "judging", 0, hidden, withheld, **more)


def answer(*named, verdict=None, place=None, **more):
    """An answer with names, or that nothing is missing."""
    verdict = verdict or (Verdict.MISSING_EFFECT if named else Verdict.ADEQUATE)
    place = place or (places_of(named[0])[0] if named else None)
    return Answer(verdict, named, place=place, **more)


FAILED = Answer(None, failed="LinAlgError: Singular matrix")
UNKNOWN_AT_MOVER = answer(verdict=Verdict.UNKNOWN_EFFECT, place="mover", answer_set=("unknown", "eddy_drag"))
