"""What identifiers say of recordings that they have not seen, while the samples arrive.

Everything that `train` says about a model rests on this: its accuracy, its accuracy after fewer samples, and from
which margin on an early answer may be trusted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from granular_id import _core
from granular_id.recording import Dataset
from granular_id.spaces import Chosen
from granular_id.splits import Partition, plan_partitions, protocol_name, splittable_rows, strictest

IntArray = npt.NDArray[np.intp]

N_CHECKPOINTS = 160
"""At so many moments of a recording provisional answers are looked at: every 20 ms of the paper's 3.2 s. A live
identification looks no more often for an early answer: each look is another chance to be wrong."""

FloatArray = npt.NDArray[np.float64]


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
