"""No law of the generators is the library's law of its mechanism with other parameters, nor one of another law.

Each law acts along one path of signals. The parameters of the library's law are then fitted to what it contributes.
"""

import types

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import least_squares

from edhas_jax.core.structs import parameters, replace
from edhas_jax.machine.interface.slots import SLOTS
from edhas_jax.machine.rigs import ActuatorSystem, PumpBench, components_by_name
from studies.hidden_effects.generators.content import CONTENT
from studies.hidden_effects.generators.functions import arctan, wrapped
from studies.hidden_effects.generators.hidden_case import Split

INTERVAL, SAMPLES = 5e-5, 4000
TIME = INTERVAL * np.arange(SAMPLES)
MIN_DIFFERENCE = 0.015  # of a law from the best of the library's, rms over rms of what it contributes
LAWS = [law for split in Split for law in CONTENT[split].laws]


def path() -> dict[str, np.ndarray]:
    """Signals of a machine that moves, each with frequencies of its own, and its parameters."""

    def wave(mean, size, frequency, phase=0.0):
        return mean + size * np.sin(2.0 * np.pi * frequency * TIME + phase)

    x = wave(0.0, 4e-3, 10.0)
    v = 4e-3 * 2.0 * np.pi * 10.0 * np.cos(2.0 * np.pi * 10.0 * TIME)
    signals = {
        "time": TIME, "piston_position": x, "piston_velocity": v, "sliding_position": x, "sliding_velocity": v,
        "current": wave(0.0, 6.0, 10.0, 1.1) + wave(0.0, 1.0, 47.0), "voltage": wave(0.0, 12.0, 10.0, 1.5),
        "resistance": np.full(SAMPLES, 1.41), "viscosity": np.full(SAMPLES, 0.04),
        "chamber_pressure_a": wave(0.8e6, 0.65e6, 10.0, 1.3), "chamber_pressure_b": wave(0.8e6, 0.65e6, 10.0, -1.9),
        "chamber_pressure": wave(0.8e6, 0.65e6, 10.0, 1.3), "plunger_velocity": v, "pressure": wave(0.9e6, 0.78e6, 7.0),
        "outlet_pressure": wave(0.7e6, 0.45e6, 20.0), "accumulator_pressure": wave(0.2e6, 1e4, 10.0),
        "suction_pressure": wave(0.17e6, 3e4, 20.0), "load_drop": wave(0.3e6, 0.2e6, 20.0, 0.5),
        "lift": wave(0.4e-3, 0.45e-3, 10.0, 0.4), "lift_velocity": wave(0.0, 0.05, 10.0, 1.9),
        "pressure_drop": wave(0.0, 0.3e6, 10.0, 0.8), "valve_area": np.maximum(wave(4e-6, 4.4e-6, 10.0, 0.4), 0.0),
        "coupling_deflection": wave(0.0, 80e-6, 10.0, 0.3), "coupling_velocity": wave(0.0, 5e-3, 10.0, 1.9),
        "head_pressure": wave(0.6e6, 0.4e6, 5.0), "rod_pressure": wave(0.3e6, 0.2e6, 5.0, 2.0),
        "cylinder_position": wave(5e-3, 5e-3, 5.0), "cylinder_velocity": wave(0.0, 0.15, 5.0, 1.57),
        "cylinder_free_force": wave(0.0, 200.0, 5.0), "cylinder_friction_level": np.zeros(SAMPLES),
        "cylinder_velocity_at_step_start": wave(0.0, 0.15, 5.0, 1.57), "time_step": np.full(SAMPLES, INTERVAL),
        "oil_temperature": wave(313.0, 18.0, 5.0), "piston_area": np.full(SAMPLES, 1.13e-4),
        "cylinder_area": np.full(SAMPLES, 3.9e-4), "outlet_flow": wave(2e-5, 1.5e-5, 20.0, 0.5),
        "suction_line_flow": wave(2e-5, 1.5e-5, 20.0, 1.1),
    }  # fmt: skip
    phases = {"suction_lift_a": 0.4, "delivery_lift_a": 3.5, "suction_lift_b": 3.5, "delivery_lift_b": 0.4}
    signals |= {n: wave(0.4e-3, 0.45e-3, 10.0, phase) for n, phase in phases.items()}
    for machine in (PumpBench(), ActuatorSystem()):
        for component in components_by_name(machine).values():
            for p in parameters(type(component)):
                signals.setdefault(p.name, np.full(SAMPLES, float(p.default)))
    return signals


