"""Write a commented rig of one's own to start from, and its configuration."""

from pathlib import Path

from edhas_jax.config.result_files import ResultFileError, report_write_errors
from edhas_jax.core.atomic_file import atomic_write

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
    texts = {path: _RIG, path.with_suffix(".yaml"): _CONFIGURATION}
    for file in texts:
        if file.exists() and not overwrite:
            raise ResultFileError(f"{file}: exists already; nothing was written. Name another file or add --overwrite")
    with report_write_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        for file, text in texts.items():
            with atomic_write(file) as temporary:
                temporary.write_text(text.format(name=name, stem=path.stem), encoding="utf-8")
    return path, path.with_suffix(".yaml"), name
