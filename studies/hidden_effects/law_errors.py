"""How near an estimated law is to the law that really acts, for the effects that a diagnosis names rightly.

What acts at the slot of the effect is recorded along the fitted runs, of the true machine and of the diagnosed one. The
error of a law is the rms error of what it contributes over the rms of the true contribution. Two estimates are
compared: the law of the library as it was accepted, and the final one, with the curve that is added to it where the law
differs. A part of a law that the uncertain parameters can take over, as viscous damping can of a friction, is an error
too.
"""

from typing import Any, NamedTuple

import numpy as np

from edhas_jax.diagnosis.laws.law_samples import along_runs
from edhas_jax.diagnosis.search.free_curves import SAME_TERMS
from edhas_jax.diagnosis.search.result import Diagnosis
from edhas_jax.machine.effects import Effect
from edhas_jax.machine.effects.tabulated_law import LawPlace
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import Campaign, Use
from studies.hidden_effects.answers import HiddenEffect, LawEstimate, same_names


class _Acting(NamedTuple):
    """What some effects contribute to slots that are the same term of the same equation, at each place of a slot."""

    slots: tuple[str, ...]
    effects: tuple[str, ...]

    def __call__(self, machine, y, t, h) -> dict[str, Any]:
        s, _ = machine.evaluate(y, t, h, y)
        out: dict[str, Any] = {}
        for slot in self.slots:
            sign, neutral = (-1.0 if slot in SAME_TERMS else 1.0), LawPlace(slot, "time").neutral
            for name, row in s.record.contributions.get(slot, {}).items():
                if name in self.effects:
                    for place, value in enumerate(row):
                        out[f"at_{place}"] = out.get(f"at_{place}", 0.0) + sign * (value - neutral)
        return out


def law_errors(diagnosis: Diagnosis, truth: Rig | None, hidden: tuple[HiddenEffect, ...]) -> dict[str, LawEstimate]:
    """The errors of the laws of rightly named effects, and the left-out residual with each of them.

    Args:
        diagnosis: the diagnosis.
        truth: the machine that made the data, with what was hidden mounted last; None where it is not known.
        hidden: what was hidden.

    Returns:
        By name; effects that act at other slots than the library's are left out, as are faults of sensors.
    """
    if truth is None:
        return {}
    out = {}
    laws = {law.of: law for law in diagnosis.laws}
    for trial in diagnosis.named:
        name = trial.candidate.name
        number = next((k for k, h in enumerate(hidden) if name in same_names(h.name)), None)
        if number is None or trial.candidate.signal is not None or trial.evaluated is None:
            continue
        really = truth.effects[len(truth.effects) - len(hidden) + number]
        slots = _slots(trial.candidate.kind)
        if not set(slots) & {slot.name for slot in really.slots}:
            continue
        final = (trial.candidate.id, *([laws[trial.candidate.id].id] if trial.candidate.id in laws else []))
        campaign, steps = diagnosis.campaign, diagnosis.final.resolution.fine
        acting = _trace(campaign, truth, _Acting(slots, (really.id,)), steps)
        estimates = [
            _trace(campaign, machine, _Acting(slots, effects), steps)
            for machine, effects in (
                (trial.evaluated.fit.machine, (trial.candidate.id,)), (diagnosis.after.fit.machine, final),
            )
        ]  # fmt: skip
        errors = [_relative(estimate, acting) for estimate in estimates]
        use = Use.HOLDOUT if diagnosis.campaign.runs_for(Use.HOLDOUT) else Use.FIT
        left = [m.rms_over_noise(use) for m in (diagnosis.calibrated, trial.evaluated, diagnosis.after)]
        out[name] = LawEstimate(*errors, trial.candidate.id in laws, *left)
    return out


def _slots(kind: type[Effect]) -> tuple[str, ...]:
    """The first slot of an effect, and the others that are the same term."""
    first = kind.slots[0].name
    term = SAME_TERMS.get(first, first)
    return (term, *(slot for slot, other in SAME_TERMS.items() if other == term))


def _trace(campaign: Campaign, machine: Rig, acting: _Acting, steps: int) -> dict[str, np.ndarray]:
    """What acts along the fitted runs at each place (samples,)."""
    return along_runs(campaign, machine, campaign.runs_for(Use.FIT), steps, acting)


def _relative(estimate: dict[str, np.ndarray], true: dict[str, np.ndarray]) -> float:
    """Rms error of an estimated contribution over the rms of the true one; NaN if that is zero in all fitted runs.

    Where only one of the two acts at a place, the other one is zero there.
    """
    if not any(map(np.any, true.values())):
        return float("nan")
    places = {**estimate, **true}
    differences = [estimate.get(place, 0.0) - true.get(place, 0.0) for place in places]
    return float(np.sqrt(np.sum(np.square(differences)) / np.sum(np.square(list(true.values())))))
