"""Accuracy against seconds of signal seen: what waiting longer would bring."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.pipeline import Pipeline

from granular_id._files import json_value
from granular_id._progress import ProgressCallback
from granular_id._text import fixed
from granular_id.identifier.rules import EarlyRule, HeldOut, outcome_text
from granular_id.identifier.training import train
from granular_id.recording import Dataset, text_table

FloatArray = npt.NDArray[np.float64]

_N_PRINTED = 10


@dataclass(frozen=True, eq=False)
class OverTime:
    """Answers about held-out recordings against seconds of signal seen; ``print`` it for a table.

    Attributes
    ----------
    seconds : ndarray, shape (M,)
        Signal seen at each moment, s, from the first sample of a recording (its lead before the motion included).
    accuracy : ndarray, shape (M,)
        Share of the provisional answers of that moment that are right, of all together. The accuracy that a model
        states is the mean over materials: another number where these are not of one size.
    answered : ndarray, shape (M,)
        Share of recordings that the early rule has answered by then.
    error : ndarray, shape (M,)
        Share of those answers that are wrong; NaN before the first. Lower than on fresh recordings, with two
        sessions by half: the rule was chosen on these.
    chance : float
        Accuracy of guessing with every class as likely.
    n_answers : int
        Held-out recordings, each counted once, as it is held out once.
    held_out : str
        What was held out, in words; `note` says how it was drawn.
    note : str
    target_error : float or None
        Of the early rule; None where there is none, and `why_not` says why.
    why_not : str
    mean_seconds : float
        Mean signal seen at an early answer, s; NaN without any.
    worst : float
        Share of wrong early answers in the worst held-out session, without sessions of all; NaN without any.
    synthetic : bool
        Recordings were simulated: figures show that the program works, not how well it knows materials.
    """

    seconds: FloatArray
    accuracy: FloatArray
    answered: FloatArray
    error: FloatArray
    chance: float
    n_answers: int
    held_out: str
    note: str
    target_error: float | None
    why_not: str
    mean_seconds: float
    worst: float
    synthetic: bool

    def summary(self) -> str:
        """Say in a line or two what the figures show."""
        whole = f"{100 * self.accuracy[-1]:.1f} % of whole recordings right ({self.seconds[-1]:g} s)"
        near = np.flatnonzero(self.accuracy >= self.accuracy[-1] - 0.01)
        first = f"within 1 % of that from {fixed(self.seconds[near[0]], 2)} s on"
        lines = [f"{self.n_answers} answers, {self.held_out}: {whole}; {first}"]
        if self.target_error is not None and self.answered[-1] > 0:
            answered, error = float(self.answered[-1]), float(self.error[-1])
            lines.append(
                f"early answers: {outcome_text(answered, self.mean_seconds, error, self.target_error, self.worst)}"
            )
        elif self.why_not:
            lines.append(f"no early answers: {self.why_not}")
        return "\n".join(lines)

    def __str__(self) -> str:
        """Return a table of some moments, and the summary."""
        places = np.unique(np.linspace(0, len(self.seconds) - 1, _N_PRINTED).round().astype(int))
        rows = [
            {
                "seconds": fixed(self.seconds[i], 2),
                "accuracy": f"{100 * self.accuracy[i]:.1f} %",
                "answered early": f"{100 * self.answered[i]:.1f} %",
                "of these wrong": "" if math.isnan(self.error[i]) else f"{100 * self.error[i]:.1f} %",
            }
            for i in places.tolist()
        ]
        title = f"Accuracy over time{' on SYNTHETIC recordings' if self.synthetic else ''}"
        return "\n".join((title, *text_table(rows), self.summary(), self.note))

    def to_dict(self) -> dict[str, Any]:
        """Return all figures, in types that JSON knows (NaN as None)."""
        return {name: json_value(value) for name, value in vars(self).items()}


def over_time(held: HeldOut, rate_hz: float, rule: EarlyRule | None, *, synthetic: bool) -> OverTime:
    """Count what is right, answered early, and wrong among that, at each moment."""
    right = held.right
    moments = np.arange(len(held.n_seen))
    answered, error = np.zeros(len(moments)), np.full(len(moments), np.nan)
    mean_seconds = math.nan
    if rule:
        given = np.flatnonzero(rule.stops >= 0)
        stops = rule.stops[given]
        wrong = ~right[given, stops]
        by_then = stops[:, None] <= moments
        counts = by_then.sum(axis=0)
        answered = counts / len(rule.stops)
        np.divide((wrong[:, None] & by_then).sum(axis=0), counts, out=error, where=counts > 0)
        mean_seconds = rule.to_dict(held, rate_hz)["mean_seconds"]
    return OverTime(
        seconds=held.n_seen / rate_hz,
        accuracy=right.mean(axis=0),
        answered=answered,
        error=error,
        chance=1 / np.unique(held.truth).size,
        n_answers=len(held.truth),
        held_out=held.held.folds.name,
        note="; ".join(held.held.folds.notes),
        target_error=rule.target_error if rule else None,
        why_not="no early rule was asked for" if rule is None else rule.why_not,
        mean_seconds=mean_seconds,
        worst=math.nan if rule is None else rule.worst,
        synthetic=synthetic,
    )


def accuracy_over_time(
    data: Dataset,
    space: str | Pipeline = "best",
    *,
    by: str = "auto",
    target_error: float = 0.01,
    progress: bool | ProgressCallback | None = None,
) -> OverTime:
    """Measure on held-out recordings how accurate provisional answers are, and what early answers are worth.

    Parameters
    ----------
    data : Dataset
        Recordings of equal length and rate with a label each.
    space : str or Pipeline, default "best"
        Feature space, as in `Identifier.fit`.
    by : str, default "auto"
        What is held out, as in `Identifier.fit`.
    target_error : float, default 0.01
        Share of early answers that may be wrong.
    progress : bool or callable, optional
        As in `granular_id.evaluate`; None is silent.

    Returns
    -------
    OverTime

    Raises
    ------
    TypeError, ValueError
        As `Identifier.fit`; also where nothing can be held out.

    Examples
    --------
    >>> from granular_id import synthesize
    >>> from granular_id import accuracy_over_time
    >>> data = synthesize(["rice", "fine sugar"], n_per_class=10, duration_s=0.5)
    >>> course = accuracy_over_time(data, target_error=0.1)
    >>> course.seconds[-1], bool(course.accuracy[-1] > 0.8)
    (np.float64(0.5), True)
    """
    training = train(data, space, by=by, target_error=target_error, progress=progress)
    if training.held is None:
        raise ValueError(f"data: nothing can be held out: {training.trained['why_no_estimate']}")
    return over_time(training.held, data.rate_hz, training.early, synthetic=data.is_synthetic)
