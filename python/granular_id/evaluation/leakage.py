"""What spoils an evaluation: copies on both sides, findings of the checks, and what is known without touching.

A material that was recorded on its own day is recognized by anything that differs between days. No accuracy shows that,
however high; what the clock or the rest before the motion reach alone does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtrc
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import FunctionTransformer

from granular_id._checks import argument_error
from granular_id._core import GranularIdError
from granular_id._text import fixed, percent
from granular_id.ecoc import ECOCClassifier
from granular_id.recording import CheckReport, Dataset, Finding
from granular_id.score import Held
from granular_id.spaces import RawSignal
from granular_id.splits import Folds

Floats = NDArray[np.float64]

MOST_INSTANTS = 200
"""Samples of the rest are thinned to so many: what gives the material away in more does in these."""

ABOVE_CHANCE_P = 0.005
SPOILS_FROM = 2 / 3
"""Share of the way from chance to the headline from which on a baseline spoils it."""

_COPIES = {"duplicates", "near-duplicates"}
_CLOCKS = {"leak-clock"}


@dataclass(frozen=True, eq=False)
class Baseline:
    """What was known to a classifier that did not touch the material, and how far that leads.

    Attributes
    ----------
    name : str
        "rest" or "clock".
    what : str
        What was known to the classifier.
    held : Held or None
        Its answers under the folds of the headline; None where it cannot be had.
    at_random : float
        Its balanced accuracy under folds drawn at random; NaN where none were drawn.
    why_not : str
        Why it cannot be had.
    """

    name: str
    what: str
    held: Held | None = None
    at_random: float = math.nan
    why_not: str = ""

    @property
    def p(self) -> float:
        """P-value of the test that it knows nothing, one-sided and binomial, over cells of one material and session.

        Answers of a session resemble each other, so that a cell counts once: as a hit where more than half of its
        answers are right. Without sessions a cell is a material in a fold. NaN where the baseline cannot be had.
        """
        if self.held is None:
            return math.nan
        places = [
            str(fold if session is None else session)
            for session, fold in zip(self.held.sessions, self.held.fold.tolist(), strict=True)
        ]
        cells = np.unique(np.array([self.held.truth.astype(str), places]), axis=1, return_inverse=True)[1]
        shares = np.bincount(cells.ravel(), weights=self.held.right) / np.bincount(cells.ravel())
        hits = int((shares > 0.5).sum())
        return float(bdtrc(hits - 1, shares.size, self.held.chance)) if hits else 1.0

    def comes_near(self, headline: Held) -> bool:
        """Whether it reaches two thirds of the way from chance to the headline."""
        way = SPOILS_FROM * (headline.accuracy - headline.chance)
        return self.held is not None and way > 0 and self.held.accuracy >= headline.chance + way

    def finding(self, headline: Held) -> Finding | None:
        """Say that it spoils an evaluation: it comes near, and is above chance."""
        if self.held is None or not (self.p < ABOVE_CHANCE_P and self.comes_near(headline)):
            return None
        reached = self.held.accuracy
        remedy = {
            "clock": "recorded one material after the other; record each material in several sessions",
            "rest": "something but the material differs before anything moves, such as the zero of the sensor",
        }
        message = f"the {self.name} alone names {percent(reached, 0)}: {remedy[self.name]}"
        values = {"accuracy": reached, "chance": headline.chance, "p": self.p}
        return Finding("error", f"baseline-{self.name}", message, values=values)


Untouched = tuple[Baseline, Pipeline | None, Floats | None]
"""A baseline without answers, its pipeline, and what stands for the samples; None where it cannot be had."""


def planned_baselines(data: Dataset) -> tuple[Untouched, ...]:
    """Return what could be known of these recordings without touching the material."""
    return _rest(data), _clock(data)


def _rest(data: Dataset) -> Untouched:
    onsets = [recording.trigger_index for recording in data]
    known = [onset for onset in onsets if onset is not None]
    n_rest = min(known, default=0)
    why_not = "a motion begins at the first sample" if n_rest == 0 else ""
    if len(known) < len(onsets):
        why_not = "no onset known (data convert --begin-at onset --lead-s 0.1 ...)"
    if why_not:
        return Baseline("rest", "the rest before the motion", why_not=why_not), None, None
    thinned = np.ascontiguousarray(data.X[:, : n_rest : math.ceil(n_rest / MOST_INSTANTS)])
    pipeline = Pipeline([("raw", RawSignal()), ("classifier", ECOCClassifier())])
    return Baseline("rest", f"the {fixed(n_rest / data.rate_hz, 2)} s before the motion"), pipeline, thinned


def _clock(data: Dataset) -> Untouched:
    what = "seconds since the session began, nearest neighbour"
    times = data.start_times
    n_missing = int(np.isnan(times).sum())
    why_not = "all recordings start at the same time" if (times == times[0]).all() else ""
    if n_missing:
        why_not = f"{n_missing} of {times.size} recordings carry no start time"
    if why_not:
        return Baseline("clock", what, why_not=why_not), None, None
    since = times.copy()
    sessions = np.array([session or "" for session in data.sessions], dtype=object)
    for session in set(sessions.tolist()):
        since[sessions == session] -= times[sessions == session].min()
    pipeline = Pipeline([("clock", FunctionTransformer()), ("classifier", KNeighborsClassifier(1))])
    return Baseline("clock", what), pipeline, since[:, np.newaxis]


# Findings of the checks.


def accepted_names(accept: str | Sequence[str]) -> tuple[str, ...]:
    """Return the findings that are known, by the names that ``data check`` prints."""
    names = (accept,) if isinstance(accept, str) else tuple(accept)
    for name in names:
        if not isinstance(name, str):
            wanted = f"must hold names as granular-id data check prints them, got {name!r}"
            raise argument_error(TypeError, "accept", wanted)
    return names


def spoiling(report: CheckReport) -> tuple[Finding, ...]:
    """Return the findings that spoil an evaluation: errors, and clocks that name the label."""
    return tuple(finding for finding in report if finding.severity == "error" or finding.code in _CLOCKS)


def refuse_copies(findings: Sequence[Finding], accepted: Sequence[str], folds: Folds, data: Dataset) -> None:
    """Refuse recordings that share samples on both sides of a split, unless that is accepted."""
    apart = {
        finding.code: pairs
        for finding in findings
        if finding.code not in accepted and (pairs := _apart(finding, folds, len(data)))
    }
    if not apart:
        return
    every = set[tuple[int, int]]().union(*apart.values())
    one, other = min(every)
    more = f", and {len(every) - 1} more such pairs" if len(every) > 1 else ""
    raise GranularIdError(
        f"{data.names[one]!r} and {data.names[other]!r} share samples, and one trains while the other is tested{more}: "
        f"leave one out, or pass accept={tuple(apart)!r} (--accept {' --accept '.join(apart)})"
    )


def copies_together(report: CheckReport, folds: Folds, data: Dataset) -> list[tuple[int, int]]:
    """Pairs of recordings that share samples, and lie on one side of every split."""
    return [
        (one, other)
        for finding in report
        if finding.code in _COPIES
        for apart in [_apart(finding, folds, len(data))]
        for one, other, *_ in finding.values["pairs"]
        if (one, other) not in apart
    ]


def _apart(finding: Finding, folds: Folds, n_rows: int) -> set[tuple[int, int]]:
    """Pairs of copies of which one trains while the other is tested."""
    found = set[tuple[int, int]]()
    if finding.code not in _COPIES:
        return found
    for fold in folds:
        side = [0] * n_rows
        for rows, sign in ((fold.train, 1), (fold.test, -1)):
            for row in rows.tolist():
                side[row] = sign
        found |= {(one, other) for one, other, *_ in finding.values["pairs"] if side[one] * side[other] < 0}
    return found
