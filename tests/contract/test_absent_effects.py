"""Effects that are not mounted add no operation to the step, and a changed parameter value compiles nothing."""

import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from edhas_jax.core import structs
from edhas_jax.machine.effects import LIBRARY, CoggingForce, ParasiticSpring
from edhas_jax.machine.interface import slots
from edhas_jax.machine.rigs import RIGS, components_by_name
from edhas_jax.simulation.integrator import step
from edhas_jax.simulation.run import Simulation, simulate
from tests.support.reference import EFFECTS, changed, nominal

H = 20e-6
by_rig = pytest.mark.parametrize("rig", [pytest.param(rig, id=name) for name, rig in RIGS.items()])


def step_jaxpr(machine):
    """The jaxpr of one step, with machine, state, time and step as its inputs."""
    y = {n: jnp.asarray(v, float) for n, v in machine.initial_state().items()}
    # a new function each time: a cached trace would hide methods replaced in between
    return jax.make_jaxpr(lambda m, y, t, h: step(m, y, t, h))(machine, y, 0.0, H)


def count_operations(jaxpr) -> int:
    """The number of equations of a jaxpr, including those of inner jaxprs."""
    parameters = [p for eqn in jaxpr.eqns for v in eqn.params.values() for p in (v if isinstance(v, tuple) else (v,))]
    inner = [getattr(p, "jaxpr", p) for p in parameters]
    inner = [p for p in inner if hasattr(p, "eqns")]
    return len(jaxpr.eqns) + sum(count_operations(j) for j in inner)


@by_rig
def test_without_effects_no_effect_is_called(rig, monkeypatch):
    before = str(step_jaxpr(rig()))

    def forbidden(*_):
        raise AssertionError("an effect that is not mounted was called")

    for effect in LIBRARY:
        for name in (*(slot.name for slot in effect.slots), "rates"):
            monkeypatch.setattr(effect, name, forbidden)
    assert str(step_jaxpr(rig())) == before
    with pytest.raises(AssertionError, match="not mounted"):
        step_jaxpr(nominal(rig))


@by_rig
def test_unused_slots_add_no_operation(rig, monkeypatch):
    with_slots = step_jaxpr(rig())
    replaced = 0
    for name, module in list(sys.modules.items()):
        if not name.startswith("edhas_jax") or module is slots:
            continue
        if getattr(module, "apply_slot", None) is slots.apply_slot:
            monkeypatch.setattr(module, "apply_slot", lambda slot, base, s: base)
            replaced += 1
    monkeypatch.setattr(slots, "apply_slot", lambda slot, base, s: base)
    assert replaced >= 4
    without_slots = step_jaxpr(rig())
    assert str(with_slots) == str(without_slots)
    assert count_operations(with_slots.jaxpr) == count_operations(without_slots.jaxpr)


@by_rig
def test_every_effect_adds_operations(rig):
    bare = count_operations(step_jaxpr(rig()).jaxpr)
    assert bare > 20
    for effect in EFFECTS[rig]:
        assert count_operations(step_jaxpr(rig(effects=(effect(),))).jaxpr) > bare, effect.__name__


@by_rig
def test_a_changed_parameter_compiles_nothing(rig, compilations):
    machine = nominal(rig)
    settings = Simulation(duration=1e-3)
    simulate(machine, settings)
    before, changes = compilations(), 0
    for part in components_by_name(machine).values():
        for parameter in structs.parameters(type(part)):
            low, high = parameter.span
            value = float(np.clip(1.01 * parameter.default if parameter.default else 1e-3 * high, low, high))
            simulate(changed(machine, parameter.name, value), settings)
            changes += 1
    simulate(machine, Simulation(duration=2e-3, step=10e-6))
    assert changes > 15
    assert compilations() == before
    if rig is RIGS["actuator_bench"]:  # the count does rise where something is compiled
        simulate(rig(effects=(ParasiticSpring(), CoggingForce())), settings)
        assert compilations() > before
