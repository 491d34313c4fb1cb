"""A law as an estimated curve with standard errors, beside the law of the library."""

import dataclasses

import numpy as np

from edhas_jax.diagnosis.laws.curve_basis import basis
from edhas_jax.machine.effects.tabulated_law import LawPlace, LawTable

MAX_NAME = 60  # characters of the name of an effect


@dataclasses.dataclass(frozen=True)
class LawCurve:
    """What acts at a place of the machine, as a curve over one signal; all values in SI.

    Args:
        name: id of the effect that the curve is.
        place: slot, variable and factors.
        beside: id of the library's effect that stays in the model, the curve being what is added to it; empty where
            the curve stands for the whole law.
        nodes: nodes (n,) of the variable.
        values: the curve (n,) as it acts in the model.
        std: standard errors (n,), all other unknowns being free.
        law_values: what the library's law contributes (n,), as fitted without the curve; None where no law was given.
        total: the whole law (n,): the curve, with the library's law where that stays in the model.
        explained_share: share of the whole law that the library's law explains at its best size, 0 … 1, each part
            weighted by how much of it the runs see; None without a law.
        log_evidence_gain: evidence [nats] for the curve's deviation from the law, to second order around the fit; near
            0 or below the data need none.
        variable_samples: values (m,) of the variable along the fitted runs.
        law_samples: what the library's law contributed there (m,); None without a law.
    """

    name: str
    place: LawPlace
    beside: str
    nodes: np.ndarray
    values: np.ndarray
    std: np.ndarray
    law_values: np.ndarray | None
    total: np.ndarray
    explained_share: float | None
    log_evidence_gain: float
    variable_samples: np.ndarray
    law_samples: np.ndarray | None

    def at(self, x: np.ndarray) -> np.ndarray:
        """The whole law (m,) at values (m,) of the variable."""
        return basis(self.nodes, np.asarray(x, float)) @ self.total

    def table(self, origin: str = "") -> LawTable:
        """The curve as a tabulated law, to be written to a file or mounted on a machine.

        Args:
            origin: where it comes from, for the file.
        """
        return LawTable(self.name, self.place, self.nodes, self.values, self.std, origin)


def curve_name(place: LawPlace, candidate: str | None) -> str:
    """The id of a curve: that of the effect whose law it replaces, or its slot, with `_curve`."""
    return f"{(candidate or place.slot)[:MAX_NAME]}_curve"
