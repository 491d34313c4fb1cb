"""The server of the workbench: on the loopback address, for the browser that was given the token."""

import contextlib
import logging
import secrets
import socket
import webbrowser
from collections.abc import Callable
from pathlib import Path

import uvicorn
from fastapi import FastAPI
from fastapi.responses import FileResponse, PlainTextResponse, Response
from nicegui import Client, app, ui

from edhas_jax.workbench.access import LOOPBACK, LocalAccess
from edhas_jax.workbench.page import Page
from edhas_jax.workbench.session import Session
from edhas_jax.workbench.workspace import RESULTS, Workspace, WorkspaceError

REPORTS, PICTURES = (".html",), (".png", ".svg")
# a report may come from a stranger: its scripts run, but in a place of their own, without access to the workbench
REPORT_POLICY = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:"
)
GRACE = 2  # s, for pages that are open when the server ends
MAX_UNOPENED = 20  # pages that wait for their browser, each with some hundred kilobytes
RECONNECT = 30.0  # s, that a page waits for a busy server


def serve(
    workspace: Workspace, port: int = 0, show: bool = True, say: Callable[[str], None] = print
) -> None:  # fmt: skip
    """Serve the page until Ctrl-C.

    Args:
        workspace: the folder.
        port: to listen on; 0 for any free one.
        show: whether the browser is opened.
        say: called with the address.

    Raises:
        WorkspaceError: the port is taken.
    """
    token = secrets.token_urlsafe(24)
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((LOOPBACK, port))
        listening.listen()  # a browser that is faster than the server waits
    except OSError as error:
        raise WorkspaceError(f"--port {port}: {error.strerror}; leave it out to take any free one") from None
    port = listening.getsockname()[1]
    session = Session(workspace)
    application = build_application(session)
    address = f"http://{LOOPBACK}:{port}/?token={token}"
    guarded = LocalAccess(application, port, token)
    config = uvicorn.Config(
        guarded, log_level="error", access_log=False, lifespan="on", timeout_graceful_shutdown=GRACE
    )  # fmt: skip
    server = uvicorn.Server(config)
    session.calculator.warm_up()
    say(address)
    if show:
        webbrowser.open(address)
    try:
        with contextlib.suppress(KeyboardInterrupt):
            server.run(sockets=[listening])
    finally:
        session.calculator.stop()


def build_application(session: Session) -> FastAPI:
    """The application behind the guard: the page, reports and pictures."""
    logging.getLogger("nicegui").setLevel(logging.ERROR)
    application = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)

    title = f"{session.workspace.folder.name} – edhas workbench"

    @ui.page("/", title=title, reconnect_timeout=RECONNECT, response_timeout=RECONNECT)
    async def show_page():
        # NiceGUI keeps for a minute what no browser connects to
        if sum(not client.has_socket_connection for client in Client.instances.values()) > MAX_UNOPENED:
            return PlainTextResponse("Many pages wait for their browser; try again in a minute.", 503)
        await Page(session).build()

    @app.get("/alive")
    def alive():
        return Response(status_code=204)

    @app.get("/results/{name:path}")
    def result(name: str):
        try:
            path = session.workspace.inside(Path(RESULTS, name))
            is_shown = path.suffix in REPORTS + PICTURES and path.is_file()
        except WorkspaceError as error:
            return PlainTextResponse(str(error), 404)
        except (ValueError, OSError):  # no name of a file, or one that is too long
            is_shown = False
        if not is_shown:
            return PlainTextResponse("There is no such report.", 404)
        headers = {"Cache-Control": "no-store"}
        if path.suffix in REPORTS:
            headers["Content-Security-Policy"] = REPORT_POLICY
        return FileResponse(path, headers=headers)

    ui.run_with(application, title="edhas workbench", favicon=FAVICON, show_welcome_message=False,
                reconnect_timeout=RECONNECT)  # fmt: skip
    return application


FAVICON = (
    '<svg viewBox="0 0 32 32" xmlns="http://www.w3.org/2000/svg"><rect width="32" height="32" rx="6" fill="#0b62c4"/>'
    '<path d="M4 20 H10 L13 9 L18 25 L21 16 H28" stroke="white" stroke-width="2.6" fill="none"/></svg>'
)
