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

from granular_id._core import AXES, UNITS, StreamingExtractor
from granular_id._text import counted, fixed
from granular_id.features import FeatureSpec
from granular_id.live.rows import timing_in_words
from granular_id.signal import butter, sosfilt, sosfilt_zi

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from granular_id.identifier import Decision
    from granular_id.live.capture import Push
    from granular_id.live.rows import BlockLike

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
_MOST_ANSWERS, _MOST_OUTCOMES = 400, 40
_MOST_CANDIDATES = 6  # more hide the rest of a screen
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


@dataclass(frozen=True, eq=False)
class Outcome:
    """What came of a push, its number in the session (from 1), and when it was over."""

    number: int
    utc_s: float
    push: Push

    @property
    def clock(self) -> str:
        """Time of day."""
        return time.strftime("%H:%M:%S", time.localtime(self.utc_s))


@dataclass(frozen=True, eq=False)
class Snapshot:
    """One instant of a session; nothing in it changes afterwards. Times are in seconds of the device."""

    state: str  # of the capture: idle, arming, armed, triggered, complete, answering, failed; ended after a replay
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
    counters: Mapping[str, int] = field(
        default_factory=dict
    )  # of the buffer; `missed`: overwritten before read
    warnings: tuple[str, ...] = ()  # of decision and session
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
        return self.counters.get("missing", 0) + self.counters.get("missed", 0)

    @property
    def capture_s(self) -> float:
        """Seconds that a whole capture takes."""
        return self.n_samples / self.rate_hz

    @property
    def span_s(self) -> float:
        """Seconds over which the ranking is shown: those of a capture, or the last ones where answers go on."""
        return self.capture_s if self.hop_s is None else max(_SPAN_S, 10 * self.capture_s)

    @cached_property
    def words(self) -> Words:
        """All that views say about this instant."""
        return Words(self)


