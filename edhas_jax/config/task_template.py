"""Write a commented task to start from: a sweep, a sizing, a sensitivity analysis; each is small, for a first try."""

from pathlib import Path

from edhas_jax.config.machine_template import write_beginning
from edhas_jax.core.literal_text import yaml_text

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


def task_template(kind: str, name: str) -> str:
    """The text of a task.

    Args:
        kind: one of `TASKS`.
        name: its title.
    """
    return TASKS[kind].format(machine=MACHINE.format(name=yaml_text(name)))


def write_task_template(kind: str, path: Path, overwrite: bool = False) -> Path:
    """Write the text of a task into a file.

    Raises:
        ResultFileError: the file exists and `overwrite` is false, or cannot be written.
    """
    return write_beginning(task_template(kind, path.stem), path, overwrite)
