"""Orders that a law prescribes among its parameters, as linear constraints on the coordinates of a fit.

Friction at break-away is at least the friction while sliding, for example. A parameter declares it with `at_least`.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from edhas_jax.core import structs
from edhas_jax.machine.parameters import ParameterError, find_parameter
from edhas_jax.machine.rigs import Rig, components_by_name
from edhas_jax.measurements.unknown_parameters import ParameterScale, UnknownParameter

TINY = 1e-300  # stands for a value of 0 on the logarithmic scale
PROJECTIONS = 10  # alternating projections onto constraints and bounds; one suffices unless a bound interferes


class LinearConstraints(NamedTuple):
    """Constraints rows · x ≥ limits on the coordinates x (n,): `rows` (m, n) of unit length, `limits` (m,)."""

    rows: np.ndarray
    limits: np.ndarray

    def project(self, x: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """The point next to x (n,) within the bounds (n,) that keeps the constraints."""
        x = np.clip(x, low, high)
        for _ in range(PROJECTIONS if len(self.rows) else 0):
            for row, limit in zip(self.rows, self.limits, strict=True):
                x = np.clip(x + row * max(limit - row @ x, 0.0), low, high)
        return x


def no_constraints(n: int) -> LinearConstraints:
    """No constraint on n coordinates."""
    return LinearConstraints(np.zeros((0, n)), np.zeros(0))


def order_constraints(machine: Rig, unknowns: Sequence[UnknownParameter]) -> LinearConstraints:
    """The constraints that the laws of a machine put on some of its parameters.

    Args:
        machine: gives the declarations, and the values of the parameters that are not unknown.
        unknowns: parameters of the machine; others, of instruments, are not constrained. Two unknowns of which one is
            logarithmic and the other linear are not constrained either, because the constraint would not be linear.
    """
    index: dict[tuple[str, str], int] = {}
    for k, u in enumerate(unknowns):
        try:
            p, path = find_parameter(machine, u.name)  # the own value of a single run is not constrained
        except ParameterError:
            continue
        index[path, p.name] = k
    rows, limits = [], []
    for path, component in components_by_name(machine).items():
        for p in structs.parameters(type(component)):
            larger, smaller = index.get((path, p.name)), index.get((path, p.at_least))
            if not p.at_least or (larger is None and smaller is None):
                continue
            scales = {unknowns[k].scale for k in (larger, smaller) if k is not None}
            if len(scales) > 1:
                continue
            (scale,) = scales
            row, constant = np.zeros(len(unknowns)), 0.0
            for k, name, sign in ((larger, p.name, 1.0), (smaller, p.at_least, -1.0)):
                value = float(getattr(component, name)) if k is None else unknowns[k].centre
                constant += sign * (math.log(max(value, TINY)) if scale is ParameterScale.LOGARITHMIC else value)
                if k is not None:
                    row[k] += sign * unknowns[k].spread
            length = np.linalg.norm(row)
            if length > 0.0:
                rows.append(row / length)
                limits.append(-constant / length)
    return LinearConstraints(np.array(rows).reshape(-1, len(unknowns)), np.array(limits))
