"""Requirements on every effect, checked for the library, two effects as a user would write them, and a table."""

import functools
import types

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edhas_jax.compiler.derivative_graph import linearize
from edhas_jax.compiler.sparse_elimination import solve
from edhas_jax.core import structs
from edhas_jax.core.structs import par
from edhas_jax.machine.effects import LIBRARY, AsymmetricFriction, Backlash, Effect, state
from edhas_jax.machine.effects.tabulated_law import LawPlace, tabulated_class
from edhas_jax.machine.interface.slots import SLOTS
from edhas_jax.machine.rigs import ActuatorSystem, PumpBench, Rig
from edhas_jax.simulation.integrator import DEFAULT_STEP
from edhas_jax.simulation.run import Simulation, simulate
from tests.support.reference import random_state, rms


class SealDrag(Effect):
    """Smooth dry friction of a lip seal, in proportion to the chamber pressure.

    F = k (p_A + p_B) tanh(v/v_0)

    Source: a user's own.
    """

    looks_like = "friction that grows with the load"

    seal_coefficient: float = par(2e-6, "m^2", (0.0, 1e-4), "friction per pressure k")
    seal_velocity: float = par(0.01, "m/s", (1e-5, 1.0), "speed at which it has built up v_0")

    def mover_friction(self, s, z):
        pressure = s.chamber_pressure_a + s.chamber_pressure_b
        return self.seal_coefficient * pressure * jnp.tanh(s.piston_velocity / self.seal_velocity)


class EddyBrake(Effect):
    """Eddy currents in the coil carrier with a state of their own, far faster than the step.

    τ di/dt = c v − i,   F = k i

    Source: a user's own.
    """

    looks_like = "damping that is missing at rest"

    eddy_time: float = par(1e-6, "s", (1e-7, 1e-2), "decay time τ")
    eddy_pickup: float = par(10.0, "A*s/m", (0.0, 1e3), "current per speed c")
    eddy_force: float = par(0.5, "N/A", (0.0, 1e2), "force per current k")

    eddy_current = state("A", "current in the carrier")

    def mover_friction(self, s, z):
        return self.eddy_force * z.eddy_current

    def rates(self, s, z):
        return {"eddy_current": (self.eddy_pickup * s.piston_velocity - z.eddy_current) / self.eddy_time}


ALL = (*LIBRARY, SealDrag, EddyBrake, tabulated_class("table", LawPlace("force_constant_factor", "piston_position"), 4))
by_effect = pytest.mark.parametrize("effect", ALL, ids=lambda e: e.__name__)
FRICTION = [e for e in ALL if {"mover_friction", "cylinder_friction_force"} & {s.name for s in e.slots}]
H = DEFAULT_STEP


@functools.cache
def rig_of(effect) -> type[Rig]:
    """The smallest rig that has all slots of the effect and every signal it reads."""
    for rig in (PumpBench, ActuatorSystem):
        if set(effect.slots) <= set(rig.slots):
            return rig
    raise AssertionError(f"{effect.__name__} fits no rig")


def machine_with(*effects: Effect, rig: type[Rig] | None = None) -> Rig:
    return (rig or rig_of(type(effects[0])))(effects=effects)


def contributions_and_rates(machine: Rig, effect: Effect, y, t=0.05):
    """The contributions of an effect by slot, and the rates of its own states, at a state of the machine."""
    s, rates = machine.evaluate(y, t, jnp.asarray(H, jnp.result_type(*y.values())), y)
    contributions = {slot: found[effect.id] for slot, found in s.record.contributions.items() if effect.id in found}
    return contributions, {n: r for n, r in rates.items() if n.startswith(f"{effect.id}.")}


@functools.cache
def compiled(effect):
    """`contributions_and_rates` as a function of the effect's parameters and the state."""
    names = [p.name for p in structs.parameters(effect)]

    @jax.jit
    def evaluate(values, y):
        mounted_effect = effect(**dict(zip(names, values, strict=True)))
        return contributions_and_rates(machine_with(mounted_effect), mounted_effect, y)

    return evaluate


def value_in_span(parameter, fraction: float) -> float:
    """A value in the span of a parameter, logarithmic if the span covers more than two decades."""
    low, high = parameter.span
    if low > 0.0 and high / low > 100.0:
        return float(low * (high / low) ** fraction)
    return float(low + fraction * (high - low))


def defaults(effect) -> list[float]:
    return [p.default for p in structs.parameters(effect)]


