"""What is not mounted is not there: not one operation of an absent effect, and no compilation for a changed value."""

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


def program(machine):
    """The jaxpr of one step, with machine, state, time and step as its inputs."""
    y = {n: jnp.asarray(v, float) for n, v in machine.initial_state().items()}
    # a fresh function each time: a cached trace would hide what was replaced in between
    return jax.make_jaxpr(lambda m, y, t, h: step(m, y, t, h))(machine, y, 0.0, H)


def operations(jaxpr) -> int:
    """The number of equations, those inside others included."""
    parameters = [p for eqn in jaxpr.eqns for v in eqn.params.values() for p in (v if isinstance(v, tuple) else (v,))]
    inner = [getattr(p, "jaxpr", p) for p in parameters]
    inner = [p for p in inner if hasattr(p, "eqns")]
    return len(jaxpr.eqns) + sum(operations(j) for j in inner)


@by_rig
def test_without_effects_no_effect_is_called(rig, monkeypatch):
    before = str(program(rig()))

    def forbidden(*_):
        raise AssertionError("an effect that is not mounted was called")

    for effect in LIBRARY:
        for name in (*(slot.name for slot in effect.slots), "rates"):
            monkeypatch.setattr(effect, name, forbidden)
    assert str(program(rig())) == before
    with pytest.raises(AssertionError, match="not mounted"):
        program(nominal(rig))


@by_rig
def test_without_effects_the_step_is_the_one_without_slots(rig, monkeypatch):
    with_slots = program(rig())
    replaced = 0
    for name, module in list(sys.modules.items()):
        if not name.startswith("edhas_jax") or module is slots:
            continue
        if getattr(module, "apply_slot", None) is slots.apply_slot:
            monkeypatch.setattr(module, "apply_slot", lambda slot, base, s: base)
            replaced += 1
    monkeypatch.setattr(slots, "apply_slot", lambda slot, base, s: base)
    assert replaced >= 4
    without_slots = program(rig())
    assert str(with_slots) == str(without_slots)
    assert operations(with_slots.jaxpr) == operations(without_slots.jaxpr)


@by_rig
def test_every_effect_adds_operations(rig):
    bare = operations(program(rig()).jaxpr)
    assert bare > 20
    for effect in EFFECTS[rig]:
        assert operations(program(rig(effects=(effect(),))).jaxpr) > bare, effect.__name__


@by_rig
def test_no_value_of_any_parameter_compiles_anything(rig, compilations):
    machine = nominal(rig)
    how = Simulation(duration=1e-3)
    simulate(machine, how)
    before, changes = compilations(), 0
    for part in components_by_name(machine).values():
        for parameter in structs.parameters(type(part)):
            low, high = parameter.span
            value = float(np.clip(1.01 * parameter.default if parameter.default else 1e-3 * high, low, high))
            simulate(changed(machine, parameter.name, value), how)
            changes += 1
    simulate(machine, Simulation(duration=2e-3, step=10e-6))
    assert changes > 15
    assert compilations() == before
    if rig is RIGS["actuator_bench"]:  # the count does rise where something is compiled
        simulate(rig(effects=(ParasiticSpring(), CoggingForce())), how)
        assert compilations() > before
