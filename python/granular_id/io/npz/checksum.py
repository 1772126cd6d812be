"""The checksum of a zip's member, made by another thread while the next bytes are read."""

from __future__ import annotations

import zlib
from concurrent.futures import Future, ThreadPoolExecutor

__all__ = ["Checksum"]

_WORTH_A_THREAD = 1 << 16
"""Bytes whose checksum takes longer than handing them over."""


class Checksum:
    """CRC-32 of bytes that come in pieces, as zip archives have it.

    Examples
    --------
    >>> import zlib
    >>> from granular_id.io.npz.checksum import Checksum
    >>> with Checksum() as checksum:
    ...     checksum.add(memoryview(b"rice "))
    ...     checksum.add(memoryview(b"and peas"))
    ...     checksum.value() == zlib.crc32(b"rice and peas")
    True
    """

    def __init__(self) -> None:
        self._value = 0
        self._thread: ThreadPoolExecutor | None = None
        self._pending: Future[None] | None = None

    def __enter__(self) -> Checksum:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def add(self, data: memoryview) -> None:
        """Count bytes in; they must not change until `value` is asked for."""
        if self._pending is None and len(data) < _WORTH_A_THREAD:
            self._count(data)
            return
        if self._thread is None:
            self._thread = ThreadPoolExecutor(1)
        self._pending = self._thread.submit(self._count, data)  # one thread: in the order they came

    def value(self) -> int:
        """Return the checksum of everything so far."""
        if self._pending is not None:
            self._pending.result()
            self._pending = None
        return self._value

    def close(self) -> None:
        """Let go of the thread, and of what it has not counted."""
        if self._thread is not None:
            self._thread.shutdown(wait=True, cancel_futures=True)
            self._thread = None

    def _count(self, data: memoryview) -> None:
        self._value = zlib.crc32(data, self._value)
