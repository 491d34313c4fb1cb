"""Reads the key `rig` of a configuration: a rig of the package by its name, one's own as file.py:ClassName."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from edhas_jax.config.yaml_with_lines import KeyPath, yaml_type
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.trusted_code import Trust
from edhas_jax.machine.own_rig import load_rig
from edhas_jax.machine.rig_base import Rig, RigError
from edhas_jax.machine.rigs import RIGS


def read_rig(value: Any, base_dir: Path, trust: Trust, add: Callable[[KeyPath, str], None]) -> type[Rig] | None:
    """The rig that a configuration names.

    Args:
        value: of the key `rig`; a class of the user needs no permission.
        base_dir: folder to which files are relative.
        trust: the user's code that may run.
        add: called with key and message of a problem.

    Returns:
        The class; None after a problem.
    """
    if isinstance(value, type) and issubclass(value, Rig):
        return value
    if value is None:
        add(("rig",), f"missing; one of {', '.join(RIGS)}")
    elif not isinstance(value, str):
        add(("rig",), f"a text belongs here, not {yaml_type(value)}; one of {', '.join(RIGS)}")
    elif value in RIGS:
        return RIGS[value]
    elif names_own_rig(value):
        try:
            return load_rig(value, base_dir, trust)
        except RigError as error:
            add(("rig",), str(error))
    else:
        add(("rig",), f"no rig `{value}`; {suggest(value, RIGS)}")
    return None


def names_own_rig(value: Any) -> bool:
    """Whether the key `rig` names a class of the user."""
    return isinstance(value, str) and (":" in value or value.endswith(".py"))


def own_keys(rig: type[Rig]) -> tuple[str, ...]:
    """The keys of the configuration of a rig of one's own."""
    return ("name", "rig", "effects", "parameters", *rig.drives, "simulation")
