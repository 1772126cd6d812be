"""The monitor's server: one thread, one event loop, and a single assignment between it and the capture."""

from __future__ import annotations

import asyncio
import contextlib
import secrets
import socket
import time
from typing import TYPE_CHECKING

from granular_id._checks import checked_index
from granular_id._text import fixed
from granular_id.live.monitor.frame import event, frame
from granular_id.live.monitor.request import answer, busy
from granular_id.live.view import MAX_HZ, checked_max_hz
from granular_id.live.view_thread import ViewThread

if TYPE_CHECKING:
    from granular_id.live.snapshot import Snapshot

__all__ = ["MonitorServer"]

_LOOPBACK = "127.0.0.1"
_HEAD_BYTES = 16 * 1024
_HEAD_S = 5.0  # for the head of a request; a browser needs milliseconds
_MOST_CONNECTIONS = 64
_MOST_STREAMS = 16
# A few frames: a browser that comes back must not first see old ones for seconds.
_SEND_BUFFER_BYTES = 256 * 1024
_QUIET_S = 1.0  # after this long without a snapshot, pages are told so
_STALLED_S = 30.0  # a browser that has taken nothing for so long is dropped
_PATIENCE_S = 10.0  # at the end; nothing here waits for a browser, so only a machine that is busy takes long


class MonitorServer(ViewThread):
    """Shows snapshots in browsers on this machine.

    `publish` assigns one attribute: it takes no lock and wakes nobody. A thread looks at that attribute
    at most `max_hz` times a second, encodes a new snapshot once, and hands it to those browsers that have taken the
    one before. A browser that does not read gets no more until it does: at most one frame waits for it here.

    Parameters
    ----------
    port : int, default 0
        Port on 127.0.0.1, the only interface served. 0: a free one.
    max_hz : float, default 30
        Updates per second, at most `granular_id.live.view.MAX_HZ`. Fewer for a slow tunnel: a frame takes about 50 kB.

    Attributes
    ----------
    url : str
        Address to open. It holds a random token: who has it can watch, and nobody else.

    Raises
    ------
    OSError
        The port is taken.

    Examples
    --------
    >>> from granular_id.live.monitor import MonitorServer
    >>> from granular_id.live.snapshot import Snapshot
    >>> with MonitorServer() as monitor:
    ...     monitor.publish(Snapshot("idle"))
    ...     print(monitor.url.split(":")[:2])
    ['http', '//127.0.0.1']
    """

    def __init__(self, port: int = 0, *, max_hz: float = MAX_HZ) -> None:
        super().__init__("monitor", patience_s=_PATIENCE_S)
        self._period_s = 1.0 / checked_max_hz(max_hz)
        if not 0 <= checked_index(port, "port") <= 65535:
            raise ValueError(f"port must be between 0 and 65535, got {fixed(port)}")
        self._token = secrets.token_urlsafe(24)
        self._socket = _listening(port)
        self.port: int = self._socket.getsockname()[1]
        self.url = f"http://{_LOOPBACK}:{self.port}/{self._token}/"
        self._newest: tuple[int, Snapshot] | None = None
        self._connections: dict[asyncio.Task[None], asyncio.StreamWriter] = {}
        self._streams: dict[asyncio.StreamWriter, _Reader] = {}
        self.begin()

    def leave(self, number: int, snapshot: Snapshot) -> None:
        """Assign the newest snapshot: the thread looks at it when it is time for the next update."""
        self._newest = (number, snapshot)

    def keep(self) -> None:
        """Serve until closed, send the last snapshot, and tell the pages that the session has ended."""
        try:
            asyncio.run(self._serve())
        finally:
            self._socket.close()

    async def _serve(self) -> None:
        server = await asyncio.start_server(self._connected, sock=self._socket, limit=_HEAD_BYTES)
        try:
            await self._broadcast()
        finally:
            server.close()
            for writer in self._connections.values():
                # What was sent may still arrive; a browser that takes nothing is not waited for.
                stuck = writer.transport.get_write_buffer_size() > 0
                writer.transport.abort() if stuck else writer.close()
            await asyncio.gather(*self._connections)

    async def _broadcast(self) -> None:
        encoded, seen = (0, b""), 0
        changed_s = told_s = time.monotonic()
        closing = False
        while not closing:
            await asyncio.sleep(self._period_s)
            # Asked before the last look, so that nothing published is missed.
            closing = self._closing.is_set()
            now = time.monotonic()
            newest = self._newest
            if newest is not None and newest[0] != seen:
                seen, changed_s = newest[0], now
            elif now - max(changed_s, told_s) > _QUIET_S:
                told_s = now
                self._tell_all(event("quiet", {"for_s": round(now - changed_s, 1)}))
            # Encoded only where somebody looks.
            if newest is not None and newest[0] != encoded[0] and self._streams:
                encoded = (newest[0], frame(newest[1], newest[0]))
            for reader in tuple(self._streams.values()):
                reader.offer(encoded, now)
        self._tell_all(event("end", {}))

    def _tell_all(self, message: bytes) -> None:
        for reader in self._streams.values():
            reader.tell(message)

    async def _connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if len(self._connections) >= _MOST_CONNECTIONS:
            writer.transport.abort()
            return
        task = asyncio.current_task()
        assert task is not None
        self._connections[task] = writer
        try:
            # What a browser does wrong, or not in time, ends its connection and nothing else.
            with contextlib.suppress(OSError, EOFError, asyncio.TimeoutError, asyncio.LimitOverrunError):
                await self._respond(reader, writer)
        finally:
            del self._connections[task]
            self._streams.pop(writer, None)
            writer.close()

    async def _respond(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        request = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), _HEAD_S)
        response = answer(request, self._token)
        if response.streams and len(self._streams) >= _MOST_STREAMS:
            response = busy()
        if response.streams:
            raw = writer.get_extra_info("socket")
            raw.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
        writer.write(response.head + response.body)
        if response.streams:
            self._streams[writer] = _Reader(writer)
            while await reader.read(_HEAD_BYTES):  # until it goes away; what it says is of no interest
                pass
        else:
            await asyncio.wait_for(writer.drain(), _HEAD_S)
            writer.write_eof()
            # A connection closed over unread input would be reset, and the answer lost with it.
            await asyncio.wait_for(reader.read(_HEAD_BYTES), _HEAD_S)


class _Reader:
    """One browser that reads the stream."""

    def __init__(self, writer: asyncio.StreamWriter) -> None:
        self._writer = writer
        self._number = 0
        self._taken_s = time.monotonic()

    def offer(self, encoded: tuple[int, bytes], now: float) -> None:
        """Send the frame, unless this browser has it or has not yet taken what it was sent before."""
        if self._writer.transport.get_write_buffer_size():
            if now - self._taken_s > _STALLED_S:
                self._writer.transport.abort()
            return
        self._taken_s = now
        number, data = encoded
        if number != self._number:
            self._number = number
            self._writer.write(data)

    def tell(self, message: bytes) -> None:
        """Send a short message, unless something waits already."""
        if not self._writer.transport.get_write_buffer_size():
            self._writer.write(message)


def _listening(port: int) -> socket.socket:
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((_LOOPBACK, port))
        listener.listen()  # here, not in the thread: the address is good from the moment it is known
    except OSError as error:
        listener.close()
        raise type(error)(f"cannot serve the monitor on port {port}: {error.strerror}") from error
    return listener
