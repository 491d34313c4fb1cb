"""The configuration files of the calibrated machine."""

import math
from pathlib import Path

from edhas_jax.config.machine_config import read_config
from edhas_jax.core.units import format_quantity
from edhas_jax.machine.parameters import find_parameter, get_parameter
from edhas_jax.machine.rigs import Rig
from studies import CONFIGS
from studies.paper.published_numbers import CALIBRATED_QUANTITIES, with_derived_parameters

NAMES = ("paper_calibrated", "paper_calibrated_step")
HEADS = {
    "paper_calibrated": """\
# yaml-language-server: $schema=edhas.schema.json
# The pump bench of Actuators 2022, 11(10), 281, with what the paper does not print set so that phase lag, amplitude
# loss, outlet pressure and flow over frequency are those of the paper's simulation (docs/paper.md).
# Written by: python -m studies.paper --calibrate
name: paper pump, calibrated
rig: pump_bench

effects: [lugre_friction, piston_leakage, entrained_air]

reference: {kind: sine, amplitude: 3.5 mm, frequency: 10 Hz}
""",
    "paper_calibrated_step": """\
# yaml-language-server: $schema=edhas.schema.json
# The whole actuator of Actuators 2022, 11(10), 281, with the pump of paper_calibrated.yaml: a step of 15 mm.
# Nothing here is fitted to the step: it is what the calibrated pump makes of it.
# Written by: python -m studies.paper --calibrate
name: paper step, calibrated
rig: actuator_system

effects: [lugre_friction, piston_leakage, entrained_air, karnopp_friction]

target: 15 mm
""",
}
TAILS = {
    "paper_calibrated": "\nsimulation:\n  duration: 0.5 s\n  sample_rate: 5 kHz\n",
    "paper_calibrated_step": "\nsimulation:\n  duration: 0.6 s\n  sample_rate: 2 kHz\n",
}


def machines(names: tuple[str, str], folder: Path = CONFIGS) -> tuple[Rig, Rig]:
    """The bench and the system of two configurations."""
    return tuple(read_config(folder / f"{name}.yaml").machine for name in names)


def quantities_of(machine: Rig) -> dict[str, float]:
    """The values of `CALIBRATED_QUANTITIES` in a bench, SI."""
    names = [o.name for o in CALIBRATED_QUANTITIES if o.name != "valve_opening_pressure"]
    out = {n: float(get_parameter(machine, n)) for n in names}
    seat = 0.25 * math.pi * out["valve_seat_diameter"] ** 2
    return out | {"valve_opening_pressure": float(get_parameter(machine, "valve_preload")) / seat}


def write_configs(bench: Rig, system: Rig, chosen: dict[str, float], folder: Path = CONFIGS) -> None:
    """Write both configurations, with four digits of each value."""
    values = {n: float(v) for n, v in with_derived_parameters(chosen).items()}
    for name, machine in zip(NAMES, (bench, system), strict=True):
        lines = ["parameters:"]
        for parameter, value in values.items():
            if parameter == "load_orifice_area" and machine is system:
                continue
            p, _ = find_parameter(machine, parameter)
            lines.append(f"  {parameter}: {format_quantity(value, p.unit)}")
        text = f"{HEADS[name]}\n" + "\n".join(lines) + "\n" + TAILS[name]
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
