"""The command `edhas schema`."""

import json
import sys

FILES = ("machine", "sweep", "size", "sensitivity", "campaign", "law")


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("schema", help="the keys of files, as JSON schema for editors or as a table")
    parser.add_argument("file", nargs="?", choices=FILES, default="machine", help="kind of file (default: machine)")
    parser.add_argument("--table", action="store_true", help="a table in Markdown instead, with ranges and defaults")
    parser.set_defaults(command=run)


def run(options) -> None:
    """Print the JSON schema of a kind of file, or the table of its keys."""
    from edhas_jax.config.law_file import LAW
    from edhas_jax.config.machine_keys import machine_keys, machine_schema
    from edhas_jax.design.sensitivity.config import KEYS as SENSITIVITY
    from edhas_jax.design.sizing.config import KEYS as SIZE
    from edhas_jax.design.sweep.config import KEYS as SWEEP
    from edhas_jax.measurements.campaign_keys import campaign_keys

    keys = dict(zip(FILES, (machine_keys(), SWEEP, SIZE, SENSITIVITY, campaign_keys(), LAW), strict=True))[options.file]
    if options.table:
        print(keys.table())
        return
    schema = machine_schema() if options.file == "machine" else keys.schema(f"edhas_jax {options.file}")
    is_unicode = "utf" in (sys.stdout.encoding or "").lower()
    print(json.dumps(schema, indent=2, ensure_ascii=not is_unicode))
