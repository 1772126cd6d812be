"""What a browser asks for, and who may have it."""

from __future__ import annotations

import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from email.parser import BytesHeaderParser
from http import HTTPStatus
from pathlib import Path

__all__ = ["EVENTS", "Response", "answer", "busy"]

EVENTS = "events"
"""Name of the stream below the token."""

_HOSTS = frozenset(("127.0.0.1", "localhost"))
"""Names under which a browser may think that it reached this machine; with any port, as tunnels change it."""

_HERE = Path(__file__).parent
_FILES: Mapping[str, tuple[bytes, str]] = {
    "": ((_HERE / "page.html").read_bytes(), "text/html"),
    # The report's own: pages of one family, and colours in one place.
    "report.css": ((_HERE.parents[1] / "report" / "style.css").read_bytes(), "text/css"),
    "page.css": ((_HERE / "page.css").read_bytes(), "text/css"),
    **{path.name: (path.read_bytes(), "text/javascript") for path in sorted(_HERE.glob("*.js"))},
}
"""All there is to be had. A name is looked up here and never becomes a path."""

_SECURITY = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src data:; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'; require-trusted-types-for 'script'"
    ),
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",  # the address holds the token
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
    "Connection": "close",
}


@dataclass(frozen=True)
class Response:
    """An answer: the head, what follows, and whether it goes on as a stream of events."""

    head: bytes
    body: bytes = b""
    streams: bool = False


def answer(request: bytes, token: str) -> Response:
    r"""Decide what a request gets.

    Parameters
    ----------
    request : bytes
        Its head, up to and including the empty line.
    token : str
        The secret that stands first in every path.

    Returns
    -------
    Response
        400 for what is no request, 403 for another host than this machine, 405 for anything that is not reading,
        401 without the token, 404 for what there is not, 308 where only the slash at the end is missing.

    Examples
    --------
    >>> from granular_id.live.monitor.request import answer
    >>> answer(b"GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n", "secret").head.partition(b"\r\n")[0]
    b'HTTP/1.1 403 Forbidden'
    """
    line, _, rest = request.partition(b"\r\n")
    words = line.split(b" ")
    if len(words) != 3 or not words[2].startswith(b"HTTP/1.") or not words[1].startswith(b"/"):
        return _refusal(HTTPStatus.BAD_REQUEST, "This is no request that a browser would send.")
    hosts = BytesHeaderParser().parsebytes(rest).get_all("Host", [])
    if len(hosts) != 1 or str(hosts[0]).strip().rsplit(":", 1)[0].lower() not in _HOSTS:
        return _refusal(HTTPStatus.FORBIDDEN, "This page is for the machine it runs on.")
    if words[0] not in (b"GET", b"HEAD"):
        return _refusal(HTTPStatus.METHOD_NOT_ALLOWED, "This page is for reading only.", Allow="GET, HEAD")
    given, slash, name = words[1][1:].partition(b"?")[0].partition(b"/")
    if not secrets.compare_digest(given, token.encode()):
        return _refusal(
            HTTPStatus.UNAUTHORIZED,
            "The address lacks its secret: open the one that was printed when the session began.",
            **{"WWW-Authenticate": "Bearer"},
        )
    if not slash:
        return _refusal(
            HTTPStatus.PERMANENT_REDIRECT, "The address ends with a slash.", Location=f"/{token}/"
        )
    return _found(name.decode("latin-1"), reads=words[0] == b"GET")


def _found(name: str, *, reads: bool) -> Response:
    if name == EVENTS:
        return Response(_head(HTTPStatus.OK, "text/event-stream", None), streams=reads)
    if name not in _FILES:
        return _refusal(HTTPStatus.NOT_FOUND, "There is no such page.")
    body, kind = _FILES[name]
    return Response(_head(HTTPStatus.OK, kind, len(body)), body if reads else b"")


def busy() -> Response:
    """Refuse a stream because there are too many."""
    return _refusal(
        HTTPStatus.SERVICE_UNAVAILABLE, "Too many pages are open: close one.", **{"Retry-After": "5"}
    )


def _refusal(status: HTTPStatus, why: str, **headers: str) -> Response:
    body = f"{why}\n".encode()
    return Response(_head(status, "text/plain", len(body), **headers), body)


def _head(status: HTTPStatus, kind: str, length: int | None, **headers: str) -> bytes:
    fields = {"Content-Type": f"{kind}; charset=utf-8", **_SECURITY, **headers}
    if length is not None:
        fields["Content-Length"] = str(length)
    lines = [
        f"HTTP/1.1 {status.value} {status.phrase}",
        *(f"{name}: {value}" for name, value in fields.items()),
    ]
    return ("\r\n".join(lines) + "\r\n\r\n").encode("latin-1")
