"""The monitor: a page on this machine that shows a session while it runs, for reading only."""

from __future__ import annotations

import base64
import json
import math
import secrets
import socket
import sys
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from socketserver import TCPServer
from threading import Condition, Thread
from typing import TYPE_CHECKING, Any

import numpy as np

from granular_id._checks import argument_error
from granular_id._core import GranularIdError
from granular_id._text import fixed
from granular_id.live.snapshot import SYNTHETIC, VIEW_S, Snapshot

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["MonitorServer", "frame"]

_LOOPBACK = "127.0.0.1"
_HOSTS = frozenset((_LOOPBACK, "localhost"))  # with any port, as tunnels change it
_QUIET_S = 1.0  # after this long without a snapshot, pages are notified
_END_S = 0.5  # at the end; who has not taken the last frame by then is not waited for
_SEND_BUFFER_BYTES = 256 * 1024  # a few frames: a browser that comes back must not see old ones for seconds

_WEB = files("granular_id").joinpath("live/web")
# All that is served. A name is looked up here and never becomes a path.
_FILES = {
    "": (_WEB.joinpath("page.html").read_bytes(), "html"),
    "page.css": (_WEB.joinpath("page.css").read_bytes(), "css"),
    "page.js": (_WEB.joinpath("page.js").read_bytes(), "javascript"),
    "style.css": (files("granular_id").joinpath("_style.css").read_bytes(), "css"),
}

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
    "Allow": "GET",
    "WWW-Authenticate": "Bearer",
}


