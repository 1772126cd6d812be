"""What views show: a session at one instant, in numbers and in words, worked out once for page and terminal."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from granular_id._core import AXES, UNITS, Block, StreamingExtractor
from granular_id._text import counted, fixed
from granular_id.features import FeatureSpec
from granular_id.live.rows import timing_in_words
from granular_id.signal import butter, sosfilt, sosfilt_zi

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from granular_id.identifier import Decision
    from granular_id.live.outcome import Push

__all__ = [
    "GIVEN",
    "SYNTHETIC",
    "VIEW_S",
    "Answer",
    "Entry",
    "Outcome",
    "Snapshot",
    "SnapshotBuilder",
    "Words",
]

SYNTHETIC = "SYNTHETIC source: a physical model, no sensor. It says nothing about real materials."

VIEW_S = 5.0
"""How much of the past traces show: a push of 3.2 s with the rest around it."""

_N_PIECES = 200  # of a trace; more than there are columns for it on a screen
_MOST_OUTCOMES = 40
_SPAN_S = 30.0

_STATES = {
    "idle": "Waiting",
    "arming": "Getting ready",
    "armed": "Armed",
    "triggered": "Listening",
    "complete": "Done",
    "answering": "Answering",
    "failed": "Failed",
    "ended": "Ended",
}
_WAITING = frozenset(("idle", "arming", "armed", "ended"))  # no push is under way

# Counters that are shown where they are not zero.
_ALARMS = ("gaps", "late", "saturated", "bad_status", "non_finite")
_NOTES = ("stale", "duplicates", "reordered")

_WARNINGS = {
    "gap": "gap: missing rows were filled in",
    "saturation": "saturation: a force was at the end of the sensor's range",
    "lag": "lag: rows were read late",
}

Kind = Literal["none", "provisional", "final", "unknown", "failed"]

GIVEN: frozenset[Kind] = frozenset(("provisional", "final", "unknown"))
"""Kinds of an answer that rest on a decision."""


class Answer(NamedTuple):
    """A decision in words: `stage` says how far it is, `detail` by how much it leads and what else it may be."""

    kind: Kind
    title: str
    stage: str
    detail: str


class Entry(NamedTuple):
    """A line of the history in words."""

    number: int
    clock: str
    kind: Kind
    title: str
    detail: str
    warnings: list[str]


class Outcome(NamedTuple):
    """What came of a push, its number in the session (from 1), and the time of day at its end."""

    number: int
    clock: str
    push: Push


@dataclass(frozen=True, eq=False)
class Snapshot:
    """One instant of a session; nothing in it changes afterwards. Times are in seconds of the device."""

    # Of the capture: idle, arming, armed, triggered, complete, failed; answering at hops, ended after a replay.
    state: str
    time_s: float | None = None  # of the newest row; None before the first
    hint: str = ""  # what the person is to do, or why a capture failed
    source: str = ""
    synthetic: bool = False
    rate_hz: float = 500.0
    cutoff_hz: float = 23.0
    n_samples: int = 1600
    classes: tuple[str, ...] = ()
    axes: tuple[str, ...] = AXES
    units: tuple[str, ...] = UNITS
    hop_s: float | None = None  # seconds from answer to answer; None: one answer a capture
    latest: NDArray[np.float64] = field(default_factory=lambda: np.full(len(AXES), math.nan))  # newest row
    # Smallest and largest value of each piece of the last seconds, oldest first, shape (m, C), and of what the
    # high-pass leaves of them; NaN where no row arrived.
    row_age_s: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    wrench: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, len(AXES))))
    residual: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, len(AXES))))
    # Histogram of the residual since the capture began: shapes (C, n_bins + 1) and (C, n_bins).
    bin_edges: NDArray[np.float64] = field(default_factory=lambda: np.tile([-1.5, 1.5], (len(AXES), 1)))
    counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros((len(AXES), 1), np.int64))
    # Seconds of signal, shape (h,), and the mean loss of each of `classes` then, shape (h, K).
    ranking_history: tuple[NDArray[np.float64], NDArray[np.float64]] = field(
        default_factory=lambda: (np.empty(0), np.empty((0, 0)))
    )
    decision: Decision | None = None  # the latest of this capture
    history: tuple[Outcome, ...] = ()  # of the last pushes, the oldest first
    lag_s: float = math.nan  # age of the newest row when it was read
    max_lag_s: float = 0.02
    counters: Mapping[str, int] = field(default_factory=dict)  # of the buffer
    n_missed: int = 0  # rows that were overwritten before they were read
    warnings: tuple[str, ...] = ()  # of the session; a decision has its own
    n_captures: int = 0  # answered so far
    n_correct: int | None = None  # of these; None where the truth is unknown

    @property
    def held(self) -> Outcome | None:
        """The last outcome, which views go on showing until the next push is triggered."""
        waits = self.history and self.hop_s is None and self.state in _WAITING
        return self.history[-1] if waits else None

    @property
    def lost(self) -> int:
        """Rows that never arrived, and rows that were overwritten before they were read."""
        return self.counters.get("missing", 0) + self.n_missed

    @property
    def capture_s(self) -> float:
        """Seconds that a whole capture takes."""
        return self.n_samples / self.rate_hz

    @property
    def span_s(self) -> float:
        """Seconds over which the ranking is shown: those of a capture, or the last ones where answers go on."""
        return self.capture_s if self.hop_s is None else max(_SPAN_S, self.capture_s)

    @cached_property
    def words(self) -> Words:
        """All that views say about this instant."""
        return Words(self)


class Words:
    """What every view says about one instant; until the next push is triggered, about the answer of the last one."""

    def __init__(self, now: Snapshot) -> None:
        self._now, held = now, now.held
        self.state = _STATES[now.state]
        line = f"{self.state}: {now.hint}" if now.hint else self.state
        if held is None:
            self.decision, self.answer = now.decision, self._current()
            if self.answer.kind in GIVEN:
                line = f"{self.state}: {self.answer.title} ({', '.join(filter(None, self.answer[2:]))})"
        else:
            self.decision, self.answer, self.state = held.push.decision, self._outcome(held.push), line
            self.answer = self.answer._replace(stage=f"{self.answer.stage}, at {held.clock}")
        self.warnings = _sentences(self.decision, now.warnings)
        self.history = [self._entry(outcome) for outcome in reversed(now.history)]
        self.spoken = ""  # by a screen reader
        if self.history:
            last = self.history[0]
            texts = filter(None, [last.title, last.detail, *last.warnings])
            self.spoken = f"Push {last.number}. {'Final answer: ' * (last.kind in GIVEN)}{', '.join(texts)}"
        mark = ["SYNTHETIC"] * now.synthetic
        self.source = " · ".join(filter(None, ["granular_id live", now.source, *mark, f"{now.rate_hz:g} Hz"]))
        self.values = [
            "-" if math.isnan(value) else fixed(value, 4 if unit == "N m" else 3)
            for value, unit in zip(now.latest.tolist(), now.units, strict=True)
        ]
        self.score = ""
        if now.n_correct is not None and now.n_captures:
            self.score = f"{now.n_correct} of {now.n_captures} right"
        elif now.n_captures:
            self.score = counted(now.n_captures, "capture" if now.hop_s is None else "answer")
        self.figures = self._figures()
        health = ", ".join(f"{name} {value}{' (!)' * alarm}" for name, value, alarm in self.figures)
        time_s = [] if now.time_s is None else [f"{fixed(now.time_s, 3)} s"]
        parts = ["  ".join([*mark, *time_s, line]), health, self.score]
        self.line = "  |  ".join(filter(None, [*parts, *(f"warning: {text}" for text in self.warnings)]))

    def _figures(self) -> tuple[tuple[str, str, bool], ...]:
        """Return names and values about the stream, and whether they should worry somebody."""
        now = self._now
        lag = "-" if math.isnan(now.lag_s) else f"{fixed(1e3 * now.lag_s, 1)} ms"
        counts = [(name, now.counters.get(name, 0)) for name in _ALARMS + _NOTES]
        timing = now.history[-1].push.timing if now.history else None  # of the last push
        return (
            ("lag", lag, now.lag_s > now.max_lag_s),
            ("lost", f"{now.lost:,}", now.lost > 0),
            *((name.replace("_", " "), f"{n:,}", name in _ALARMS) for name, n in counts if n),
            *((name, value, False) for name, value in timing_in_words(timing)),
        )

    def _current(self) -> Answer:
        state, hint, decision = self._now.state, self._now.hint, self._now.decision
        if state == "failed":
            return Answer("failed", "no answer", "the capture failed", hint)
        if state == "ended":
            what = "pushes" if self._now.hop_s is None else "samples"
            return Answer("none", f"no more {what}", hint, "")
        if decision is None:
            return Answer("none", "no answer yet", hint or self.state.lower(), "")
        return self._named(decision, given=decision.final or state == "complete")

    def _outcome(self, push: Push) -> Answer:
        if push.decision is None:
            return Answer("failed", "no answer", "the capture failed", push.text)
        return self._named(push.decision, given=True)

    def _named(self, decision: Decision, *, given: bool) -> Answer:
        seconds = f"{fixed(decision.seconds, 2)} s"
        if self._now.hop_s is not None:
            stage = f"about the last {seconds}"
        elif decision.final:
            stage = f"final, after {seconds}"
        else:
            stage = f"{'early' if given else 'provisional'}, {seconds} of {fixed(self._now.capture_s, 2)} s"
            stage += ", sure enough to stop" * decision.sure
        if decision.unknown:
            detail = f"nearest: {decision.label}, {decision.lead()}"
            return Answer("unknown", "like no known material", stage, detail)
        return Answer("final" if given else "provisional", decision.label, stage, decision.lead())

    def _entry(self, outcome: Outcome) -> Entry:
        number, clock, push = outcome
        decision, answer = push.decision, self._outcome(push)
        detail = [{True: "right", False: "wrong", None: ""}[push.is_right]]
        if decision is not None and push.is_right is not None and (decision.unknown or not push.is_right):
            detail.append(f"it was {push.truth}")
        if decision is not None and not decision.final:
            detail.append(answer.stage)
        text = ", ".join(filter(None, [*detail, answer.detail]))
        return Entry(number, clock, answer.kind, answer.title, text, _sentences(decision))


def _sentences(decision: Decision | None, others: Sequence[str] = ()) -> list[str]:
    every = (*(() if decision is None else decision.warnings), *others)
    return [_WARNINGS.get(text, text) for text in dict.fromkeys(every)]


class SnapshotBuilder:
    """Turns the rows of a stream into snapshots; `session` are the fields of `Snapshot` that do not change."""

    def __init__(
        self, rate_hz: float, spec: FeatureSpec | None, classes: Sequence[str], **session: Any
    ) -> None:
        spec = FeatureSpec(rate_hz=rate_hz, cutoff_hz=min(23.0, rate_hz / 4)) if spec is None else spec
        names = ("rate_hz", "cutoff_hz", "order", "n_bins", "bin_range", "outside", "initial")
        counting = FeatureSpec(raw=False, **{name: getattr(spec, name) for name in names})
        n_axes = len(session["axes"])
        low, high = np.broadcast_to(np.asarray(spec.bin_range, np.float64), (n_axes, 2)).T
        self._now = Snapshot(
            "idle",
            rate_hz=rate_hz,
            cutoff_hz=spec.cutoff_hz,
            bin_edges=np.linspace(low, high, spec.n_bins + 1, axis=1),
            classes=tuple(classes),
            latest=np.full(n_axes, math.nan),
            **session,
        )
        self._sections = butter(spec.order, spec.cutoff_hz, "highpass", fs=spec.rate_hz)
        self._filter: NDArray[np.float64] | None = None
        self._histogram = StreamingExtractor(counting, n_samples=self._now.n_samples, n_axes=n_axes)
        self._begins = False
        self._times, self._losses = np.empty(0), np.empty((0, len(classes)))
        self._step = max(1, math.ceil(VIEW_S * rate_hz / _N_PIECES))
        # Extremes of the last pieces of the wrench and of its residual, and the rows that are no whole piece yet.
        self._nothing = np.full((self._step * _N_PIECES, 2 * n_axes), math.nan)
        self._pieces: deque[NDArray[np.float64]] = deque(maxlen=_N_PIECES)
        self._open = self._nothing[:0]
        self._append(self._nothing)
        self._epoch: int | None = None

    def rows(self, block: Block) -> None:
        """Take the next block; a gap interrupts the traces and the high-pass, a new epoch clears them."""
        self._now = replace(self._now, n_missed=self._now.n_missed + int(block.missed))
        if not len(block.wrench):
            return
        wrench, gaps = np.asarray(block.wrench, np.float64), np.array(block.missing_before, np.int64)
        gaps[0] += block.missed if block.epoch == self._epoch else len(self._nothing)
        self._epoch = block.epoch
        starts = np.union1d(0, np.flatnonzero(gaps))
        for n_missing, piece in zip(gaps[starts], np.split(wrench, starts[1:]), strict=True):
            if n_missing:
                self._append(self._nothing[:n_missing])
                # From a steady state: a step from nothing to the sensor's offset is no residual worth a screen.
                self._filter = sosfilt_zi(self._sections)[:, :, None] * piece[0]
            residual, self._filter = sosfilt(self._sections, piece, axis=0, zi=self._filter)
            self._append(np.hstack([piece, residual]))
        self._now = replace(self._now, latest=wrench[-1].copy(), time_s=float(block.time_s[-1]))

    def begin_capture(self) -> None:
        """Let the next rows of `captured` empty the histogram and the ranking: they belong to another capture."""
        self._begins = True

    def captured(self, rows: NDArray[np.float64]) -> None:
        """Take rows of the capture, shape (k, C), in order and each once."""
        if self._begins and len(rows):
            self._begins = False
            self._histogram.reset()
            if self._now.hop_s is None:
                self._times, self._losses = self._times[:0], self._losses[:0]
        self._histogram.push(rows)

    def end_capture(self, push: Push) -> None:
        """Add what came of a capture to the history."""
        history = self._now.history
        number = history[-1].number + 1 if history else 1
        outcome = Outcome(number, time.strftime("%H:%M:%S"), push)
        self._now = replace(self._now, history=(*history, outcome)[-_MOST_OUTCOMES:])

    def build(self, state: str, decision: Decision | None = None, **now: Any) -> Snapshot:
        """Return a snapshot of now; `now` are the other fields of `Snapshot` that change."""
        if decision is not None:
            self._add_losses(decision)
        n_axes, ends = len(self._now.axes), np.vstack(self._pieces)
        age = (np.arange(len(ends))[::-1] + 0.5) * self._step / 2 + len(self._open)
        times = self._times
        if self._now.hop_s is not None and len(times):
            times = times - times[-1] + self._now.span_s
        return replace(
            self._now,
            state=state,
            decision=decision,
            row_age_s=age / self._now.rate_hz,
            wrench=ends[:, :n_axes],
            residual=ends[:, n_axes:],
            counts=self._histogram.features().reshape(n_axes, -1).astype(np.int64),
            ranking_history=(times, self._losses),
            **now,
        )

    def _append(self, rows: NDArray[np.float64]) -> None:
        rows = np.vstack([self._open, rows])
        *pieces, self._open = np.split(rows, range(self._step, len(rows) + 1, self._step))
        self._pieces.extend(np.stack([np.fmin.reduce(piece), np.fmax.reduce(piece)]) for piece in pieces)

    def _add_losses(self, decision: Decision) -> None:
        now = self._now
        seconds = decision.seconds if now.hop_s is None or now.time_s is None else now.time_s
        # Later times are of an answer that has begun anew.
        keep = (self._times < seconds) & (self._times >= seconds - now.span_s)
        of = dict(decision.ranking)
        self._times = np.append(self._times[keep], seconds)
        self._losses = np.vstack([self._losses[keep], [of[name] for name in now.classes]])