PATH = path()


class Instant(types.SimpleNamespace):
    """The signals that are known at a place in the equations, which tell what the place belongs to."""

    def values(self):
        return vars(self)


class Along:
    """What an effect contributes at its slots along the path, as a function of its free parameters; compiled once."""

    def __init__(self, kind):
        self.kind = kind
        self.free = [p for p in parameters(kind) if p.plausible is not None]
        self._run = jax.jit(self._contributions)

    def _contributions(self, values):
        effect = replace(self.kind(), **dict(zip((p.name for p in self.free), values, strict=True)))
        slots = [slot.name for slot in self.kind.slots if slot.name != "oil_gas"]

        def at(state, signals):
            known = {n: v for n, v in signals.items() if "_lift_" not in n}  # each is set after its valve
            z, out = types.SimpleNamespace(**state), {}
            for name in sorted(slots, key=lambda n: "resistance" not in n):
                before = {"suction_lift_a": signals["suction_lift_a"]} if name == "delivery_valve_area" else {}
                out[name] = jnp.asarray(getattr(effect, name)(Instant(**known | before), z), float)
                known[name] = out[name]  # the equations set the resistance of a line as a signal
            rates = effect.rates(Instant(**signals | known), z)
            return {n: state[n] + INTERVAL * rates[n] for n in state}, out

        start = {n: jnp.asarray(declared.initial) for n, declared in self.kind.states.items()}
        return jax.lax.scan(at, start, {n: jnp.asarray(v) for n, v in PATH.items()})[1]

    def __call__(self, values) -> dict[str, np.ndarray]:
        found = {n: np.asarray(v) for n, v in self._run(jnp.asarray(values, float)).items()}
        return {n: v - 1.0 if SLOTS[n].unit == "-" else v for n, v in found.items()}


def middle(p) -> float:
    low, high = p.plausible
    return float(np.sqrt(low * high)) if low > 0.0 else 0.6 * high


def difference(law: Along, library: Along) -> float:
    """The smallest rms difference of the library's law from a law, over the rms of the law, over its slots."""
    wanted = law([middle(p) for p in law.free])
    scales = {n: np.sqrt(np.mean(np.square(v))) for n, v in wanted.items()}
    if wanted.keys() != {slot.name for slot in library.kind.slots if slot.name != "oil_gas"}:
        return 1.0
    centre = np.array([middle(p) for p in library.free])
    positive = np.array([p.plausible[0] > 0.0 for p in library.free])

    def values(x):
        return np.where(positive, centre * np.exp(np.clip(x, -8.0, 8.0)), centre * (1.0 + x))

    def residual(x):
        found = library(values(x))
        rows = [(found[n] - wanted[n]) / scales[n] for n in wanted if scales[n] > 0.0]
        return np.nan_to_num(np.concatenate(rows), nan=1e3, posinf=1e3, neginf=-1e3) / np.sqrt(SAMPLES * len(rows))

    starts = [np.zeros(len(centre)), np.full(len(centre), 0.7), np.full(len(centre), -1.5)]
    return min(float(np.sqrt(2.0 * least_squares(residual, x, max_nfev=40).cost)) for x in starts)


@pytest.mark.parametrize("mechanism", sorted({law.mechanism for law in LAWS}, key=lambda kind: kind.id))
def test_no_law_is_the_librarys_with_other_parameters(mechanism):
    library = Along(mechanism)
    again = library([0.8 * middle(p) if p.plausible[0] > 0 else middle(p) for p in library.free])
    assert all(np.isfinite(v).all() for v in again.values())
    for law in LAWS:
        if law.mechanism is mechanism:
            assert difference(Along(law.kind), library) > MIN_DIFFERENCE, law.id


def test_functions_of_their_own():
    x = np.linspace(-50.0, 50.0, 20001)
    np.testing.assert_allclose(arctan(x), np.arctan(x), atol=2e-9)
    angle = np.linspace(-9.0, 9.0, 4001)
    away = np.abs(np.cos(0.5 * angle)) > 1e-3
    np.testing.assert_allclose(wrapped(angle)[away], np.angle(np.exp(1j * angle))[away], atol=1e-5)
