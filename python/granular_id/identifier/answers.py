"""What a model is and what it says, whatever it was made from."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, overload

import numpy as np
import numpy.typing as npt

from granular_id import _core
from granular_id._columns import samples_of
from granular_id._text import fixed
from granular_id.ecoc import Posterior
from granular_id.features import FeatureSpec
from granular_id.identifier.metadata import axes_of, lead_of
from granular_id.identifier.recipe import BANDED
from granular_id.recording import Dataset, Recording
from granular_id.spaces import USUAL_BLOCKS

FloatArray = npt.NDArray[np.float64]


def probabilities(core: _core.Model, scores: FloatArray) -> FloatArray:
    """Probability (n, K) of each class from scores (n, L), by the sigmoids that a model keeps.

    Raises
    ------
    ValueError
        The model was trained without `posterior`.
    """
    if core.sigmoid is None:
        raise ValueError(
            "the model knows no probabilities: train it with posterior='kullback_leibler' or 'wu_lin_weng'"
        )
    slope, offset = core.sigmoid.T
    weights = np.ones(len(slope)) if core.posterior_weights is None else core.posterior_weights
    posterior = Posterior(core.metadata["posterior"], slope, offset, weights)
    return posterior.probabilities(scores, core.coding_matrix)


class Answers:
    """Base of `granular_id.identifier.Identifier`: properties of a model, and answers about whole recordings."""

    def __init__(self, core: _core.Model) -> None:
        if not isinstance(core, _core.Model):
            raise TypeError(f"core must be a granular_id._core.Model, got {type(core).__name__}")
        self.core = core

    @property
    def classes(self) -> tuple[str, ...]:
        """The K labels, sorted."""
        return self.core.classes

    @property
    def spec(self) -> FeatureSpec | _core.MultiBandExtractor:
        """What is extracted from a recording: samples and counts, or multi-band features with their scales."""
        return self.core.spec

    @property
    def space(self) -> str:
        """Feature space that the model was trained in: one of `granular_id.identifier.recipe.SPACES`.

        Of a classifier that was taken over with multi-band features: "multiband", with the blocks added or left out.
        """
        spec = self.spec
        if isinstance(spec, FeatureSpec):
            return "+".join(name for name in ("raw", "hfmh") if getattr(spec, name))
        settings = self.trained.get("settings")
        if isinstance(settings, dict) and settings.get("space") in BANDED:
            return str(settings["space"])
        left_out = [name for name in USUAL_BLOCKS if name not in spec.blocks]
        added = [name for name in spec.blocks if name not in USUAL_BLOCKS]
        return "+".join(["multiband", *added]) + "".join(f"-{name}" for name in left_out)

    @property
    def n_samples(self) -> int:
        """Samples T of a recording."""
        return self.core.n_samples

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the C axes."""
        return axes_of(self.core)

    @property
    def rate_hz(self) -> float:
        """Sampling rate, Hz."""
        return self.core.rate_hz

    @property
    def lead_s(self) -> float | None:
        """Seconds of rest ahead of the trigger, where all recordings of the training had the same; else None."""
        return lead_of(self.core)

    @property
    def lacks_digest(self) -> bool:
        """Whether it was read from a file of an earlier version, without a digest: damage cannot be told."""
        return self.core.lacks_digest

    @cached_property
    def trained(self) -> dict[str, Any]:
        """What it was trained on and how, and the estimates; empty where nothing is known."""
        known: dict[str, Any] = json.loads(self.core.metadata["trained"])
        return known

    @property
    def synthetic(self) -> bool:
        """Whether it is known to be trained on simulated recordings: its answers say nothing about real materials."""
        return bool(self.trained.get("synthetic", False))

    def scores(self, X: npt.ArrayLike, *, threads: int | None = None) -> FloatArray:
        """Scores (n, L) of the binary learners; positive speaks for the classes with code +1.

        Parameters
        ----------
        X : array-like, shape (n, T, C) or (T, C)
            Recordings of the length, rate and axes of the training, N and N m. Tables with named columns, one or a
            list of them, come into the order of `axes`; other names are refused.
        threads : int, optional
            Threads of a batch; no bit depends on it. Default: all cores.

        Raises
        ------
        TypeError, ValueError
            Another shape, NaN or infinity; a `Dataset` instead of its ``X``.
        """
        if isinstance(X, (Dataset, Recording)):
            kind, part = type(X).__name__, "X" if isinstance(X, Dataset) else "wrench"
            raise TypeError(
                f"X must be an array, got a {kind}: pass its {part}, or the recording to identify"
            )
        samples, _ = samples_of(X, "X", self.axes)
        return self.core.scores(samples, threads)

    def losses(self, X: npt.ArrayLike) -> FloatArray:
        """Mean binary loss (n, K) of each class for recordings as in `scores`: the smallest wins."""
        return self.core.losses(self.scores(X))

    def decision_function(self, X: npt.ArrayLike) -> FloatArray:
        """Decision values as `ECOCClassifier.decision_function` gives them.

        Returns
        -------
        ndarray, shape (n, K), or (n,) for two classes
            Minus the mean binary loss of each class. For two classes the value of the second minus the first.
        """
        values = -self.losses(X)
        return values[:, 1] - values[:, 0] if values.shape[1] == 2 else values

    def predict(self, X: npt.ArrayLike) -> npt.NDArray[np.str_]:
        """Label (n,) of each recording as in `scores`; of tied classes the first in `classes`."""
        labels: npt.NDArray[np.str_] = np.array(self.classes)[self.losses(X).argmin(axis=1)]
        return labels

    def predict_proba(self, X: npt.ArrayLike) -> FloatArray:
        """Probability (n, K) of each class for recordings as in `scores`; rows sum to 1.

        Raises
        ------
        ValueError
            The model was trained without `posterior`.
        """
        return probabilities(self.core, self.scores(X))


