"""Who may talk to the workbench: the browser of this machine that was given the token, and nobody else."""

import hmac
import http
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs

LOOPBACK = "127.0.0.1"
MAX_BODY = 1_000_000_000  # bytes of a request, as many as are read of a run file
# no script, picture, font or connection from elsewhere; the page itself needs scripts and styles within it
POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self' ws://{host}; frame-ancestors 'self'; "
    "base-uri 'self'; form-action 'self'; object-src 'none'"
)


class LocalAccess:
    """An ASGI application that hands on only what may come in, and answers everything else with one sentence.

    Args:
        application: the application behind it.
        port: the port that the server listens on.
        token: what the address of the page must contain; a cookie then stands for it.
    """

    def __init__(self, application, port: int, token: str):
        self._application, self._token = application, token
        self._hosts = {f"{name}:{port}" for name in (LOOPBACK, "localhost")}
        self._cookie = f"edhas_workbench_{port}"  # cookies do not know ports

    async def __call__(self, scope, receive, send):
        """Serve one connection, see the ASGI specification."""
        if scope["type"] not in ("http", "websocket"):
            return await self._application(scope, receive, send)
        headers = [(name.decode("latin-1").lower(), value.decode("latin-1")) for name, value in scope["headers"]]
        problem = self.problem(headers, scope.get("query_string", b"").decode("latin-1"))
        if problem is not None:
            return await _refuse(scope, receive, send, *problem)
        if scope["type"] == "websocket":
            return await self._application(scope, receive, send)
        host = next(value for name, value in headers if name == "host")

        async def send_protected(message):
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], *self._protection(host, message["headers"])]
            await send(message)

        return await self._application(scope, receive, send_protected)

    def problem(self, headers: list[tuple[str, str]], query: str) -> tuple[http.HTTPStatus, str] | None:
        """Why a request is refused: status and sentence; None if it may come in.

        Args:
            headers: name in lower case and value of every header.
            query: what follows the question mark in the address.
        """
        hosts = [value for name, value in headers if name == "host"]
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            return http.HTTPStatus.MISDIRECTED_REQUEST, "This page is served under 127.0.0.1 only."
        origins = [value for name, value in headers if name == "origin"]
        if any(origin not in {f"http://{host}" for host in self._hosts} for origin in origins):
            return http.HTTPStatus.FORBIDDEN, "Requests from other pages are refused."
        lengths = [value for name, value in headers if name == "content-length"]
        if any(not value.isdecimal() or int(value) > MAX_BODY for value in lengths):
            return http.HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"At most {MAX_BODY / 1e6:.0f} MB are accepted."
        given = parse_qs(query).get("token", [])
        given += [cookie for name, value in headers if name == "cookie" for cookie in self._tokens_in(value)]
        if not any(hmac.compare_digest(text.encode(), self._token.encode()) for text in given):
            return http.HTTPStatus.FORBIDDEN, "Open the address that `edhas workbench` has printed; it has a token."
        return None

    def _tokens_in(self, cookies: str) -> list[str]:
        try:
            found = SimpleCookie(cookies).get(self._cookie)
        except CookieError:
            return []
        return [] if found is None else [found.value]

    def _protection(self, host: str, present) -> list[tuple[bytes, bytes]]:
        """Headers of every answer; a page that brings its own policy keeps it."""
        rows = {
            "set-cookie": f"{self._cookie}={self._token}; HttpOnly; SameSite=Strict; Path=/",
            "referrer-policy": "no-referrer",
            "x-content-type-options": "nosniff",
            "cross-origin-opener-policy": "same-origin",
        }
        if not any(name.lower() == b"content-security-policy" for name, _ in present):
            rows["content-security-policy"] = POLICY.format(host=host)
        return [(name.encode(), value.encode("latin-1")) for name, value in rows.items()]


async def _refuse(scope, receive, send, status: http.HTTPStatus, sentence: str) -> None:
    """Answer with a status and a sentence; a websocket is closed before it is open."""
    if scope["type"] == "websocket":
        await receive()
        return await send({"type": "websocket.close", "code": 1008, "reason": sentence})
    headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"x-content-type-options", b"nosniff")]
    await send({"type": "http.response.start", "status": int(status), "headers": headers})
    return await send({"type": "http.response.body", "body": f"{sentence}\n".encode()})
