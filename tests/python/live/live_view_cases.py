"""Sessions to be shown: blocks of simulated pushes, decisions that grow, and the snapshots made of them."""

from dataclasses import dataclass, field

import numpy as np

from granular_id.live import Push, SnapshotBuilder
from granular_id.synthetic import PAPER_MATERIALS, synthesize

CLASSES = tuple(material.name for material in PAPER_MATERIALS)
RATE_HZ = 500.0


@dataclass
class Block:
    """What a reader of the buffer returns, as far as views care."""

    wrench: np.ndarray
    time_s: np.ndarray
    missing_before: np.ndarray
    epoch: int = 0
    missed: int = 0


@dataclass(frozen=True)
class Answer:
    """A decision."""

    label: str
    ranking: tuple
    margin: float
    final: bool
    seconds: float
    probability: float | None = None
    settled: bool = False
    sure: bool = False
    n_seen: int = 0
    warnings: tuple = field(default=())
    candidates: tuple = ()
    unknown: bool | None = None


def block(wrench, first=0, *, missing_before=None, epoch=0, missed=0, rate_hz=RATE_HZ):
    """Rows `first`, `first` + 1, ... of a stream, behind the gaps that `missing_before` gives by row."""
    wrench = np.asarray(wrench, float)
    gaps = np.zeros(len(wrench), np.uint32)
    for row, n in (missing_before or {}).items():
        gaps[row] = n
    time_s = (first + np.arange(len(wrench)) + np.cumsum(gaps)) / rate_hz
    return Block(wrench, time_s, gaps, epoch, missed)


def push(material="rice", seed=0, rest=400):
    """Half-still rows, then one push."""
    wrench = synthesize([material], n_per_class=1, seed=seed)[0].wrench
    still = wrench[:40][np.random.default_rng(seed).integers(0, 40, rest)]
    return np.vstack([still, wrench]), wrench


def answer(seconds, *, final=False, classes=CLASSES, **options):
    """Losses that part as the signal grows, the truth being the third class."""
    seen = min(1.0, seconds / 3.2)
    rng = np.random.default_rng(3)
    ends = np.sort(rng.uniform(0.25, 0.8, len(classes)))
    order = np.roll(np.arange(len(classes)), 2)
    ends[0] = 0.09
    wobble = 0.10 * np.sin(6 * seconds + rng.uniform(0, 6, len(classes))) * (1 - seen)
    losses = 0.5 + (ends - 0.5) * seen**0.6 + wobble
    ranking = tuple(
        sorted(((classes[k], float(losses[i])) for i, k in enumerate(order)), key=lambda pair: pair[1])
    )
    margin = ranking[1][1] - ranking[0][1] if len(ranking) > 1 else 0.0
    return Answer(ranking[0][0], ranking, margin, final, seconds, n_seen=round(500 * seconds), **options)


def listening(seconds=3.2, *, final=None, step=25, classes=CLASSES, **options):
    """A builder and the last snapshot of a capture that went on for so long."""
    rows, wrench = push()
    builder = SnapshotBuilder(RATE_HZ, classes=classes, source="sim:rice", synthetic=True)
    rest = len(rows) - len(wrench)
    builder.rows(block(rows[:rest]))
    builder.begin_capture()
    n = round(seconds * RATE_HZ)
    final = seconds >= 3.2 if final is None else final
    for start in range(0, n, step):
        piece = wrench[start : min(start + step, n)]
        builder.rows(block(piece, rest + start))
        builder.captured(piece)
        now = (start + len(piece)) / RATE_HZ
        over = final and now >= seconds
        decision = answer(now, final=over, classes=classes)
        if over:
            builder.end_capture(Push(decision))
        snapshot = builder.build(
            "complete" if over else "triggered",
            decision,
            **({"lag_s": 0.0012, "counters": {"written": n}, "n_captures": 12, "n_correct": 12} | options),
        )
    return builder, snapshot
