"""The missing force, flow or voltage as a curve over its natural variable, with no law assumed, beside the law."""

import dataclasses
import math
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax.core import structs
from edhas_jax.core.structs import par
from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.calibration.least_squares import regularised_inverse
from edhas_jax.diagnosis.search.candidates import Suspect
from edhas_jax.machine.effects import Effect
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.machine.interface.slots import Rule, Slot
from edhas_jax.measurements.measurement_model import MeasurementModel
from edhas_jax.measurements.unknown_parameters import ParameterScale, UnknownParameter
from edhas_jax.simulation.integrator import step

NODES = 11
BINS = 80
NEAR = 20  # samples that say what the law is at a node
CROWDED = 3.0  # nodes lie as sinh: those next to zero that much closer than even ones, as laws turn there
FREE = 3.0  # spread of a node's value around the law, in the law's largest size
KNOWN = 0.5  # share of that spread above which the measurements say too little of a node
PREFERRED = 0.02  # of explained variance: axes as good as that are taken in their order
STRETCH = 512  # samples of one program

_DRIVE = {"current": "current", "piston_velocity": "piston_velocity", "piston_position": "piston_position",
          "voltage": "voltage"}  # fmt: skip
_MOVER = {"piston_velocity": "piston_velocity", "piston_position": "piston_position", "current": "current",
          "chamber_pressure_a": "chamber_pressure_a"}  # fmt: skip
_CYLINDER = {"cylinder_velocity": "cylinder_velocity", "cylinder_position": "cylinder_position",
             "head_pressure": "head_pressure"}  # fmt: skip
