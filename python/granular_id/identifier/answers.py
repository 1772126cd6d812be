"""What a model is and what it says, whatever it was made from."""

from __future__ import annotations

import json
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from granular_id import _core
from granular_id._columns import samples_of
from granular_id.ecoc.posterior import Posterior
from granular_id.features import FeatureSpec
from granular_id.identifier.about import axes_of, lead_of
from granular_id.identifier.recipe import BANDED
from granular_id.recording import Dataset, Recording
from granular_id.spaces.multiband import USUAL_BLOCKS

__all__ = ["Answers", "probabilities"]

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
