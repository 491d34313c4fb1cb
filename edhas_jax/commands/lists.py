"""`edhas parameters`, `edhas effects` and `edhas schema`."""

import json

from edhas_jax.commands.console import console, table

CHOSEN = "chosen; the paper is silent"


def parameters(options) -> None:
    """`edhas parameters`: every parameter, of a configuration or of everything there is."""
    from edhas_jax.config.machine_config import read_config
    from edhas_jax.core import structs
    from edhas_jax.core.units import format_quantity
    from edhas_jax.machine.parameters import list_parameters

    out = console()
    if options.config:
        listed = [(p, value) for p, value, _ in list_parameters(read_config(options.config).machine)]
        title = f"parameters of {options.config}"
    else:
        listed, title = [(p, p.default) for owner in _owners() for p in structs.parameters(owner)], "parameters"
    rows = table(title, "parameter", "of", "value" if options.config else "default", "allowed", "meaning", "source")
    for p, value in listed:
        low, high = (format_quantity(bound, p.unit) for bound in p.span)
        value = format_quantity(float(value), p.unit)
        rows.add_row(p.name, structs.owner_id(p.owner), value, f"{low} … {high}", p.doc, p.source or CHOSEN)
    out.print(rows)


def _owners() -> list[type]:
    """Every struct that declares parameters: the parts of all rigs, the alternatives, the library."""
    import typing

    from edhas_jax.machine import rigs
    from edhas_jax.machine.effects import LIBRARY
    from edhas_jax.machine.parameters import KINDS

    found: dict[type, None] = {}
    for rig in rigs.RIGS.values():
        for name, kind in typing.get_type_hints(rig).items():
            if name == "effects":
                continue
            for owner in KINDS[name].values() if name in KINDS else typing.get_args(kind) or (kind,):
                if hasattr(owner, "__dataclass_fields__"):
                    found[owner] = None
    return [*found, *LIBRARY]


def effects(options) -> None:
    """`edhas effects`: the library, the effects of a configuration, or one effect in full."""
    from edhas_jax.config.machine_config import read_config
    from edhas_jax.core import structs
    from edhas_jax.machine.effects import LIBRARY
    from edhas_jax.machine.effects.loading import load_effect

    out = console()
    if options.name:
        effect = load_effect(options.name)
        _effect(effect, out)
        if options.picture:
            _signature(effect, options.picture, out)
        return
    shown = LIBRARY
    if options.config:
        shown = tuple(type(e) for e in read_config(options.config).machine.effects)
    rows = table("effects", "effect", "acts on", "what it is", "parameters")
    for effect in shown:
        where = ", ".join(dict.fromkeys(s.where for s in effect.slots))
        what = (effect.__doc__ or "").strip().split("\n")[0]
        rows.add_row(effect.id, where, what, ", ".join(p.name for p in structs.parameters(effect)))
    out.print(rows)


def _effect(effect, out) -> None:
    """One effect in full."""
    from inspect import cleandoc

    from edhas_jax.core import structs
    from edhas_jax.core.units import format_quantity

    def interval(bounds, unit):
        return f"{format_quantity(bounds[0], unit)} … {format_quantity(bounds[1], unit)}" if bounds else "known"

    out.print(f"[bold]{effect.id}[/bold]")
    out.print(cleandoc(effect.__doc__ or ""), markup=False)
    if effect.looks_like:
        out.print(f"\n[bold]looks like[/bold]: {effect.looks_like}")
    if effect.confused_with:
        out.print(f"[bold]confused with[/bold]: {', '.join(effect.confused_with)}")
    out.print("[bold]enters at[/bold]: " + ", ".join(f"{s.name} ({s.where})" for s in effect.slots))
    for name, state in effect.states.items():
        out.print(f"[bold]state[/bold]: {name}, {state.doc}, in {state.unit}")
    rows = table(None, "parameter", "default", "plausible", "allowed", "meaning")
    for p in structs.parameters(effect):
        default = format_quantity(p.default, p.unit)
        rows.add_row(p.name, default, interval(p.plausible, p.unit), interval(p.span, p.unit), p.doc)
    out.print(rows)


def _signature(effect, path, out) -> None:
    """The picture of what an effect does to the signals."""
    from edhas_jax.config.run_folder import StoreError
    from edhas_jax.simulation.effect_preview import plot_signature, signature

    with out.status(f"runs without and with {effect.id}"):
        figure = plot_signature(signature(effect()))
    try:
        figure.savefig(path, dpi=130)
    except (OSError, ValueError) as error:
        raise StoreError(f"{path}: cannot be written: {error}") from None
    out.print(f"written: {path}", soft_wrap=True)


def schema(options) -> None:
    """`edhas schema`: the JSON schema of configurations."""
    from edhas_jax.config.json_schema import json_schema

    print(json.dumps(json_schema(), indent=2, ensure_ascii=False))
