"""A sensor box that is none: speaks RDT and serves its page on this machine, with faults on demand.

For trying things without hardware, and for tests: it counts exactly what it did wrong. ``python -m granular_id.testing
--material rice`` runs it until Ctrl-C; `FakeNetft` runs it inside a program.
"""

from __future__ import annotations

import argparse
import json
import select
import socket
import sys
import threading
import time
from array import array
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, fields
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_id._checks import argument_error, as_floats, finite_number, positive_number
from granular_id._core import GranularIdError
from granular_id.live.netft_page import SYNTHETIC_FIELD, parse_page
from granular_id.synthetic import synthesize

__all__ = ["FakeNetft", "Faults", "Injected"]

HOST = "127.0.0.1"
_IDLE_S = 0.02
_STOP, _START, _START_BUFFERED, _BIAS = 0x0000, 0x0002, 0x0003, 0x0042
_BAD_STATUS = 0x8000_0001  # of a Net F/T: supply voltage

_RECORD = np.dtype([("rdt", ">u4"), ("ft", ">u4"), ("status", ">u4"), ("counts", ">i4", (6,))])
_TICK_HZ = 7000.0  # samples per second within the sensor
_PER_DATAGRAM = 40  # records, when a client asks for buffered mode
_PROTECTED = 3  # datagrams at both ends of a stream: what is lost at its end, nobody can count
_FIRST_FT = 1_000_000  # a box is never queried in its first moment
_AFTER_S = 0.5  # clients get so long to say that they are done

_FACTORY = {
    "prodname": "Net F/T", "runstat": "0x00000000", "runrate": "7000", "cfgnam": "Fake box", "cfgcalsel": "0",
    "cfgcalsn": "FT00000", "scfgfu": "N", "scfgtu": "Nm", "cfgtfx": "0;0;0;0;0;0", "scfgtdu": "mm",
    "scfgtau": "degrees", "cfgcpf": "1000000", "cfgcpt": "1000000", "cfgmr": "290;290;580;10;10;10",
    "setbias": "0;0;0;0;0;0", "setuserfilter": "0", "comrdte": "Enabled", "comrdtrate": "500", "comrdtbsiz": "40",
    "mfgdigsn": "FAKE", "mfgdigver": "0.0.0", SYNTHETIC_FIELD: "1",
}  # fmt: skip
"""What the page of a Net F/T fresh from the factory says, as far as clients may want it."""


@dataclass(frozen=True)
class Faults:
    """What is to go wrong; all off by default.

    Parameters
    ----------
    loss, duplicate, reorder : float
        Share of datagrams that are lost, sent twice, or sent after the next one. At most one of these happens to a
        datagram; the first three and the last three of a stream are left alone.
    bad_status : float
        Share of records whose status word tells an error.

    Raises
    ------
    ValueError
        A number outside its range, or shares of datagrams that add up to more than 1.

    Examples
    --------
    >>> from granular_id.testing import Faults
    >>> Faults(loss=0.01)
    Faults(loss=0.01, duplicate=0.0, reorder=0.0, bad_status=0.0)
    """

    loss: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    bad_status: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            finite_number(field.name, getattr(self, field.name), least=0, most=1)
        finite_number("loss + duplicate + reorder", self.loss + self.duplicate + self.reorder, most=1)


@dataclass
class Injected:
    """Numbers of records: sent at least once, and with each of the faults, by the names of the client's counters."""

    sent: int = 0
    lost: int = 0
    duplicates: int = 0
    reordered: int = 0
    bad_status: int = 0


