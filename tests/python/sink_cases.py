"""A buffer in plain Python that remembers everything, for tests of sources."""

from __future__ import annotations

import threading
import time

import numpy as np


class Sink:
    """What a source wrote: rows (time, wrench, flags) and where device time began anew."""

    def __init__(self):
        self.rows, self.epochs = [], []
        self._came = threading.Condition()

    def push(self, wrench, t=None, *, flags=0, host_ns=None):
        with self._came:
            self.rows.append((t, np.array(wrench, dtype=float), int(flags)))
            self._came.notify_all()

    def push_block(self, wrench, t=None, *, flags=None, host_ns=None):
        for row, at, flag in zip(wrench, t, [0] * len(wrench) if flags is None else flags, strict=True):
            self.push(row, float(at), flags=flag)

    def new_epoch(self):
        self.epochs.append(len(self.rows))

    def wait(self, n):
        """Wait for n rows."""
        with self._came:
            assert self._came.wait_for(lambda: len(self.rows) >= n, timeout=20)

    @property
    def time_s(self):
        return np.array([row[0] for row in self.rows])

    @property
    def wrench(self):
        return np.array([row[1] for row in self.rows])

    @property
    def flags(self):
        return np.array([row[2] for row in self.rows])


def eventually(condition):
    """Wait until something is true."""
    deadline_s = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < deadline_s, "it did not happen"
        time.sleep(0.002)
