"""The command `edhas workbench`."""

import importlib.util
from pathlib import Path

from edhas_jax.commands.arguments import whole_number


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("workbench", help="the whole loop in the browser: data, comparison, diagnosis, design")
    parser.add_argument(
        "path", type=Path, nargs="?", default=Path("."), metavar="CAMPAIGN | CONFIG",
        help="folder of a campaign, an empty folder to begin one, or a configuration (default: this folder)",
    )  # fmt: skip
    parser.add_argument("--port", type=whole_number(0, 65535), default=0, help="to listen on (default: any free one)")
    parser.add_argument("--no-browser", action="store_true", help="print the address, open no browser")
    parser.set_defaults(command=run)


def run(options) -> None:
    """Serve the workbench on the loopback address until Ctrl-C.

    Raises:
        WorkspaceError: there is nothing of that name, or the port is taken.
    """
    from edhas_jax.workbench.workspace import WorkspaceError, open_workspace

    if missing := [name for name in ("nicegui", "plotly") if importlib.util.find_spec(name) is None]:
        raise WorkspaceError(f"{' and '.join(missing)} is missing; install it with: pip install 'edhas_jax[workbench]'")
    workspace = open_workspace(options.path)
    from edhas_jax.workbench.server import serve

    def say(address: str) -> None:
        print(
            f"edhas workbench on {workspace.folder}\nopen {address}\nCtrl-C ends it; jobs that run go on.", flush=True
        )

    serve(workspace, options.port, not options.no_browser, say)
