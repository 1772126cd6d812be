"""What a result says of one feature space, and of one recording in one partition."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

__all__ = ["Prediction", "SpaceSummary"]


@dataclass(frozen=True)
class SpaceSummary:
    """One feature space as it was evaluated.

    Parameters
    ----------
    name : str
        ``"raw"``, ``"hfmh"``, ``"raw+hfmh"`` or the caller's own name.
    paper_accuracy : float or None
        Accuracy that the paper reports for this space on its own recordings, in [0, 1]. Never measured here.
    learns : bool
        True when the features were fitted on the training rows of each partition.
    n_features : int
        Length of a feature vector.
    seconds : mapping of str to float
        Time spent in the stages ``features``, ``gram``, ``training`` and ``prediction``, controls left out. What
        several spaces share is counted for each, as it would take alone, and with several threads the stages of
        different partitions overlap: the sum exceeds the time that passed, which is `EvaluationResult.wall_s`.
    settings : mapping
        Parameters of the transformer.
    """

    name: str
    paper_accuracy: float | None
    learns: bool
    n_features: int
    seconds: Mapping[str, float]
    settings: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Prediction:
    """What one partition said about one recording."""

    protocol: str
    partition: int
    space: str
    row: int
    recording: str
    session: str
    label: str
    predicted: str
