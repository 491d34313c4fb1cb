"""The command `edhas effects`."""

from pathlib import Path

from edhas_jax.commands.arguments import add_output_options, add_own_code, own_code, require_own_code
from edhas_jax.commands.console import console, finish, save_figure
from edhas_jax.commands.progress import WorkProgress


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("effects", help="the library of effects; with a name, one effect in full")
    parser.add_argument("name", nargs="?", help="id of an effect, or FILE.py:Class")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="draw what the named effect does to the signals")
    parser.add_argument("--config", type=Path, help="list the effects of this configuration, a user's own included")
    add_own_code(parser)
    add_output_options(parser)
    parser.set_defaults(command=run)


def run(options) -> None:
    """Print the library, the effects of a configuration, or one effect in full.

    Raises:
        ResultFileError: the picture cannot be written.
    """
    if options.picture:
        from edhas_jax.tasks.result import require_picture_name

        require_picture_name(options.picture)
    from edhas_jax.config.machine_config import read_config
    from edhas_jax.core import structs
    from edhas_jax.core.summary import Summary, SummaryTable
    from edhas_jax.machine.effects import LIBRARY
    from edhas_jax.machine.effects.loading import load_effect

    out = console(options)
    if options.name:
        effect = load_effect(options.name, trust=[options.name])
        if options.picture:
            _draw_effect(effect, options)
        picture = str(options.picture or "")
        finish(options, out, _one_effect(effect), next_command=f"effects {effect.id} --picture {effect.id}.png"
               if not picture else "", written=picture)  # fmt: skip
        return
    listed = LIBRARY
    if options.config:
        machine = read_config(options.config, trust=own_code(options)).machine
        require_own_code(options, machine)
        listed = tuple(type(e) for e in machine.effects)
    rows = []
    for effect in listed:
        where = ", ".join(dict.fromkeys(s.location for s in effect.slots))
        summary = (effect.__doc__ or "").strip().split("\n")[0]
        rows.append((effect.id, where, summary, ", ".join(p.name for p in structs.parameters(effect))))
    table = SummaryTable.of("effects", ("effect", "acts on", "what it is", "parameters"), rows)
    follow = f"effects {listed[0].id}" if listed else "effects"
    finish(options, out, Summary("effects", (table,)), next_command=follow)


def _one_effect(effect):
    """Description, slots, states and parameters of one effect, as a `Summary`."""
    from inspect import cleandoc

    from edhas_jax.core import structs
    from edhas_jax.core.summary import Summary, SummaryTable
    from edhas_jax.core.units import format_quantity

    def interval(bounds, unit):
        return f"{format_quantity(bounds[0], unit)} … {format_quantity(bounds[1], unit)}" if bounds else "known"

    texts = [cleandoc(effect.__doc__ or "")]
    if effect.looks_like:
        texts.append(f"looks like: {effect.looks_like}")
    if effect.confused_with:
        texts.append(f"confused with: {', '.join(effect.confused_with)}")
    texts.append("slots: " + ", ".join(f"{s.name} ({s.location})" for s in effect.slots))
    texts += [f"state: {name}, {state.doc}, in {state.unit}" for name, state in effect.states.items()]
    rows, records = [], []
    for p in structs.parameters(effect):
        default = format_quantity(p.default, p.unit)
        rows.append((p.name, default, interval(p.plausible, p.unit), interval(p.span, p.unit), p.doc))
        records.append({"parameter": p.name, "default": p.default, "unit": p.unit, "plausible": p.plausible,
                        "allowed": p.span, "meaning": p.doc})  # fmt: skip
    columns = "parameter", "default", "plausible", "allowed", "meaning"
    return Summary(effect.id, (*texts, SummaryTable.of("parameters", columns, rows, records)))


def _draw_effect(effect, options) -> None:
    """Draw what an effect does to the signals.

    Raises:
        ResultFileError: the picture cannot be written.
    """
    from edhas_jax.simulation.effect_preview import plot_preview, preview_effect

    with WorkProgress(options, f"runs without and with {effect.id}"):
        figure = plot_preview(preview_effect(effect()))
    save_figure(figure, options.picture)
