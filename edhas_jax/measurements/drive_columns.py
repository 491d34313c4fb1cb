"""The columns of recorded drives that `campaign.yaml` names: the set point, or the drives of a rig of one's own."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from edhas_jax.config.document import Entry
from edhas_jax.config.problem_list import ProblemList
from edhas_jax.config.recorded_signal import BETWEEN, encode_samples
from edhas_jax.config.yaml_with_lines import yaml_type
from edhas_jax.machine.components.set_points import Recorded
from edhas_jax.machine.rig_base import Rig
from edhas_jax.measurements.run_reader import ColumnSource


def read_drive_columns(
    problems: ProblemList, data: Mapping[str, Any], rig: type[Rig] | None
) -> dict[str, ColumnSource]:
    """The columns of the recorded drives, by drive; that of the set point is `reference`.

    Args:
        problems: collects what is wrong.
        data: the mapping of `campaign.yaml`.
        rig: the rig of the campaign; None where it is not known.
    """
    if rig is not None and rig.is_own:
        return _own_drives(problems, data.get("drives"), rig)
    if rig is not None and data.get("drives") is not None:
        hint = f"the recorded set point of {rig.name} is `reference: COLUMN`"
        problems.add(("drives",), f"belongs to a rig of one's own; {hint}")
    return _set_point(problems, data.get("reference"))


def recorded_placeholders(columns: Mapping[str, ColumnSource]) -> dict[str, Any]:
    """The sections of a configuration for these drives, whose samples are read with the runs."""
    samples = encode_samples(Recorded(values=np.zeros(2), interval=1.0))
    return {name: {"kind": "recorded", **samples} for name in columns}


def _set_point(problems: ProblemList, reference: Any) -> dict[str, ColumnSource]:
    """The column of `reference: xref` or `reference: {column: xref, unit: mm, between: hold}`."""
    if isinstance(reference, str):
        return {"reference": ColumnSource(reference, "")}
    if not isinstance(reference, Mapping) or "column" not in reference or set(reference) & {"kind", "file"}:
        return {}
    return {"reference": _column(problems, ("reference",), reference, "reference")}


def _own_drives(problems: ProblemList, section: Any, rig: type[Rig]) -> dict[str, ColumnSource]:
    """The columns of `drives: {voltage: u}` or `drives: {voltage: {column: u, unit: V, between: hold}}`."""
    if section is not None and not isinstance(section, Mapping):
        problems.add(("drives",), f"a mapping belongs here, such as {{voltage: u}}, not {yaml_type(section)}")
    found, section = {}, section if isinstance(section, Mapping) else {}
    problems.add_unknown_keys(("drives",), section, tuple(rig.drives))
    for name in (n for n in section if n in rig.drives):
        entry = {"column": section[name]} if isinstance(section[name], str) else section[name]
        if not isinstance(entry, Mapping):
            problems.add(("drives", name), f"the name of a column belongs here, not {yaml_type(entry)}")
            continue
        found[name] = _column(problems, ("drives", name), entry, name)
    return found


def _column(problems: ProblemList, key: tuple, entry: Mapping[str, Any], name: str) -> ColumnSource:
    """The column of the drive `name` that an entry describes."""
    problems.add_unknown_keys(key, entry, ("column", "unit", "between"))
    between = BETWEEN.kind.read(Entry(entry, key, problems.problems)["between"]) if "between" in entry else None
    return ColumnSource(str(entry.get("column", name)), str(entry.get("unit", "")), between)
