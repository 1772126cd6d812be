"""Streams for tests of captures: rows with a clock, cut into blocks as a reader would."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from granular_id.live.capture import Capture
from granular_id.live.robot import TimedMotion
from granular_id.live.trigger import MotionTrigger

RATE_HZ = 500.0


@dataclass
class Block:
    """A block as a reader returns it."""

    wrench: np.ndarray
    time_s: np.ndarray
    host_ns: np.ndarray
    flags: np.ndarray
    missing_before: np.ndarray
    epoch: int = 0
    missed: int = 0

    def __len__(self):
        return len(self.time_s)


@dataclass
class Line:
    """A whole stream; faults are put in, then it is cut."""

    wrench: np.ndarray
    time_s: np.ndarray
    host_ns: np.ndarray
    flags: np.ndarray
    missing_before: np.ndarray
    epoch: np.ndarray = field(default=None)

    @classmethod
    def of(cls, n, *, rate_hz=RATE_HZ, seed=0, start_s=10.0):
        rng = np.random.default_rng(seed)
        time_s = start_s + np.arange(n) / rate_hz
        return cls(
            wrench=rng.normal(size=(n, 6)) * 0.02,
            time_s=time_s,
            host_ns=(5e9 + 1e9 * time_s + rng.uniform(0, 5e5, n)).astype(np.uint64),
            flags=np.zeros(n, dtype=np.uint8),
            missing_before=np.zeros(n, dtype=np.uint32),
            epoch=np.zeros(n, dtype=np.int64),
        )

    def without(self, at, n):
        """Lose n rows from `at` on."""
        keep = np.r_[0:at, at + n : len(self.time_s)]
        missing = self.missing_before.copy()
        missing[at + n] = n
        parts = {
            name: getattr(self, name)[keep] for name in ("wrench", "time_s", "host_ns", "flags", "epoch")
        }
        return Line(**parts, missing_before=missing[keep])

    def blocks(self, cuts):
        """Cut before these rows, and wherever an epoch ends."""
        n = len(self.time_s)
        epochs = np.flatnonzero(np.diff(self.epoch)) + 1
        edges = sorted({0, n, *epochs.tolist(), *(int(c) for c in cuts if c < n)})
        for a, b in pairwise(edges):
            yield Block(
                *(
                    getattr(self, name)[a:b]
                    for name in ("wrench", "time_s", "host_ns", "flags", "missing_before")
                ),
                epoch=int(self.epoch[a]),
            )


def run(capture: Capture, line: Line, cuts=()) -> np.ndarray:
    """Feed a stream and return the rows that the capture gave back."""
    return np.concatenate([capture.feed(block) for block in line.blocks(cuts)])


N = 400
PRE_S = 0.1  # 50 rows


class Motion(TimedMotion):
    def __init__(self, start_time_s):
        super().__init__(0, 1.0)
        self.start_time_s = start_time_s


def capture(trigger, **options):
    return Capture(
        RATE_HZ, **{"n_samples": N, "pre_s": PRE_S, "trigger": trigger, "utc_at_zero_s": 1.7e9, **options}
    )


def moving_at(line, row):
    """A trigger whose motion begins between a row and the one before."""
    return MotionTrigger(Motion(float(line.time_s[row]) - 0.4 / RATE_HZ))
