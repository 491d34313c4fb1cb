"""The section `simulation` of a configuration: duration, step or accuracy, sample rate and precision of a run."""

import dataclasses
from collections.abc import Mapping

from edhas_jax.config.declared_keys import Key, Keys, choice, quantity
from edhas_jax.config.document import Entry
from edhas_jax.core.structs import Parameter
from edhas_jax.core.units import format_quantity
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
STEP_OR_ACCURACY = frozenset(("step", "accuracy"))  # only one of the two may be given
MAX_SAMPLES = 5_000_000  # of a run; each takes about 1 kB


def simulation_keys(rig: type[Rig] = Rig) -> Keys:
    """The keys of the section; the time step of the rig says which times and rates are usual."""
    reason = f", too large: {rig.fastest}" if rig.fastest else ""
    defaults = {"step": "20 µs without `accuracy`", "accuracy": "none"}
    found = {}
    for name, p in SIMULATION_SETTINGS.items():
        p = dataclasses.replace(p, span=setting_span(name, rig))
        kind = quantity(p, "%" * (name == "accuracy"), reason * (name == "step"))
        found[name] = Key(kind, p.doc, shown=defaults.get(name, format_quantity(p.default, p.unit)))
    return Keys(found | {"precision": Key(choice(Precision, "precision"), "of all numbers")}, "{duration: 0.5 s}")


def read_settings(section: Entry, overrides: Mapping[str, str], rig: type[Rig] = Rig) -> Simulation:
    """Read the settings of a run.

    Args:
        section: the section `simulation` of a configuration.
        overrides: settings from the command line by name; they replace those of the section.
        rig: the machine; its time step says which times and rates are usual.

    Returns:
        The settings; those with a problem have their defaults.
    """
    keys = simulation_keys(rig)
    entries = section.mapping(keys.example)
    keys.refuse_others(entries)
    overriding = {name: Entry(value, (f"--set {name}",), section.problems) for name, value in overrides.items()}
    for given in (entries, overriding):
        if given.keys() >= STEP_OR_ACCURACY:
            given["accuracy"].add("given together with `step`; give one of them")
    if STEP_OR_ACCURACY & overriding.keys():
        entries = {name: entry for name, entry in entries.items() if name not in STEP_OR_ACCURACY}
    entries |= overriding
    values = {name: keys.keys[name].kind.read(entry) for name, entry in entries.items() if name in keys.keys}
    settings = Simulation(**{name: value for name, value in values.items() if value is not None})
    settings = dataclasses.replace(settings, sample_rate=settings.rate(rig))
    rate, step, duration = settings.sample_rate, settings.step, settings.duration
    rate_text = format_quantity(rate, "Hz")

    def add(message: str, *names: str) -> None:
        next((entries[n] for n in names if n in entries), section).add(message)

    if step and rate * step > 1.0 + 1e-9:
        limit = f"at most {format_quantity(1.0 / step, 'Hz')} with a step of {format_quantity(step, 's')}"
        add(f"{rate_text} asks for samples between steps; {limit}", "sample_rate", "step")
    if (count := (duration or rig.duration) * rate) > MAX_SAMPLES:
        limit = f"a run has at most {MAX_SAMPLES:,} samples; {count:,.0f} are asked for"
        add(limit, "sample_rate", "duration")
    if duration and duration * rate < 1.0:
        shortest, given = (format_quantity(x, "s") for x in (1.0 / rate, duration))
        add(f"{given} is shorter than one sample at {rate_text}; at least {shortest}", "duration")
    return settings


def setting_span(name: str, rig: type[Rig] = Rig) -> tuple[float, float]:
    """The smallest and the largest value (SI) of a setting; times are in proportion to the time step of the rig."""
    low, high = SIMULATION_SETTINGS[name].span
    if name == "accuracy":
        return low, high
    scale = rig.time_step / Rig.time_step
    return (low / scale, high / scale) if name == "sample_rate" else (low * scale, high * scale)
