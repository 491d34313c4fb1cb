"""Reader of the parameters that a configuration varies: ranges and lists of quantities become axes."""

from collections.abc import Mapping
from typing import Any

from edhas_jax.config.problem_list import ProblemList
from edhas_jax.config.yaml_with_lines import KeyPath, yaml_type
from edhas_jax.core.structs import Parameter
from edhas_jax.core.units import format_quantity
from edhas_jax.design.batch.design_table import resolve_parameter
from edhas_jax.design.batch.experiment_design import MAX_DESIGNS, Axis, DesignError, first_repeated
from edhas_jax.machine.parameters import ParameterError
from edhas_jax.machine.rigs import Rig

RANGE_KEYS = ("from", "to", "count", "spacing")
AXIS_KEYS = (*RANGE_KEYS, "values")


class AxesReader(ProblemList):
    """Reads the axes of one kind of sweep; without a machine it only checks that there are any."""

    def __init__(self, machine: Rig | None, kind: str, problems: list[tuple[KeyPath, str]]):
        super().__init__(problems)
        self._machine, self._kind = machine, kind

    def read(self, parameters: Any) -> tuple[Axis, ...]:
        """The axes in a mapping from parameter to range or list of values; invalid ones become problems."""
        key = ("sweep", "parameters")
        if not isinstance(parameters, Mapping) or not parameters:
            count = ", count: 20" if self._kind == "grid" else ""
            example = f"`piston_clearance: {{from: 5 um, to: 40 um{count}}}`"
            self.add(key, f"at least one parameter belongs here, for example {example}")
            return ()
        if self._machine is None:
            return ()
        axes, names_by_column = [], {}
        for name, spec in parameters.items():
            try:
                p, column = resolve_parameter(self._machine, str(name))
                if column in names_by_column:
                    raise ParameterError(f"given twice, also as {names_by_column[column]}")
                names_by_column[column] = name
            except ParameterError as error:
                self.add((*key, name), str(error))
                continue
            axis = self._read_axis((*key, name), p, column, spec)
            axes += [axis] if axis else []
        return tuple(axes)

    def _read_axis(self, key: KeyPath, p: Parameter, column: str, spec: Any) -> Axis | None:
        problems_before = len(self.problems)
        if isinstance(spec, list):
            spec = {"values": spec}
        if not isinstance(spec, Mapping):
            low, high = (format_quantity(x * p.default or 1.0, p.unit) for x in (0.5, 2.0))
            return self.add(key, f"a range or values belong here, for example {{from: {low}, to: {high}}}, not "
                                  f"{yaml_type(spec)}")  # fmt: skip
        self.add_unknown_keys(key, spec, AXIS_KEYS)
        if "values" in spec:
            for name in (n for n in RANGE_KEYS if n in spec):
                self.add((*key, name), "given together with `values`; give a range or values")
            listed = spec["values"]
            if not isinstance(listed, list) or not listed:
                return self.add((*key, "values"), "a list of at least one value belongs here")
            values = tuple(self.read_quantity((*key, "values", i), p, v) for i, v in enumerate(listed))
            return self._build((*key, "values"), p, problems_before, name=column, values=values)
        ends = []
        for name in ("from", "to"):
            if name not in spec:
                return self.add(key, f"`{name}` is missing; give `from` and `to`, or `values`")
            ends.append(self.read_quantity((*key, name), p, spec[name]))
        count = 0
        if self._kind == "grid":
            count = self.read_integer((*key, "count"), spec.get("count"), 2, MAX_DESIGNS)
        elif "count" in spec:
            self.add((*key, "count"), f"belongs to a grid; a {self._kind} has one count for all, in `sweep:`")
        spacing = spec.get("spacing", "linear")
        if spacing not in ("linear", "log"):
            self.add((*key, "spacing"), f"no spacing `{spacing}`; one of linear, log")
        return self._build(
            key, p, problems_before, name=column, low=ends[0], high=ends[1], count=count, log=spacing == "log"
        )

    def _build(self, key: KeyPath, p: Parameter, problems_before: int, **axis) -> Axis | None:
        """The axis; None if its keys have problems or contradict each other."""
        if len(self.problems) > problems_before:
            return None
        if "low" in axis and not axis["low"] < axis["high"]:
            low, high = (format_quantity(axis[end], p.unit) for end in ("low", "high"))
            return self.add(key, f"the range from {low} to {high} is empty; `from` must lie below `to`")
        values = axis.get("values", ())
        repeated = first_repeated(values)
        if repeated is not None:
            return self.add(key, f"{format_quantity(repeated, p.unit)} is listed twice")
        try:
            return Axis(**axis)
        except DesignError as error:
            return self.add(key, str(error).partition(": ")[2])
