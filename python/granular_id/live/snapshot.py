"""What views show: a session at one instant, in numbers and in words, worked out once for page and terminal."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from granular_id._core import AXES, UNITS
from granular_id._text import counted, fixed
from granular_id.live.rows import timing_in_words

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from granular_id.identifier import Decision
    from granular_id.live.capture import Push

__all__ = ["GIVEN", "SYNTHETIC", "Answer", "Entry", "Figure", "Outcome", "Snapshot", "Words", "printable"]

SYNTHETIC = "SYNTHETIC source: a physical model, no sensor. It says nothing about real materials."
"""Shown wherever the rows come from a model."""

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

# Counters that are told where they are not zero: how, and whether that should worry somebody.
_COUNTERS = {
    "gaps": ("gaps", True),
    "late": ("late", True),
    "stale": ("stale", False),
    "duplicates": ("duplicates", False),
    "reordered": ("reordered", False),
    "saturated": ("saturated", True),
    "bad_status": ("bad status", True),
    "non_finite": ("not finite", True),
}

# Warnings of a decision, and what they mean.
_WARNINGS = {
    "gap": "gap: missing rows were filled in",
    "saturation": "saturation: a force was at the end of the sensor's range",
    "lag": "lag: rows were read late",
}

_SPAN_S = 30.0
_MOST_CANDIDATES = 6  # more are no help to anybody, and hide the rest of a screen

Kind = Literal["none", "provisional", "final", "unknown", "failed"]

GIVEN: frozenset[Kind] = frozenset(("provisional", "final", "unknown"))
"""Kinds of an answer that rest on a decision."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """One line of the history: what came of a push, its number in the session (from 1), and when it was over."""

    number: int
    utc_s: float
    push: Push


class Answer(NamedTuple):
    """A decision in words.

    Final is what nothing will be added to: early answers that were given, too. Unknown is a final answer that refuses
    to name a material. `stage` says how far the answer is, `detail` by how much it leads and what else it may be.
    """

    kind: Kind
    title: str
    stage: str
    detail: str


class Entry(NamedTuple):
    """A line of the history in words: which push, when it was over, its answer, and warnings."""

    number: int
    clock: str
    kind: Kind
    title: str
    detail: str
    warnings: tuple[str, ...]


class Figure(NamedTuple):
    """A number about the stream with its name; `alarm` where it should worry somebody."""

    name: str
    value: str
    alarm: bool


class Words(NamedTuple):
    """What every view says about one instant; made by `Snapshot.words`."""

    answer: Answer
    """Until the next push is triggered, that of the last one."""
    state: str
    """Of the capture; while the last answer is held, with what the person is to do."""
    warnings: tuple[str, ...]
    """Of the answer and of the session, in sentences."""
    decision: Decision | None
    """What the answer rests on."""
    figures: tuple[Figure, ...]
    """How well the stream is: lag and lost rows always, other troubles where there are any."""
    score: str
    """How many captures there were, or how many of them were named rightly where that is known."""
    source: str
    """Where the rows come from, whether they are simulated, and their rate."""
    values: tuple[str, ...]
    """The newest value of each axis."""
    ranking: tuple[tuple[str, str], ...]
    """Material and mean loss, the best first."""
    history: tuple[Entry, ...]
    """What came of the last pushes, the newest first."""
    spoken: str
    """What came of the last push, for a screen reader."""
    line: str
    """All of it in one line, for a log."""


@dataclass(frozen=True, eq=False)
class Snapshot:
    """One instant of a session. Made by a `SnapshotBuilder`; nothing in it changes afterwards.

    Times are in seconds of the device; of C axes, in general the six of a wrench in N and N m.

    Parameters
    ----------
    state : str
        State of the capture in lower case: idle, arming, armed, triggered, complete, answering or failed; ended
        after the last row of a replay.
    time_s : float or None
        Device time of the newest row; None before the first.
    hint : str
        What the person is to do, or why a capture failed.
    source : str
        Where the rows come from.
    synthetic : bool
        Do they come from a model instead of a sensor? Every view says so.
    rate_hz, cutoff_hz : float
        Sampling rate, and the cut-off of the high-pass.
    n_samples : int
        Length of a capture.
    latest : ndarray, shape (C,)
        Newest row; NaN before the first.
    row_age_s : ndarray, shape (m,)
        Seconds from the newest row back to each row of `wrench`, oldest first.
    wrench, residual : ndarray, shape (m, C)
        The last seconds and what the high-pass leaves of them. Long spans are thinned to the extremes of short
        pieces, so no peak is lost; instants that never arrived are NaN.
    bin_edges : ndarray, shape (C, n_bins + 1)
        Edges of the histogram's bins.
    counts : ndarray of int64, shape (C, n_bins)
        Histogram of the residual since the capture began.
    classes : tuple of str
        Materials the model knows, in its order.
    ranking_history : pair of ndarray, shapes (h,), (h, K)
        Seconds of signal, and the mean loss of each of `classes` then.
    decision : Decision or None
        The latest answer of this capture.
    history : tuple of Outcome
        What came of the last pushes, the oldest first; its last number counts all of the session.
    lag_s, max_lag_s : float
        Age of the newest row when it was looked at (NaN: unknown), and from where on that is an alarm.
    counters : mapping of str to int
        What arrived and what did not, see ``WrenchBuffer.stats``; ``missed`` are rows read too late.
    warnings : tuple of str
        Those of the decision and of the session.
    n_captures : int
        Captures finished so far.
    n_correct : int or None
        How many of them were named rightly; None where the truth is unknown.
    axes, units : tuple of str
        Names and units of the C axes.
    hop_s : float or None
        Answers come every so many seconds (state answering); None: one a capture.

    Examples
    --------
    >>> from granular_id.live import Snapshot
    >>> snapshot = Snapshot("armed", hint="push now", lag_s=0.0342, counters={"missing": 2, "missed": 1})
    >>> snapshot.lost, snapshot.words.answer.stage
    (3, 'push now')
    >>> snapshot.words.figures
    (Figure(name='lag', value='34.2 ms', alarm=True), Figure(name='lost', value='3', alarm=True))
    """

    state: str
    time_s: float | None = None
    hint: str = ""
    source: str = ""
    synthetic: bool = False
    rate_hz: float = 500.0
    cutoff_hz: float = 23.0
    n_samples: int = 1600
    latest: NDArray[np.float64] = field(default_factory=lambda: np.full(len(AXES), math.nan))
    row_age_s: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    wrench: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, len(AXES))))
    residual: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, len(AXES))))
    bin_edges: NDArray[np.float64] = field(default_factory=lambda: np.tile([-1.5, 1.5], (len(AXES), 1)))
    counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros((len(AXES), 1), np.int64))
    classes: tuple[str, ...] = ()
    ranking_history: tuple[NDArray[np.float64], NDArray[np.float64]] = field(
        default_factory=lambda: (np.empty(0), np.empty((0, 0)))
    )
    decision: Decision | None = None
    history: tuple[Outcome, ...] = ()
    lag_s: float = math.nan
    max_lag_s: float = 0.02
    counters: Mapping[str, int] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    n_captures: int = 0
    n_correct: int | None = None
    axes: tuple[str, ...] = AXES
    units: tuple[str, ...] = UNITS
    hop_s: float | None = None

    @property
    def held(self) -> Outcome | None:
        """What views go on showing: the last outcome, until the next push is triggered."""
        holds = self.history and self.hop_s is None and self.state in _WAITING
        return self.history[-1] if holds else None

    @property
    def lost(self) -> int:
        """Rows that never arrived, and rows that were overwritten before they were read."""
        return self.counters.get("missing", 0) + self.counters.get("missed", 0)

    @property
    def capture_s(self) -> float:
        """Seconds that a whole capture takes."""
        return self.n_samples / self.rate_hz

    @property
    def ranking_s(self) -> float:
        """Seconds over which the ranking is shown: those of a capture, or the last ones where answers go on."""
        return ranking_span_s(self.capture_s, self.hop_s)

    @cached_property
    def words(self) -> Words:
        """All that views say about this instant."""
        state = _STATES.get(self.state, printable(self.state).capitalize())
        hint = f"{state}: {printable(self.hint)}" if self.hint else state
        then, warnings = self, _sentences(self.warnings)
        answer = _answer(self)
        if self.held is None:
            line = hint
            if answer.kind in GIVEN:
                line = f"{state}: {answer.title} ({', '.join(filter(None, (answer.stage, answer.detail)))})"
        else:  # the last answer stays; beside it, how far the next push is
            then, state, line = _at_the_end(self.held, self.n_samples, self.rate_hz), hint, hint
            answer = _answer(then)
            answer = answer._replace(stage=f"{answer.stage}, at {_clock(self.held.utc_s)}")
        figures, score = self._figures(), self._score()
        history = tuple(_entry(one, self.n_samples, self.rate_hz) for one in reversed(self.history))
        ranking = () if then.decision is None else then.decision.ranking
        time_s = () if self.time_s is None else (f"{fixed(self.time_s, 3)} s",)
        mark = (SYNTHETIC.partition(" ")[0],) if self.synthetic else ()
        health = ", ".join(f"{name} {value}{' (!)' * alarm}" for name, value, alarm in figures)
        parts = ("  ".join((*mark, *time_s, line)), health, score, *(f"warning: {text}" for text in warnings))
        return Words(
            answer=answer,
            state=state,
            warnings=tuple(dict.fromkeys((*_sentences(then.warnings), *warnings))),
            decision=then.decision,
            figures=figures,
            score=score,
            source=" · ".join(filter(None, (printable(self.source), *mark, f"{self.rate_hz:g} Hz"))),
            values=tuple(
                "-" if math.isnan(value) else fixed(value, 4 if unit == "N m" else 3)
                for value, unit in zip(self.latest.tolist(), self.units, strict=True)
            ),
            ranking=tuple((printable(name), fixed(loss, 3)) for name, loss in ranking),
            history=history,
            spoken=_spoken(history[0]) if history else "",
            line="  |  ".join(filter(None, parts)),
        )

    def _figures(self) -> tuple[Figure, ...]:
        lag = "-" if math.isnan(self.lag_s) else f"{fixed(1e3 * self.lag_s, 1)} ms"
        counts = ((*told, self.counters.get(key, 0)) for key, told in _COUNTERS.items())
        timing = self.history[-1].push.timing if self.history else None  # of the last push
        return (
            Figure("lag", lag, self.lag_s > self.max_lag_s),
            Figure("lost", f"{self.lost:,}", self.lost > 0),
            *(Figure(name, f"{n:,}", alarm) for name, alarm, n in counts if n),
            *(Figure(name, value, alarm=False) for name, value in timing_in_words(timing)),
        )

    def _score(self) -> str:
        if not self.n_captures:
            return ""
        if self.n_correct is None:
            return counted(self.n_captures, "capture" if self.hop_s is None else "answer")
        return f"{self.n_correct} of {self.n_captures} right"


def ranking_span_s(capture_s: float, hop_s: float | None) -> float:
    """Return over how many seconds the ranking is shown."""
    return capture_s if hop_s is None else max(_SPAN_S, 10 * capture_s)


def _answer(snapshot: Snapshot) -> Answer:
    hint = printable(snapshot.hint)
    if snapshot.state == "failed":
        return Answer("failed", "no answer", "the capture failed", hint)
    if snapshot.state == "ended":
        return Answer("none", "no more pushes" if snapshot.hop_s is None else "no more samples", hint, "")
    decision = snapshot.decision
    if decision is None:
        title = "recorded" if snapshot.state == "complete" else "no answer yet"
        return Answer("none", title, hint or _STATES.get(snapshot.state, "").lower(), "")
    seconds = f"{fixed(decision.seconds, 2)} s"
    given = decision.final or snapshot.state == "complete"
    if snapshot.hop_s is not None:
        stage = f"about the last {seconds}"
    elif decision.final:
        stage = f"final, after {seconds}"
    else:
        stage = f"{'early' if given else 'provisional'}, {seconds} of {fixed(snapshot.capture_s, 2)} s"
        if decision.sure:
            stage += ", sure enough to stop"
    if decision.unknown:
        return Answer("unknown", "like no known material", stage, _lead(decision))
    return Answer("final" if given else "provisional", printable(decision.label), stage, _lead(decision))


def _lead(decision: Decision) -> str:
    parts = [f"nearest: {printable(decision.label)}"] if decision.unknown else []
    if len(decision.ranking) > 1:
        parts.append(f"margin {fixed(decision.margin, 3)} ahead of {printable(decision.ranking[1][0])}")
    if decision.probability is not None:
        parts.append(f"probability {100 * decision.probability:.0f} %")
    if len(decision.candidates) > 1:
        shown = [printable(name) for name in decision.candidates[:_MOST_CANDIDATES]]
        others = len(decision.candidates) - len(shown)
        parts.append(f"may be {' or '.join([*shown, *[f'{others} more'] * bool(others)])}")
    return ", ".join(parts)


def _at_the_end(outcome: Outcome, n_samples: int, rate_hz: float) -> Snapshot:
    """Return a snapshot of the instant at which a push was over, as far as words need it."""
    push, decision = outcome.push, outcome.push.decision
    return Snapshot(
        "complete" if push.reason is None else "failed",
        hint=push.text,
        decision=decision,
        warnings=() if decision is None else decision.warnings,
        n_samples=n_samples,
        rate_hz=rate_hz,
    )


@lru_cache(maxsize=128)  # views ask thirty times a second
def _entry(outcome: Outcome, n_samples: int, rate_hz: float) -> Entry:
    then, push = _at_the_end(outcome, n_samples, rate_hz), outcome.push
    answer, decision = _answer(then), push.decision
    verdict = {True: "right", False: "wrong", None: ""}[push.is_right]
    if decision is not None and verdict and (decision.unknown or not push.is_right):
        verdict += f", it was {printable(push.truth or '')}"
    stage = "" if decision is None or decision.final else answer.stage
    detail = ", ".join(filter(None, (verdict, stage, answer.detail)))
    clock = _clock(outcome.utc_s)
    return Entry(outcome.number, clock, answer.kind, answer.title, detail, _sentences(then.warnings))


def _spoken(entry: Entry) -> str:
    begin = "Final answer: " if entry.kind in ("final", "unknown") else ""
    said = ", ".join(filter(None, (entry.title, entry.detail, *entry.warnings)))
    return f"Push {entry.number}. {begin}{said}"


def _clock(utc_s: float) -> str:
    return time.strftime("%H:%M:%S", time.localtime(utc_s))


def _sentences(warnings: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(_WARNINGS.get(text, printable(text)) for text in warnings)


def printable(text: str) -> str:
    """Replace what would steer a terminal instead of being shown."""
    return "".join(c if c.isprintable() else "\ufffd" for c in text)
