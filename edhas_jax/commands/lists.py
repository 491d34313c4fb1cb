"""The commands that list what there is: parameters, effects, keys of files, engines."""

import typing
from inspect import cleandoc

from edhas_jax.commands.command_line import KINDS_OF_FILES
from edhas_jax.commands.console import console, finish, print_json, print_table, quoted, say
from edhas_jax.commands.options import own_code, require_own_code
from edhas_jax.commands.progress import WorkProgress
from edhas_jax.config.machine_config import read_config
from edhas_jax.core import structs
from edhas_jax.core.summary import Summary, SummaryTable
from edhas_jax.core.units import format_quantity
from edhas_jax.machine import rigs
from edhas_jax.machine.effects import LIBRARY
from edhas_jax.machine.effects.loading import load_effect
from edhas_jax.machine.parameters import COMPONENT_KINDS, list_parameters

NO_SOURCE = "chosen; the paper gives no value"


def _machine(options) -> rigs.Rig:
    """The machine of the configuration that is named."""
    machine = read_config(options.config, trust=own_code(options)).machine
    require_own_code(options, machine)
    return machine


def _span(bounds, unit: str) -> str:
    return " … ".join(format_quantity(bound, unit) for bound in bounds)


def parameters(options) -> None:
    """Print the parameters of a configuration, or of all rigs, alternative components and effects."""
    if options.config:
        listed = [(p, value) for p, value, _ in list_parameters(_machine(options))]
        title = f"parameters of {options.config}"
    else:
        listed = [(p, p.default) for owner in _parameter_owners() for p in structs.parameters(owner)]
        title = "parameters"
    rows, records = [], []
    for p, value in listed:
        owner, source = structs.owner_id(p.owner), p.source or NO_SOURCE
        rows.append((p.name, owner, format_quantity(float(value), p.unit), _span(p.span, p.unit), p.doc, source))
        records.append({"parameter": p.name, "of": owner, "value": float(value), "unit": p.unit, "allowed": p.span,
                        "meaning": p.doc, "source": source})  # fmt: skip
    columns = "parameter", "of", "value" if options.config else "default", "allowed", "meaning", "source"
    follow = f"simulate {quoted(options.config)} --set {listed[0][0].name}=VALUE" if options.config else "effects"
    finish(options, Summary(title, (SummaryTable.of("parameters", columns, rows, records),)), next_command=follow)


def _parameter_owners() -> list[type]:
    """Every class that declares parameters: components of the rigs, those that can replace them, effects."""
    found: dict[type, None] = {}
    for rig in rigs.RIGS.values():
        for name, kind in typing.get_type_hints(rig).items():
            if name == "effects":
                continue
            mounted = typing.get_args(kind) or (kind,)
            for owner in COMPONENT_KINDS[name].values() if name in COMPONENT_KINDS else mounted:
                if hasattr(owner, "__dataclass_fields__"):
                    found[owner] = None
    return [*found, *LIBRARY]


def effects(options) -> None:
    """Print the library, the effects of a configuration, or one effect in full.

    Raises:
        ResultFileError: the picture cannot be written.
    """
    if options.picture:
        from edhas_jax.simulation.effect_preview import plot_preview, preview_effect
        from edhas_jax.tasks.result import require_picture_name, save_figure

        require_picture_name(options.picture)
    if options.name:
        effect = load_effect(options.name, trust=[options.name])
        if options.picture:
            with WorkProgress(options, f"runs without and with {effect.id}"):
                figure = plot_preview(preview_effect(effect()))
            save_figure(figure, options.picture)
        follow = "" if options.picture else f"effects {effect.id} --picture {effect.id}.png"
        finish(options, _one_effect(effect), next_command=follow, written=str(options.picture or ""))
        return
    listed = tuple(type(e) for e in _machine(options).effects) if options.config else LIBRARY
    rows = []
    for effect in listed:
        where = ", ".join(dict.fromkeys(s.location for s in effect.slots))
        summary = (effect.__doc__ or "").strip().split("\n")[0]
        rows.append((effect.id, where, summary, ", ".join(p.name for p in structs.parameters(effect))))
    table = SummaryTable.of("effects", ("effect", "acts on", "what it is", "parameters"), rows)
    follow = f"effects {listed[0].id}" if listed else "effects"
    finish(options, Summary("effects", (table,)), next_command=follow)


def _one_effect(effect) -> Summary:
    """Description, slots, states and parameters of one effect."""
    texts = [cleandoc(effect.__doc__ or "")]
    if effect.looks_like:
        texts.append(f"looks like: {effect.looks_like}")
    if effect.confused_with:
        texts.append(f"confused with: {', '.join(effect.confused_with)}")
    texts.append("slots: " + ", ".join(f"{s.name} ({s.location})" for s in effect.slots))
    texts += [f"state: {name}, {state.doc}, in {state.unit}" for name, state in effect.states.items()]
    rows, records = [], []
    for p in structs.parameters(effect):
        spans = (_span(bounds, p.unit) if bounds else "known" for bounds in (p.plausible, p.span))
        rows.append((p.name, format_quantity(p.default, p.unit), *spans, p.doc))
        records.append({"parameter": p.name, "default": p.default, "unit": p.unit, "plausible": p.plausible,
                        "allowed": p.span, "meaning": p.doc})  # fmt: skip
    columns = "parameter", "default", "plausible", "allowed", "meaning"
    return Summary(effect.id, (*texts, SummaryTable.of("parameters", columns, rows, records)))


def schema(options) -> None:
    """Print the JSON schema of a kind of file, or the table of its keys."""
    from edhas_jax.config.law_file import LAW
    from edhas_jax.config.machine_keys import machine_keys, machine_schema
    from edhas_jax.design.sensitivity.config import KEYS as SENSITIVITY
    from edhas_jax.design.sizing.config import KEYS as SIZE
    from edhas_jax.design.sweep.config import KEYS as SWEEP
    from edhas_jax.measurements.campaign_keys import campaign_keys

    declared = machine_keys(), SWEEP, SIZE, SENSITIVITY, campaign_keys(), LAW
    keys = dict(zip(KINDS_OF_FILES, declared, strict=True))[options.file]
    if options.table:
        print(keys.table())
    else:
        print_json(machine_schema() if options.file == "machine" else keys.schema(f"edhas_jax {options.file}"))


def device(options) -> None:
    """Print the processor, the number of cores, and every loop engine with the reason why it serves or not."""
    import jax

    from edhas_jax.compiler.engines import engine_statuses
    from edhas_jax.core import runtime

    statuses, cache = engine_statuses(), runtime.cache_folder()
    facts = {
        "platform": jax.default_backend(), "device": str(jax.devices()[0].device_kind), "cores": runtime.cores(),
        "cache": "off" if cache is None else str(cache),
    }  # fmt: skip
    if options.json:
        print_json(facts | {"engines": [row._asdict() for row in statuses]})
        return
    rows = [(row.name, "yes" if row.serves else "no", row.reason) for row in statuses]
    table = SummaryTable.of("engines", ("engine", "serves", "reason"), rows, title="Loop engines")
    print_table(console(options), table)
    say(options, ", ".join(f"{name} {value}" for name, value in facts.items()))
