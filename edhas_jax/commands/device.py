"""The command `edhas device`."""

from edhas_jax.commands.arguments import add_output_options
from edhas_jax.commands.console import console, print_json, print_table


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("device", help="which engine runs the time loops here, which do not, and why")
    add_output_options(parser)
    parser.set_defaults(command=run)


def run(options) -> None:
    """Print the processor, the number of cores, and every loop engine with the reason why it serves or not."""
    import jax

    from edhas_jax.compiler.engines import engine_statuses
    from edhas_jax.core import runtime
    from edhas_jax.core.summary import SummaryTable

    statuses, device = engine_statuses(), jax.devices()[0]
    cache = runtime.cache_folder()
    facts = {
        "platform": jax.default_backend(), "device": str(device.device_kind), "cores": runtime.cores(),
        "cache": "off" if cache is None else str(cache),
    }  # fmt: skip
    if options.json:
        print_json(facts | {"engines": [row._asdict() for row in statuses]})
        return
    out = console(options)
    rows = [(row.name, "yes" if row.serves else "no", row.reason) for row in statuses]
    print_table(out, SummaryTable.of("engines", ("engine", "serves", "reason"), rows, title="Loop engines"))
    out.print(", ".join(f"{name} {value}" for name, value in facts.items()), soft_wrap=True)
