"""The command `edhas device`."""

import json


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("device", help="which engine runs the time loops here, which do not, and why")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    parser.set_defaults(command=run)


def run(options) -> None:
    """Print the processor, the number of cores, and every loop engine with the reason why it serves or not."""
    import jax

    from edhas_jax.commands.console import console, table
    from edhas_jax.compiler.engines import engine_statuses
    from edhas_jax.core import runtime

    statuses, device = engine_statuses(), jax.devices()[0]
    cache = runtime.cache_folder()
    facts = {
        "platform": jax.default_backend(), "device": str(device.device_kind), "cores": runtime.cores(),
        "cache": "off" if cache is None else str(cache),
    }  # fmt: skip
    if options.json:
        print(json.dumps(facts | {"engines": [row._asdict() for row in statuses]}, indent=2))
        return
    out = console()
    rows = table("Loop engines", "engine", "serves", "reason")
    for row in statuses:
        rows.add_row(row.name, "yes" if row.serves else "no", row.reason)
    out.print(rows)
    out.print(", ".join(f"{name} {value}" for name, value in facts.items()), soft_wrap=True)
