"""Identity of a sweep: everything its numbers depend on, so that a folder is only resumed by the same sweep."""

import dataclasses
import functools
import hashlib
import importlib.metadata
import json
import os
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jaxlib
import numpy as np

import edhas_jax
from edhas_jax.compiler import engines
from edhas_jax.compiler.engines import serving_engine
from edhas_jax.config.writer import config_kind, dump_config
from edhas_jax.core import runtime
from edhas_jax.core.source_location import is_users_code
from edhas_jax.core.trusted_code import TrustedCode
from edhas_jax.core.units import format_quantity
from edhas_jax.design.sweep.config import Sweep
from edhas_jax.machine.effects.loading import content_hash_of, trusted_as_loaded
from edhas_jax.machine.effects.tabulated_law import table_of
from edhas_jax.machine.parameters import component_kinds, find_parameter, list_parameters
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.run import Simulation

# the packages whose code determines the metrics of a design
MODEL_PACKAGES = ("core", "compiler", "machine", "simulation", "config", "design/batch")


def sweep_identity(sweep: Sweep, engine: str = "") -> dict[str, Any]:
    """Everything the results depend on, as plain data: parameters, effects, designs, settings and versions.

    Args:
        sweep: the sweep.
        engine: as of `versions`.
    """
    varied = {(path, p.name) for p, path in (find_parameter(sweep.machine, name) for name in sweep.designs)}
    digest = hashlib.sha256()
    for name, values in sweep.designs.items():
        digest.update(name.encode() + np.ascontiguousarray(values, "<f8").tobytes())
    settings = dataclasses.asdict(sweep.settings)
    return {
        "rig": sweep.machine.name,
        "kinds": {s: config_kind(sweep.machine, s) for s in component_kinds(sweep.machine)},
        "effects": effect_code(sweep.machine),
        "parameters": {
            f"{path}.{p.name}": [float(v), p.unit]
            for p, v, path in list_parameters(sweep.machine)
            if (path, p.name) not in varied
        },
        "designs": {"count": len(sweep), "names": list(sweep.designs), "sha256": digest.hexdigest()},
        "settings": settings | {"precision": sweep.settings.precision.value},
        "versions": versions(engine),
    }


def identity_hash(identity: Mapping[str, Any]) -> str:
    """A short hash of an identity."""
    return hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()[:16]


def machine_text(sweep: Sweep) -> str:
    """The machine of a sweep as configuration text with every parameter."""
    return dump_config(sweep.machine, Simulation(precision=sweep.settings.precision))


def versions(engine: str = "") -> dict[str, str]:
    """The versions that determine the results, with a hash of the model's own code.

    Args:
        engine: name of the engine that runs the designs; empty: the one that is asked first for a loop.
    """
    return {
        "edhas_jax": edhas_jax.__version__,
        "model code": runtime.code_hash(MODEL_PACKAGES)[:12],
        "jax": jax.__version__,
        "jaxlib": jaxlib.__version__,
        "llvmlite": _installed_version("llvmlite"),
        "engine": engine or serving_engine().name,
    }


@functools.cache
def _installed_version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "none"


def device(engine: str = "") -> dict[str, str]:
    """The processor on which this process computes, and the compiler flags.

    Args:
        engine: as of `versions`.
    """
    names_of = {e.name: e.device_names for e in engines.ENGINES}[engine or serving_engine().name]
    return {
        "platform": jax.default_backend(),
        "device": names_of() or str(jax.devices()[0].device_kind),
        "xla_flags": os.environ.get("XLA_FLAGS", ""),
    }


def effect_code(machine: Rig) -> dict[str, str]:
    """By effect `library`, the place of a tabulated law, or the hash of the user's file; so for a user's controller."""
    sources = {}
    for effect in machine.effects:
        place = None if (table := table_of(effect)) is None else table.place
        words = ("table", place.slot, place.variable, *place.factors) if place else (_code_of(effect),)
        sources[effect.id] = " ".join(words)
    for part in machine.replaceable_parts():
        if part is machine:
            sources["rig"] = _code_of(machine)
        elif part not in machine.effects and _code_of(part) != "library":
            sources["controller"] = _code_of(part)
    return sources


def user_code(machine: Rig) -> TrustedCode:
    """The user's code that a machine consists of, with the content that has run in this process."""
    return trusted_as_loaded(type(part) for part in machine.replaceable_parts() if _code_of(part) != "library")


def _code_of(part) -> str:
    return content_hash_of(type(part))[:12] if is_users_code(type(part)) else "library"


def identity_differences(stored: Mapping[str, Any], current: Mapping[str, Any]) -> list[str]:
    """The parameters, effects, designs, settings and versions in which two identities differ, one line each.

    Args:
        stored: the identity in the folder.
        current: the identity of the sweep to run.
    """
    if stored["rig"] != current["rig"]:
        return [f"rig: {stored['rig']} in the folder, {current['rig']} now"]

    def differing(what: str, key: str, to_text: Callable[[Any], str] = str) -> list[str]:
        old, new = ({n: to_text(v) for n, v in values[key].items()} for values in (stored, current))
        names = [n for n in dict.fromkeys([*old, *new]) if stored[key].get(n) != current[key].get(n)]
        return [f"{what}{n}: {old.get(n, 'none')} in the folder, {new.get(n, 'none')} now" for n in names]

    lines = differing("", "kinds") + differing("effect ", "effects")
    lines += differing("parameter ", "parameters", lambda value: format_quantity(*value))
    old, new = stored["designs"], current["designs"]
    if old["names"] != new["names"]:
        lines.append(f"varied parameters: {', '.join(old['names'])} in the folder, {', '.join(new['names'])} now")
    elif old["count"] != new["count"]:
        lines.append(f"number of designs: {old['count']:,} in the folder, {new['count']:,} now")
    elif old["sha256"] != new["sha256"]:
        lines.append("table of designs: other values")
    return lines + differing("setting ", "settings") + differing("version of ", "versions")
