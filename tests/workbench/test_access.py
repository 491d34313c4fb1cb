"""Who may talk to the workbench: foreign hosts and origins, missing tokens, paths outside the folder."""

import asyncio
import json
import os
import signal
from urllib.error import HTTPError
from urllib.request import HTTPCookieProcessor, build_opener

import pytest

from edhas_jax.workbench.access import LocalAccess
from edhas_jax.workbench.workspace import Workspace, WorkspaceError

PORT, TOKEN = 8123, "right-token"
HOST = f"127.0.0.1:{PORT}"


async def inner(scope, receive, send):
    """An application that answers everything."""
    if scope["type"] == "websocket":
        await receive()
        return await send({"type": "websocket.accept"})
    await send({"type": "http.response.start", "status": 200, "headers": []})
    return await send({"type": "http.response.body", "body": b"secret"})


def answer(kind="http", query=b"", **headers):
    """The messages that a request gets."""
    sent = []

    async def receive():
        return {"type": "websocket.connect"} if kind == "websocket" else {"type": "http.request"}

    async def send(message):
        sent.append(message)

    rows = [(name.replace("_", "-").encode(), value.encode()) for name, value in headers.items()]
    scope = {"type": kind, "headers": rows, "query_string": query, "path": "/"}
    asyncio.run(LocalAccess(inner, PORT, TOKEN)(scope, receive, send))
    return sent


RIGHT = f"edhas_workbench_{PORT}={TOKEN}"


def test_the_token_in_the_address_or_in_the_cookie_opens_the_page():
    for request in ({"query": f"token={TOKEN}".encode()}, {"cookie": RIGHT}, {"cookie": f"a=b; {RIGHT}"}):
        start, body = answer(host=HOST, **request)
        assert start["status"] == 200 and body["body"] == b"secret"
    headers = dict(start["headers"])
    assert b"HttpOnly" in headers[b"set-cookie"] and b"SameSite=Strict" in headers[b"set-cookie"]
    assert b"default-src 'self'" in headers[b"content-security-policy"]


@pytest.mark.parametrize(
    ("status", "request_headers"),
    [
        (403, {"host": HOST}),
        (403, {"host": HOST, "cookie": f"edhas_workbench_{PORT}=wrong"}),
        (403, {"host": HOST, "cookie": f"edhas_workbench_{PORT + 1}={TOKEN}"}),
        (403, {"host": HOST, "cookie": RIGHT, "origin": "http://evil.example"}),
        (403, {"host": HOST, "cookie": RIGHT, "origin": "null"}),
        (403, {"host": HOST, "cookie": RIGHT, "origin": f"https://{HOST}"}),
        (421, {"host": "evil.example", "cookie": RIGHT}),
        (421, {"host": f"evil.example:{PORT}", "cookie": RIGHT}),
        (421, {"host": "127.0.0.1", "cookie": RIGHT}),
        (421, {"cookie": RIGHT}),
        (413, {"host": HOST, "cookie": RIGHT, "content_length": "99999999999"}),
        (413, {"host": HOST, "cookie": RIGHT, "content_length": "-1"}),
    ],
)
def test_everything_else_is_refused(status, request_headers):
    sent = answer(**request_headers)
    assert sent[0]["status"] == status
    assert b"secret" not in sent[1]["body"] and TOKEN.encode() not in sent[1]["body"]
    assert not any(name == b"set-cookie" for name, _ in sent[0]["headers"])
    assert answer(kind="websocket", **request_headers)[0]["type"] == "websocket.close"


def test_a_websocket_of_the_page_itself_is_accepted():
    assert answer(kind="websocket", host=HOST, origin=f"http://{HOST}", cookie=RIGHT)[0]["type"] == "websocket.accept"


def test_nothing_outside_the_folder_is_reached(tmp_path):
    folder = tmp_path / "campaign"
    folder.mkdir()
    (tmp_path / "secret.csv").write_text("time [s],current [A]\n0,1\n")
    os.symlink(tmp_path / "secret.csv", folder / "link.csv")
    workspace = Workspace(folder)
    for name in ("../secret.csv", "/etc/passwd", "link.csv", "a/../../secret.csv"):
        with pytest.raises(WorkspaceError, match="lies outside"):
            workspace.inside(name)
    assert workspace.inside("run1.csv") == folder / "run1.csv"


@pytest.mark.parametrize(
    "text",
    ["runs:\n  - {file: ../secret.csv, use: fit}\n", "reference: {kind: recorded, file: /etc/passwd}\nruns: []\n"],
)
def test_a_campaign_that_names_files_outside_its_folder_is_refused(tmp_path, text):
    (tmp_path / "campaign.yaml").write_text(f"rig: actuator_bench\n{text}")
    with pytest.raises(WorkspaceError, match="lies outside"):
        Workspace(tmp_path).require_files_inside()


def test_a_link_in_place_of_the_result_folder_is_refused(tmp_path):
    folder = tmp_path / "campaign"
    folder.mkdir()
    (tmp_path / "elsewhere").mkdir()
    os.symlink(tmp_path / "elsewhere", folder / "workbench")
    with pytest.raises(WorkspaceError, match="lies outside"):
        Workspace(folder).add_step("compare", "edhas compare x", "edhas.compare(x)")
    assert not list((tmp_path / "elsewhere").iterdir())


def test_damaged_files_of_the_workbench_are_as_if_absent(tmp_path):
    results = tmp_path / "workbench"
    (results / "tried").mkdir(parents=True)
    (results / "jobs").mkdir()
    for content in ("{", "[]", '"text"', json.dumps({"added": 3, "rejected": []}), "\x00"):
        for name in ("decisions.json", "steps.jsonl", "tried/a.json", "jobs/1.json"):
            (results / name).write_text(content)
        workspace = Workspace(tmp_path)
        assert workspace.decisions().added == () and not workspace.steps() and not workspace.tried()


def test_what_a_stranger_program_asks_of_the_server(workbench, tmp_path):
    pytest.importorskip("nicegui", reason="no nicegui: pip install 'edhas_jax[workbench]'")
    served, opener = workbench(tmp_path), build_opener(HTTPCookieProcessor())

    def ask(address):
        try:
            return opener.open(address).status, ""
        except HTTPError as error:
            return error.code, error.read().decode()

    answers = [ask(served.address) for _ in range(30)]
    assert answers[0][0] == 200 and answers[-1] == (503, "Many pages wait for their browser; try again in a minute.")
    long = served.address.partition("?")[0] + "results/" + "a" * 5000 + ".html"
    assert ask(long) == (404, "There is no such report.")
    served.process.send_signal(signal.SIGINT)
    assert served.process.wait(60.0) == 130
    assert served.process.stdout.read().splitlines()[-1].startswith("edhas: interrupted")
