"""Commented files to start from: a machine with every parameter, a rig of one's own with its configuration, tasks."""

import string
from pathlib import Path

from edhas_jax.config.result_files import ResultFileError, report_write_errors, require_new
from edhas_jax.core.atomic_file import atomic_write
from edhas_jax.core.literal_text import one_line, yaml_text
from edhas_jax.core.units import exact_quantity
from edhas_jax.machine.effects import EntrainedAir, KarnoppFriction, LugreFriction, PistonLeakage
from edhas_jax.machine.parameters import COMPONENT_KINDS, format_span, list_parameters, short_names
from edhas_jax.machine.rigs import ActuatorBench, ActuatorSystem, PumpBench, Rig, components_by_name

# what a user calls each rig, its nominal machine, what drives it, the parameter that is set, and how long it runs
_SINE = "reference: {kind: sine, amplitude: 3.5 mm, frequency: 10 Hz}"
_STEP = "target: 15 mm  # a step at once; {kind: step, step_size: 15 mm, step_time: 0.1 s} waits first"
_OF_PUMP = (LugreFriction, PistonLeakage, EntrainedAir)
BEGINNINGS: dict[str, tuple[type[Rig], tuple, str, str, str]] = {
    "actuator": (ActuatorBench, (LugreFriction,), _SINE, "coil_resistance", "0.5 s"),
    "pump": (PumpBench, _OF_PUMP, _SINE, "piston_clearance", "0.5 s"),
    "system": (ActuatorSystem, (*_OF_PUMP, KarnoppFriction), _STEP, "piston_clearance", "0.6 s"),
}
TASKS = ("sweep", "size", "sensitivity")
FOLDER = Path(__file__).parents[1] / "templates"


def filled(file: str, **values: str) -> str:
    """The text of a template of the package.

    Args:
        file: its name.
        values: what stands for each `$name` in it.
    """
    return string.Template((FOLDER / file).read_text(encoding="utf-8")).substitute(values)


def machine_template(kind: str, name: str) -> str:
    """The text of a configuration.

    Args:
        kind: one of `BEGINNINGS`.
        name: its title.
    """
    rig, effects, drive, first, duration = BEGINNINGS[kind]
    machine = rig(effects=tuple(effect() for effect in effects))
    names, rows = short_names(machine), list_parameters(machine)
    kinds = {section: COMPONENT_KINDS[section] for section in COMPONENT_KINDS if hasattr(machine, section)}
    others = [f"# {section}: {{kind: KIND}}  # one of {', '.join(of)}" for section, of in kinds.items()
              if not drive.startswith(section)]  # fmt: skip
    lines = []
    for path in (p for p in components_by_name(machine) if p not in COMPONENT_KINDS):
        own = [(p, value) for p, value, owner in rows if owner == path]
        lines += [f"  # {path}"] if own else []
        for p, value in own:
            mark = "" if p.name == first else "# "
            about = f"{one_line(p.doc)} ({format_span(p)})"
            lines.append(f"  {mark}{names[path, p.name]}: {exact_quantity(value, p.unit)}  # {about}")
    return filled(
        "machine.yaml", about=rig.__doc__.strip().splitlines()[0], name=yaml_text(name), rig=rig.name, drive=drive,
        effects=", ".join(effect.id for effect in effects), others="\n".join(others), parameters="\n".join(lines),
        duration=duration,
    )  # fmt: skip


def task_template(kind: str, name: str) -> str:
    """The text of a task, which is small, for a first try.

    Args:
        kind: one of `TASKS`.
        name: its title.
    """
    return filled(f"{kind}.yaml", name=yaml_text(name))


def write_beginning(kind: str, path: Path, overwrite: bool = False) -> Path:
    """Write the text of a configuration or of a task into a file.

    Args:
        kind: one of `BEGINNINGS` or of `TASKS`.
        path: the file; its name is the title.
        overwrite: whether a file that exists is replaced.

    Raises:
        ResultFileError: the file exists and `overwrite` is false, or cannot be written.
    """
    _write({path: (task_template if kind in TASKS else machine_template)(kind, path.stem)}, overwrite)
    return path


def write_rig_template(path: Path, overwrite: bool = False) -> tuple[Path, Path, str]:
    """Write the file of a rig and a configuration beside it.

    Args:
        path: the file of the rig, ending in .py.
        overwrite: whether files that exist are replaced.

    Returns:
        The two files, and the name of the class.

    Raises:
        ResultFileError: the name is not that of a Python file, a file exists and `overwrite` is false, or cannot be
            written.
    """
    if path.suffix != ".py" or not path.stem.isidentifier():
        raise ResultFileError(f"{path}: the name of a Python file belongs here, such as my_rig.py")
    name = "".join(word.capitalize() for word in path.stem.split("_"))
    own, configuration = {"name": name, "stem": path.stem}, path.with_suffix(".yaml")
    _write({path: filled("rig.py.txt", **own), configuration: filled("rig.yaml", **own)}, overwrite)
    return path, configuration, name


def _write(texts: dict[Path, str], overwrite: bool) -> None:
    """Write texts by file, in one folder.

    Raises:
        ResultFileError: a file exists and `overwrite` is false, or cannot be written.
    """
    for path in texts:
        require_new(path, overwrite, "file")
    for path, text in texts.items():
        with report_write_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            with atomic_write(path) as file:
                file.write_text(text, encoding="utf-8")
