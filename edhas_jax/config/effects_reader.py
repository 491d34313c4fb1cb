"""Reads the entries of the list `effects` of a configuration: effects of the library or of the user, tabulated laws."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from edhas_jax.config.law_file import LAW_SUFFIXES, law_from_mapping, read_law_file
from edhas_jax.config.yaml_with_lines import yaml_type
from edhas_jax.core import structs
from edhas_jax.core.trusted_code import TrustedCode
from edhas_jax.core.units import UnitError, to_si
from edhas_jax.machine.effects import Effect, EffectError
from edhas_jax.machine.effects.loading import load_effect
from edhas_jax.machine.rig_base import Rig


def read_effect(spec: Any, base_dir: Path, trust: TrustedCode, rig: type[Rig] | None = None) -> Effect:
    """The effect that an entry names.

    Args:
        spec: id of an effect of the library, "file.py:ClassName", an effect class, the file of a tabulated law
            ("curve.yaml"), or a mapping with the keys of such a file.
        base_dir: folder to which files are relative.
        trust: the user's code that may run; a tabulated law is no code.
        rig: the rig of one's own on which a tabulated law acts; None for the rigs of the package.

    Raises:
        LawError: a tabulated law has problems; all are listed.
        EffectError: it cannot be loaded.
        UnitError: a parameter is declared in an unknown unit.
    """
    if isinstance(spec, Mapping):
        return law_from_mapping(spec, rig).effect()
    if isinstance(spec, str) and spec.endswith(LAW_SUFFIXES):
        return read_law_file(base_dir / spec, rig).effect()
    if isinstance(spec, type) and issubclass(spec, Effect):
        cls = spec
    elif isinstance(spec, str):
        cls = load_effect(spec, base_dir, trust)
    else:
        raise EffectError(
            f"the id of an effect, file.py:ClassName or the file of a tabulated law belongs here, not {yaml_type(spec)}"
        )
    for p in structs.parameters(cls):
        try:
            to_si("1" if p.unit == "-" else f"1 {p.unit}", p.unit)
        except UnitError:
            raise UnitError(f'{cls.__name__}.{p.name} is declared in "{p.unit}", which is not a unit') from None
    return cls()
