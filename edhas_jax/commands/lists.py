"""`edhas parameters`, `edhas effects` and `edhas schema`."""

import json

from edhas_jax.commands.console import console, table

CHOSEN = "chosen; the paper is silent"


def parameters(options) -> None:
    """`edhas parameters`: every parameter, of a configuration or of everything there is."""
    from edhas_jax import tree
    from edhas_jax.config import read_config
    from edhas_jax.parameters import list_parameters
    from edhas_jax.units import format_quantity

    out = console()
    if options.config:
        listed = [(p, value) for p, value, _ in list_parameters(read_config(options.config).machine)]
        title = f"parameters of {options.config}"
    else:
        listed, title = [(p, p.default) for owner in _owners() for p in tree.parameters(owner)], "parameters"
    rows = table(title, "parameter", "of", "value" if options.config else "default", "allowed", "meaning", "source")
    for p, value in listed:
        low, high = (format_quantity(bound, p.unit) for bound in p.span)
        value = format_quantity(float(value), p.unit)
        rows.add_row(p.name, tree.owner_id(p.owner), value, f"{low} … {high}", p.doc, p.source or CHOSEN)
    out.print(rows)


def _owners() -> list[type]:
    """Every struct that declares parameters: the parts of all rigs, the alternatives, the library."""
    import typing

    from edhas_jax import system
    from edhas_jax.effects import LIBRARY

    found: dict[type, None] = {}
    for rig in system.RIGS.values():
        for name, kind in typing.get_type_hints(rig).items():
            if name == "effects":
                continue
            for owner in typing.get_args(kind) or (kind,):
                if hasattr(owner, "__dataclass_fields__"):
                    found[owner] = None
    return [*found, *LIBRARY]


def effects(options) -> None:
    """`edhas effects`: the library, the effects of a configuration, or one effect in full."""
    from edhas_jax import tree
    from edhas_jax.config import read_config
    from edhas_jax.effects import LIBRARY
    from edhas_jax.effects.discover import load_effect
    from edhas_jax.units import format_quantity

    out = console()
    if options.name:
        effect = load_effect(options.name)
        out.print(f"[bold]{effect.id}[/bold]  {effect.__doc__ or ''}", markup=True)
        out.print("enters at: " + ", ".join(f"{s.name} ({s.where})" for s in effect.slots))
        rows = table(None, "parameter", "default", "allowed", "meaning")
        for p in tree.parameters(effect):
            low, high = (format_quantity(bound, p.unit) for bound in p.span)
            rows.add_row(p.name, format_quantity(p.default, p.unit), f"{low} … {high}", p.doc)
        out.print(rows)
        for name, state in effect.states.items():
            out.print(f"state: {name}, {state.doc}, in {state.unit}")
        return
    shown = LIBRARY
    if options.config:
        shown = tuple(type(e) for e in read_config(options.config).machine.effects)
    rows = table("effects", "effect", "acts on", "what it is", "parameters")
    for effect in shown:
        where = ", ".join(dict.fromkeys(s.where for s in effect.slots))
        what = (effect.__doc__ or "").strip().split("\n")[0]
        rows.add_row(effect.id, where, what, ", ".join(p.name for p in tree.parameters(effect)))
    out.print(rows)


def schema(options) -> None:
    """`edhas schema`: the JSON schema of configurations."""
    from edhas_jax.schema import json_schema

    print(json.dumps(json_schema(), indent=2, ensure_ascii=False))
