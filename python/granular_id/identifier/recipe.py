"""How an identifier is made: the settings of features and classifier, and the scikit-learn pipeline they stand for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.pipeline import Pipeline

from granular_id.ecoc import ECOCClassifier
from granular_id.ecoc.codings import design
from granular_id.evaluation.describe import describe_estimator
from granular_id.spaces import HFMH, RawHFMH, RawSignal
from granular_id.spaces.hfmh import DEFAULT_RANGE, BinRange
from granular_id.spaces.weights import BlockWeights

__all__ = ["SPACES", "Recipe"]

SPACES = ("raw", "hfmh", "raw+hfmh")
"""Feature spaces of which scores grow with each sample: a linear score of samples and counts, nothing else."""


@dataclass(frozen=True)
class Recipe:
    """Settings of features and classifier; the defaults are the paper's.

    Parameters
    ----------
    space : {"raw+hfmh", "hfmh", "raw"}
        Feature space. Others need the whole recording before they know a first feature.
    cutoff_hz, order, n_bins, bin_range, outside, density, initial
        As in `granular_id.HFMH`; without effect on ``"raw"``.
    block_weights : None, "unit" or two numbers
        Of ``"raw+hfmh"``, as in `granular_id.RawHFMH`; they end in the weights of the model.
    C, coding, loss, decoding, posterior
        As in `granular_id.ECOCClassifier`.
    random_state : int
        Draws random codings and the folds of `posterior`.

    Raises
    ------
    ValueError
        An unknown space (the message names those that work), or weights of blocks for a space of one block.

    Examples
    --------
    >>> from granular_id.identifier.recipe import Recipe
    >>> [name for name, _ in Recipe(space="hfmh").pipeline(500.0).steps]
    ['features', 'classifier']
    """

    space: str = "raw+hfmh"
    cutoff_hz: float = 23.0
    order: int = 8
    n_bins: int = 100
    bin_range: BinRange = DEFAULT_RANGE
    outside: str = "drop"
    density: bool = False
    initial: str = "zero"
    block_weights: BlockWeights = None
    C: float = 1.0
    coding: str | npt.ArrayLike = "onevsone"
    loss: str = "auto"
    decoding: str = "loss_weighted"
    posterior: str | None = None
    random_state: int = 0

    def __post_init__(self) -> None:
        if self.space not in SPACES:
            raise ValueError(
                f"space must be one of {', '.join(map(repr, SPACES))}, got {self.space!r}: an identifier answers "
                "while samples arrive, which needs scores that are linear in samples and counts"
            )
        if self.block_weights is not None and self.space != "raw+hfmh":
            raise ValueError(
                f"block_weights weigh two blocks side by side, and space={self.space!r} has one: leave them out, or "
                "take 'raw+hfmh'"
            )

    def features(self, rate_hz: float) -> Any:
        """Return the feature space, not fitted, for recordings of a rate."""
        if self.space == "raw":
            return RawSignal(rate_hz=rate_hz)
        options: dict[str, Any] = {
            name: getattr(self, name)
            for name in ("cutoff_hz", "order", "n_bins", "bin_range", "outside", "density", "initial")
        }
        if self.space == "hfmh":
            return HFMH(rate_hz=rate_hz, **options)
        return RawHFMH(rate_hz=rate_hz, block_weights=self.block_weights, **options)

    def classifier(self, *, posterior: bool = True) -> ECOCClassifier:
        """Return the classifier, not fitted; without `posterior` even where the settings ask for one."""
        return ECOCClassifier(
            C=self.C,
            coding=self.coding,
            loss=self.loss,
            decoding=self.decoding,
            posterior=self.posterior if posterior else None,
            random_state=self.random_state,
        )

    def pipeline(self, rate_hz: float, *, posterior: bool = True, threads: int | None = None) -> Pipeline:
        """Return feature space and classifier as one pipeline, not fitted; no number depends on `threads`."""
        features = self.features(rate_hz).set_params(threads=threads)
        return Pipeline([("features", features), ("classifier", self.classifier(posterior=posterior))])

    def n_learners(self, n_classes: int) -> int:
        """Count the binary learners that `coding` makes of so many classes."""
        return int(design(self.coding, n_classes, np.random.default_rng(0)).shape[1])

    def to_dict(self, rate_hz: float) -> dict[str, Any]:
        """Return all settings, for recordings of a rate, in types that JSON knows."""
        features = describe_estimator(self.features(rate_hz))
        classifier = describe_estimator(self.classifier())
        return {
            "space": self.space,
            "features": {name: value for name, value in features.items() if name != "threads"},
            "classifier": {name: value for name, value in classifier.items() if name != "n_jobs"},
        }
