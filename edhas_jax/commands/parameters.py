"""The command `edhas parameters`."""

from pathlib import Path

from edhas_jax.commands.arguments import add_output_options, add_own_code, own_code, require_own_code
from edhas_jax.commands.console import console, finish, quoted

NO_SOURCE = "chosen; the paper gives no value"


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("parameters", help="every parameter with unit, value, range, meaning, source")
    parser.add_argument("config", nargs="?", type=Path, help="configuration (default: all rigs and effects)")
    add_own_code(parser)
    add_output_options(parser)
    parser.set_defaults(command=run)


def run(options) -> None:
    """Print the parameters of a configuration, or of all rigs, alternative components and effects."""
    from edhas_jax.config.machine_config import read_config
    from edhas_jax.core import structs
    from edhas_jax.core.summary import Summary, SummaryTable
    from edhas_jax.core.units import format_quantity
    from edhas_jax.machine.parameters import list_parameters

    out = console(options)
    if options.config:
        machine = read_config(options.config, trust=own_code(options)).machine
        require_own_code(options, machine)
        listed = [(p, value) for p, value, _ in list_parameters(machine)]
        title = f"parameters of {options.config}"
    else:
        listed = [(p, p.default) for owner in _parameter_owners() for p in structs.parameters(owner)]
        title = "parameters"
    rows, records = [], []
    for p, value in listed:
        low, high = (format_quantity(bound, p.unit) for bound in p.span)
        owner, source = structs.owner_id(p.owner), p.source or NO_SOURCE
        rows.append((p.name, owner, format_quantity(float(value), p.unit), f"{low} … {high}", p.doc, source))
        records.append({"parameter": p.name, "of": owner, "value": float(value), "unit": p.unit, "allowed": p.span,
                        "meaning": p.doc, "source": source})  # fmt: skip
    columns = "parameter", "of", "value" if options.config else "default", "allowed", "meaning", "source"
    follow = f"simulate {quoted(options.config)} --set {listed[0][0].name}=VALUE" if options.config else "effects"
    finish(options, out, Summary(title, (SummaryTable.of("parameters", columns, rows, records),)), next_command=follow)


def _parameter_owners() -> list[type]:
    """Every struct that declares parameters: components of all rigs, alternatives of the sections, effects."""
    import typing

    from edhas_jax.machine import rigs
    from edhas_jax.machine.effects import LIBRARY
    from edhas_jax.machine.parameters import COMPONENT_KINDS

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
