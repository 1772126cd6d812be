"""A buffer in plain Python that remembers everything, for tests of sources."""

from __future__ import annotations

import threading
import time

import numpy as np


class Sink:
    """What a source wrote: rows (time, wrench, flags) and where device time began anew."""

    def __init__(self):
        self.rows = []
        self.epochs = []
        self._more = threading.Condition()

    def push(self, wrench, t=None, *, flags=0, host_ns=None):
        with self._more:
            self.rows.append((t, np.array(wrench, dtype=float), flags))
            self._more.notify_all()

    def push_block(self, wrench, t=None, *, flags=None, host_ns=None):
        wrench = np.asarray(wrench)
        flags = np.zeros(len(wrench), dtype=np.uint8) if flags is None else flags
        with self._more:
            for row, at, flag in zip(wrench, t, flags, strict=True):
                self.rows.append((float(at), row.copy(), int(flag)))
            self._more.notify_all()

    def new_epoch(self):
        self.epochs.append(len(self.rows))

    def wait(self, n, timeout_s=20.0):
        """Wait for n rows."""
        with self._more:
            assert self._more.wait_for(lambda: len(self.rows) >= n, timeout_s), (
                f"{len(self.rows)} of {n} rows"
            )

    @property
    def time_s(self):
        return np.array([row[0] for row in self.rows])

    @property
    def wrench(self):
        return np.array([row[1] for row in self.rows])

    @property
    def flags(self):
        return np.array([row[2] for row in self.rows])


def eventually(condition, timeout_s=20.0):
    """Wait until something is true."""
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline_s, "it did not happen"
        time.sleep(0.002)
