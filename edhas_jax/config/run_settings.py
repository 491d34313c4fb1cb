"""The settings of a run, as the section `simulation:` of a configuration gives them."""

import numbers
from collections.abc import Callable, Mapping
from typing import Any

from edhas_jax.config.yaml_with_lines import KeyPath, yaml_type
from edhas_jax.core.names import nearest
from edhas_jax.core.structs import Parameter
from edhas_jax.core.units import UnitError, format_quantity, to_si
from edhas_jax.machine.parameters import ParameterError
from edhas_jax.simulation.integrator import DEFAULT_STEP, LARGEST_STEP
from edhas_jax.simulation.run import Precision, Simulation

SIMULATION_SETTINGS = {
    p.name: p
    for p in (
        Parameter("duration", 0.5, "s", (1e-6, 1e3), "length of the run (0.6 s for the system)", "", Simulation),
        Parameter("step", DEFAULT_STEP, "s", (1e-7, LARGEST_STEP), "time step", "", Simulation),
        Parameter("accuracy", 0.005, "-", (1e-5, 0.05), "wanted relative accuracy", "", Simulation),
        Parameter("sample_rate", 5e3, "Hz", (1.0, 1e7), "samples per second that are kept", "", Simulation),
    )
}
SETTING_NAMES = (*SIMULATION_SETTINGS, "precision")


def setting_text(p: Parameter, value: float) -> str:
    """A value of a parameter or setting as it is told: an accuracy in percent."""
    return f"{100.0 * value:.4g} %" if p is SIMULATION_SETTINGS["accuracy"] else format_quantity(value, p.unit)


def quantity_text(p: Parameter, value: Any) -> str:
    """The text of a quantity that is given as a text or a number.

    Raises:
        ParameterError: it is given as something else.
    """
    if isinstance(value, numbers.Real) and not isinstance(value, bool):
        return repr(float(value))
    if not isinstance(value, str):
        example = setting_text(p, p.default)
        missing = f"a value is missing; write for example {example}"
        other = f"a quantity such as {example} belongs here, not {yaml_type(value)}"
        raise ParameterError(missing if value is None else other)
    return value


def read_settings(
    given: Mapping[str, Any], overrides: Mapping[str, str], add: Callable[[KeyPath, str], None]
) -> Simulation:
    """The settings in a section `simulation:` with overrides on top; problems go to `add(key, what)`."""
    rows = {name: (("simulation", name), value) for name, value in given.items()}
    either = {"step", "accuracy"}
    if either <= set(given):
        add(("simulation", "accuracy"), "given together with `step`; give one of them")
    if either & set(overrides):
        rows = {n: row for n, row in rows.items() if n not in either}
    rows |= {name: ((f"--set {name}",), value) for name, value in overrides.items()}
    if either <= set(overrides):
        add(("--set accuracy",), "given together with `step`; give one of them")
    values: dict[str, Any] = {}
    for name, (key, value) in rows.items():
        try:
            values[name] = _precision(value) if name == "precision" else _setting(name, value)
        except (ParameterError, UnitError) as error:
            add(key, str(error))

    def key_of(*names: str) -> KeyPath:
        return next((rows[n][0] for n in names if n in rows), ("simulation",))

    settings = Simulation(**values)
    rate, step, duration = settings.sample_rate, settings.step, settings.duration
    told = format_quantity(rate, "Hz")
    if step and rate * step > 1.0 + 1e-9:
        most = f"at most {format_quantity(1.0 / step, 'Hz')} with a step of {format_quantity(step, 's')}"
        add(key_of("sample_rate", "step"), f"{told} asks for samples between steps; {most}")
    if duration and duration * rate < 1.0:
        least = f"at least {format_quantity(1.0 / rate, 's')}"
        add(key_of("duration"), f"{format_quantity(duration, 's')} is shorter than one sample at {told}; {least}")
    return settings


def _setting(name: str, value: Any) -> float:
    if name not in SIMULATION_SETTINGS:
        raise ParameterError(f"unknown key; {nearest(str(name), SETTING_NAMES)}")
    p = SIMULATION_SETTINGS[name]
    number = to_si(quantity_text(p, value), p.unit, setting_text(p, p.default))
    low, high = p.span
    if low <= number <= high:
        return number
    why = ""
    if name == "step" and number > high:
        why = ", too large for the physics: the ball of a check valve swings on its seat with a period of 0.56 ms"
    low, high, given = (setting_text(p, x) for x in (low, high, number))
    raise ParameterError(f"must lie in {low} … {high} ({p.doc}); got {given}{why}")


def _precision(value: Any) -> Precision:
    valid = [p.value for p in Precision]
    if isinstance(value, Precision) or isinstance(value, str) and value in valid:
        return Precision(value)
    wrong = f"no precision `{value}`" if isinstance(value, str) else f"a text belongs here, not {yaml_type(value)}"
    raise ParameterError(f"{wrong}; one of {', '.join(valid)}")
