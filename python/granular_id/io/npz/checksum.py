"""The checksum of a zip's member, made by another thread while the next bytes are read."""

from __future__ import annotations

import zlib
from concurrent.futures import Future, ThreadPoolExecutor

__all__ = ["Checksum"]

WORTH_A_THREAD = 4 << 20
"""Bytes of a member whose checksum takes much longer than starting a thread."""


class Checksum:
    """CRC-32 of bytes that come in pieces, as zip archives have it.

    Parameters
    ----------
    n_bytes : int
        How many will come.

    Examples
    --------
    >>> import zlib
    >>> from granular_id.io.npz.checksum import Checksum
    >>> checksum = Checksum(13)
    >>> checksum.add(memoryview(b"rice "))
    >>> checksum.add(memoryview(b"and peas"))
    >>> checksum.value() == zlib.crc32(b"rice and peas")
    True
    >>> checksum.close()
    """

    def __init__(self, n_bytes: int) -> None:
        self._value = 0
        self._thread = ThreadPoolExecutor(1) if n_bytes >= WORTH_A_THREAD else None
        self._pending: Future[None] | None = None

    def add(self, data: memoryview) -> None:
        """Count bytes in; they must not change until `value` is asked for."""
        if self._thread is not None:
            try:
                self._pending = self._thread.submit(self._count, data)  # one thread: in the order they came
            except RuntimeError:  # none is to be had: under a limit, or when the program is ending
                self.close()
            else:
                return
        self._count(data)

    def value(self) -> int:
        """Return the checksum of everything so far."""
        if self._pending is not None:
            self._pending.result()
        return self._value

    def close(self) -> None:
        """Let go of the thread, and of what it has not counted."""
        if self._thread is not None:
            self._thread.shutdown(wait=True, cancel_futures=True)
            self._thread = None
            self._pending = None

    def _count(self, data: memoryview) -> None:
        self._value = zlib.crc32(data, self._value)