class MonitorServer(ThreadingHTTPServer):
    """Shows snapshots in browsers on this machine: a view for `Views`.

    It serves `port` of 127.0.0.1 (0: a free one) from a thread of its own. Each browser has another, which sends the
    newest frame once the one before is taken: a browser that does not read holds up nobody. `url` holds a random
    token: who has it can watch, and nobody else.

    Examples
    --------
    >>> from granular_id.live import MonitorServer, Views
    >>> with Views([monitor := MonitorServer()]):
    ...     print(monitor.url.split(":")[:2])
    ['http', '//127.0.0.1']
    """

    daemon_threads = True

    def __init__(self, port: int = 0) -> None:
        if not 0 <= port <= 65535:
            raise argument_error(GranularIdError, "port", f"must be between 0 and 65535, got {fixed(port)}")
        try:
            super().__init__((_LOOPBACK, port), _Handler)
        except OSError as error:
            raise type(error)(f"cannot serve the monitor on port {port}: {error.strerror}") from error
        self.token = secrets.token_urlsafe(24)
        self.url = f"http://{_LOOPBACK}:{self.server_address[1]}/{self.token}/"
        self._changed = Condition()
        self._number, self._frame, self._is_over = 0, b"", False
        self._n_browsers = 0
        Thread(target=self.serve_forever, args=(0.05,), name="granular_id monitor", daemon=True).start()

    def server_bind(self) -> None:
        """Leave the network alone, which the derived class asks for the name of this machine."""
        TCPServer.server_bind(self)

    def show(self, snapshot: Snapshot) -> None:
        """Encode a snapshot for the browsers, which take it when they can."""
        data = frame(snapshot, self._number + 1)
        with self._changed:
            self._number, self._frame = self._number + 1, data
            self._changed.notify_all()

    def close(self) -> None:
        """Tell the pages that the session has ended, once they have its last snapshot."""
        with self._changed:
            self._is_over = True
            self._changed.notify_all()
            self._changed.wait_for(lambda: not self._n_browsers, _END_S)
        self.shutdown()
        self.server_close()

    def send_frames(self, send: Callable[[bytes], object]) -> None:
        """Send the newest frame whenever there is another, until the end; now and then, that there is none."""
        seen, is_over = 0, False
        with self._changed:
            self._n_browsers += 1
        try:
            while not is_over:
                with self._changed:
                    self._changed.wait_for(lambda: self._number != seen or self._is_over, _QUIET_S)  # noqa: B023
                    data = self._frame if self._number != seen else _event("quiet")
                    seen, is_over = self._number, self._is_over
                send(data + _event("end") * is_over)
        finally:
            with self._changed:
                self._n_browsers -= 1
                self._changed.notify_all()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Print what went wrong, unless a browser went away."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    """What a browser asks for, and whether it may have it."""

    protocol_version = "HTTP/1.1"
    timeout = 5.0  # for a request; a browser needs milliseconds
    stalled_s = 30.0  # a browser that has not taken a frame for so long is dropped
    server: MonitorServer

    def do_GET(self) -> None:
        hosts = self.headers.get_all("Host", [])
        token, slash, name = self.path[1:].partition("?")[0].partition("/")
        if len(hosts) != 1 or hosts[0].strip().rsplit(":", 1)[0].lower() not in _HOSTS:
            self._answer(403, b"This page is for the machine it runs on.\n")
        elif not secrets.compare_digest(token.encode(), self.server.token.encode()):
            self._answer(
                401, b"The address lacks its secret: open the one that was printed at the beginning.\n"
            )
        elif name == "events":
            self.connection.settimeout(self.stalled_s)
            self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
            self._answer(200, None, "event-stream")
            self.server.send_frames(self.wfile.write)
        elif slash and name in _FILES:
            self._answer(200, *_FILES[name])
        else:
            self._answer(404, b"There is no such page.\n")

    def _answer(self, status: int, body: bytes | None, kind: str = "plain") -> None:
        self.send_response_only(status)
        length = {} if body is None else {"Content-Length": str(len(body))}
        for name, value in {"Content-Type": f"text/{kind}; charset=utf-8", **length, **_SECURITY}.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body or b"")

    def send_error(self, code: int, *_: object) -> None:
        if code == HTTPStatus.NOT_IMPLEMENTED:
            self._answer(405, b"This page is for reading only.\n")
        else:
            self._answer(code, b"This is no request that a browser would send.\n")

    def log_message(self, *_: object) -> None:
        """Nobody reads it."""


def frame(snapshot: Snapshot, number: int) -> bytes:
    """Encode a snapshot as a server-sent event; curves are float32 in base64, as decimal numbers take milliseconds."""
    words, now = snapshot.words, snapshot.decision
    names = ("state", "score", "source", "spoken", "warnings", "figures")
    so_far = 0.0 if now is None else min(1.0, now.seconds / snapshot.capture_s)
    return _event(
        "snapshot",
        number=number,
        **{name: getattr(words, name) for name in names},
        answer=words.answer._asdict(),
        history=[entry._asdict() for entry in words.history],
        synthetic=SYNTHETIC if snapshot.synthetic else "",
        progress=so_far if words.answer.kind == "provisional" else float(snapshot.state == "complete"),
        captions={
            "wrench": f"last {VIEW_S:g} s",
            "residual": f"the same above {snapshot.cutoff_hz:g} Hz",
            "bins": "histogram since start" if snapshot.hop_s is None else "its histogram",
        },
        at=_packed(1 - snapshot.row_age_s / np.max(snapshot.row_age_s, initial=VIEW_S)),
        axes=[_axis(snapshot, i) for i in range(len(snapshot.axes))],
        ranking=_ranking(snapshot) if len(snapshot.ranking_history[0]) else None,
    )


def _axis(snapshot: Snapshot, i: int) -> dict[str, Any]:
    unit, wrench, residual = snapshot.units[i], snapshot.wrench[:, i], snapshot.residual[:, i]
    least, (low, high) = 0.05 if unit == "N" else 0.002, _extremes(wrench)
    step = _rounded_up(max(high - low, least)) / 10  # round ends: the scale must not tremble with the noise
    low = math.floor(low / step) * step
    end = _rounded_up(max(*map(abs, _extremes(residual)), least))
    counts, edges = snapshot.counts[i], snapshot.bin_edges[i]
    middle, most = len(counts) / 2, int(counts.max())
    # The part with counts, at least ten bins on either side of the middle.
    reach = min(middle, max([10, *np.ceil(abs(np.flatnonzero(counts) + 0.5 - middle))]))
    first, last = math.floor(middle - reach), math.ceil(middle + reach)
    return {
        "name": snapshot.axes[i],
        "unit": unit,
        "value": snapshot.words.values[i].replace("-", "\u2212"),
        "wrench": _curve(wrench, low, max(math.ceil(high / step) * step, low + step)),
        "residual": _curve(residual, -end, end),
        "bins": {
            # The root, so that the few large values that tell materials apart are not lost beside the many small ones.
            "shares": _packed(np.sqrt(counts[first:last] / max(most, 1))),
            "most": f"{most:,} max" if most else "",
            "low": _label(edges[first]),
            "high": f"{_label(edges[last])} {unit}",
        },
    }


def _curve(values: NDArray[np.float64], low: float, high: float) -> dict[str, Any]:
    zero = min(max(-low / (high - low), 0.0), 1.0)
    shares = _packed((values - low) / (high - low))
    return {"shares": shares, "zero": zero, "low": _label(low), "high": _label(high)}


def _ranking(snapshot: Snapshot) -> dict[str, Any]:
    times, losses = snapshot.ranking_history
    until, (low, high) = max(snapshot.span_s, times[-1]), _extremes(losses)
    zero = 0.0 if snapshot.hop_s is None else until  # where answers go on, times are before now
    step = next((step for step in (0.2, 1, 2, 10, 60) if until <= 8 * step), 600)
    shares, order = (losses - low) / max(high - low, 1e-6), np.argsort(losses[-1])
    return {
        "at": _packed(times / until),
        "names": [(snapshot.classes[k], fixed(losses[-1, k], 3)) for k in order],
        "curves": [_packed(shares[:, k]) for k in order],
        "levels": [fixed(level, 2) for level in (low, (low + high) / 2, high)],
        "ticks": [(tick / until, _label(tick - zero)) for tick in np.arange(0, until * 1.0001, step)],
    }


def _extremes(values: NDArray[np.float64]) -> tuple[float, float]:
    known = values[np.isfinite(values)]
    return (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)


def _rounded_up(value: float) -> float:
    """Return the next number of the series 1, 2, 5, 10, ..."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(factor * power for factor in (1, 2, 5, 10) if factor * power >= value * (1 - 1e-9))


def _label(value: float) -> str:
    return f"{float(f'{value + 0.0:.3g}'):g}".replace("-", "\u2212")


def _event(kind: str, **data: Any) -> bytes:
    """Encode one server-sent event; JSON has no line breaks of its own, so one ``data`` line holds it."""
    return f"event: {kind}\ndata: {json.dumps(data, allow_nan=False)}\n\n".encode()


def _packed(shares: NDArray[np.float64]) -> str:
    return base64.b64encode(shares.astype("<f4").tobytes()).decode()
