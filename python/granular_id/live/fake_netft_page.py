"""The page of the fake box, and the server that serves it."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from xml.sax.saxutils import escape

from granular_id.live.netft_http import PATH

__all__ = ["PageServer", "page_text"]

_FIELDS = {
    "prodname": "Net F/T",
    "runstat": "0x00000000",
    "runrate": "7000",
    "cfgnam": "Fake box",
    "cfgcalsel": "0",
    "cfgcalsn": "FT00000",
    "scfgfu": "N",
    "scfgtu": "Nm",
    "cfgtfx": "0;0;0;0;0;0",
    "scfgtdu": "mm",
    "scfgtau": "degrees",
    "cfgcpf": "1000000",
    "cfgcpt": "1000000",
    "cfgmr": "290;290;580;10;10;10",
    "setbias": "0;0;0;0;0;0",
    "setuserfilter": "0",
    "comrdte": "Enabled",
    "comrdtrate": "500",
    "comrdtbsiz": "40",
    "mfgdigsn": "FAKE",
    "mfgdigver": "0.0.0",
}
"""What a Net F/T tells, as far as clients may want it."""


def page_text(values: Mapping[str, str], changes: Mapping[str, str | None]) -> bytes:
    """Write the page.

    Parameters
    ----------
    values : mapping of str to str
        Fields that differ from a Net F/T fresh from the factory.
    changes : mapping of str to str or None
        The same, for faults: fields with None are left out.

    Examples
    --------
    >>> from granular_id.live.fake_netft_page import page_text
    >>> b"<scfgfu>lbf</scfgfu>" in page_text({"scfgfu": "lbf"}, {"cfgcpf": None})
    True
    """
    fields = {**_FIELDS, **values, **changes}
    lines = [f"<{name}>{escape(value)}</{name}>" for name, value in fields.items() if value is not None]
    return "\n".join(['<?xml version="1.0"?>', "<netft>", *lines, "</netft>", ""]).encode()


class PageServer:
    """Serves one page from a thread, on one address.

    Parameters
    ----------
    text : bytes
    host : str
    port : int
        0: any that is free.
    """

    def __init__(self, text: bytes, host: str, port: int) -> None:
        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                if self.path != PATH:
                    self.send_error(404)
                    return
                self.send_response(200)
                self.send_header("Content-Type", "text/xml")
                self.send_header("Content-Length", str(len(text)))
                self.end_headers()
                self.wfile.write(text)

            def log_message(self, *_: object) -> None:
                """Nobody reads it."""

        self._server = ThreadingHTTPServer((host, port), Handler)
        self._server.daemon_threads = True
        self._thread = threading.Thread(
            target=self._server.serve_forever,
            kwargs={"poll_interval": 0.02},
            name="fake Net F/T page",
            daemon=True,
        )

    @property
    def port(self) -> int:
        """TCP port."""
        return int(self._server.server_address[1])

    def start(self) -> None:
        """Begin to serve."""
        self._thread.start()

    def stop(self) -> None:
        """End, and free the port."""
        if self._thread.is_alive():
            self._server.shutdown()
            self._thread.join()
        self._server.server_close()
