"""Declaration of physical parameters, and the frozen dataclasses (JAX pytrees) that hold them."""

import dataclasses
import functools
from typing import Any, dataclass_transform

import jax


@dataclasses.dataclass(frozen=True)
class Parameter:
    """The declaration of one physical parameter: everything but its present value.

    Attributes:
        name: field name.
        default: default value, SI.
        unit: SI unit as text.
        span: closed interval of allowed values, SI.
        doc: meaning.
        source: where the default comes from.
        owner: the struct that declares it.
        plausible: narrower interval in which a search for the value starts, SI; None if the value counts as known.
        at_least: parameter of the same struct that this one is never smaller than; empty without such a law.
    """

    name: str
    default: float
    unit: str
    span: tuple[float, float]
    doc: str
    source: str
    owner: type
    plausible: tuple[float, float] | None = None
    at_least: str = ""


def owner_id(owner: type) -> str:
    """The id of a struct in texts: its attribute `id` if it has one, else its class name in snake case."""
    return owner.__dict__.get("id") or snake_case(owner.__name__)


def snake_case(name: str) -> str:
    """`SealDrag` → `seal_drag`."""
    return "".join("_" + c.lower() if c.isupper() and i else c.lower() for i, c in enumerate(name))


def par(
    default: float, unit: str, span: tuple[float, float], doc: str, source: str = "", *,
    plausible: tuple[float, float] | None = None, at_least: str = "",
) -> Any:  # fmt: skip
    """Declare one parameter of a struct.

    Args:
        default: default value, SI.
        unit: SI unit as text, "-" for a number.
        span: closed interval of allowed values, SI.
        doc: meaning.
        source: where the default comes from.
        plausible: interval in which a search for the value starts, SI; None if the value counts as known.
        at_least: parameter of the same struct that this one is never smaller than, by the law of the struct.
    """
    metadata = {"par": (unit, span, doc, source), "plausible": plausible, "at_least": at_least}
    return dataclasses.field(default=default, metadata=metadata)


@dataclass_transform(frozen_default=True, kw_only_default=True, eq_default=False, field_specifiers=(par,))
def struct(cls):
    """Make `cls` a frozen, keyword-only dataclass that is a JAX pytree with its fields as children."""
    cls = dataclasses.dataclass(frozen=True, kw_only=True, eq=False)(cls)
    names = tuple(f.name for f in dataclasses.fields(cls))
    keys = tuple(map(jax.tree_util.GetAttrKey, names))

    def children(node):
        return tuple(getattr(node, name) for name in names), None

    def children_with_keys(node):
        return tuple(zip(keys, children(node)[0], strict=True)), None

    def unflatten(_, values):
        return cls(**dict(zip(names, values, strict=True)))

    # not `register_dataclass`: for JAX the structures of two such classes with as many fields are equal, so that it now
    # and then runs the program that was compiled for the other class
    jax.tree_util.register_pytree_with_keys(cls, children_with_keys, unflatten, children)
    return cls


@functools.cache
def parameters(owner: type) -> tuple[Parameter, ...]:
    """The parameters that the struct `owner` declares, in the order of declaration."""
    return tuple(
        Parameter(f.name, f.default, *f.metadata["par"], owner, f.metadata["plausible"], f.metadata["at_least"])
        for f in dataclasses.fields(owner)
        if "par" in f.metadata
    )


def replace(node: Any, **values: Any) -> Any:
    """A copy of a struct with some fields changed."""
    return dataclasses.replace(node, **values)
