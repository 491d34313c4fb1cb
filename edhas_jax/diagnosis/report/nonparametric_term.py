"""Nonparametric estimate of a missing force, flow or voltage over its variable, beside the law of a candidate."""

import dataclasses
import math
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from edhas_jax.core import structs
from edhas_jax.core.structs import par
from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.calibration.symmetric_matrices import regularised_inverse
from edhas_jax.diagnosis.search.candidates import Candidate
from edhas_jax.machine.effects import Effect
from edhas_jax.machine.interface.signals import SIGNALS, UnknownNameError
from edhas_jax.machine.interface.slots import Rule, Slot
from edhas_jax.machine.parameters import get_parameter
from edhas_jax.measurements.measurement_model import PLACEHOLDER_PARAMETER, MeasurementModel
from edhas_jax.measurements.unknown_parameters import ParameterScale, UnknownParameter
from edhas_jax.simulation.batch_trajectories import simulate_batch

NODES = 11  # of the piecewise linear function
NODE_CLUSTERING = 3.0  # nodes are spaced as sinh over ±3, denser around zero, where laws change most
NODE_RANGE_PERCENTILES = 0.2, 99.8  # of the variable, between which the nodes lie
SAMPLES_PER_NODE = 20  # nearest samples over which the law is averaged at a node
PRIOR_SPREAD = 3.0  # prior standard deviation of a node's value around the law, over the law's largest magnitude
MAX_RELATIVE_STD = 0.5  # of the prior standard deviation: nodes estimated less precisely are omitted
VARIANCE_BINS = 80  # bins of equal count for the explained variance
VARIABLE_TIE = 0.02  # difference in explained variance below which the variable listed first is taken
MIN_VARIATION = 1e-3  # standard deviation of a law over its largest magnitude: a constant follows no variable
PATH_SAMPLES = 3000  # approximate number of the law's samples that are kept for a figure
COEFFICIENT_LIMITS = (-1e30, 1e30)

_DRIVE = {"current": "current", "piston_velocity": "piston_velocity", "piston_position": "piston_position",
          "voltage": "voltage"}  # fmt: skip
_MOVER = {"piston_velocity": "piston_velocity", "piston_position": "piston_position", "current": "current",
          "chamber_pressure_a": "chamber_pressure_a"}  # fmt: skip
_CYLINDER = {"cylinder_velocity": "cylinder_velocity", "cylinder_position": "cylinder_position",
             "head_pressure": "head_pressure"}  # fmt: skip