# the variables of a slot: their name where the effect acts, and the signal that has the values of the first such place
AXES: dict[str, dict[str, str]] = {
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
class MissingTerm:
    """What enters a slot, over the signal `axis`, all in SI.

    `at` (n,), `value` (n,), `std` (n,): estimated freely at some points. `path` (m,) and `law` (m,): the accepted law
    along the fitted runs.
    """

    suspect: Suspect
    slot: Slot
    axis: str
    at: np.ndarray
    value: np.ndarray
    std: np.ndarray
    path: np.ndarray
    law: np.ndarray


def missing_term(fitted: Fit, suspect: Suspect) -> MissingTerm | None:
    """The curve of what `suspect`, mounted in a fit, adds to the equations; None where it has no natural variable.

    A piecewise linear deviation from the law is put into the same slot, its values at the nodes free, and estimated in
    one Gauss-Newton step from the residuals of the fit, everything else as fitted. If the law is right, the points lie
    on it within their standard errors. (With everything else free too, what a known parameter can imitate, such as the
    linear part of a friction, would come out as noise.)
    """
    slot = None if suspect.signal is not None else suspect.kind.slots[0]
    if slot is None or slot.name not in AXES:
        return None
    rows = [_trajectory(fitted, r, slot, suspect.id) for r in range(len(fitted.outcomes))]
    law = np.concatenate([row["law"] for row in rows])
    size = float(np.abs(law - (1.0 if slot.rule is Rule.SCALE else 0.0)).max())
    along = {local: np.concatenate([row[n] for row in rows]) for local, n in AXES[slot.name].items() if n in rows[0]}
    along = {local: q for local, q in along.items() if np.ptp(q) > 0.0}
    if not (along and np.isfinite(law).all() and size > 0.0):
        return None
    explained = {local: _explained(q, law) for local, q in along.items()}
    local = next(n for n, share in explained.items() if share > max(explained.values()) - PREFERRED)
    q, signal = along[local], AXES[slot.name][local]
    nodes = _nodes(*np.percentile(q, [0.2, 99.8]))
    deviation, std = _estimated(fitted, slot, local, nodes, FREE * size)
    mean = np.array([law[np.argsort(np.abs(q - node))[:NEAR]].mean() for node in nodes])
    ok = std < KNOWN * FREE * size
    thin = slice(None, None, max(1, len(law) // 3000))
    return MissingTerm(suspect, slot, signal, nodes[ok], (mean + deviation)[ok], std[ok], q[thin], law[thin])


def _explained(q: np.ndarray, law: np.ndarray) -> float:
    """The share of a law's variance that a function of one variable explains."""
    if not np.var(law) > 0.0:
        return 1.0
    which = np.digitize(q, np.quantile(q, np.linspace(0.0, 1.0, BINS + 1)[1:-1]))
    counts = np.maximum(np.bincount(which, minlength=BINS), 1)
    means = np.bincount(which, law, BINS) / counts
    return 1.0 - float(np.var(law - means[which]) / np.var(law))


def _nodes(low: float, high: float) -> np.ndarray:
    """Values of a variable (NODES,) over its range: even, or crowded around a zero inside."""
    if low * high >= 0.0:
        return np.linspace(low, high, NODES)
    scale = np.sinh(CROWDED) / max(-low, high)
    return np.sinh(np.linspace(np.arcsinh(low * scale), np.arcsinh(high * scale), NODES)) / scale


def _hats(nodes, q):
    """The piecewise linear basis (NODES,) at a value; held outside."""
    up = jnp.clip((q - nodes[:-1]) / jnp.diff(nodes), 0.0, 1.0)
    return jnp.concatenate([jnp.ones(1), up]) - jnp.concatenate([up, jnp.zeros(1)])


def _estimated(fitted: Fit, slot: Slot, local: str, nodes: np.ndarray, spread: float):
    """The deviation from the law at the nodes and its standard errors: one Gauss-Newton step."""
    curve = _curve(slot, local)(**{f"at_{k}": float(q) for k, q in enumerate(nodes)})
    machine = structs.replace(fitted.machine, effects=(*fitted.machine.effects, curve))
    free = tuple(
        UnknownParameter(f"{curve.id}.value_{k}", 0.0, spread, slot.unit, (-math.inf, math.inf), ParameterScale.LINEAR)
        for k in range(NODES)
    )
    base = fitted.problem.model()
    model = MeasurementModel(base.campaign, machine, free, base.runs, fitted.instruments)
    found = model.predict_all_runs(np.zeros(NODES), fitted.resolution.coarse, with_sensitivities=True)
    curvature, downhill = np.eye(NODES), np.zeros(NODES)
    for r, (run, outcome) in enumerate(zip(base.runs, fitted.outcomes, strict=True)):
        for n, measured in run.signals.items():
            noise, there = base.campaign.channels[n].noise, np.isfinite(measured)
            slopes = found[r].sensitivities[n][there] / noise
            curvature = curvature + slopes.T @ slopes
            downhill = downhill + slopes.T @ (measured - outcome.values[n])[there] / noise
    covariance = regularised_inverse(curvature)
    return spread * (covariance @ downhill), spread * np.sqrt(np.diag(covariance))


def _curve(slot: Slot, local: str) -> type[Effect]:
    """An effect that enters a slot with a piecewise linear function of the variable called `local` there."""
    rest = 1.0 if slot.rule is Rule.SCALE else 0.0
    anything = (-1e30, 1e30)

    def enter(self, s, z):
        nodes, values = (
            jnp.stack([jnp.asarray(getattr(self, f"{what}_{k}")) for k in range(NODES)]) for what in ("at", "value")
        )
        return rest + _hats(nodes, getattr(s, local)) @ values

    names = [f"{what}_{k}" for what in ("at", "value") for k in range(NODES)]
    body = {n: par(0.0, slot.unit, anything, "node of a curve") for n in names}
    body |= {"__annotations__": dict.fromkeys(names, float), "__module__": __name__, "__doc__": "A free curve."}
    # its machine code is kept under its name
    name = "".join(part.title() for part in f"free_{slot.name}_by_{local}".split("_"))
    return type(name, (Effect,), body | {slot.name: enter})


def _trajectory(fitted: Fit, r: int, slot: Slot, effect: str) -> dict[str, np.ndarray]:
    """The signals (n,) of a fitted run, and as `law` what an effect adds at the first place of a slot."""
    base = fitted.problem.model()
    run = base.runs[r]
    machine = jax.tree.map(np.asarray, base.campaign.machine_of(run, fitted.machine))
    steps, interval = fitted.resolution.coarse, run.interval
    h, samples = interval / steps, math.ceil(run.time[-1] / interval - 1e-4) + 1
    y = {n: jnp.asarray(v, float) for n, v in machine.initial_state().items()}
    stretches = []
    for first in range(0, samples, STRETCH):
        y, rows = _march(machine, y, first * steps, h, steps, slot.name, effect)
        stretches.append(jax.device_get(rows))
    return {n: np.concatenate([rows[n] for rows in stretches])[:samples] for n in stretches[0]}


@partial(jax.jit, static_argnames=("slot", "effect"))
def _march(machine, y, first_step, h, per_sample, slot: str, effect: str):
    """`STRETCH` samples from state `y`: signals, and the effect's contribution."""

    def sample(carry, _):
        y, number = carry
        s, _ = machine.evaluate(y, number * h, h, y)
        row = {n: jnp.asarray(v) for n, v in s.values().items() if n in SIGNALS}
        row["law"] = jnp.asarray(s.record.contributions[slot][effect][0], float)
        y = jax.lax.fori_loop(0, per_sample, lambda k, y: step(machine, y, (number + k) * h, h)[0], y)
        return (y, number + per_sample), row

    (y, _), rows = jax.lax.scan(sample, (y, jnp.asarray(first_step)), length=STRETCH)
    return y, rows
