"""The page of a Net F/T box, fetched over HTTP: small, soon, or not at all."""

from __future__ import annotations

import threading
from contextlib import suppress
from http.client import HTTPConnection, HTTPException
from socket import SHUT_RDWR

from granular_id.live.netft_page import NetftPage, NetftPageError, parse_page

__all__ = ["MAX_PAGE_BYTES", "PATH", "read_page"]

PATH = "/netftapi2.xml"
MAX_PAGE_BYTES = 64 * 1024
"""A page has some 4 KiB."""
TIMEOUT_S = 2.0
"""For the whole page: a box on the same network answers within hundredths of a second."""


def read_page(host: str, port: int = 80, *, timeout_s: float = TIMEOUT_S) -> NetftPage:
    """Ask a box for its page.

    Parameters
    ----------
    host : str
        Name or address of the box.
    port : int, default 80
        Where it serves HTTP.
    timeout_s : float, default 2
        For everything together, however slowly bytes come.

    Raises
    ------
    NetftPageError
        The page is none, is too long, or says too little.
    OSError
        The box does not answer; with the address.

    Examples
    --------
    >>> from granular_id.live.fake_netft import FakeNetft
    >>> from granular_id.live.netft_http import read_page
    >>> with FakeNetft(force_unit="lbf") as box:
    ...     page = read_page("127.0.0.1", box.http_port)
    >>> page.rate_hz, round(page.counts_per_newton, 3)
    (500.0, 224808.943)
    """
    url = f"http://{host}{PATH}" if port == 80 else f"http://{host}:{port}{PATH}"
    connection = HTTPConnection(host, port, timeout=timeout_s)
    expired = threading.Event()

    def give_up() -> None:
        expired.set()
        with suppress(OSError):  # closed already: it was a matter of microseconds
            link.shutdown(SHUT_RDWR)

    # a time-out of the socket begins anew with every byte
    alarm = threading.Timer(timeout_s, give_up)
    try:
        connection.connect()
        link = connection.sock  # the connection forgets it before the answer is read
        alarm.start()
        connection.request("GET", PATH, headers={"Connection": "close"})
        response = connection.getresponse()
        text = response.read(MAX_PAGE_BYTES + 1)
    except (OSError, HTTPException) as error:
        if expired.is_set() or isinstance(error, TimeoutError):
            raise TimeoutError(f"{url} did not answer within {timeout_s:g} s") from error
        raise ConnectionError(
            f"{url} cannot be read: {error or type(error).__name__}; is the address that of the sensor box? "
            "(its page may be at another port: http_port)"
        ) from error
    finally:
        alarm.cancel()
        connection.close()
    if expired.is_set():
        raise TimeoutError(f"{url} did not answer within {timeout_s:g} s")
    if response.status != 200:
        raise NetftPageError(
            f"{url} answers {response.status} {response.reason}; wanted the page of a Net F/T box"
        )
    if len(text) > MAX_PAGE_BYTES:
        raise NetftPageError(f"{url} is longer than {MAX_PAGE_BYTES} bytes; wanted the page of a Net F/T box")
    return parse_page(text, url)