class FakeNetft:
    """A fake Net F/T box on the loopback interface.

    Parameters
    ----------
    signal : array_like, shape (n, 6), optional
        What it measures, N and N m, again and again. Default: slow sines of a few newton.
    rate_hz : float, default 500
        Records per second; made one that the internal rate, 7000 Hz, is a multiple of, as the box does.
    faults : Faults, optional
        What goes wrong.
    n_records : int, optional
        End of the stream; default: none.
    page : mapping of str to str or None, optional
        Fields of the page to be changed, or left out (None). What is sent follows from it: the units ``scfgfu`` and
        ``scfgtu`` (N and Nm), and counts per unit, ``cfgcpf`` and ``cfgcpt`` (1e6). ``simulated`` says that no sensor
        measures here.
    seed : int, default 0
        Of the faults.

    Attributes
    ----------
    injected : Injected
        What was sent and what went wrong.
    requests : list of bytes
        Every request that came.
    send_stamps : array of int
        ``time.monotonic_ns()`` right before each datagram was sent; for measuring how late a client was.

    Raises
    ------
    ValueError
        An unknown unit, a rate that is not above 0, or a signal of another shape.

    Examples
    --------
    >>> from granular_id.testing import FakeNetft
    >>> with FakeNetft(n_records=100) as box:
    ...     box.url.startswith("rdt://127.0.0.1:")
    True
    """

    def __init__(
        self,
        signal: ArrayLike | None = None,
        *,
        rate_hz: float = 500.0,
        faults: Faults | None = None,
        n_records: int | None = None,
        page: Mapping[str, str | None] | None = None,
        seed: int = 0,
    ) -> None:
        self._step = max(1, round(_TICK_HZ / positive_number("rate_hz", rate_hz)))
        self.rate_hz = _TICK_HZ / self._step
        self.faults = Faults() if faults is None else faults
        self.n_records, self._seed = n_records, seed
        self.injected = Injected()
        self.requests: list[bytes] = []
        self.send_stamps = array("Q")
        self._bias = np.zeros(6, dtype=np.int64)
        self._ft = _FIRST_FT
        self._client: tuple[str, int] | None = None
        self._stream: Iterator[tuple[float, bytes]] = iter(())
        self._next: tuple[float, bytes] | None = None
        self._done, self._stopping = threading.Event(), threading.Event()
        text = page_text({"comrdtrate": f"{round(self.rate_hz)}", **(page or {})})
        read = parse_page(text, "page")
        self._counts = counts_of(signal, read.counts_per_newton, read.counts_per_newton_metre)
        self._page = _page_server(text)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((HOST, 0))
        self._socket.setblocking(False)
        self._threads = [
            threading.Thread(target=self._page.serve_forever, args=(_IDLE_S,), daemon=True),
            threading.Thread(target=self._serve, name="fake Net F/T", daemon=True),
        ]

    @property
    def port(self) -> int:
        """UDP port."""
        return int(self._socket.getsockname()[1])

    @property
    def http_port(self) -> int:
        """TCP port of the page."""
        return int(self._page.server_address[1])

    @property
    def url(self) -> str:
        """Where clients find it."""
        return f"rdt://{HOST}:{self.port}?http_port={self.http_port}"

    def __enter__(self) -> FakeNetft:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopping.set()
        self._page.shutdown()
        for thread in self._threads:
            thread.join()
        self._page.server_close()
        self._socket.close()

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait until all of `n_records` are sent; returns whether they are."""
        return self._done.wait(timeout_s)

    def _serve(self) -> None:
        while not self._stopping.is_set():
            wait_s = _IDLE_S
            if self._next is not None:
                wait_s = min(wait_s, max(0.0, self._next[0] - time.monotonic()))
            if select.select([self._socket], [], [], wait_s)[0]:
                self._hear()
            self._send_due()
        self._hear()  # what was requested before the end is noted

    def _send_due(self) -> None:
        while self._next is not None and self._client is not None and self._next[0] <= time.monotonic():
            self.send_stamps.append(time.monotonic_ns())
            try:
                self._socket.sendto(self._next[1], self._client)
            except OSError:  # as a network: what cannot be sent is lost, and the client's business
                self.injected.lost += 1
            self._advance()

    def _advance(self) -> None:
        self._next = next(self._stream, None)
        if self._next is None and self._client is not None:
            self._client = None
            self._done.set()

    def _hear(self) -> None:
        while True:
            try:
                data, sender = self._socket.recvfrom(64)
            except BlockingIOError:
                return
            except OSError:  # an ICMP answer to a client that is gone
                continue
            self.requests.append(data)
            if len(data) == 8 and data[:2] == b"\x12\x34":
                self._obey(int.from_bytes(data[2:4], "big"), sender)

    def _obey(self, command: int, sender: tuple[str, int]) -> None:
        if command == _STOP:
            self._client, self._next = None, None
        elif command in (_START, _START_BUFFERED):
            self._client = sender
            self._stream = self._datagrams(_PER_DATAGRAM if command == _START_BUFFERED else 1)
            self._advance()
        elif command == _BIAS:
            self._bias = self._counts[len(self.send_stamps) % len(self._counts)]

    def _datagrams(self, per_datagram: int) -> Iterator[tuple[float, bytes]]:
        """Yield each datagram, faults and all, with the time at which it is to be sent."""
        faults, made, rng = self.faults, self.injected, np.random.default_rng(self._seed)
        fates = np.cumsum([faults.loss, faults.duplicate, faults.reorder])
        start_s, margin = time.monotonic(), _PROTECTED * per_datagram
        held: bytes | None = None
        first, limit = 0, self.n_records
        while limit is None or first < limit:
            n = per_datagram if limit is None else min(per_datagram, limit - first)
            bad = rng.random(n) < faults.bad_status
            data = self._records(first, bad)
            is_protected = first < margin or (limit is not None and first + n > limit - margin)
            first += n
            drawn = int(np.searchsorted(fates, rng.random(), side="right"))
            fate = "" if is_protected else ("loss", "duplicate", "reorder", "")[drawn]
            if fate == "loss":
                made.lost += n
                continue
            made.sent += n
            made.bad_status += int(bad.sum())
            if fate == "reorder" and held is None:
                made.reordered += n
                held = data
                continue
            when = start_s + first / self.rate_hz
            yield when, data
            if held is not None:
                yield when, held
                held = None
            if fate == "duplicate":
                made.duplicates += n
                yield when, data

    def _records(self, first: int, bad: NDArray[np.bool_]) -> bytes:
        """Return records of a stream, from its number `first` on, as they are sent."""
        n = len(bad)
        numbers = first + np.arange(n)
        records = np.zeros(n, _RECORD)
        records["rdt"] = (1 + numbers) % 2**32
        records["ft"] = (self._ft + self._step * np.arange(n)) % 2**32
        records["status"] = np.where(bad, _BAD_STATUS, 0)
        counts = self._counts[numbers % len(self._counts)] - self._bias
        records["counts"] = np.clip(counts, -(2**31), 2**31 - 1)
        self._ft += n * self._step  # the next stream goes on from there
        return records.tobytes()


def counts_of(signal: ArrayLike | None, per_newton: float, per_newton_metre: float) -> NDArray[np.int64]:
    """Turn wrenches (n, 6) into counts; None: slow sines."""
    if signal is None:
        phase = 2 * np.pi * np.arange(1000)[:, np.newaxis] / 1000
        signal = np.array([3, 1, 5, 0.1, 0.3, 0.02]) * np.sin(phase * np.arange(1, 7))
    wrench = as_floats(signal, "signal", "a real array of shape (n, 6), N and N m")
    if wrench.ndim != 2 or wrench.shape[1] != 6 or not len(wrench):
        raise argument_error(GranularIdError, "signal", f"has shape {wrench.shape}; wanted (n, 6), N and N m")
    return np.asarray(np.rint(wrench * np.repeat([per_newton, per_newton_metre], 3)), dtype=np.int64)


def page_text(changes: Mapping[str, str | None]) -> bytes:
    """Write the page of a box; fields with None are left out."""
    shown = {name: value for name, value in {**_FACTORY, **changes}.items() if value is not None}
    lines = [f"<{name}>{escape(value)}</{name}>" for name, value in shown.items()]
    return "\n".join(['<?xml version="1.0"?>', "<netft>", *lines, "</netft>", ""]).encode()


def _page_server(text: bytes) -> ThreadingHTTPServer:
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/xml")
            self.end_headers()
            self.wfile.write(text)

        def log_message(self, *_: object) -> None:
            """Nobody reads it."""

    server = ThreadingHTTPServer((HOST, 0), Handler)
    server.daemon_threads = True
    return server


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command: print the URL first, and what was injected last."""
    parser = argparse.ArgumentParser(
        prog="python -m granular_id.testing",
        description="A fake Net F/T box on this machine: RDT over UDP and netftapi2.xml over HTTP.",
    )
    add = parser.add_argument
    add("--material", help="material to simulate; default: slow sines")
    add("--rate-hz", type=float, default=500.0, help="records per second (500)")
    for name in ("loss", "duplicate", "reorder"):
        add(f"--{name}", type=float, default=0.0, help="share of datagrams")
    add("--bad-status", type=float, default=0.0, help="share of records")
    add("--records", type=int, help="end after so many")
    add("--stamps", type=Path, metavar="FILE.npy", help="where to store the time of each datagram")
    options = parser.parse_args(arguments)
    signal, rate_hz = None, options.rate_hz
    try:
        if options.material is not None:  # four pushes, again and again
            pushes = synthesize(options.material, 4, rate_hz=rate_hz)
            signal = np.concatenate([recording.wrench for recording in pushes])
        faults = Faults(options.loss, options.duplicate, options.reorder, options.bad_status)
        box = FakeNetft(signal, rate_hz=rate_hz, faults=faults, n_records=options.records)
    except ValueError as error:
        sys.exit(str(error))
    with box, suppress(KeyboardInterrupt):
        print(box.url, flush=True)
        box.wait()
        time.sleep(_AFTER_S)
    if options.stamps is not None:
        np.save(options.stamps, np.asarray(box.send_stamps, dtype=np.uint64))
    print(json.dumps(asdict(box.injected)), flush=True)


if __name__ == "__main__":
    main()
