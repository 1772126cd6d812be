"""What could be known without touching the material: from the rest before the motion, and from the clock.

A material that was recorded on its own day is told apart by anything that differs between days. No accuracy shows that,
however high; what the clock or the rest reach alone does.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtrc
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import FunctionTransformer

from granular_id._text import fixed, percent
from granular_id.ecoc import ECOCClassifier
from granular_id.recording import Dataset, Finding
from granular_id.score import Held
from granular_id.spaces import RawSignal

MOST_INSTANTS = 200
"""Samples of the rest are thinned to so many: what gives the material away in more does in these."""

ABOVE_CHANCE_P = 0.005
SPOILS_FROM = 2 / 3
"""Share of the way from chance to the headline from which on a baseline spoils it."""


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


Score = Callable[[str, Pipeline, NDArray[np.float64]], tuple[Held, float]]
"""Called with the name, the pipeline and what stands for the samples; returns answers and the accuracy at random."""


def run_baselines(data: Dataset, score: Score) -> tuple[Baseline, ...]:
    """Score both baselines under the folds of the headline."""
    return _rest(data, score), _clock(data, score)


def _rest(data: Dataset, score: Score) -> Baseline:
    onsets = [recording.trigger_index for recording in data]
    known = [onset for onset in onsets if onset is not None]
    what = "the rest before the motion"
    if len(known) < len(onsets):
        return Baseline(
            "rest",
            what,
            why_not="no onset known (--begin-at onset --lead-s 0.1 --duration-s S)",
        )
    n_rest = min(known)
    if n_rest == 0:
        return Baseline("rest", what, why_not="a motion begins at the first sample")
    thinned = np.ascontiguousarray(data.X[:, : n_rest : math.ceil(n_rest / MOST_INSTANTS)])
    pipeline = Pipeline([("raw", RawSignal()), ("classifier", ECOCClassifier())])
    what = f"the {fixed(n_rest / data.rate_hz, 2)} s before the motion"
    return Baseline("rest", what, *score("rest", pipeline, thinned))


def _clock(data: Dataset, score: Score) -> Baseline:
    what = "seconds since the session began, nearest neighbour"
    times = data.start_times
    if np.isnan(times).any():
        missing = int(np.isnan(times).sum())
        return Baseline("clock", what, why_not=f"{missing} of {times.size} recordings carry no start time")
    if (times == times[0]).all():
        return Baseline("clock", what, why_not="all recordings start at the same time")
    since = times.copy()
    sessions = np.array([session or "" for session in data.sessions], dtype=object)
    for session in set(sessions.tolist()):
        since[sessions == session] -= times[sessions == session].min()
    pipeline = Pipeline([("clock", FunctionTransformer()), ("classifier", KNeighborsClassifier(1))])
    return Baseline("clock", what, *score("clock", pipeline, since[:, np.newaxis]))
