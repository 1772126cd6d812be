"""A small model; sessions to be shown: blocks of simulated pushes, decisions that grow, snapshots made of them."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np

from granular_id import Decision, Identifier
from granular_id._core import AXES, UNITS
from granular_id.live import FailureReason, Push
from granular_id.live.snapshot import SnapshotBuilder
from granular_id.synthetic import PAPER_MATERIALS, synthesize

CLASSES = tuple(material.name for material in PAPER_MATERIALS)
RATE_HZ = 500.0


@cache
def pushes_and_model():
    """Pushes of one second, as a recorder would have them (0.1 s of rest, then the motion), and what learnt them."""
    data = synthesize(["rice", "fine sugar"], n_per_class=8, duration_s=1.3, seed=5)
    pushes = data.align(trigger="recorded", lead_s=0.1, n_samples=500)
    return pushes, Identifier.fit(pushes, "hfmh", estimate=False)


def block(wrench, first=0, *, missing_before=None, epoch=0, missed=0):
    """Rows `first`, `first` + 1, ... of a stream, behind the gaps that `missing_before` gives by row."""
    wrench = np.asarray(wrench, float)
    gaps = np.zeros(len(wrench), np.uint32)
    for row, n in (missing_before or {}).items():
        gaps[row] = n
    time_s = (first + np.arange(len(wrench)) + np.cumsum(gaps)) / RATE_HZ
    return SimpleNamespace(wrench=wrench, time_s=time_s, missing_before=gaps, epoch=epoch, missed=missed)


def push():
    """Half-still rows, then one push."""
    wrench = synthesize(["rice"], n_per_class=1, seed=0)[0].wrench
    still = wrench[:40][np.random.default_rng(0).integers(0, 40, 400)]
    return np.vstack([still, wrench]), wrench


def new_builder(rate_hz=RATE_HZ, spec=None, classes=(), **session):
    """A builder for a wrench, unless `session` says otherwise."""
    return SnapshotBuilder(rate_hz, spec, classes, **{"axes": AXES, "units": UNITS} | session)


def answer(seconds, *, final=False, classes=CLASSES, **options):
    """Losses that part as the signal grows, the truth being the third class."""
    seen = min(1.0, seconds / 3.2)
    rng = np.random.default_rng(3)
    ends = np.sort(rng.uniform(0.25, 0.8, len(classes)))
    ends[0] = 0.09
    wobble = 0.10 * np.sin(6 * seconds + rng.uniform(0, 6, len(classes))) * (1 - seen)
    losses = 0.5 + (ends - 0.5) * seen**0.6 + wobble
    names = [classes[k] for k in np.roll(np.arange(len(classes)), 2)]
    ranking = tuple(sorted(zip(names, losses.tolist(), strict=True), key=lambda pair: pair[1]))
    margin = ranking[1][1] - ranking[0][1] if len(ranking) > 1 else 0.0
    n_seen = round(RATE_HZ * seconds)
    return Decision(ranking[0][0], ranking, margin, final=final, seconds=seconds, n_seen=n_seen, **options)


def hopping(**session):
    """A snapshot of answers that go on, one every half second for 50 s."""
    builder = new_builder(100.0, classes=CLASSES, n_samples=170, hop_s=0.5, **session)
    for k in range(100):
        builder.rows(block(np.full((250, len(builder.build("arming").axes)), k), 250 * k))
        snapshot = builder.build("answering", replace(answer(3.2, final=True), seconds=1.7))
    return snapshot


def listening(seconds=3.2, *, step=25, classes=CLASSES):
    """A builder and the last snapshot of a capture that went on for so long; after 3.2 s it is over."""
    rows, wrench = push()
    builder = new_builder(classes=classes, source="sim:rice", synthetic=True)
    rest, n = len(rows) - len(wrench), round(seconds * RATE_HZ)
    builder.rows(block(rows[:rest]))
    builder.begin_capture()
    for start in range(0, n, step):
        piece = wrench[start : min(start + step, n)]
        builder.rows(block(piece, rest + start))
        builder.captured(piece)
        now = (start + len(piece)) / RATE_HZ
        over = now >= 3.2
        decision = answer(now, final=over, classes=classes)
        if over:
            builder.end_capture(Push(decision))
        state, now = "complete" if over else "triggered", {"n_captures": 12, "n_correct": 12}
        snapshot = builder.build(state, decision, lag_s=0.0012, **now)
    return builder, snapshot


def session(n=12):
    """A builder behind `n` pushes: every third one is like none, every fourth one failed; the last is like none."""
    builder, _ = listening(0.1)
    for k in range(n):
        decision = answer(3.2, final=True, warnings=("gap",), unknown=k % 3 == 2)
        failed = Push(None, FailureReason.GAP, "12 rows are missing")
        builder.end_capture(failed if k % 4 == 2 else Push(decision, truth=CLASSES[2]))
    return builder
