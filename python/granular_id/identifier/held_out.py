"""What identifiers say of recordings that they have not seen, while the samples arrive.

Everything that `train` says about a model rests on this: its accuracy, its accuracy after fewer samples, and from
which margin on an early answer may be trusted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from granular_id import _core
from granular_id._progress import ProgressCallback
from granular_id._text import fixed
from granular_id.identifier.recipe import Recipe
from granular_id.identifier.rules import EarlyRule, outcome_text
from granular_id.identifier.training import train
from granular_id.recording import Dataset
from granular_id.recording.report import text_table
from granular_id.spaces.candidates import Chosen
from granular_id.splits import Partition, plan_partitions, protocol_name, splittable_rows, strictest

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

N_CHECKPOINTS = 160
"""At so many moments of a recording provisional answers are looked at: every 20 ms of the paper's 3.2 s. A live
identification looks no more often for an early answer: each look is another chance to be wrong."""


class Partitions(NamedTuple):
    """Partitions of recordings, and how they came about.

    Attributes
    ----------
    protocol : str
        Key of `granular_id.splits.PROTOCOLS`.
    each : tuple of Partition
    note : str
        How they were drawn, and what kept stricter ones out.
    """

    protocol: str
    each: tuple[Partition, ...]
    note: str


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Answers about held-out recordings at some moments, the last of which has seen everything.

    Attributes
    ----------
    n_seen : ndarray of int, shape (M,)
        Samples seen at each moment, ascending; the last is the length of a recording.
    rows, folds, truth : ndarrays of int, shape (n,)
        Recording, number of the partition that held it out, and class, of each answer.
    winners : ndarray of int, shape (n, M)
        Class with the least mean loss; the first of equal ones.
    margins : ndarray, shape (n, M)
        Second least mean loss minus the least.
    protocol : str
        Key of `granular_id.splits.PROTOCOLS`.
    held_out : str
        What a partition holds out, in words: ``"held-out sessions"``.
    note : str
        How the partitions were drawn, and what kept stricter ones out.
    partitions : tuple of Partition
    values, scores : ndarrays, shapes (n, K) and (n, L)
        Minus the mean losses, and the scores of the learners, of whole recordings; empty where nobody kept them.
    chosen : tuple of (Chosen or None)
        What the model of each partition chose; empty where nobody kept it.
    """

    n_seen: IntArray
    rows: IntArray
    folds: IntArray
    truth: IntArray
    winners: IntArray
    margins: FloatArray
    protocol: str
    held_out: str
    note: str
    partitions: tuple[Partition, ...]
    values: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    scores: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    chosen: tuple[Chosen | None, ...] = ()

    @property
    def right(self) -> npt.NDArray[np.bool_]:
        """Whether each answer (n, M) is the truth."""
        same: npt.NDArray[np.bool_] = self.winners == self.truth[:, None]
        return same

    def fold_accuracies(self) -> FloatArray:
        """Share of right answers to whole recordings, one for each partition."""
        right = self.right[:, -1]
        return np.array([right[self.folds == fold].mean() for fold in range(len(self.partitions))])