@by_effect
def test_declaration_is_complete(effect):
    text = effect.__doc__
    assert text and "Source:" in text and effect.looks_like
    assert text.strip().splitlines()[0].endswith((".", ":"))
    assert effect.slots and all(SLOTS[slot.name] is slot for slot in effect.slots)
    for parameter in structs.parameters(effect):
        low, high = parameter.span
        assert low <= parameter.default <= high, parameter.name
        assert low < high and np.isfinite([low, high]).all()
        assert parameter.unit and parameter.doc
        if parameter.plausible:
            assert low <= parameter.plausible[0] <= parameter.default <= parameter.plausible[1] <= high
    for own in effect.states.values():
        assert own.unit and own.doc


@by_effect
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_contributions_are_scalars_in_the_precision_of_the_run(effect, dtype):
    machine = jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype), machine_with(effect()))
    y = {n: jnp.asarray(v, dtype) for n, v in machine.initial_state().items()}
    t = jnp.asarray(0.05, dtype)
    found = jax.eval_shape(lambda m, y: contributions_and_rates(m, m.effects[0], y, t), machine, y)
    assert set(found[0]) == {slot.name for slot in effect.slots}
    assert len(found[1]) == len(effect.states)
    for leaf in jax.tree.leaves(found):
        assert leaf.shape == () and leaf.dtype == dtype


@by_effect
@settings(max_examples=40, deadline=None)
@given(shares=st.lists(st.floats(0.0, 1.0), min_size=8, max_size=8), seed=st.integers(0, 2**31))
def test_contributions_are_finite_over_all_spans(effect, shares, seed):
    values = [value_in_span(p, fraction) for p, fraction in zip(structs.parameters(effect), shares, strict=False)]
    y = random_state(machine_with(effect()), np.random.default_rng(seed))
    for leaf in jax.tree.leaves(compiled(effect)(values, y)):
        assert np.isfinite(leaf)


@by_effect
def test_derivatives_equal_differences(effect):
    """Along random directions of states and parameters, except where a kink lies within the difference."""
    rng = np.random.default_rng(11)
    evaluate = compiled(effect)
    directional_derivative = jax.jit(lambda point, tangent: jax.jvp(lambda p: evaluate(*p), (point,), (tangent,))[1])
    machine = machine_with(effect())
    checked = 0
    for _ in range(12):
        point = ([d * rng.uniform(0.7, 1.3) for d in defaults(effect)], random_state(machine, rng))
        direction = jax.tree.map(lambda leaf: jnp.asarray(leaf * rng.uniform(-1.0, 1.0), float), point)
        point = jax.tree.map(lambda leaf: jnp.asarray(leaf, float), point)

        def at(fraction, point=point, direction=direction):
            return np.array(jax.tree.leaves(evaluate(*jax.tree.map(lambda p, w: p + fraction * w, point, direction))))

        def slope(d, at=at):
            return (8.0 * (at(d) - at(-d)) - (at(2.0 * d) - at(-2.0 * d))) / (12.0 * d)

        exact = np.array(jax.tree.leaves(directional_derivative(point, direction)))
        coarse, fine = slope(1e-4), slope(5e-5)
        scale = np.abs(exact) + np.abs(at(0.0)) + 1e-300
        smooth = np.abs(coarse - fine) < 1e-6 * scale
        np.testing.assert_array_less(np.abs(exact - fine)[smooth], 1e-5 * scale[smooth])
        checked += smooth.sum()
    assert checked >= 6


@by_effect
def test_a_batch_over_a_parameter_equals_a_loop(effect):
    base = defaults(effect)
    y = random_state(machine_with(effect()), np.random.default_rng(5))
    values = [np.asarray(v) * np.array([0.5, 1.0, 1.5]) for v in base[:1]] + [np.full(3, v) for v in base[1:]]
    together = jax.tree.leaves(jax.vmap(compiled(effect), in_axes=(0, None))(values, y))
    for k in range(3):
        single = jax.tree.leaves(compiled(effect)([v[k] for v in values], y))
        for result, expected in zip(together, single, strict=True):
            np.testing.assert_allclose(jnp.broadcast_to(result, (3,))[k], expected, rtol=1e-9, atol=1e-15)


def test_the_order_of_effects_changes_nothing():
    effects = tuple(e() for e in ALL if set(e.slots) <= set(ActuatorSystem.slots))
    orders = effects, effects[::-1], effects[3:] + effects[:3]
    rng = np.random.default_rng(2)
    states = [random_state(machine_with(*effects, rig=ActuatorSystem), rng) for _ in range(5)]
    results = []
    for order in orders:
        machine = machine_with(*order, rig=ActuatorSystem)
        rates = jax.jit(lambda y, machine=machine: machine.evaluate(y, 0.05, H, y)[1])
        results.append([jax.device_get(rates(y)) for y in states])
    for other in results[1:]:
        for one, two in zip(results[0], other, strict=True):
            for name, rate in one.items():
                # the forces nearly cancel: the rounding error scales with the terms, not with their sum
                np.testing.assert_allclose(two[name], rate, rtol=1e-10, atol=1e-8, err_msg=name)


