"""A free curve as a candidate: its values at the nodes are parameters that a fit estimates with all others."""

import dataclasses
import math

import numpy as np

from edhas_jax.core import structs
from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.laws.law_curve import LawCurve
from edhas_jax.diagnosis.laws.law_samples import law_samples
from edhas_jax.diagnosis.search.free_term import FreeTerm
from edhas_jax.machine.effects.tabulated_law import LawTable
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.unknown_parameters import ParameterScale, UnknownParameter


@dataclasses.dataclass(frozen=True)
class CurveCandidate(FreeTerm):
    """A curve at a place of the machine; values in SI.

    Args:
        nodes: nodes of the curve, whose values at them are its numbers.
    """

    nodes: tuple[float, ...] = ()

    @property
    def text(self) -> str:
        """Where the curve acts and over what, in words."""
        over = " · ".join(["a curve over " + self.place.variable, *self.place.factors])
        return f"{over} as {self.place.slot}".replace("_", " ")

    def mounted(self, machine: Rig, instruments: Instruments) -> tuple[Rig, Instruments]:
        """The machine with the curve, without influence at first."""
        nodes = np.array(self.nodes)
        effect = LawTable(self.id, self.place, nodes, np.full(len(nodes), self.place.neutral)).effect()
        return structs.replace(machine, effects=(*machine.effects, effect)), instruments

    def unknowns(self, campaign: Campaign) -> list[UnknownParameter]:
        """The values of the curve as unknowns, with a normal prior each."""
        neutral, unit, limits = self.place.neutral, self.place.value_unit, (-np.inf, np.inf)
        return [
            UnknownParameter(name, neutral, self.spread, unit, limits, ParameterScale.LINEAR)
            for name in self.value_names
        ]

    @property
    def value_names(self) -> list[str]:
        """The names of the values among the unknowns of a fit."""
        return [f"{self.prefix}value_{k}" for k in range(1, len(self.nodes) + 1)]

    def table(self, fit: Fit, origin: str = "") -> LawTable:
        """The curve as fitted, with its standard errors.

        Args:
            fit: a fit with the curve.
            origin: where it comes from, for a file.
        """
        all_errors = {u.name: u.spread * std for u, std in zip(fit.problem.unknowns, fit.std, strict=True)}
        values, errors = ([of[name] for name in self.value_names] for of in (fit.values, all_errors))
        return LawTable(self.id, self.place, np.array(self.nodes), np.array(values), np.array(errors), origin)


def fitted_curve(fit: Fit, curve: CurveCandidate) -> LawCurve:
    """A free curve as fitted, for a figure, with the values that its variable took along the runs."""
    table, samples = curve.table(fit), law_samples(fit, (curve.place,))
    return LawCurve(
        curve.id, curve.place, "", table.nodes, table.values, table.std, None, table.values, None, math.nan,
        samples.values[curve.place.variable], samples.weight(curve.place), None,
    )  # fmt: skip
