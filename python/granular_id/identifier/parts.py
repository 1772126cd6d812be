"""From a fitted pipeline to the parts of a model: what is extracted, weights, codes, sigmoids."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.pipeline import Pipeline
from sklearn.utils.validation import check_is_fitted

from granular_id import _core
from granular_id.best import BestClassifier
from granular_id.best.classifier import DECODING
from granular_id.ecoc import ECOCClassifier
from granular_id.ecoc.losses import fitting_loss
from granular_id.ecoc.posterior import Posterior
from granular_id.features import FeatureSpec
from granular_id.identifier.banded import without_silent_blocks
from granular_id.spaces import HFMH, RawHFMH, RawSignal
from granular_id.spaces.base import real_steps
from granular_id.spaces.folding import folded_back, is_linear_step
from granular_id.spaces.multiband import MultiBand

__all__ = ["Parts", "parts_of", "raw_spec"]

FloatArray = npt.NDArray[np.float64]

_LOWEST_CUTOFF = 0.25


@dataclass(frozen=True, eq=False)
class Parts:
    """What decides about labels.

    Attributes
    ----------
    spec : FeatureSpec or granular_id._core.MultiBandExtractor
        What is extracted, with the rate of the recordings.
    n_samples, n_axes : int
        Shape of a recording.
    coef, intercept : ndarray, shapes (L, D) and (L,)
        Learners on the plain features of `spec`; weights of blocks, scaling and whitening are folded in.
    coding_matrix : ndarray of int8, shape (K, L)
    classes : tuple of str
    loss, decoding : str
    posterior : Posterior or None
        Fitted sigmoids and how they are coupled.
    """

    spec: FeatureSpec | _core.MultiBandExtractor
    n_samples: int
    n_axes: int
    coef: FloatArray
    intercept: FloatArray
    coding_matrix: npt.NDArray[np.int8]
    classes: tuple[str, ...]
    loss: str
    decoding: str
    posterior: Posterior | None

    @property
    def takes_samples(self) -> bool:
        """Whether raw samples are among the features."""
        return isinstance(self.spec, FeatureSpec) and self.spec.raw


def parts_of(pipeline: Any, rate_hz: float | None = None) -> Parts:
    """Take a fitted pipeline apart.

    Parameters
    ----------
    pipeline : Pipeline
        `RawSignal`, `HFMH`, `RawHFMH` or `MultiBand`, then any of `granular_id.spaces.folding.LINEAR_STEPS` (scaling,
        whitening, components), then an `ECOCClassifier` of linear learners or a `BestClassifier`; fitted on
        recordings (n, T, C).
    rate_hz : float, optional
        Rate of the recordings, where the feature space does not know it (`RawSignal` need not).

    Raises
    ------
    TypeError
        Another kind of pipeline, or learners that are not linear.
    ValueError
        Not fitted, no rate or another rate than that of the filter, or labels that are no text.
    """
    space, between, classifier = _steps(pipeline)
    check_is_fitted(space)
    known = getattr(space, "rate_hz", None)
    if rate_hz is not None and known is not None and known != rate_hz:
        raise ValueError(f"rate_hz={rate_hz:g}, but the feature space was made for {known:g} Hz")
    rate = known if rate_hz is None else rate_hz
    if rate is None:
        raise ValueError("rate_hz must be stated: the feature space does not know the rate of the recordings")
    n_samples, n_axes = int(space.n_features_in_), int(space.n_axes_in_)
    with np.errstate(over="ignore"):  # the model refuses what is not finite
        coef, intercept = folded_back(between, classifier.coef_, classifier.intercept_)
        spec, coef = _on_plain_features(space, coef, rate)
    return Parts(
        spec=spec,
        n_samples=n_samples,
        n_axes=n_axes,
        coef=coef,
        intercept=np.array(intercept, dtype=np.float64),
        coding_matrix=classifier.coding_matrix_,
        classes=_texts(classifier.classes_),
        loss=fitting_loss(classifier.loss, "real").name,
        decoding=DECODING if isinstance(classifier, BestClassifier) else str(classifier.decoding),
        posterior=getattr(classifier, "_posterior", None),
    )


def raw_spec(rate_hz: float) -> FeatureSpec:
    """Return the specification of raw samples alone; its filter is never used, and fits any rate."""
    cutoff_hz = min(23.0, _LOWEST_CUTOFF * rate_hz)
    return FeatureSpec(rate_hz=rate_hz, cutoff_hz=cutoff_hz, raw=True, hfmh=False)


def _on_plain_features(
    space: Any, coef: FloatArray, rate_hz: float
) -> tuple[FeatureSpec | _core.MultiBandExtractor, FloatArray]:
    """Weights of what `_core` computes, from those of a feature space's columns."""
    if isinstance(space, MultiBand):
        return without_silent_blocks(space.extractor_, coef)
    if isinstance(space, RawHFMH):
        n_raw = space.n_features_in_ * space.n_axes_in_
        weights = np.repeat(space.block_weights_, [n_raw, coef.shape[1] - n_raw])
        return space.spec_, coef * weights
    return space.spec_ if isinstance(space, HFMH) else raw_spec(rate_hz), coef


def _steps(pipeline: Any) -> tuple[Any, list[Any], ECOCClassifier | BestClassifier]:
    steps = real_steps(pipeline) if isinstance(pipeline, Pipeline) else [pipeline]
    kinds = ", ".join(type(step).__name__ for step in steps)
    wanted = (
        "classifier must be a fitted pipeline of RawSignal, HFMH, RawHFMH or MultiBand, steps that scale or whiten, "
        "and ECOCClassifier or BestClassifier"
    )
    if len(steps) < 2 or type(steps[0]) not in (RawSignal, HFMH, RawHFMH, MultiBand):
        raise TypeError(f"{wanted}, got {kinds}")
    space, *between, classifier = steps
    if not (isinstance(classifier, (ECOCClassifier, BestClassifier)) and all(map(is_linear_step, between))):
        raise TypeError(f"{wanted}, got {kinds}")
    check_is_fitted(classifier, ["dual_coef_", "_estimators", "coef_"], all_or_any=any)
    if not hasattr(classifier, "coef_"):
        raise TypeError(f"{wanted} of linear learners; these have no coef_")
    return space, between, classifier


def _texts(classes: npt.NDArray[Any]) -> tuple[str, ...]:
    labels = classes.tolist()
    wrong = next((label for label in labels if not isinstance(label, str)), None)
    if wrong is not None:
        raise ValueError(f"classes must be texts, got {wrong!r}: fit on labels of type str")
    return tuple(labels)
