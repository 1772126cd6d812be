"""What views say, in words: one wording for the terminal, the page and the log."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Literal, NamedTuple

from granular_id._text import counted, fixed
from granular_id.live.snapshot import Snapshot

if TYPE_CHECKING:
    from granular_id.identifier import Decision
    from granular_id.live.snapshot import Outcome

__all__ = [
    "GIVEN",
    "SYNTHETIC",
    "Answer",
    "Entry",
    "Figure",
    "Shown",
    "answer_of",
    "figures_of",
    "history_of",
    "printable",
    "score_of",
    "shown_of",
    "state_of",
    "warnings_of",
]

SYNTHETIC = "SYNTHETIC source: a physical model, no sensor. It says nothing about real materials."
"""Shown wherever the rows come from a model."""

_STATES = {
    "idle": "Waiting",
    "arming": "Getting ready",
    "armed": "Armed",
    "triggered": "Listening",
    "complete": "Done",
    "failed": "Failed",
    "ended": "Ended",
}

_COUNTERS = {
    "gaps": "gaps",
    "late": "late",
    "stale": "stale",
    "duplicates": "duplicates",
    "reordered": "reordered",
    "saturated": "saturated",
    "bad_status": "bad status",
    "non_finite": "not finite",
}
"""Counters that are told where they are not zero, and how."""

_ALARMS = frozenset(("gaps", "late", "saturated", "bad status", "not finite"))

_WARNINGS = {
    "gap": "gap: missing rows were filled in",
    "saturation": "saturation: a force was at the end of the sensor's range",
    "lag": "lag: rows were read late",
}
"""Warnings of a decision, and what they mean."""

_MOST_CANDIDATES = 6  # more are no help to anybody, and hide the rest of a screen

Kind = Literal["none", "provisional", "final", "unknown", "failed"]

GIVEN: frozenset[Kind] = frozenset(("provisional", "final", "unknown"))
"""Kinds of an answer that rest on a decision."""


@dataclass(frozen=True)
class Answer:
    """The decision in words.

    Parameters
    ----------
    kind : {"none", "provisional", "final", "unknown", "failed"}
        What sort of an answer it is. Final is what nothing will be added to: early answers that were given, too.
        Unknown is a final answer that refuses to name a material.
    title : str
        The material, that it is like no known one, or that there is none yet.
    stage : str
        How far the answer is.
    detail : str
        Which material is nearest where it is like none, by how much it leads, and what else it may be.
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


class Shown(NamedTuple):
    """What a view of one instant shows, in words; `decision` is what the answer rests on."""

    answer: Answer
    state: str
    warnings: tuple[str, ...]
    decision: Decision | None


class Figure(NamedTuple):
    """A number about the stream with its name; `alarm` where it should worry somebody."""

    name: str
    value: str
    alarm: bool


def state_of(snapshot: Snapshot) -> str:
    """Name the state of the capture."""
    return _STATES.get(snapshot.state, printable(snapshot.state).capitalize())


def answer_of(snapshot: Snapshot) -> Answer:
    """Put the decision into words.

    Examples
    --------
    >>> from granular_id.live.snapshot import Snapshot
    >>> from granular_id.live.wording import answer_of
    >>> answer_of(Snapshot("armed", hint="push now")).stage
    'push now'
    """
    hint = printable(snapshot.hint)
    if snapshot.state == "failed":
        return Answer("failed", "no answer", "the capture failed", hint)
    if snapshot.state == "ended":
        return Answer("none", "no more pushes", hint, "")
    decision = snapshot.decision
    if decision is None:
        title = "recorded" if snapshot.state == "complete" else "no answer yet"
        return Answer("none", title, hint or state_of(snapshot).lower(), "")
    seconds = f"{fixed(decision.seconds, 2)} s"
    given = decision.final or snapshot.state == "complete"
    if decision.final:
        stage = f"final, after {seconds}"
    else:
        stage = f"{'early' if given else 'provisional'}, {seconds} of {fixed(snapshot.capture_s, 2)} s"
        if decision.settled:
            stage += ", can no longer change (forces as in training)"
        elif decision.sure:
            stage += ", sure enough to stop"
    if decision.unknown:
        return Answer("unknown", "like no known material", stage, _lead(decision))
    kind: Kind = "final" if given else "provisional"
    return Answer(kind, printable(decision.label), stage, _lead(decision))


