"""Which steps of a model lead from recordings to columns, and which on to the classifier, and the way back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.pipeline import Pipeline
from sklearn.utils.validation import check_is_fitted

from granular_id.best import BestClassifier
from granular_id.ecoc import ECOCClassifier
from granular_id.spaces import FeatureBlock, RecordingFilter, feature_blocks
from granular_id.spaces.band_columns import BandColumns, band_columns
from granular_id.spaces.base import real_steps
from granular_id.spaces.folding import LINEAR_STEPS, folded_back, is_linear_step

__all__ = ["Chain", "chain_of"]

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Chain:
    """A fitted model in three parts.

    Attributes
    ----------
    space : Pipeline
        From recordings to columns with a meaning: filters and one feature space.
    after : tuple of transformers
        From columns to what the classifier sees; each an affine map.
    classifier : ECOCClassifier or BestClassifier
        With linear learners.
    blocks : tuple of FeatureBlock
        What the columns stand for.
    bands : BandColumns or None
        What the columns stand for in the multi-band space; `blocks` then hold only those read along one coordinate.
    """

    space: Pipeline
    after: tuple[Any, ...]
    classifier: ECOCClassifier | BestClassifier
    blocks: tuple[FeatureBlock, ...]
    bands: BandColumns | None = None

    def columns_and_scores(
        self, recordings: npt.NDArray[Any], factors: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Columns (n, D) of recordings (n, T, C), and weighted sums (n,) of the learners' scores."""
        columns = features = self.space.transform(recordings)
        for step in self.after:  # not as arrays: a step fitted on a data frame wants its names again
            features = step.transform(features)
        weights, offset = factors @ self.classifier.coef_, factors @ self.classifier.intercept_
        scores: FloatArray = np.asarray(features, dtype=np.float64) @ weights + offset
        return np.asarray(columns, dtype=np.float64), scores

    def weights_of(self, factors: FloatArray) -> FloatArray:
        """Weight (D,) of each column in the weighted sum of the learners' scores."""
        weights, _ = folded_back(self.after, factors @ self.classifier.coef_)
        return weights


def chain_of(model: Any) -> Chain:
    """Take a fitted model apart.

    Raises
    ------
    TypeError
        Not a pipeline that ends in an `ECOCClassifier` with linear learners or a `BestClassifier`, or a step
        that mixes columns in a way that cannot be followed back.
    NotFittedError
        Not fitted.
    """
    if not isinstance(model, Pipeline):
        raise TypeError(
            "model must be a Pipeline of a feature space and an ECOCClassifier, "
            f"for instance make_pipeline(RawHFMH(), ECOCClassifier()), got {type(model).__name__}"
        )
    steps = real_steps(model)
    classifier = steps.pop() if steps else None
    if not isinstance(classifier, (ECOCClassifier, BestClassifier)):
        raise TypeError(
            f"model must end in an ECOCClassifier or a BestClassifier, got {type(classifier).__name__}"
        )
    check_is_fitted(classifier, "classes_")
    if getattr(classifier, "coef_", None) is None:
        raise TypeError(
            "model must have linear learners, whose score is a sum over features, trained by fit: "
            f"{classifier} has no coef_"
        )
    n_before = 0
    while n_before < len(steps) and isinstance(steps[n_before], RecordingFilter):
        n_before += 1
    space, after = steps[: n_before + 1], steps[n_before + 1 :]
    for step in after:
        if not is_linear_step(step):
            known = ", ".join(kind.__name__ for kind in LINEAR_STEPS)
            raise TypeError(
                f"model may have {known} between feature space and classifier, "
                f"got {type(step).__name__}, which cannot be followed back to instants and bins"
            )
    before = Pipeline(
        [(f"step{number}", step) for number, step in enumerate(space)] or [("none", "passthrough")]
    )
    bands = band_columns(before)
    if bands is not None:
        return Chain(before, tuple(after), classifier, bands.read_along(), bands)
    try:
        blocks = feature_blocks(before)
    except TypeError as reason:
        raise TypeError(f"model cannot be followed back to the recording: {reason}") from None
    return Chain(before, tuple(after), classifier, blocks)
