"""Commented files to start from: a machine with every parameter, a rig of one's own with its configuration, tasks."""

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
MACHINE = """\
name: {name}
machine: # or a configuration of your own: `base: my_pump.yaml`, as `edhas new pump` writes it
  rig: pump_bench
  effects: [lugre_friction, piston_leakage, entrained_air]
parameters: {{load_orifice_area: 1 mm²}} # what differs from it; edhas parameters lists all
"""
TASKS = {
    "sweep": """\
# A sweep: many designs of a machine, each to its periodic state. Run it with: edhas sweep FILE
{machine}
sweep:
  kind: grid # every combination; or lhs or sobol, with `count: 1000` and ranges without a count
  parameters:
    piston_clearance: {{from: 5 um, to: 40 um, count: 8}} # `spacing: log` for even ratios
    frequency: {{values: [10 Hz, 20 Hz, 30 Hz]}}

batch: {{step: 50 us, tolerance: 0.1 %, max_cycles: 16}} # of time; of flow, power and stroke from cycle to cycle
""",
    "size": """\
# A sizing: the dimensions that serve an objective best within limits. Run it with: edhas size FILE
{machine}
points: # limits hold at every one, the objective is the mean
  frequency: [10 Hz, 20 Hz]

free: # what may change, and within which bounds it can be made
  piston_diameter: {{from: 8 mm, to: 16 mm}}
  amplitude: {{from: 2 mm, to: 4.5 mm}}
  piston_clearance: {{from: 8 um, to: 40 um, spacing: log}}

objective: # weights: one per cent of this counts as much as one per cent of that; also `minimise`
  maximise: {{mean_flow: 1, overall_efficiency: 1}}
# front: 8 # trades the two off instead of weighing them

constraints: # that the supply voltage is not clipped is always one
  rms_current: {{max: 6 A}}
  pressure_ripple: {{max: 2 MPa}}

starts: 8 # of the search
iterations: 10 # of each
""",
    "sensitivity": """\
# A sensitivity analysis: what matters at which operating point. Run it with: edhas sensitivity FILE
{machine}
points: # a grid of operating points
  frequency: [10 Hz, 30 Hz]

metrics: [mean_flow, overall_efficiency]
# local: [piston_clearance] # elasticities are taken of every parameter unless some are listed here

ranges: # of the global analysis
  piston_diameter: {{from: 11 mm, to: 13 mm}}
  piston_clearance: {{from: 5 um, to: 40 um}}
  coulomb_friction: {{from: 2 N, to: 5 N}}
samples: 64 # Sobol: times (parameters + 2) designs at each operating point; 0 leaves it out
trajectories: 10 # Morris: times (parameters + 1); 0 leaves it out

batch: {{step: 50 us, tolerance: 0.1 %}}
""",
}
_RIG = '''"""A machine of one's own: one tank that a pump fills and a hole drains. Change it into yours."""

import jax.numpy as jnp

from edhas_jax import Rig, drive, par, signal, slot, state


class {name}(Rig):
    """A pump fills a tank, which drains through a hole."""

    time_step, duration = 0.1, 300.0  # s: the step with which a run begins, and its usual length

    # What drives it from outside: a configuration gives a record, a sine, a step or a chirp in its place.
    pump_flow = drive("m^3/s", "flow of the pump", 2e-4)

    # Numbers: default in SI, unit, allowed range, meaning. Parts with numbers of their own are attributes as well:
    # `oil: Oil = Oil()` is one of the package, a class with the decorator edhas_jax.struct one of yours.
    area: float = par(0.05, "m^2", (1e-4, 10.0), "area of the tank")
    hole_area: float = par(1e-4, "m^2", (1e-8, 1.0), "area of the hole")
    start_level: float = par(0.1, "m", (0.0, 10.0), "level at the start")

    # States: unit, meaning, start: a number, or the name of a parameter, which a fit may then look for.
    level = state("m", "level of the water", "start_level")

    # What else the equations compute and a sensor may measure.
    outflow = signal("m^3/s", "flow through the hole", "L/min")

    # Where an effect may act: part of the machine, unit, meaning, signals over which its law may be drawn, usual size.
    loss = slot("tank", "m^3/s", "water that leaves the tank, but not by the hole", "level", 1e-5)

    def equations(self, y, s):
        """y has the states, s parameters, drives and states by name; return the rate of every state."""
        s.set(outflow=self.hole_area * jnp.sqrt(2.0 * 9.81 * jnp.maximum(y.level, 1e-6)))
        return {{"level": (s.pump_flow - s.outflow - self.loss.apply(0.0, s)) / self.area}}
'''
_CONFIGURATION = """# Run it with: edhas simulate {stem}.yaml --rig {stem}.py:{name}
rig: {stem}.py:{name}
pump_flow: 8 L/min   # or {{kind: recorded, file: bench.csv, column: q}}, or a sine, a step, a chirp
parameters:
  hole_area: 120 mm^2
simulation:
  duration: 300 s
  sample_rate: 1 Hz
"""


def machine_template(kind: str, name: str) -> str:
    """The text of a configuration.

    Args:
        kind: one of `BEGINNINGS`.
        name: its title.
    """
    rig, effects, drive, first, duration = BEGINNINGS[kind]
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
            mark = "" if p.name == first else "# "
            about = f"{one_line(p.doc)} ({format_span(p)})"
            lines.append(f"  {mark}{names[path, p.name]}: {exact_quantity(value, p.unit)}  # {about}")
    lines += ["", "simulation:", f"  duration: {duration}", "  sample_rate: 5 kHz",
              "  # step: 20 µs        # chosen by the program where it is left out",
              "  # accuracy: 0.5 %    # or: halve the step until every signal is so accurate", ""]  # fmt: skip
    return "\n".join(lines)


def task_template(kind: str, name: str) -> str:
    """The text of a task, which is small, for a first try.

    Args:
        kind: one of `TASKS`.
        name: its title.
    """
    return TASKS[kind].format(machine=MACHINE.format(name=yaml_text(name)))


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
    _write({path: _RIG.format(**own), configuration: _CONFIGURATION.format(**own)}, overwrite)
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