class _Lazy:
    """A field that may be given as a function, called when the field is first read."""

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = f"_{name}"

    @overload
    def __get__(self, instance: None, owner: type) -> None: ...

    @overload
    def __get__(self, instance: object, owner: type) -> float | None: ...

    def __get__(self, instance: object | None, owner: type) -> float | None:
        if instance is None:
            return None  # the default of the field
        value: Callable[[], float] | float | None = vars(instance)[self._name]
        if callable(value):
            value = vars(instance)[self._name] = value()
        return value

    def __set__(self, instance: object, value: Callable[[], float] | float | None) -> None:
        vars(instance)[self._name] = value


@dataclass(frozen=True)
class Decision:
    """The answer to one push, provisional or final.

    Attributes
    ----------
    label : str
        The best material.
    ranking : tuple of (str, float)
        Every material with its mean loss, the best first.
    margin : float
        Loss of the second material minus that of the first.
    probability : float, optional
        Probability of the label, of a model that was trained with `posterior`; else None. A function may be given
        instead of a number: it is called when the probability is first read, because coupling the learners takes
        longer than everything else about a decision.
    final : bool
        Whether the whole signal was seen.
    settled : bool
        Whether the label can no longer change while the remaining forces stay in the range that they had in training.
    sure : bool
        Whether the margin is as large as the model's rule for early answers wants at this moment.
    n_seen : int
        Samples seen.
    seconds : float
        Seconds of signal seen.
    warnings : tuple of str
        What may have spoilt the signal: a gap, saturation, lag; and what of the set-up is not as in the training.
    candidates : tuple of str
        Materials that it may be, the likeliest first: they hold the right one as often as the training asked for.
        Empty for a provisional answer, and for a model without such a rule.
    unknown : bool or None
        Whether the signal is like none of the materials that the model knows; None for a provisional answer, and
        without such a rule.

    Examples
    --------
    >>> from granular_id.identifier.streaming import Decision
    >>> decision = Decision("rice", (("rice", 0.1), ("salt", 0.3)), 0.2, final=False, n_seen=800, seconds=1.6)
    >>> print(decision)
    rice after 1.60 s, provisional: margin 0.200 ahead of salt
    >>> decision.to_dict()["ranking"]
    [['rice', 0.1], ['salt', 0.3]]
    """

    label: str
    ranking: tuple[tuple[str, float], ...]
    margin: float
    probability: _Lazy = _Lazy()
    final: bool = False
    settled: bool = False
    sure: bool = False
    n_seen: int = 0
    seconds: float = 0.0
    warnings: tuple[str, ...] = ()
    candidates: tuple[str, ...] = ()
    unknown: bool | None = None

    def __str__(self) -> str:
        stage = (
            "final" if self.final else "settled" if self.settled else "sure" if self.sure else "provisional"
        )
        name = f"like no known material, nearest {self.label}," if self.unknown else self.label
        line = f"{name} after {fixed(self.seconds, 2)} s, {stage}: margin {fixed(self.margin, 3)}"
        if len(self.ranking) > 1:
            line += f" ahead of {self.ranking[1][0]}"
        if self.probability is not None:
            line += f", probability {self.probability:.3f}"
        if len(self.candidates) > 1:
            line += f"; may be {' or '.join(self.candidates)}"
        return f"{line} ({', '.join(self.warnings)})" if self.warnings else line

    def to_dict(self) -> dict[str, Any]:
        """Return the decision in types that JSON knows; computes the probability."""
        return {
            "label": self.label,
            "ranking": [[label, loss] for label, loss in self.ranking],
            "margin": self.margin,
            "probability": self.probability,
            "final": self.final,
            "settled": self.settled,
            "sure": self.sure,
            "n_seen": self.n_seen,
            "seconds": self.seconds,
            "warnings": list(self.warnings),
            "candidates": list(self.candidates),
            "unknown": self.unknown,
        }
