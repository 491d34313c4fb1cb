"""The command `edhas schema`."""

import json
import sys


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("schema", help="the JSON schema of configurations, for completion in editors")
    parser.set_defaults(command=run)


def run(options) -> None:
    """Print the JSON schema of configurations."""
    from edhas_jax.config.machine_keys import machine_schema

    is_unicode = "utf" in (sys.stdout.encoding or "").lower()
    print(json.dumps(machine_schema(), indent=2, ensure_ascii=not is_unicode))