# possible variables of a slot: local name, and signal with its values at the first place where the effect acts
SLOT_VARIABLES: dict[str, dict[str, str]] = {
    **dict.fromkeys(("coil_voltage_change", "coil_resistance_factor", "coil_inductance_factor",
                     "force_constant_factor"), _DRIVE),
    **dict.fromkeys(("motor_force_factor", "mover_force", "mover_friction"), _MOVER),
    "check_valve_force": {"lift": "suction_lift_a"},
    "suction_valve_area": {"lift": "suction_lift_a"},
    "delivery_valve_area": {"lift": "delivery_lift_a"},
    "chamber_leakage": {"chamber_pressure": "chamber_pressure_a", "plunger_velocity": "piston_velocity"},
    "gap_viscosity_factor": {"chamber_pressure": "chamber_pressure_a"},
    "outlet_capacity": {"outlet_pressure": "outlet_pressure"},
    **dict.fromkeys(("cylinder_force", "cylinder_friction_force", "cylinder_friction_level",
                     "cylinder_leakage_change"), _CYLINDER),
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class NonparametricTerm:
    """The contribution of a missing effect to a slot over one signal, all values in SI.

    Args:
        candidate: the candidate whose law is compared.
        slot: the slot to which the term is added.
        variable: name of the signal on the horizontal axis.
        nodes: values (n,) of the variable at which the term is estimated.
        values: nonparametric estimate (n,) of the term at the nodes.
        std: standard errors (n,) of the estimate.
        variable_samples: values (m,) of the variable along the fitted runs.
        law_samples: contribution (m,) of the candidate's law along the fitted runs.
    """

    candidate: Candidate
    slot: Slot
    variable: str
    nodes: np.ndarray
    values: np.ndarray
    std: np.ndarray
    variable_samples: np.ndarray
    law_samples: np.ndarray


def estimate_nonparametric_term(fitted: Fit, candidate: Candidate) -> NonparametricTerm | None:
    """Estimate what a candidate contributes to the equations without assuming its functional form.

    A piecewise linear deviation from the law is added to the same slot. Its values at the nodes are estimated in one
    Gauss-Newton step from the residuals, with all parameters fixed at their fitted values. If the law is correct, the
    points lie on it within their standard errors. (If the parameters were free, whatever they can reproduce, such as
    the linear part of a friction, would be confounded with the term.)

    Args:
        fitted: a fit that contains the candidate.
        candidate: the effect whose slot is examined.

    Returns:
        The estimate over the variable that explains most of the law's variance; None for a sensor fault, a slot
        without a variable, or a law that vanishes or is not finite.
    """
    slot = None if candidate.signal is not None else candidate.kind.slots[0]
    if slot is None or slot.name not in SLOT_VARIABLES:
        return None
    rows = [_trajectory(fitted, r, slot, candidate.id) for r in range(len(fitted.outcomes))]
    law = np.concatenate([row["law"] for row in rows])
    magnitude = float(np.abs(law - (1.0 if slot.rule is Rule.SCALE else 0.0)).max())
    variables = SLOT_VARIABLES[slot.name]
    samples = {local: np.concatenate([row[n] for row in rows]) for local, n in variables.items() if n in rows[0]}
    samples = {local: q for local, q in samples.items() if np.ptp(q) > 0.0}
    if not (samples and np.isfinite(law).all() and magnitude > 0.0):
        return None
    explained = {local: _explained_variance(q, law) for local, q in samples.items()}
    local = next(n for n, share in explained.items() if share > max(explained.values()) - VARIABLE_TIE)
    q = samples[local]
    nodes = _place_nodes(*np.percentile(q, NODE_RANGE_PERCENTILES))
    spread = PRIOR_SPREAD * magnitude
    deviation, std = _estimate_deviation(fitted, slot, local, nodes, spread)
    law_at_nodes = np.array([law[np.argsort(np.abs(q - node))[:SAMPLES_PER_NODE]].mean() for node in nodes])
    ok = std < MAX_RELATIVE_STD * PRIOR_SPREAD * magnitude
    thinned = slice(None, None, max(1, len(law) // PATH_SAMPLES))
    values = (law_at_nodes + deviation)[ok]
    return NonparametricTerm(candidate, slot, variables[local], nodes[ok], values, std[ok], q[thinned], law[thinned])


def _explained_variance(q: np.ndarray, law: np.ndarray) -> float:
    """The share of a law's variance that a function of one variable explains, 0 … 1."""
    if not np.var(law) > 0.0:
        return 1.0
    bins = np.digitize(q, np.quantile(q, np.linspace(0.0, 1.0, VARIANCE_BINS + 1)[1:-1]))
    counts = np.maximum(np.bincount(bins, minlength=VARIANCE_BINS), 1)
    means = np.bincount(bins, law, VARIANCE_BINS) / counts
    return 1.0 - float(np.var(law - means[bins]) / np.var(law))


def _place_nodes(low: float, high: float) -> np.ndarray:
    """Nodes (NODES,) over a range: equidistant, or denser around zero where it lies inside."""
    if low * high >= 0.0:
        return np.linspace(low, high, NODES)
    scale = np.sinh(NODE_CLUSTERING) / max(-low, high)
    return np.sinh(np.linspace(np.arcsinh(low * scale), np.arcsinh(high * scale), NODES)) / scale


def _hat_functions(nodes: list, q) -> list:
    """The piecewise linear basis functions at a value, one for each node; constant outside the nodes.

    They are scalars, because a loop in machine code holds no arrays.
    """
    pairs = zip(nodes[:-1], nodes[1:], strict=True)
    up = [jnp.minimum(jnp.maximum((q - low) / (high - low), 0.0), 1.0) for low, high in pairs]
    return [before - after for before, after in zip([1.0, *up], [*up, 0.0], strict=True)]


def _estimate_deviation(
    fitted: Fit, slot: Slot, local: str, nodes: np.ndarray, spread: float
) -> tuple[np.ndarray, np.ndarray]:
    """The deviation from the law at the nodes and its standard errors, by one Gauss-Newton step."""
    base, found = _curve_slopes(fitted, slot, local, nodes, spread)
    curvature, gradient = np.eye(NODES), np.zeros(NODES)
    for r, (run, outcome) in enumerate(zip(base.runs, fitted.outcomes, strict=True)):
        for n, measured in run.signals.items():
            noise, valid = base.campaign.channels[n].noise, np.isfinite(measured)
            slopes = found[r].sensitivities[n][valid] / noise
            curvature = curvature + slopes.T @ slopes
            gradient = gradient + slopes.T @ (measured - outcome.values[n])[valid] / noise
    covariance = regularised_inverse(curvature)
    return spread * (covariance @ gradient), spread * np.sqrt(np.diag(covariance))


def _curve_slopes(fitted: Fit, slot: Slot, local: str, nodes: np.ndarray, spread: float):
    """The model of the fitted runs, and its signals with their derivatives by a deviation of `spread` at each node."""
    curve = _curve_effect(slot, local)(**{f"at_{k}": float(q) for k, q in enumerate(nodes)})
    machine = structs.replace(fitted.machine, effects=(*fitted.machine.effects, curve))
    unbounded = (-math.inf, math.inf)
    unknowns = tuple(
        UnknownParameter(f"{curve.id}.value_{k}", 0.0, spread, slot.unit, unbounded, ParameterScale.LINEAR)
        for k in range(NODES)
    )
    base = fitted.problem.model()
    model = MeasurementModel(base.campaign, machine, unknowns, base.runs, fitted.instruments)
    found = model.predict_all_runs(np.zeros(NODES), fitted.resolution.coarse, with_sensitivities=True)
    return base, found


def deviation_columns(fitted: Fit, candidate: Candidate, share: float) -> list[dict[str, np.ndarray]] | None:
    """The change of the signals by a deviation of a law, a piecewise linear function of the variable that it follows.

    Args:
        fitted: a fit that contains the candidate.
        candidate: the effect whose law may deviate.
        share: deviation at a node that counts as 1, over the largest magnitude of the law.

    Returns:
        By fitted run the columns (samples, nodes) by signal, SI; None where the law vanishes or its slot has no
        variable.
    """
    slot = candidate.kind.slots[0]
    if slot.name not in SLOT_VARIABLES:
        return None
    rows = [_trajectory(fitted, r, slot, candidate.id) for r in range(len(fitted.outcomes))]
    law = np.concatenate([row["law"] for row in rows])
    magnitude = float(np.abs(law - (1.0 if slot.rule is Rule.SCALE else 0.0)).max())
    if not (np.isfinite(law).all() and np.std(law) > MIN_VARIATION * magnitude):
        return None
    samples = {
        local: np.concatenate([row[name] for row in rows])
        for local, name in SLOT_VARIABLES[slot.name].items()
        if name in rows[0]
    }
    explained = {local: _explained_variance(q, law) for local, q in samples.items() if np.ptp(q) > 0.0}
    for local in sorted(explained, key=lambda n: -explained[n]):
        nodes = _place_nodes(*np.percentile(samples[local], NODE_RANGE_PERCENTILES))
        try:
            model, slopes = _curve_slopes(fitted, slot, local, nodes, share * magnitude)
        except UnknownNameError:  # the slot is evaluated before this variable is known
            continue
        columns = [slopes[r].sensitivities for r in range(len(model.runs))]
        return columns if all(np.isfinite(v).all() for run in columns for v in run.values()) else None
    return None


def _curve_effect(slot: Slot, local: str) -> type[Effect]:
    """The class of an effect that adds a piecewise linear function of the variable `local` to a slot."""
    neutral = 1.0 if slot.rule is Rule.SCALE else 0.0

    def contribute(self, s, z):
        nodes, values = ([getattr(self, f"{what}_{k}") for k in range(NODES)] for what in ("at", "value"))
        hats = _hat_functions(nodes, getattr(s, local))
        return neutral + sum(hat * value for hat, value in zip(hats, values, strict=True))

    names = [f"{what}_{k}" for what in ("at", "value") for k in range(NODES)]
    body = {n: par(0.0, slot.unit, COEFFICIENT_LIMITS, "node of a curve") for n in names}
    body |= {"__annotations__": dict.fromkeys(names, float), "__module__": __name__, "__doc__": "Piecewise linear."}
    # compiled loops are cached by the name of the class
    name = "".join(part.title() for part in f"free_{slot.name}_by_{local}".split("_"))
    return type(name, (Effect,), body | {slot.name: contribute})


class SignalsWithContribution(NamedTuple):
    """All signals, and as `law` what an effect contributes at the first place of a slot."""

    slot: str
    effect: str

    def __call__(self, machine, y, t, h) -> dict[str, Any]:
        """The signals of one instant."""
        s, _ = machine.evaluate(y, t, h, y)
        signals = {n: v for n, v in s.values().items() if n in SIGNALS}
        return signals | {"law": s.record.contributions[self.slot][self.effect][0]}


def _trajectory(fitted: Fit, r: int, slot: Slot, effect: str) -> dict[str, np.ndarray]:
    """The signals (n,) of a fitted run, and as `law` what an effect adds at the first place of a slot."""
    base = fitted.problem.model()
    run = base.runs[r]
    machine = base.campaign.machine_of(run, fitted.machine)
    steps, interval = fitted.resolution.coarse, run.interval
    samples = math.ceil(run.time[-1] / interval - 1e-4) + 1
    values = {PLACEHOLDER_PARAMETER: np.array([float(get_parameter(machine, PLACEHOLDER_PARAMETER))])}
    observer = SignalsWithContribution(slot.name, effect)
    traces = simulate_batch(machine, values, None, interval / steps, steps, samples, observer)
    return {n: column[:, 0] for n, column in traces.values.items()}
