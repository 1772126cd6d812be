"""What is asked about every partition, and what a partition answers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator

from granular_id.evaluation.chosen import Chosen
from granular_id.evaluation.gram_engine import GramBank
from granular_id.evaluation.origins import Origins
from granular_id.evaluation.partition import Partition
from granular_id.evaluation.plan import Space

__all__ = ["STAGES", "Answer", "Answers", "SpaceRun", "Task"]

Codes = NDArray[np.intp]

STAGES = ("features", "gram", "training", "prediction")


@dataclass(frozen=True, eq=False)
class Task:
    """One space and one classifier, to be asked about every partition.

    Parameters
    ----------
    space : Space
    classifier : estimator
        Not changed; each partition fits a clone.
    bank : GramBank
        Of the recordings; shared by the tasks on the same recordings.
    origins : Origins, optional
        Told to a classifier that asks for sessions or an order; None: it learns nothing about them.
    shuffled : bool
        Whether the labels of the training rows are shuffled first, see `granular_id.evaluation.controls`.
    kind : {"space", "control"}
        A control may be called like a space.
    """

    space: Space
    classifier: BaseEstimator
    bank: GramBank
    origins: Origins | None = None
    shuffled: bool = False
    kind: str = "space"

    @property
    def key(self) -> str:
        """What no other task of an evaluation is called."""
        return f"{self.kind} {self.space.name}"


@dataclass(frozen=True, eq=False)
class Answer:
    """What one partition said.

    Parameters
    ----------
    predicted : (n_test,) int array
        Class numbers.
    n_features : int
        Length of a feature vector.
    seconds : mapping of str to float
        Of this partition alone.
    shared_seconds : mapping of str to float
        Of what all partitions of the space share.
    chosen : Chosen or None
        What a classifier that chooses took.
    has_weights : bool
        Whether the classifier, trained on features, says in `coef_` how it weighs them: such can be drawn.
    """

    predicted: Codes
    n_features: int
    seconds: dict[str, float]
    shared_seconds: dict[str, float]
    chosen: Chosen | None = None
    has_weights: bool = False


class Answers(Protocol):
    """Where answers are kept as they come, see `granular_id.evaluation.checkpoint`."""

    def load(self, task: str, partition: Partition) -> Answer | None:
        """Return the answer of an earlier run, or None."""

    def save(self, task: str, partition: Partition, answer: Answer) -> None:
        """Keep an answer."""


@dataclass(frozen=True, eq=False)
class SpaceRun:
    """Predictions and choices of one space, one per partition, what they took, and what did not converge.

    `has_weights` as in `Answer`, of the last.
    """

    predicted: list[Codes]
    chosen: list[Chosen | None]
    n_features: int
    seconds: dict[str, float]
    complaints: tuple[str, ...] = ()
    has_weights: bool = False
