"""The parameters that a sweep varies, as its configuration gives them: ranges and lists of quantities."""

from collections.abc import Mapping
from typing import Any

from edhas_jax.config.problem_list import ProblemList
from edhas_jax.config.yaml_with_lines import KeyPath, yaml_type
from edhas_jax.core.structs import Parameter
from edhas_jax.core.units import format_quantity
from edhas_jax.design.batch.design_table import MOST, Axis, DesignError, own_name
from edhas_jax.machine.parameters import ParameterError
from edhas_jax.machine.rigs import Rig

AXIS = ("from", "to", "count", "spacing", "values")


class AxesReader(ProblemList):
    """Reads the axes of a sweep of one kind; without a machine it says only whether there are any."""

    def __init__(self, machine: Rig | None, kind: str, problems: list[tuple[KeyPath, str]]):
        super().__init__(problems)
        self._machine, self._kind = machine, kind

    def read(self, given: Any) -> tuple[Axis, ...]:
        """The axes in a mapping of parameters."""
        kind, machine = self._kind, self._machine
        key = ("sweep", "parameters")
        if not isinstance(given, Mapping) or not given:
            example = "`piston_clearance: {from: 5 um, to: 40 um" + (", count: 20}`" if kind == "grid" else "}`")
            self.add(key, f"at least one parameter belongs here, for example {example}")
            return ()
        axes, seen = [], {}
        for name, spec in given.items() if machine is not None else ():
            try:
                p, own = own_name(machine, str(name))
                if own in seen:
                    raise ParameterError(f"given twice, also as {seen[own]}")
                seen[own] = name
            except ParameterError as error:
                self.add((*key, name), str(error))
                continue
            axis = self._axis((*key, name), p, own, spec)
            axes += [axis] if axis else []
        return tuple(axes)

    def _axis(self, key: KeyPath, p: Parameter, own: str, spec: Any) -> Axis | None:
        before, kind = len(self.problems), self._kind
        if isinstance(spec, list):
            spec = {"values": spec}
        if not isinstance(spec, Mapping):
            low, high = (format_quantity(x * p.default or 1.0, p.unit) for x in (0.5, 2.0))
            return self.add(key, f"a range or values belong here, for example {{from: {low}, to: {high}}}, not "
                                  f"{yaml_type(spec)}")  # fmt: skip
        self.add_unknown_keys(key, spec, AXIS)
        if "values" in spec:
            for name in (n for n in ("from", "to", "count", "spacing") if n in spec):
                self.add((*key, name), "given together with `values`; give a range or values")
            listed = spec["values"]
            if not isinstance(listed, list) or not listed:
                return self.add((*key, "values"), "a list of at least one value belongs here")
            values = tuple(self.read_quantity((*key, "values", i), p, v) for i, v in enumerate(listed))
            return self._made((*key, "values"), p, before, name=own, values=values)
        ends = []
        for name in ("from", "to"):
            if name not in spec:
                return self.add(key, f"`{name}` is missing; give `from` and `to`, or `values`")
            ends.append(self.read_quantity((*key, name), p, spec[name]))
        if kind == "grid":
            count = self.read_integer((*key, "count"), spec.get("count"), 2, MOST)
        else:
            count = 0
            if "count" in spec:
                self.add((*key, "count"), f"belongs to a grid; a {kind} has one count for all, in `sweep:`")
        spacing = spec.get("spacing", "linear")
        if spacing not in ("linear", "log"):
            self.add((*key, "spacing"), f"no spacing `{spacing}`; one of linear, log")
        return self._made(key, p, before, name=own, low=ends[0], high=ends[1], count=count, log=spacing == "log")

    def _made(self, key: KeyPath, p: Parameter, before: int, **axis) -> Axis | None:
        if len(self.problems) > before:
            return None
        if "low" in axis and not axis["low"] < axis["high"]:
            low, high = (format_quantity(axis[end], p.unit) for end in ("low", "high"))
            return self.add(key, f"the range from {low} to {high} is empty; `from` must lie below `to`")
        listed = axis.get("values", ())
        twice = next((v for i, v in enumerate(listed) if v in listed[:i]), None)
        if twice is not None:
            return self.add(key, f"{format_quantity(twice, p.unit)} is listed twice")
        try:
            return Axis(**axis)
        except DesignError as error:
            return self.add(key, str(error).partition(": ")[2])
