"""Derivatives by parameters: forward, reverse and finite differences agree on smooth runs."""

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from edhas_jax.core import structs
from edhas_jax.machine.effects import EntrainedAir, KarnoppFriction, LugreFriction, PistonLeakage
from edhas_jax.machine.rigs import ActuatorBench, ActuatorSystem, PumpBench, Rig, components_by_name
from edhas_jax.simulation.integrator import evaluate_signals, step
from tests.support.convergence import Stretch, beginning
from tests.support.reference import changed, nominal, value_of
from tests.support.xla import jit

H, STEPS = 20e-6, 200


class Case(NamedTuple):
    """A smooth stretch of a run and one parameter of each part that acts in it."""

    machine: Rig
    begin: float
    parameters: tuple[str, ...]


def modified(rig: type[Rig], **values) -> Rig:
    """A nominal rig with some parameters changed."""
    machine = nominal(rig)
    for name, value in values.items():
        machine = changed(machine, name, value)
    return machine


CASES = {
    "actuator in its stop, supply at its limit": Case(
        modified(ActuatorBench, amplitude=9e-3, supply_voltage=3.0, pump_stroke=3e-3, stop_stiffness=3e5),
        0.2236,
        ("supply_voltage", "stop_stiffness", "coil_resistance", "mover_mass", "coulomb_friction"),
    ),
    "pump in mid-stroke": Case(
        nominal(PumpBench),
        0.195,
        ("amplitude", "position_gain", "load_orifice_area", "outlet_volume", "valve_spring_rate", "oil_density"),
    ),
    "system near its target": Case(
        modified(ActuatorSystem, step_size=9e-3),
        0.215,
        (
            "step_size", "frequency", "velocity_gain", "force_constant", "plunger_mass", "coulomb_friction",
            "viscous_friction", "piston_diameter", "piston_clearance", "valve_seat_diameter", "discharge_coefficient",
            "oil_bulk_modulus", "air_fraction", "accumulator_gas_volume", "amplitude_band", "reversing_valve_area",
            "cylinder_bore", "cylinder_sliding_friction",
        ),
    ),
}  # fmt: skip


def test_the_cases_name_every_part():
    """One parameter of each component and of each effect of the paper's model."""
    mounted = {(type(part), case) for case in CASES.values() for part in components_by_name(case.machine).values()}
    covered = {part for part, case in mounted if any(p.name in case.parameters for p in structs.parameters(part))}
    assert {part for part, _ in mounted if structs.parameters(part)} == covered
    assert {LugreFriction, PistonLeakage, EntrainedAir, KarnoppFriction} <= covered


class Problem(NamedTuple):
    """A number that every state at the end and the mean flow enter, as a function of the machine.

    `path` are the states before each step; `end` and `flow` are the derivatives of the number by the states at the end
    and by the flow before each step.
    """

    outcome: Callable
    compiled: Callable
    machine: Rig
    path: dict[str, np.ndarray]
    end: dict[str, np.ndarray]
    flow: float


def advance(name: str, machine: Rig, y, t):
    """(states after a step, flow before it) of a case."""
    flow = "current" if isinstance(machine, ActuatorBench) else "outlet_flow"
    return step(machine, y, t, H)[0], evaluate_signals(machine, y, t, H)[flow]


@functools.cache
def problem(name: str) -> Problem:
    case = CASES[name]
    y0 = jax.device_get(beginning(Stretch(case.machine, case.begin, 0.0, ""), 10e-6))

    def march(machine):
        def one(y, j):
            after, flow = advance(name, machine, y, case.begin + j.astype(float) * H)
            return after, (flow, y)

        y, (flows, path) = jax.lax.scan(one, y0, jnp.arange(STEPS))
        return y, flows.mean(), path

    _, mean, path = jax.device_get(jit(march)(case.machine))
    end = {
        n: np.asarray((1.0 + 0.1 * k) / max(np.abs(path[n]).max(), 1e-12)) for k, n in enumerate(sorted(path))
    }

    def outcome(machine):
        y, flow, _ = march(machine)
        return sum(end[n] * y[n] for n in y) + flow / np.abs(mean)

    machine = jax.tree.map(lambda leaf: jnp.asarray(leaf, float), case.machine)
    return Problem(outcome, jit(outcome), machine, path, end, 1.0 / (STEPS * np.abs(mean)))


@functools.cache
def forward(name: str):
    outcome = problem(name).outcome
    return jit(lambda machine, direction: jax.jvp(outcome, (machine,), (direction,))[1])


@functools.cache
def reverse(name: str):
    """All derivatives at once, step by step from the end: a transposed step compiles faster than a transposed loop."""
    found, begin = problem(name), CASES[name].begin

    @jit
    def back(machine, y, t, cotangents):
        return jax.vjp(lambda machine, y: advance(name, machine, y, t), machine, y)[1](cotangents)

    adjoint, total = found.end, jax.tree.map(np.zeros_like, found.machine)
    for j in reversed(range(STEPS)):
        y = {n: values[j] for n, values in found.path.items()}
        by_machine, adjoint = jax.device_get(back(found.machine, y, begin + j * H, (adjoint, np.asarray(found.flow))))
        total = jax.tree.map(np.add, total, by_machine)
    return total


PAIRS = [(name, parameter) for name, case in CASES.items() for parameter in case.parameters]


@pytest.mark.parametrize(("name", "parameter"), PAIRS)
def test_forward_equals_differences_and_reverse(name, parameter):
    _, outcome, machine, *_ = problem(name)
    base = value_of(machine, parameter)
    direction = changed(jax.tree.map(jnp.zeros_like, machine), parameter, base)
    elasticity = float(forward(name)(machine, direction))

    def moved(share):
        return float(outcome(changed(machine, parameter, base * (1.0 + share))))

    def differences(d):
        return (8.0 * (moved(d) - moved(-d)) - (moved(2.0 * d) - moved(-2.0 * d))) / (12.0 * d)

    wanted, other = differences(3e-5), differences(6e-5)
    assert abs(wanted - other) < 1e-3 * abs(wanted) + 1e-8, "the stretch is not smooth: differences do not settle"
    np.testing.assert_allclose(elasticity, wanted, rtol=1e-5, atol=1e-9 + 3.0 * abs(wanted - other))
    assert abs(elasticity) > 1e-7, "the parameter does not act in this case"
    if not isinstance(machine, ActuatorSystem):  # its transposed step takes long to compile
        np.testing.assert_allclose(value_of(reverse(name), parameter) * base, elasticity, rtol=1e-9)