class Words:
    """What every view says about one instant; until the next push is triggered, about the answer of the last one."""

    def __init__(self, now: Snapshot) -> None:
        self._now, held = now, now.held
        mark = ["SYNTHETIC"] * now.synthetic
        self.state = _STATES.get(now.state, now.state)
        line = f"{self.state}: {now.hint}" if now.hint else self.state
        self.decision = now.decision if held is None else held.push.decision
        self.warnings = _sentences(self.decision, now.warnings)
        if held is None:
            self.answer = self._current()
            if self.answer.kind in GIVEN:
                line = f"{self.state}: {self.answer.title} ({', '.join(filter(None, self.answer[2:]))})"
        else:
            answer, self.state = self._outcome(held), line
            self.answer = answer._replace(stage=f"{answer.stage}, at {held.clock}")
        self.history = [self._entry(outcome) for outcome in reversed(now.history)]
        self.spoken = ""  # by a screen reader
        if self.history:
            number, _, kind, title, detail, warnings = self.history[0]
            begin = f"Push {number}. {'Final answer: ' * (kind in GIVEN)}"
            self.spoken = begin + ", ".join(filter(None, [title, detail, *warnings]))
        self.source = " · ".join(filter(None, [now.source, *mark, f"{now.rate_hz:g} Hz"]))
        self.values = [
            "-" if math.isnan(value) else fixed(value, 4 if unit == "N m" else 3)
            for value, unit in zip(now.latest.tolist(), now.units, strict=True)
        ]
        ranking = () if self.decision is None else self.decision.ranking
        self.ranking = [(name, fixed(loss, 3)) for name, loss in ranking]
        self.score = ""
        if now.n_captures:
            self.score = counted(now.n_captures, "capture" if now.hop_s is None else "answer")
            if now.n_correct is not None:
                self.score = f"{now.n_correct} of {now.n_captures} right"
        self.figures = self._figures()
        health = ", ".join(f"{name} {value}{' (!)' * alarm}" for name, value, alarm in self.figures)
        time_s = [] if now.time_s is None else [f"{fixed(now.time_s, 3)} s"]
        parts = ["  ".join([*mark, *time_s, line]), health, self.score]
        self.line = "  |  ".join(filter(None, [*parts, *(f"warning: {text}" for text in self.warnings)]))

    def _figures(self) -> tuple[tuple[str, str, bool], ...]:
        """Return names and values about the stream, and whether they should worry somebody."""
        now, counters = self._now, self._now.counters
        lag = "-" if math.isnan(now.lag_s) else f"{fixed(1e3 * now.lag_s, 1)} ms"
        counts = [(key, counters.get(key, 0)) for key in _ALARMS + _NOTES]
        timing = now.history[-1].push.timing if now.history else None  # of the last push
        return (
            ("lag", lag, now.lag_s > now.max_lag_s),
            ("lost", f"{now.lost:,}", now.lost > 0),
            *((key.replace("_", " "), f"{n:,}", key in _ALARMS) for key, n in counts if n),
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

    def _outcome(self, outcome: Outcome) -> Answer:
        if outcome.push.decision is None:
            return Answer("failed", "no answer", "the capture failed", outcome.push.text)
        return self._named(outcome.push.decision, given=True)

    def _named(self, decision: Decision, *, given: bool) -> Answer:
        stage = seconds = f"{fixed(decision.seconds, 2)} s"
        if self._now.hop_s is not None:
            stage = f"about the last {seconds}"
        elif decision.final:
            stage = f"final, after {seconds}"
        else:
            stage = f"{'early' if given else 'provisional'}, {seconds} of {fixed(self._now.capture_s, 2)} s"
            stage += ", sure enough to stop" * decision.sure
        lead = [f"nearest: {decision.label}"] * bool(decision.unknown)
        if len(decision.ranking) > 1:
            lead.append(f"margin {fixed(decision.margin, 3)} ahead of {decision.ranking[1][0]}")
        if decision.probability is not None:
            lead.append(f"probability {100 * decision.probability:.0f} %")
        if len(decision.candidates) > 1:
            others = len(decision.candidates) - _MOST_CANDIDATES
            names = [*decision.candidates[:_MOST_CANDIDATES], *[f"{others} more"] * (others > 0)]
            lead.append(f"may be {' or '.join(names)}")
        kind: Kind = "unknown" if decision.unknown else "final" if given else "provisional"
        return Answer(
            kind, "like no known material" if decision.unknown else decision.label, stage, ", ".join(lead)
        )

    def _entry(self, outcome: Outcome) -> Entry:
        push, decision, answer = outcome.push, outcome.push.decision, self._outcome(outcome)
        detail = [{True: "right", False: "wrong", None: ""}[push.is_right]]
        if decision is not None and push.is_right is not None and (decision.unknown or not push.is_right):
            detail.append(f"it was {push.truth}")
        if decision is not None and not decision.final:
            detail.append(answer.stage)
        text = ", ".join(filter(None, [*detail, answer.detail]))
        return Entry(outcome.number, outcome.clock, answer.kind, answer.title, text, _sentences(decision))


def _sentences(decision: Decision | None, others: Sequence[str] = ()) -> list[str]:
    every = (*(() if decision is None else decision.warnings), *others)
    return [_WARNINGS.get(text, text) for text in dict.fromkeys(every)]


class SnapshotBuilder:
    """Turns the rows of a stream into snapshots, at the cost of a filter per block.

    `rows` takes every block as it is read, `captured` the rows of a capture after `begin_capture`, and `end_capture`
    what came of it. Without a `spec` the high-pass is the paper's, at most a quarter of the rate. `session` are the
    fields of `Snapshot` that do not change.
    """

    def __init__(
        self, rate_hz: float, spec: FeatureSpec | None, classes: Sequence[str], **session: Any
    ) -> None:
        spec = FeatureSpec(rate_hz=rate_hz, cutoff_hz=min(23.0, rate_hz / 4)) if spec is None else spec
        names = ("rate_hz", "cutoff_hz", "order", "n_bins", "bin_range", "outside", "initial")
        counting = FeatureSpec(raw=False, **{name: getattr(spec, name) for name in names})
        n_axes = len(session["axes"])
        low, high = np.broadcast_to(np.asarray(spec.bin_range, np.float64), (n_axes, 2)).T
        edges = np.linspace(low, high, spec.n_bins + 1, axis=1)
        self._session = Snapshot(
            "idle",
            rate_hz=rate_hz,
            cutoff_hz=spec.cutoff_hz,
            bin_edges=edges,
            classes=tuple(classes),
            **session,
        )
        self._sections = butter(spec.order, spec.cutoff_hz, "highpass", fs=spec.rate_hz)
        self._histogram = StreamingExtractor(counting, n_samples=self._session.n_samples, n_axes=n_axes)
        self._step = max(1, math.ceil(VIEW_S * rate_hz / _N_PIECES))
        # The last seconds of the wrench and of its residual, by the number of the instant.
        self._recent = np.full((self._step * _N_PIECES, 2 * n_axes), math.nan)
        self._n_instants = 0
        self._filter: NDArray[np.float64] | None = None  # None: it begins anew
        self._latest, self._time_s = np.full(n_axes, math.nan), math.nan
        self._epoch: int | None = None
        self._n_missed = 0
        self._answers: deque[tuple[float, list[float]]] = deque(maxlen=_MOST_ANSWERS)
        self._begins = False
        self._history: deque[Outcome] = deque(maxlen=_MOST_OUTCOMES)

    def rows(self, block: BlockLike) -> None:
        """Take the next block; a gap interrupts the traces and the high-pass, a new epoch clears them."""
        wrench, gaps = np.asarray(block.wrench, np.float64), np.array(block.missing_before, np.int64)
        self._n_missed += int(block.missed)
        if not len(wrench):
            return
        if block.epoch == self._epoch:
            gaps[0] += int(block.missed)
        else:  # rows that were missed are of the epoch before
            self._epoch, self._filter = block.epoch, None
            self._recent.fill(math.nan)
        borders = np.flatnonzero(gaps)
        for n_missing, piece in zip([0, *gaps[borders].tolist()], np.split(wrench, borders), strict=True):
            if n_missing:
                nothing = np.full((min(n_missing, len(self._recent)), self._recent.shape[1]), math.nan)
                self._append(nothing, n_missing)
                self._filter = None
            if len(piece):
                self._append(np.hstack([piece, self._high_passed(piece)]), len(piece))
        self._latest, self._time_s = wrench[-1].copy(), float(block.time_s[-1])

    def begin_capture(self) -> None:
        """Let the next rows of `captured` empty the histogram and the ranking: they belong to another capture."""
        self._begins = True

    def captured(self, rows: NDArray[np.float64]) -> None:
        """Take rows of the capture, shape (k, C), in order and each once."""
        if self._begins and len(rows):
            self._histogram.reset()
            if self._session.hop_s is None:
                self._answers.clear()
            self._begins = False
        self._histogram.push(rows)

    def end_capture(self, push: Push) -> None:
        """Add what came of a capture to the history."""
        number = self._history[-1].number + 1 if self._history else 1
        self._history.append(Outcome(number, time.time(), push))

    def build(
        self,
        state: str,
        decision: Decision | None = None,
        *,
        counters: Mapping[str, int] | None = None,
        warnings: Sequence[str] = (),
        **now: Any,
    ) -> Snapshot:
        """Return a snapshot of now; `now` are the other fields of `Snapshot` that change."""
        session = self._session
        if decision is not None:
            self._remember(decision)
        n_axes, step = len(session.axes), self._step
        n_open = -self._n_instants % step  # instants of the newest piece that are still to come
        pieces = np.roll(self._recent, -(self._n_instants + n_open), axis=0).reshape(-1, step, 2 * n_axes)
        ends = np.stack([np.fmin.reduce(pieces, axis=1), np.fmax.reduce(pieces, axis=1)], axis=1)
        ends = ends.reshape(-1, 2 * n_axes)
        age = (np.arange(len(ends))[::-1] + 0.5) * step / 2 - n_open
        times = np.array([seconds for seconds, _ in self._answers])
        if session.hop_s is not None and len(times):
            times = times - times[-1] + session.span_s
        losses = np.array([losses for _, losses in self._answers]).reshape(len(times), len(session.classes))
        own = () if decision is None else decision.warnings
        return replace(
            session,
            state=state,
            time_s=None if math.isnan(self._time_s) else self._time_s,
            latest=self._latest,
            row_age_s=np.maximum(age, 0) / session.rate_hz,
            wrench=ends[:, :n_axes],
            residual=ends[:, n_axes:],
            counts=self._histogram.features().reshape(n_axes, -1).astype(np.int64),
            ranking_history=(times, losses),
            decision=decision,
            history=tuple(self._history),
            counters={"missed": self._n_missed, **(counters or {})},
            warnings=tuple(dict.fromkeys((*own, *warnings))),
            **now,
        )

    def _append(self, rows: NDArray[np.float64], n_instants: int) -> None:
        self._n_instants += n_instants
        n, size = self._n_instants, len(self._recent)
        self._recent[np.arange(n - len(rows), n)[-size:] % size] = rows[-size:]
        self._recent[np.arange(n, n + -n % self._step) % size] = math.nan

    def _high_passed(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        if self._filter is None:
            # From a steady state: a step from nothing to the sensor's offset is no residual worth a screen.
            self._filter = sosfilt_zi(self._sections)[:, :, None] * rows[0]
        residual, self._filter = sosfilt(self._sections, rows, axis=0, zi=self._filter)
        return residual

    def _remember(self, decision: Decision) -> None:
        session, answers = self._session, self._answers
        seconds = decision.seconds if session.hop_s is None else self._time_s
        if answers and seconds < answers[-1][0]:
            answers.clear()  # the answer begins anew
        if not answers or seconds > answers[-1][0]:
            losses = dict(decision.ranking)
            answers.append((seconds, [losses[name] for name in session.classes]))
        while session.hop_s is not None and answers[0][0] < seconds - session.span_s:
            answers.popleft()