def program(machine: Rig) -> str:
    """The rates of a machine as a jaxpr."""
    y = {n: jnp.asarray(v, float) for n, v in machine.initial_state().items()}
    return str(jax.make_jaxpr(lambda m, y, t, h: m.evaluate(y, t, h, y)[1])(machine, y, 0.0, H))


program_with = functools.cache(lambda rig, kinds: program(rig(effects=tuple(kind() for kind in kinds))))


@by_effect
def test_a_removed_effect_leaves_the_same_program(effect):
    rig = rig_of(effect)
    kinds = tuple(e for e in (*LIBRARY[:4], SealDrag) if e is not effect and set(e.slots) <= set(rig.slots))
    whole = rig(effects=(effect(), *(kind() for kind in kinds)))
    assert program(structs.replace(whole, effects=whole.effects[1:])) == program_with(rig, kinds) != program(whole)


GROUPS = {
    "drive": (PumpBench, [e for e in ALL if {s.location for s in e.slots} & {"coil", "mover"} and e is not Backlash]),
    "oil": (PumpBench, [e for e in ALL if not {s.location for s in e.slots} & {"coil", "mover", "cylinder"}]),
    "backlash": (PumpBench, [*LIBRARY[:3], Backlash]),
    "cylinder": (ActuatorSystem, [*LIBRARY[:4], *(e for e in ALL if {s.location for s in e.slots} == {"cylinder"})]),
}
"""Machines that together have every effect; each is compiled once."""


def test_the_groups_contain_every_effect():
    assert {e for _, group in GROUPS.values() for e in group} == set(ALL)


@pytest.mark.parametrize("group", GROUPS)
def test_a_changed_value_compiles_nothing_and_a_long_step_is_stable(group, compilations):
    rig, effects = GROUPS[group]
    machine = rig(effects=tuple(e() for e in dict.fromkeys(effects)))

    def run(machine, **how):
        return simulate(machine, Simulation(**how))

    normal = run(machine, duration=0.25)
    before = compilations()
    for k, mounted_effect in enumerate(machine.effects):
        others = machine.effects[:k], machine.effects[k + 1 :]
        for parameter in structs.parameters(type(mounted_effect)):
            changed = structs.replace(mounted_effect, **{parameter.name: 1.1 * parameter.default})
            short = run(structs.replace(machine, effects=(*others[0], changed, *others[1])), duration=1e-3)
            assert all(np.isfinite(v).all() for v in short.signals.values())
    coarse = run(machine, duration=0.25, step=5.0 * H)
    assert compilations() == before
    for signal in ("piston_position", "current"):
        difference = coarse.signals[signal] - normal.signals[signal]
        assert rms(difference) < 0.02 * np.ptp(normal.signals[signal])


@pytest.mark.parametrize("effect", FRICTION, ids=lambda e: e.__name__)
@pytest.mark.parametrize("velocity", [-0.5, -0.05, -2e-3, 2e-3, 0.05, 0.5])
def test_friction_opposes_steady_sliding(effect, velocity):
    """Friction dissipates energy at constant speed, with its own states settled."""
    mounted_effect = effect()
    machine = machine_with(mounted_effect)
    y = {n: jnp.asarray(v, float) for n, v in machine.initial_state().items()}
    y |= {n: jnp.asarray(velocity) for n in ("piston_velocity", "cylinder_velocity") if n in y}
    y["piston_position"] = jnp.asarray(2e-3)  # off mid-stroke, where a friction may vanish
    own = [f"{mounted_effect.id}.{n}" for n in mounted_effect.states]

    def settle(_, z):
        graph = linearize(lambda z: contributions_and_rates(machine, mounted_effect, y | z)[1], z)
        k = solve(graph, graph.values, 1e3)  # an implicit step of 1 ms
        return {n: z[n] + k[n] for n in z}

    if own:
        y = y | jax.jit(lambda z: jax.lax.fori_loop(0, 2000, settle, z))({n: y[n] for n in own})
    contributions, rates = jax.jit(lambda y: contributions_and_rates(machine, mounted_effect, y))(y)
    for slot in ("mover_friction", "cylinder_friction_force"):
        if slot in contributions:
            force = float(sum(contributions[slot]))
            # a friction in the forward direction alone is zero backward
            assert force * velocity > 0.0 or (effect is AsymmetricFriction and velocity < 0.0 and force == 0.0)
    for rate in rates.values():
        assert abs(float(rate)) < 1e-6


def test_states_are_passed_to_an_effect_by_name():
    brake = EddyBrake()
    z = types.SimpleNamespace(eddy_current=2.0)
    assert brake.mover_friction(None, z) == 1.0
    assert brake.rates(types.SimpleNamespace(piston_velocity=0.3), z)["eddy_current"] == pytest.approx(1e6)
