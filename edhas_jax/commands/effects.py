"""The command `edhas effects`."""

from pathlib import Path

from edhas_jax.commands.arguments import add_own_code, own_code, require_own_code
from edhas_jax.commands.console import console, headed, save_figure, table


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("effects", help="the library of effects; with a name, one effect in full")
    parser.add_argument("name", nargs="?", help="id of an effect, or FILE.py:Class")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="draw what the named effect does to the signals")
    parser.add_argument("--config", type=Path, help="list the effects of this configuration, a user's own included")
    add_own_code(parser)
    parser.set_defaults(command=run)


def run(options) -> None:
    """Print the library, the effects of a configuration, or one effect in full."""
    from edhas_jax.config.machine_config import read_config
    from edhas_jax.core import structs
    from edhas_jax.machine.effects import LIBRARY
    from edhas_jax.machine.effects.loading import load_effect

    out = console()
    if options.name:
        effect = load_effect(options.name, trust=[options.name])
        _print_effect(effect, out)
        if options.picture:
            _draw_effect(effect, options.picture, out)
        return
    listed = LIBRARY
    if options.config:
        machine = read_config(options.config, trust=own_code(options)).machine
        require_own_code(options, machine)
        listed = tuple(type(e) for e in machine.effects)
    rows = table("effects", "effect", "acts on", "what it is", "parameters")
    for effect in listed:
        where = ", ".join(dict.fromkeys(s.location for s in effect.slots))
        summary = (effect.__doc__ or "").strip().split("\n")[0]
        rows.add_row(effect.id, where, summary, ", ".join(p.name for p in structs.parameters(effect)))
    out.print(rows)


def _print_effect(effect, out) -> None:
    """Print the description, slots, states and parameters of one effect."""
    from inspect import cleandoc

    from edhas_jax.core import structs
    from edhas_jax.core.units import format_quantity

    def interval(bounds, unit):
        return f"{format_quantity(bounds[0], unit)} … {format_quantity(bounds[1], unit)}" if bounds else "known"

    out.print(headed(effect.id, ""))
    out.print(cleandoc(effect.__doc__ or ""))
    if effect.looks_like:
        out.print("\n", headed("looks like", f": {effect.looks_like}"), sep="")
    if effect.confused_with:
        out.print(headed("confused with", f": {', '.join(effect.confused_with)}"))
    out.print(headed("slots", ": " + ", ".join(f"{s.name} ({s.location})" for s in effect.slots)))
    for name, state in effect.states.items():
        out.print(headed("state", f": {name}, {state.doc}, in {state.unit}"))
    rows = table(None, "parameter", "default", "plausible", "allowed", "meaning")
    for p in structs.parameters(effect):
        default = format_quantity(p.default, p.unit)
        rows.add_row(p.name, default, interval(p.plausible, p.unit), interval(p.span, p.unit), p.doc)
    out.print(rows)


def _draw_effect(effect, path, out) -> None:
    """Draw what an effect does to the signals.

    Raises:
        ResultFileError: the picture cannot be written.
    """
    from edhas_jax.simulation.effect_preview import plot_preview, preview_effect

    with out.status(f"runs without and with {effect.id}"):
        figure = plot_preview(preview_effect(effect()))
    save_figure(figure, path)
    out.print(f"written: {path}", soft_wrap=True)
