"""The command `edhas workbench`."""

import importlib.util

from edhas_jax.workbench.workspace import WorkspaceError, open_workspace


def serve(options) -> None:
    """Serve the workbench on the loopback address until Ctrl-C.

    Raises:
        WorkspaceError: there is nothing of that name, or the port is taken.
    """
    if missing := [name for name in ("nicegui", "plotly") if importlib.util.find_spec(name) is None]:
        raise WorkspaceError(f"{' and '.join(missing)} is missing; install it with: pip install 'edhas_jax[workbench]'")
    workspace = open_workspace(options.path)
    from edhas_jax.workbench import server

    def say(address: str) -> None:
        print(
            f"edhas workbench on {workspace.folder}\nopen {address}\nCtrl-C ends it; jobs that run go on.", flush=True
        )

    server.serve(workspace, options.port, not options.no_browser, say)
