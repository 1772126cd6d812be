"""A buffer of rows with any number of axes, between a source that is written in Python and what reads it.

The core's `WrenchBuffer` holds rows of six, waits for nobody and sorts what a network has mixed up. This one has a lock
and keeps the order in which rows come: enough for recordings that are played again.
"""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from granular_id._checks import as_floats
from granular_id._core import WrenchBuffer, WrenchReader, host_ns
from granular_id.live.rows import Rows

__all__ = ["AnyBuffer", "AnyReader", "ChannelBuffer", "ChannelReader", "buffer_for"]


@dataclass(frozen=True)
class _Block(Rows):
    """Rows in a row of one epoch; `first` is the number of the first one, `missed` how many before it are gone."""

    first: int = 0
    epoch: int = 0
    missed: int = 0


class ChannelBuffer:
    """The newest rows of a source, as `WrenchBuffer` keeps them.

    Parameters
    ----------
    seconds : float
        How much it holds.
    rate_hz : float
    n_axes : int

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.live.channels import ChannelBuffer
    >>> buffer = ChannelBuffer(10.0, rate_hz=100.0, n_axes=3)
    >>> reader = buffer.reader()
    >>> buffer.push_block(np.zeros((5, 3)))
    5
    >>> reader.read().wrench.shape
    (5, 3)
    """

    def __init__(self, seconds: float, *, rate_hz: float, n_axes: int) -> None:
        self.rate_hz, self.n_axes = rate_hz, n_axes
        self._capacity = max(1, round(seconds * rate_hz))
        self._blocks: deque[_Block] = deque()
        self._changed = threading.Condition()
        self._epoch = self._gaps = self._missing = 0
        self._last_s: float | None = None  # device time of the newest row of this epoch
        self._offset_ns = float("inf")  # of the row that came soonest after its device time
        self.n_written = 0

    def push(
        self, wrench: ArrayLike, t: float | None = None, *, flags: int = 0, host_ns: int | None = None
    ) -> int:
        """Write one row (C,); see `push_block`."""
        times, arrived = (None if one is None else [one] for one in (t, host_ns))
        return self.push_block(np.asarray(wrench)[None], times, flags=[flags], host_ns=arrived)

    def push_block(
        self,
        wrench: ArrayLike,
        t: ArrayLike | None = None,
        *,
        flags: ArrayLike | None = None,
        host_ns: ArrayLike | None = None,
    ) -> int:
        """Write rows (n, C) with their times (n,), ascending; by default one period after another. Returns n.

        Raises
        ------
        TypeError, ValueError
            Another shape, values that are not finite, times that do not ascend.
        """
        values = as_floats(wrench, "wrench", f"numbers of shape (n, {self.n_axes})")
        n = len(values)
        if values.shape != (n, self.n_axes) or not np.isfinite(values).all():
            raise ValueError(f"wrench must be finite numbers of shape (n, {self.n_axes}), got {values.shape}")
        if not n:
            return 0
        before_s = self._last_s
        if t is None:
            first_s = 0.0 if before_s is None else before_s + 1 / self.rate_hz
            times = first_s + np.arange(n) / self.rate_hz
        else:
            times = np.broadcast_to(np.asarray(t, np.float64), n)
        steps = np.diff(times, prepend=times[0] - 1 / self.rate_hz if before_s is None else before_s)
        if not (steps > 0).all():
            raise ValueError("t must ascend from row to row")
        missing = np.maximum(np.rint(steps * self.rate_hz) - 1, 0).astype(np.int64)
        now = _now_ns() if host_ns is None else host_ns
        arrived = np.broadcast_to(np.asarray(now, np.int64), n)
        told = np.broadcast_to(np.asarray(0 if flags is None else flags, np.uint8), n)
        with self._changed:
            block = _Block(values.copy(), times.copy(), arrived, told, missing, self.n_written, self._epoch)
            self._blocks.append(block)
            self.n_written += n
            self._gaps += int((missing > 0).sum())
            self._missing += int(missing.sum())
            self._last_s = float(times[-1])
            self._offset_ns = min(self._offset_ns, float(np.min(arrived - 1e9 * times)))
            while self.n_written - self._blocks[0].first - len(self._blocks[0]) >= self._capacity:
                self._blocks.popleft()
            self._changed.notify_all()
        return n

    def new_epoch(self) -> None:
        """Say that device time begins anew: nothing that follows joins what came before."""
        with self._changed:
            self._epoch += 1
            self._last_s, self._offset_ns = None, float("inf")

    def reader(self, from_oldest: bool = False) -> ChannelReader:
        """Return a reader of the rows that come from now on, or of all that are held."""
        with self._changed:
            held = from_oldest and self._blocks
            return ChannelReader(self, self._blocks[0].first if held else self.n_written)

    def lag_s(self) -> float:
        """How long ago the newest row should have come, by the row that came soonest after its device time."""
        last_s = self._last_s
        return 0.0 if last_s is None else max(0.0, 1e-9 * (_now_ns() - self._offset_ns) - last_s)

    def stats(self) -> dict[str, int]:
        """Count the rows that were written, and those that did not come."""
        return {
            "written": self.n_written,
            "gaps": self._gaps,
            "missing": self._missing,
            "epochs": self._epoch,
        }

    def _wait(self, number: int, timeout_s: float) -> bool:
        with self._changed:
            return self._changed.wait_for(lambda: self.n_written > number, timeout_s)

    def _after(self, number: int) -> _Block:
        """Return the rows from a number on, as far as they are of one epoch."""
        with self._changed:
            oldest = self._blocks[0].first if self._blocks else self.n_written
            place = max(number, oldest)
            new: list[_Block] = []
            for block in reversed(self._blocks):
                if block.first + len(block) <= place:
                    break
                new.append(block)
        new.reverse()
        new = [block for block in new if block.epoch == new[0].epoch]
        if not new:
            nothing = Rows.none(self.n_axes)
            return _Block(**vars(nothing), first=place, epoch=self._epoch, missed=0)
        rows = Rows.joined(new)[place - new[0].first :]
        return _Block(**vars(rows), first=place, epoch=new[0].epoch, missed=place - number)


class ChannelReader:
    """Reads each row of a `ChannelBuffer` once, in order."""

    def __init__(self, buffer: ChannelBuffer, number: int) -> None:
        self._buffer, self._number = buffer, number

    def read(self) -> _Block:
        """Return the rows since the last time, as far as they are of one epoch; none perhaps."""
        block = self._buffer._after(self._number)
        self._number = block.first + len(block)
        return block

    def wait(self, timeout_s: float) -> bool:
        """Wait until there are rows to be read; False: there were none."""
        return self._buffer._wait(self._number, timeout_s)


AnyBuffer = WrenchBuffer | ChannelBuffer
AnyReader = WrenchReader | ChannelReader


def buffer_for(
    seconds: float, rate_hz: float, n_axes: int, *, tick_hz: float = 1e9, reorder_depth: int = 0
) -> AnyBuffer:
    """Return the core's buffer for rows of six, another for others."""
    if n_axes == 6:
        return WrenchBuffer(seconds, rate_hz=rate_hz, tick_hz=tick_hz, reorder_depth=reorder_depth)
    return ChannelBuffer(seconds, rate_hz=rate_hz, n_axes=n_axes)


def _now_ns() -> int:
    return host_ns()
