"""Write a commented configuration to start from: every parameter with its default, meaning and allowed range."""

from pathlib import Path

from edhas_jax.config.result_files import ResultFileError, report_write_errors
from edhas_jax.core.atomic_file import atomic_write
from edhas_jax.core.literal_text import one_line, yaml_text
from edhas_jax.core.units import exact_quantity
from edhas_jax.machine.effects import EntrainedAir, KarnoppFriction, LugreFriction, PistonLeakage
from edhas_jax.machine.parameters import COMPONENT_KINDS, format_span, list_parameters, short_names
from edhas_jax.machine.rigs import ActuatorBench, ActuatorSystem, PumpBench, Rig, components_by_name

# what a user calls each rig, its nominal machine, and what drives it
BEGINNINGS: dict[str, tuple[type[Rig], tuple, str]] = {
    "actuator": (ActuatorBench, (LugreFriction,), "reference: {kind: sine, amplitude: 3.5 mm, frequency: 10 Hz}"),
    "pump": (
        PumpBench, (LugreFriction, PistonLeakage, EntrainedAir),
        "reference: {kind: sine, amplitude: 3.5 mm, frequency: 10 Hz}",
    ),
    "system": (
        ActuatorSystem, (LugreFriction, PistonLeakage, EntrainedAir, KarnoppFriction),
        "target: 15 mm  # a step at once; {kind: step, step_size: 15 mm, step_time: 0.1 s} waits first",
    ),
}  # fmt: skip
FIRST = {"actuator": "coil_resistance", "pump": "piston_clearance", "system": "piston_clearance"}
DURATION = {"actuator": "0.5 s", "pump": "0.5 s", "system": "0.6 s"}


def machine_template(kind: str, name: str) -> str:
    """The text of a configuration.

    Args:
        kind: one of `BEGINNINGS`.
        name: its title.
    """
    rig, effects, drive = BEGINNINGS[kind]
    machine = rig(effects=tuple(effect() for effect in effects))
    names, rows = short_names(machine), list_parameters(machine)
    lines = [
        f"# {rig.__doc__.strip().splitlines()[0]}",
        "# Run it with: edhas simulate FILE. Completion in an editor: edhas schema > edhas.schema.json",
        f"name: {yaml_text(name)}",
        f"rig: {rig.name}",
        "",
        "# Effects, each of which can be taken out; `edhas effects` lists all, your own are my_effects.py:ClassName.",
        f"effects: [{', '.join(effect.id for effect in effects)}]",
        "",
        drive,
    ]
    for section in (s for s in COMPONENT_KINDS if hasattr(machine, s) and not drive.startswith(s)):
        lines.append(f"# {section}: {{kind: KIND}}  # one of {', '.join(COMPONENT_KINDS[section])}")
    lines += ["", "# What is not named keeps its default, which stands here; take away the # to change it."]
    lines.append("parameters:")
    for path in (p for p in components_by_name(machine) if p not in COMPONENT_KINDS):
        own = [(p, value) for p, value, owner in rows if owner == path]
        lines += [f"  # {path}"] if own else []
        for p, value in own:
            mark = "" if p.name == FIRST[kind] else "# "
            about = f"{one_line(p.doc)} ({format_span(p)})"
            lines.append(f"  {mark}{names[path, p.name]}: {exact_quantity(value, p.unit)}  # {about}")
    lines += ["", "simulation:", f"  duration: {DURATION[kind]}", "  sample_rate: 5 kHz",
              "  # step: 20 µs        # chosen by the program where it is left out",
              "  # accuracy: 0.5 %    # or: halve the step until every signal is so accurate", ""]  # fmt: skip
    return "\n".join(lines)


def write_machine_template(kind: str, path: Path, overwrite: bool = False) -> Path:
    """Write the text of a configuration into a file.

    Raises:
        ResultFileError: the file exists and `overwrite` is false, or cannot be written.
    """
    return write_beginning(machine_template(kind, path.stem), path, overwrite)


def write_beginning(text: str, path: Path, overwrite: bool = False) -> Path:
    """Write a text to start from into a file.

    Raises:
        ResultFileError: the file exists and `overwrite` is false, or cannot be written.
    """
    if path.exists() and not overwrite:
        raise ResultFileError(f"{path}: exists already; nothing was written. Name another file or add --overwrite")
    with report_write_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path) as file:
            file.write_text(text, encoding="utf-8")
    return path