def checkpoints(n_samples: int, n_checkpoints: int = N_CHECKPOINTS) -> IntArray:
    """Return the moments, in samples seen, at which provisional answers are looked at.

    Examples
    --------
    >>> from granular_id.identifier.held_out import checkpoints
    >>> checkpoints(1600)[[0, 1, -1]].tolist(), checkpoints(3).tolist()
    ([10, 20, 1600], [1, 2, 3])
    """
    steps = min(n_checkpoints, n_samples)
    return np.array([-(-k * n_samples // steps) for k in range(1, steps + 1)], dtype=np.intp)


def honest_partitions(data: Dataset, *, n_folds: int = 5, seed: int = 0) -> Partitions:
    """Draw the strictest partitions that recordings allow.

    Whole sessions where every class has several; else halves in time order; else, without an order in time,
    stratified random folds.

    Parameters
    ----------
    data : Dataset
        Labels, sessions, start times and names are read.
    n_folds, seed : int
        Of random folds.

    Returns
    -------
    Partitions

    Raises
    ------
    ValueError
        One class only, or a class with a single recording.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.recording import Dataset, Recording
    >>> zeros = np.zeros((4, 6))
    >>> data = Dataset([Recording(zeros, rate_hz=500, label=m) for m in ("oat", "rice") for _ in range(2)])
    >>> protocol, partitions, note = honest_partitions(data)
    >>> protocol, len(partitions)
    ('chronological', 2)
    """
    splittable_rows(data.y, "held-out")
    name, why = strictest(data)
    protocol = "kfold" if name is None else name
    largest = max(rows.size for rows in splittable_rows(data.y, protocol).values())
    partitions, note = plan_partitions(data, protocol, n_folds=min(n_folds, largest), seed=seed)
    return Partitions(protocol, tuple(partitions), f"{note} ({why})" if why else note)


def answers_held_out(
    data: Dataset,
    drawn: Partitions,
    fitted: Callable[[Partition], tuple[_core.Model, Chosen | None]],
    *,
    tick: Callable[[str], None] = lambda _: None,
) -> HeldOut:
    """Train on the rows of each partition, and answer about the recordings it holds out.

    Parameters
    ----------
    data : Dataset
        Recordings of one length and rate with a label each.
    drawn : Partitions
        Of `honest_partitions`.
    fitted : callable
        From a partition to the model that was trained on its training rows, and what that chose.
    tick : callable
        Told the name of each partition that is done.
    """
    protocol, partitions, note = drawn
    labels, truth = np.unique(data.y, return_inverse=True)
    X = data.X
    n_seen = checkpoints(X.shape[1])
    winners, margins, values, scores, chosen = [], [], [], [], []
    for partition in partitions:
        core, choice = fitted(partition)
        chosen.append(choice)
        if tuple(core.classes) != tuple(labels.tolist()):
            raise ValueError(
                f"partition {partition.description!r} trains on other classes than the data set has"
            )
        answered = [provisional_answers(core, X[row], n_seen) for row in partition.test.tolist()]
        winners += [winner for winner, _ in answered]
        margins += [margin for _, margin in answered]
        scores.append(core.scores(X[partition.test]))
        values.append(-core.losses(scores[-1]))
        tick(f"{protocol_name(protocol, partitions)}: {partition.description}")
    rows = np.concatenate([partition.test for partition in partitions])
    folds = np.concatenate([np.full(p.test.size, k, dtype=np.intp) for k, p in enumerate(partitions)])
    return HeldOut(
        n_seen=n_seen,
        rows=rows,
        folds=folds,
        truth=truth[rows].astype(np.intp),
        winners=np.array(winners, dtype=np.intp),
        margins=np.array(margins),
        protocol=protocol,
        held_out=protocol_name(protocol, partitions),
        note=note,
        partitions=partitions,
        values=np.concatenate(values),
        scores=np.concatenate(scores),
        chosen=tuple(chosen),
    )


def provisional_answers(
    core: _core.Model, wrench: FloatArray, n_seen: Sequence[int] | IntArray
) -> tuple[IntArray, FloatArray]:
    """Answer about one recording at some moments, exactly as a live identification would.

    Parameters
    ----------
    core : granular_id._core.Model
    wrench : ndarray, shape (T, C)
    n_seen : sequence of int
        Samples seen at each moment, ascending, at most T.

    Returns
    -------
    winners : ndarray of int, shape (M,)
        Class with the least mean loss; the first of equal ones.
    margins : ndarray, shape (M,)
        Second least mean loss minus the least.
    """
    stream = _core.StreamingIdentifier(core)
    losses = np.empty((len(n_seen), len(core.classes)))
    start = 0
    for k, stop in enumerate(n_seen):
        stream.push(wrench[start:stop])
        losses[k] = stream.losses()
        start = int(stop)
    return losses.argmin(axis=1), margins_of(losses)


def margins_of(losses: FloatArray) -> FloatArray:
    """Return the second least of the mean losses (..., K) minus the least."""
    least = np.partition(losses, 1, axis=-1)
    margins: FloatArray = least[..., 1] - least[..., 0]
    return margins


# Accuracy against seconds of signal seen: what waiting longer would bring.

_PRINTED = 10


@dataclass(frozen=True, eq=False)
class OverTime:
    """Answers about held-out recordings against seconds of signal seen; ``print`` it for a table.

    Attributes
    ----------
    seconds : ndarray, shape (M,)
        Signal seen at each moment, s, from the first sample of a recording (its lead before the motion included).
    accuracy : ndarray, shape (M,)
        Share of the provisional answers of that moment that are right, of all together. The accuracy that a model
        states is the mean over partitions: another number where these are not of one size.
    answered : ndarray, shape (M,)
        Share of recordings that the early rule has answered by then.
    error : ndarray, shape (M,)
        Share of those answers that are wrong; NaN before the first. A little lower than on fresh recordings, see
        `granular_id.identifier.rules`.
    chance : float
        Accuracy of guessing with every class as likely.
    n_answers : int
        Held-out recordings, each counted as often as a partition held it out.
    held_out : str
        What was held out, in words; `note` says how it was drawn.
    note : str
    target_error : float or None
        Of the early rule; None where there is none, and `why_not` says why.
    why_not : str
    mean_seconds : float
        Mean signal seen at an early answer, s; NaN without any.
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
    synthetic: bool

    def summary(self) -> str:
        """Say in a line or two what the figures show."""
        whole = f"{100 * self.accuracy[-1]:.1f} % of whole recordings right ({self.seconds[-1]:g} s)"
        near = np.flatnonzero(self.accuracy >= self.accuracy[-1] - 0.01)
        first = f"within 1 % of that from {fixed(self.seconds[near[0]], 2)} s on"
        lines = [f"{self.n_answers} answers, {self.held_out}: {whole}; {first}"]
        if self.target_error is not None and self.answered[-1] > 0:
            outcome = outcome_text(
                float(self.answered[-1]), self.mean_seconds, float(self.error[-1]), self.target_error
            )
            lines.append(f"early answers: {outcome}")
        elif self.why_not:
            lines.append(f"no early answers: {self.why_not}")
        return "\n".join(lines)

    def __str__(self) -> str:
        """Return a table of some moments, and the summary."""
        places = np.unique(np.linspace(0, len(self.seconds) - 1, _PRINTED).round().astype(int))
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
        plain: dict[str, Any] = {}
        for name, value in vars(self).items():
            numbers = value.tolist() if isinstance(value, np.ndarray) else [value]
            known = [None if isinstance(n, float) and math.isnan(n) else n for n in numbers]
            plain[name] = known if isinstance(value, np.ndarray) else known[0]
        return plain


def over_time(held: HeldOut, rate_hz: float, rule: EarlyRule | None, *, synthetic: bool) -> OverTime:
    """Count what is right, answered early, and wrong among that, at each moment.

    Parameters
    ----------
    held : HeldOut
        Provisional answers about held-out recordings.
    rate_hz : float
    rule : EarlyRule or None
        Calibrated on them.
    synthetic : bool
    """
    right = held.right
    moments = np.arange(len(held.n_seen))
    answered, error = np.zeros(len(moments)), np.full(len(moments), np.nan)
    mean_seconds = math.nan
    if rule:
        given = np.flatnonzero(rule.stops >= 0)
        stops = rule.stops[given]
        wrong = ~right[given, stops]
        counts = (stops[:, None] <= moments).sum(axis=0)
        answered = counts / len(rule.stops)
        np.divide(
            (wrong[:, None] & (stops[:, None] <= moments)).sum(axis=0), counts, out=error, where=counts > 0
        )
        mean_seconds = float(held.n_seen[stops].mean() / rate_hz)
    return OverTime(
        seconds=held.n_seen / rate_hz,
        accuracy=right.mean(axis=0),
        answered=answered,
        error=error,
        chance=1 / np.unique(held.truth).size,
        n_answers=len(held.rows),
        held_out=held.held_out,
        note=held.note,
        target_error=rule.target_error if rule else None,
        why_not="no early rule was asked for" if rule is None else rule.why_not,
        mean_seconds=mean_seconds,
        synthetic=synthetic,
    )


def accuracy_over_time(
    data: Dataset,
    space: str = "best",
    *,
    target_error: float = 0.01,
    n_folds: int = 5,
    progress: bool | ProgressCallback | None = None,
    **settings: Any,
) -> OverTime:
    """Measure on held-out recordings how accurate provisional answers are, and what early answers are worth.

    Whole sessions are held out where every class has several; else halves in time order; else random folds.

    Parameters
    ----------
    data : Dataset
        Recordings of equal length and rate with a label each.
    space : str, default "best"
        Feature space, as in `Identifier.fit`.
    target_error : float, default 0.01
        Share of early answers that may be wrong.
    n_folds : int, default 5
        Random folds, where neither sessions nor an order in time are known.
    progress : bool or callable, optional
        As in `granular_id.evaluate`; None is silent.
    **settings
        Others of `granular_id.identifier.recipe.Recipe` that the space has: ``cutoff_hz``, ``C``, ``coding`` ...

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
    >>> from granular_id.identifier import accuracy_over_time
    >>> data = synthesize(["rice", "fine sugar"], n_per_class=10, duration_s=0.5)
    >>> course = accuracy_over_time(data, target_error=0.1)
    >>> course.seconds[-1], bool(course.accuracy[-1] > 0.8)
    (np.float64(0.5), True)
    """
    training = train(
        data, Recipe(space=space, **settings), target_error=target_error, n_folds=n_folds, progress=progress
    )
    if training.held is None:
        raise ValueError(f"data: nothing can be held out: {training.why_none}")
    return over_time(training.held, data.rate_hz, training.early, synthetic=data.is_synthetic)
