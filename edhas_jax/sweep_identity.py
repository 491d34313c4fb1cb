"""What makes a sweep this sweep and no other, so that nothing is mixed with results that do not belong to it."""

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from edhas_jax.chunk_task import effect_code, versions
from edhas_jax.dump import dump_config, kind_of
from edhas_jax.parameters import KINDS, find_parameter, list_parameters
from edhas_jax.run import Simulation
from edhas_jax.sweep_config import Sweep
from edhas_jax.units import format_quantity


def describe(sweep: Sweep) -> dict[str, Any]:
    """All that the numbers depend on: parameters, effects, designs, settings and versions."""
    varied = {(path, p.name) for p, path in (find_parameter(sweep.machine, name) for name in sweep.designs)}
    digest = hashlib.sha256()
    for name, values in sweep.designs.items():
        digest.update(name.encode() + np.ascontiguousarray(values, "<f8").tobytes())
    settings = dataclasses.asdict(sweep.settings)
    return {
        "rig": sweep.machine.name,
        "kinds": {s: kind_of(s, getattr(sweep.machine, s)) for s in KINDS if hasattr(sweep.machine, s)},
        "effects": effect_code(sweep.machine),
        "parameters": {
            f"{path}.{p.name}": [float(v), p.unit]
            for p, v, path in list_parameters(sweep.machine)
            if (path, p.name) not in varied
        },
        "designs": {"count": len(sweep), "names": list(sweep.designs), "sha256": digest.hexdigest()},
        "settings": settings | {"precision": sweep.settings.precision.value},
        "versions": versions(),
    }


def fingerprint(identity: Mapping[str, Any]) -> str:
    """One short text for a description."""
    return hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()[:16]


def machine_text(sweep: Sweep) -> str:
    """The machine of a sweep as configuration text, every parameter written out."""
    return dump_config(sweep.machine, Simulation(precision=sweep.settings.precision))


def differences(there: Mapping[str, Any], here: Mapping[str, Any]) -> list[str]:
    """In which parameters, effects, designs, settings and versions two descriptions differ, one line each."""
    told = []
    if there["rig"] != here["rig"]:
        return [f"rig: {there['rig']} there, {here['rig']} here"]
    told += _lines("", there["kinds"], here["kinds"], str)
    told += _lines("effect ", there["effects"], here["effects"], str)
    told += _lines("parameter ", there["parameters"], here["parameters"], lambda v: format_quantity(*v))
    old, new = there["designs"], here["designs"]
    if old["names"] != new["names"]:
        told.append(f"varied parameters: {', '.join(old['names'])} there, {', '.join(new['names'])} here")
    elif old["count"] != new["count"]:
        told.append(f"number of designs: {old['count']:,} there, {new['count']:,} here")
    elif old["sha256"] != new["sha256"]:
        told.append("table of designs: other values")
    told += _lines("setting ", there["settings"], here["settings"], str)
    return told + _lines("version of ", there["versions"], here["versions"], str)


def _lines(what: str, there: Mapping, here: Mapping, text) -> list[str]:
    def tell(values, name):
        return text(values[name]) if name in values else "none"

    names = dict.fromkeys([*there, *here])
    return [f"{what}{n}: {tell(there, n)} there, {tell(here, n)} here" for n in names if there.get(n) != here.get(n)]
