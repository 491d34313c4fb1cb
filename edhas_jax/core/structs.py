"""Parameters declared once, and the frozen structs (JAX pytrees) that hold them."""

import dataclasses
import functools
from typing import Any, dataclass_transform

import jax


@dataclasses.dataclass(frozen=True)
class Parameter:
    """What is known of one physical parameter: everything but its present value.

    `default`, `span` (the closed interval of allowed values) and `plausible` (the narrower one in which a search for
    its value looks; None: the value is taken as known) are in SI; `unit` is the SI unit as text.
    """

    name: str
    default: float
    unit: str
    span: tuple[float, float]
    doc: str
    source: str
    owner: type
    plausible: tuple[float, float] | None = None


def owner_id(owner: type) -> str:
    """The id by which texts name a struct: its `id` if it has one, else its class name in snake case."""
    return owner.__dict__.get("id") or snake_case(owner.__name__)


def snake_case(name: str) -> str:
    """`SealDrag` → `seal_drag`."""
    return "".join("_" + c.lower() if c.isupper() and i else c.lower() for i, c in enumerate(name))


def par(
    default: float, unit: str, span: tuple[float, float], doc: str, source: str = "", *,
    plausible: tuple[float, float] | None = None,
) -> Any:  # fmt: skip
    """Declare one parameter of a struct: SI default, SI unit, allowed span, meaning, source, plausible range."""
    return dataclasses.field(default=default, metadata={"par": (unit, span, doc, source), "plausible": plausible})


@dataclass_transform(frozen_default=True, kw_only_default=True, eq_default=False, field_specifiers=(par,))
def struct(cls):
    """Make `cls` a frozen, keyword-only dataclass that is a JAX pytree with its fields as children."""
    cls = dataclasses.dataclass(frozen=True, kw_only=True, eq=False)(cls)
    jax.tree_util.register_dataclass(cls, [f.name for f in dataclasses.fields(cls)], [])
    return cls


@functools.cache
def parameters(owner: type) -> tuple[Parameter, ...]:
    """The parameters that `owner` declares, in the order of declaration."""
    return tuple(
        Parameter(f.name, f.default, *f.metadata["par"], owner, f.metadata["plausible"])
        for f in dataclasses.fields(owner)
        if "par" in f.metadata
    )


def replace(node: Any, **values: Any) -> Any:
    """A copy of `node` with some fields changed; nothing is mutated."""
    return dataclasses.replace(node, **values)