def shown_of(snapshot: Snapshot) -> Shown:
    """Put into words what a view of one instant shows: until the next push is triggered, the last outcome.

    Examples
    --------
    >>> from granular_id.live.push import Push
    >>> from granular_id.live.snapshot import Outcome, Snapshot
    >>> from granular_id.live.wording import shown_of
    >>> waiting = Snapshot("armed", hint="push now", history=(Outcome(1, 0.0, Push()),))
    >>> shown_of(waiting).answer.title, shown_of(waiting).state
    ('recorded', 'Armed: push now')
    """
    held, state, warnings = snapshot.held, state_of(snapshot), warnings_of(snapshot)
    if held is None:
        return Shown(answer_of(snapshot), state, warnings, snapshot.decision)
    then = _then(held, snapshot.n_samples, snapshot.rate_hz)
    answer = answer_of(then)
    return Shown(
        replace(answer, stage=f"{answer.stage}, at {_clock(held.utc_s)}"),
        f"{state}: {printable(snapshot.hint)}" if snapshot.hint else state,
        tuple(dict.fromkeys((*warnings_of(then), *warnings))),
        then.decision,
    )


def history_of(snapshot: Snapshot) -> tuple[Entry, ...]:
    """Put the history into words, the newest first."""
    return tuple(_entry(one, snapshot.n_samples, snapshot.rate_hz) for one in reversed(snapshot.history))


@lru_cache(maxsize=128)  # views ask thirty times a second
def _entry(outcome: Outcome, n_samples: int, rate_hz: float) -> Entry:
    then, push = _then(outcome, n_samples, rate_hz), outcome.push
    answer, decision = answer_of(then), push.decision
    verdict = {True: "right", False: "wrong", None: ""}[push.is_right]
    if decision is not None and verdict and (decision.unknown or not push.is_right):
        verdict += f", it was {printable(push.truth or '')}"
    stage = "" if decision is None or decision.final else answer.stage
    detail = ", ".join(part for part in (verdict, stage, answer.detail) if part)
    clock = _clock(outcome.utc_s)
    return Entry(outcome.number, clock, answer.kind, answer.title, detail, warnings_of(then))


def _then(outcome: Outcome, n_samples: int, rate_hz: float) -> Snapshot:
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


def _clock(utc_s: float) -> str:
    return time.strftime("%H:%M:%S", time.localtime(utc_s))


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


def figures_of(snapshot: Snapshot) -> tuple[Figure, ...]:
    """List what tells how well the stream is: lag and lost rows always, other troubles where there are any.

    Examples
    --------
    >>> from granular_id.live.snapshot import Snapshot
    >>> from granular_id.live.wording import figures_of
    >>> figures_of(Snapshot("idle", lag_s=0.0342, counters={"missing": 3, "gaps": 1}))[:2]
    (Figure(name='lag', value='34.2 ms', alarm=True), Figure(name='lost', value='3', alarm=True))
    """
    lag = "-" if math.isnan(snapshot.lag_s) else f"{fixed(1e3 * snapshot.lag_s, 1)} ms"
    always = (
        Figure("lag", lag, snapshot.lagging),
        Figure("lost", f"{snapshot.lost:,}", snapshot.lost > 0),
    )
    counts = ((name, snapshot.counters.get(key, 0)) for key, name in _COUNTERS.items())
    return always + tuple(Figure(name, f"{n:,}", name in _ALARMS) for name, n in counts if n)


def score_of(snapshot: Snapshot) -> str:
    """Tell how many captures there were, and how many of them were named rightly where that is known."""
    if not snapshot.n_captures:
        return ""
    if snapshot.n_correct is None:
        return counted(snapshot.n_captures, "capture")
    return f"{snapshot.n_correct} of {snapshot.n_captures} right"


def warnings_of(snapshot: Snapshot) -> tuple[str, ...]:
    """Put the warnings into sentences; what has none is shown as it is.

    Examples
    --------
    >>> from granular_id.live.snapshot import Snapshot
    >>> from granular_id.live.wording import warnings_of
    >>> warnings_of(Snapshot("complete", warnings=("lag", "the tool slipped")))
    ('lag: rows were read late', 'the tool slipped')
    """
    return tuple(_WARNINGS.get(text, printable(text)) for text in snapshot.warnings)


def printable(text: str) -> str:
    """Replace what would steer a terminal instead of being shown.

    Examples
    --------
    >>> from granular_id.live.wording import printable
    >>> printable("oats" + chr(27) + "[2J")
    'oats�[2J'
    """
    return "".join(c if c.isprintable() else "\ufffd" for c in text)
