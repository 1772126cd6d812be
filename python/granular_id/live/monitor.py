"""The monitor: a page on this machine that shows a session while it runs, for reading only."""

from __future__ import annotations

import base64
import json
import secrets
import socket
import sys
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import closing
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from socketserver import TCPServer
from threading import Condition, Thread
from typing import TYPE_CHECKING, Any

import numpy as np

from granular_id._checks import checked_index
from granular_id._text import fixed
from granular_id.live.snapshot import SYNTHETIC, Snapshot
from granular_id.live.view import MAX_HZ, BackgroundView, checked_max_hz

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

__all__ = ["MonitorServer", "frame"]

_LOOPBACK = "127.0.0.1"
_HOSTS = frozenset((_LOOPBACK, "localhost"))
"""Names under which a browser may think that it reached this machine; with any port, as tunnels change it."""

_QUIET_S = 1.0  # after this long without a snapshot, pages are told so
_END_S = 0.5  # at the end; who has not taken the last frame by then is not waited for
# A few frames: a browser that comes back must not first see old ones for seconds.
_SEND_BUFFER_BYTES = 256 * 1024

_PACKAGE = files("granular_id")
_FILES: Mapping[str, tuple[bytes, str]] = {
    "": (_PACKAGE.joinpath("live/web/page.html").read_bytes(), "text/html"),
    "page.css": (_PACKAGE.joinpath("live/web/page.css").read_bytes(), "text/css"),
    "page.js": (_PACKAGE.joinpath("live/web/page.js").read_bytes(), "text/javascript"),
    "style.css": (_PACKAGE.joinpath("_style.css").read_bytes(), "text/css"),
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


class MonitorServer(BackgroundView):
    """Shows snapshots in browsers on this machine.

    Publishing leaves the snapshot for a thread, which encodes the newest one at most `max_hz` times a second. Each
    browser has a thread of its own, which sends the newest frame once the one before is taken: a browser that does not
    read holds up neither the session nor the others, and costs the memory of one frame.

    Parameters
    ----------
    port : int, default 0
        Port on 127.0.0.1, the only interface served. 0: a free one.
    max_hz : float, default 30
        Updates per second, at most 30. Fewer for a slow tunnel: a frame takes about 50 kB.

    Attributes
    ----------
    url : str
        Address to open. It holds a random token: who has it can watch, and nobody else.
    port : int

    Raises
    ------
    OSError
        The port is taken.

    Examples
    --------
    >>> from granular_id.live import MonitorServer, Snapshot
    >>> with MonitorServer() as monitor:
    ...     monitor.publish(Snapshot("idle"))
    ...     print(monitor.url.split(":")[:2])
    ['http', '//127.0.0.1']
    """

    def __init__(self, port: int = 0, *, max_hz: float = MAX_HZ) -> None:
        checked_max_hz(max_hz)
        if not 0 <= checked_index(port, "port") <= 65535:
            raise ValueError(f"port must be between 0 and 65535, got {fixed(port)}")
        try:
            self._server = _Server(port)
        except OSError as error:
            raise type(error)(f"cannot serve the monitor on port {port}: {error.strerror}") from error
        self.port: int = self._server.server_address[1]
        self.url = f"http://{_LOOPBACK}:{self.port}/{self._server.token}/"
        self._number = 0
        Thread(target=self._server.serve_forever, args=(0.05,), name="monitor", daemon=True).start()
        super().__init__("monitor", max_hz=max_hz, patience_s=10.0)

    def show(self, snapshot: Snapshot) -> None:
        """Encode a snapshot for the browsers, which take it when they can."""
        self._number += 1
        self._server.offer(self._number, frame(snapshot, self._number))

    def finish(self) -> None:
        """Tell the pages that the session has ended, once they have its last snapshot; then close."""
        self._server.end(_event("end", {}) if self.failure is None else b"")


class _Server(ThreadingHTTPServer):
    """One thread a connection; what all of them share is the newest frame."""

    daemon_threads = True
    request_queue_size = 64

    def __init__(self, port: int) -> None:
        self.token = secrets.token_urlsafe(24)
        self._changed = Condition()
        self._number, self._frame, self._since_s = 0, b"", time.monotonic()
        self._farewell: bytes | None = None
        self.n_streams = 0
        super().__init__((_LOOPBACK, port), _Handler)

    def server_bind(self) -> None:
        TCPServer.server_bind(self)  # the other one asks the network for the name of this machine

    def offer(self, number: int, data: bytes) -> None:
        with self._changed:
            self._number, self._frame, self._since_s = number, data, time.monotonic()
            self._changed.notify_all()

    def end(self, farewell: bytes) -> None:
        """Send the last frame, and this after it, to all that take them soon; then close."""
        with self._changed:
            self._farewell = farewell
            self._changed.notify_all()
            self._changed.wait_for(lambda: not self.n_streams, _END_S)
        self.shutdown()
        self.server_close()

    def frames(self) -> Generator[bytes, None, None]:
        """Yield the newest frame whenever there is another, until the end; now and then, that there is none."""
        seen, farewell = 0, None
        with self._changed:
            self.n_streams += 1
        try:
            while farewell is None:
                with self._changed:
                    self._changed.wait_for(self._has_news(seen), _QUIET_S)
                    number, data, farewell = self._number, self._frame, self._farewell
                if number == seen:
                    data = _event("quiet", {"for_s": round(time.monotonic() - self._since_s, 1)})
                seen = number
                yield data + (farewell or b"")
        finally:
            with self._changed:
                self.n_streams -= 1
                self._changed.notify_all()

    def _has_news(self, seen: int) -> Callable[[], bool]:
        return lambda: self._number != seen or self._farewell is not None

    def handle_error(self, request: Any, client_address: Any) -> None:
        if not isinstance(sys.exc_info()[1], OSError):  # a browser that goes away is none
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    """What a browser asks for, and whether it may have it."""

    protocol_version = "HTTP/1.1"
    timeout = 5.0  # for a request; a browser needs milliseconds
    stalled_s = 30.0  # a browser that has not taken a frame for so long is dropped
    server: _Server

    def do_GET(self) -> None:
        hosts = self.headers.get_all("Host", [])
        if len(hosts) != 1 or hosts[0].strip().rsplit(":", 1)[0].lower() not in _HOSTS:
            self._refuse(HTTPStatus.FORBIDDEN, "This page is for the machine it runs on.")
            return
        token = self.server.token
        given, slash, name = self.path[1:].partition("?")[0].partition("/")
        if not secrets.compare_digest(given.encode(), token.encode()):
            why = "The address lacks its secret: open the one that was printed when the session began."
            self._refuse(HTTPStatus.UNAUTHORIZED, why, **{"WWW-Authenticate": "Bearer"})
        elif not slash:
            why = "The address ends with a slash."
            self._refuse(HTTPStatus.PERMANENT_REDIRECT, why, Location=f"/{token}/")
        elif name == "events":
            self._stream()
        elif name in _FILES:
            self._answer(HTTPStatus.OK, _FILES[name][1], _FILES[name][0])
        else:
            self._refuse(HTTPStatus.NOT_FOUND, "There is no such page.")

    do_HEAD = do_GET  # noqa: N815

    def _stream(self) -> None:
        self.connection.settimeout(self.stalled_s)
        self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
        self._answer(HTTPStatus.OK, "text/event-stream")
        if self.command == "HEAD":
            return
        with closing(self.server.frames()) as frames:
            for data in frames:
                self.wfile.write(data)

    def _refuse(self, status: HTTPStatus, why: str, **headers: str) -> None:
        self._answer(status, "text/plain", f"{why}\n".encode(), **headers)

    def _answer(self, status: HTTPStatus, kind: str, body: bytes | None = None, **headers: str) -> None:
        self.send_response_only(status)
        length = {} if body is None else {"Content-Length": str(len(body))}
        fields = {"Content-Type": f"{kind}; charset=utf-8", **length, **_SECURITY, **headers}
        for name, value in fields.items():
            self.send_header(name, value)
        self.end_headers()
        if body is not None and self.command != "HEAD":
            self.wfile.write(body)

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:  # noqa: ARG002
        if code == HTTPStatus.NOT_IMPLEMENTED:
            why = "This page is for reading only."
            self._refuse(HTTPStatus.METHOD_NOT_ALLOWED, why, Allow="GET, HEAD")
        else:
            self._refuse(HTTPStatus(code), "This is no request that a browser would send.")

    def log_message(self, *_: object) -> None:
        """Nobody reads it."""


def frame(snapshot: Snapshot, number: int) -> bytes:
    """Encode a snapshot as a server-sent event.

    Traces are float32 in base64, axis by axis: written as decimal numbers they would be four times as long and
    take the interpreter lock for milliseconds, thirty times a second.
    """
    words = snapshot.words
    times, losses = snapshot.ranking_history
    return _event(
        "snapshot",
        {
            "number": number,
            "complete": snapshot.state == "complete",
            "state": words.state,
            "answer": words.answer._asdict(),
            "history": [entry._asdict() for entry in words.history],
            "spoken": words.spoken,
            "figures": words.figures,
            "score": words.score,
            "warnings": words.warnings,
            "source": words.source,
            "synthetic": SYNTHETIC if snapshot.synthetic else "",
            "ranking": words.ranking,
            "values": words.values,
            "axes": snapshot.axes,
            "units": snapshot.units,
            "cutoff_hz": snapshot.cutoff_hz,
            "capture_s": snapshot.ranking_s,
            "ago": snapshot.hop_s is not None,
            "age_s": _packed(snapshot.row_age_s),
            "wrench": _packed(snapshot.wrench.T),
            "residual": _packed(snapshot.residual.T),
            "bins": [[float(edges[0]), float(edges[-1])] for edges in snapshot.bin_edges],
            "counts": _packed(snapshot.counts),
            "classes": snapshot.classes,
            "history_s": _packed(times),
            "history_losses": _packed(losses.T),
        },
    )


def _event(kind: str, data: dict[str, Any]) -> bytes:
    """Encode one server-sent event; JSON has no line breaks of its own, so one ``data`` line holds it."""
    return f"event: {kind}\ndata: {json.dumps(data, allow_nan=False)}\n\n".encode()


def _packed(values: ArrayLike) -> str:
    with np.errstate(over="ignore"):  # beyond float32 nothing is drawn
        return base64.b64encode(np.asarray(values).astype("<f4").tobytes()).decode()
