"""The section `simulation` of a configuration: duration, step or accuracy, sample rate and precision of a run."""

import dataclasses
import numbers
from collections.abc import Callable, Mapping
from typing import Any

from edhas_jax.config.yaml_with_lines import KeyPath, yaml_type
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.structs import Parameter
from edhas_jax.core.units import UnitError, format_quantity, to_si
from edhas_jax.machine.parameters import ParameterError
from edhas_jax.machine.rig_base import Rig
from edhas_jax.simulation.integrator import DEFAULT_STEP, LARGEST_STEP
from edhas_jax.simulation.run_settings import Precision, Simulation

SIMULATION_SETTINGS = {
    p.name: p
    for p in (
        Parameter("duration", 0.5, "s", (1e-6, 1e3), "length of the run (0.6 s for the system)", "", Simulation),
        Parameter("step", DEFAULT_STEP, "s", (1e-7, LARGEST_STEP), "time step", "", Simulation),
        Parameter("accuracy", 0.005, "-", (1e-5, 0.05), "requested relative accuracy", "", Simulation),
        Parameter("sample_rate", 5e3, "Hz", (1.0, 1e7), "stored samples per second", "", Simulation),
    )
}
SETTING_NAMES = (*SIMULATION_SETTINGS, "precision")
STEP_OR_ACCURACY = frozenset(("step", "accuracy"))  # only one of the two may be given
MAX_SAMPLES = 5_000_000  # of a run; each takes about 1 kB
CHECK_VALVE_PERIOD = "0.56 ms"  # of the ball of a nominal check valve on its seat


def setting_text(p: Parameter, value: float) -> str:
    """Format an SI value of a parameter or setting with its unit; the accuracy is shown in percent."""
    return f"{100.0 * value:.4g} %" if p is SIMULATION_SETTINGS["accuracy"] else format_quantity(value, p.unit)


def quantity_text(p: Parameter, value: Any) -> str:
    """Check that a value from a configuration is a text or a number, and return it as text.

    Raises:
        ParameterError: the value is missing or of another type.
    """
    if isinstance(value, numbers.Real) and not isinstance(value, bool):
        return repr(float(value))
    if not isinstance(value, str):
        example = setting_text(p, p.default)
        if value is None:
            raise ParameterError(f"a value is missing; write for example {example}")
        raise ParameterError(f"a quantity such as {example} belongs here, not {yaml_type(value)}")
    return value


def read_settings(
    given: Mapping[str, Any], overrides: Mapping[str, str], add: Callable[[KeyPath, str], None],
    rig: type[Rig] = Rig,
) -> Simulation:  # fmt: skip
    """Read the settings of a run.

    Args:
        given: the section `simulation` of a configuration.
        overrides: settings from the command line by name; they replace those of the section.
        add: called with key and message of each problem.
        rig: the machine; its time step says which times and rates are usual.

    Returns:
        The settings; those with a problem have their defaults.
    """
    entries = {name: (("simulation", name), value) for name, value in given.items()}
    if set(given) >= STEP_OR_ACCURACY:
        add(("simulation", "accuracy"), "given together with `step`; give one of them")
    if STEP_OR_ACCURACY & set(overrides):
        entries = {name: entry for name, entry in entries.items() if name not in STEP_OR_ACCURACY}
    entries |= {name: ((f"--set {name}",), value) for name, value in overrides.items()}
    if set(overrides) >= STEP_OR_ACCURACY:
        add(("--set accuracy",), "given together with `step`; give one of them")
    values: dict[str, Any] = {}
    for name, (key, value) in entries.items():
        try:
            values[name] = _precision(value) if name == "precision" else _setting(name, value, rig)
        except (ParameterError, UnitError) as error:
            add(key, str(error))

    def first_key(*names: str) -> KeyPath:
        return next((entries[n][0] for n in names if n in entries), ("simulation",))

    settings = Simulation(**values)
    settings = dataclasses.replace(settings, sample_rate=settings.rate(rig))
    rate, step, duration = settings.sample_rate, settings.step, settings.duration
    rate_text = format_quantity(rate, "Hz")
    if step and rate * step > 1.0 + 1e-9:
        limit = f"at most {format_quantity(1.0 / step, 'Hz')} with a step of {format_quantity(step, 's')}"
        add(first_key("sample_rate", "step"), f"{rate_text} asks for samples between steps; {limit}")
    if (duration or rig.duration) * rate > MAX_SAMPLES:
        limit = f"a run has at most {MAX_SAMPLES:,} samples; {(duration or rig.duration) * rate:,.0f} are asked for"
        add(first_key("sample_rate", "duration"), limit)
    if duration and duration * rate < 1.0:
        limit = f"at least {format_quantity(1.0 / rate, 's')}"
        duration_text = format_quantity(duration, "s")
        add(first_key("duration"), f"{duration_text} is shorter than one sample at {rate_text}; {limit}")
    return settings


def setting_span(name: str, rig: type[Rig] = Rig) -> tuple[float, float]:
    """The smallest and the largest value (SI) of a setting; times are in proportion to the time step of the rig."""
    low, high = SIMULATION_SETTINGS[name].span
    if name == "accuracy":
        return low, high
    scale = rig.time_step / Rig.time_step
    return (low / scale, high / scale) if name == "sample_rate" else (low * scale, high * scale)


def _setting(name: str, value: Any, rig: type[Rig]) -> float:
    """The SI value of a setting.

    Raises:
        ParameterError: the name is unknown or the value lies outside the allowed range.
        UnitError: the value is not a quantity in a unit of this kind.
    """
    if name not in SIMULATION_SETTINGS:
        raise ParameterError(f"unknown key; {suggest(str(name), SETTING_NAMES)}")
    p = SIMULATION_SETTINGS[name]
    number = to_si(quantity_text(p, value), p.unit, setting_text(p, p.default))
    low, high = setting_span(name, rig)
    if low <= number <= high * (1.0 + 1e-12):
        return number
    reason = ""
    if name == "step" and number > high and not rig.is_own:
        reason = f", too large: the ball of a check valve oscillates on its seat with a period of {CHECK_VALVE_PERIOD}"
    low, high, given = (setting_text(p, x) for x in (low, high, number))
    raise ParameterError(f"must lie in {low} … {high} ({p.doc}); got {given}{reason}")


def _precision(value: Any) -> Precision:
    valid = [p.value for p in Precision]
    if isinstance(value, Precision) or isinstance(value, str) and value in valid:
        return Precision(value)
    if isinstance(value, str):
        problem = f"no precision `{value}`"
    else:
        problem = f"a text belongs here, not {yaml_type(value)}"
    raise ParameterError(f"{problem}; one of {', '.join(valid)}")
