"""From a fitted pipeline to the parts of a model: what is extracted, weights, codes, sigmoids."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.pipeline import Pipeline
from sklearn.utils.validation import check_is_fitted

from granular_id.ecoc import ECOCClassifier
from granular_id.ecoc.losses import fitting_loss
from granular_id.ecoc.posterior import Posterior
from granular_id.features import FeatureSpec
from granular_id.identifier.recipe import SPACES
from granular_id.spaces import HFMH, RawHFMH, RawSignal
from granular_id.spaces.base import real_steps

__all__ = ["Parts", "parts_of", "raw_spec"]

FloatArray = npt.NDArray[np.float64]

_LOWEST_CUTOFF = 0.25


@dataclass(frozen=True, eq=False)
class Parts:
    """What decides about labels.

    Attributes
    ----------
    spec : FeatureSpec
        What is extracted, with the rate of the recordings.
    n_samples, n_axes : int
        Shape of a recording.
    coef, intercept : ndarray, shapes (L, D) and (L,)
        Learners on the plain features of `spec`; weights of blocks are folded in.
    coding_matrix : ndarray of int8, shape (K, L)
    classes : tuple of str
    loss, decoding : str
    posterior : Posterior or None
        Fitted sigmoids and how they are coupled.
    """

    spec: FeatureSpec
    n_samples: int
    n_axes: int
    coef: FloatArray
    intercept: FloatArray
    coding_matrix: npt.NDArray[np.int8]
    classes: tuple[str, ...]
    loss: str
    decoding: str
    posterior: Posterior | None


def parts_of(pipeline: Any, rate_hz: float | None = None) -> Parts:
    """Take a fitted pipeline apart.

    Parameters
    ----------
    pipeline : Pipeline
        `RawSignal`, `HFMH` or `RawHFMH`, then an `ECOCClassifier` of linear learners; fitted on recordings
        (n, T, C).
    rate_hz : float, optional
        Rate of the recordings, where the feature space does not know it (`RawSignal` need not).

    Raises
    ------
    TypeError
        Another kind of pipeline, or learners that are not linear.
    ValueError
        Not fitted, no rate or another rate than that of the filter, or labels that are no text.
    """
    space, classifier = _steps(pipeline)
    check_is_fitted(space)
    known = getattr(space, "rate_hz", None)
    if rate_hz is not None and known is not None and known != rate_hz:
        raise ValueError(f"rate_hz={rate_hz:g}, but the feature space was made for {known:g} Hz")
    rate = known if rate_hz is None else rate_hz
    if rate is None:
        raise ValueError("rate_hz must be stated: the feature space does not know the rate of the recordings")
    n_samples, n_axes = int(space.n_features_in_), int(space.n_axes_in_)
    weights = np.ones(classifier.coef_.shape[1])
    if isinstance(space, RawHFMH):
        n_raw = n_samples * n_axes
        weights[:n_raw], weights[n_raw:] = space.block_weights_
    with np.errstate(over="ignore"):  # the model refuses what is not finite
        coef = classifier.coef_ * weights
    return Parts(
        spec=space.spec_ if isinstance(space, HFMH) else raw_spec(rate),
        n_samples=n_samples,
        n_axes=n_axes,
        coef=coef,
        intercept=np.array(classifier.intercept_, dtype=np.float64),
        coding_matrix=classifier.coding_matrix_,
        classes=_texts(classifier.classes_),
        loss=fitting_loss(classifier.loss, "real").name,
        decoding=str(classifier.decoding),
        posterior=getattr(classifier, "_posterior", None),
    )


def raw_spec(rate_hz: float) -> FeatureSpec:
    """Return the specification of raw samples alone; its filter is never used, and fits any rate."""
    cutoff_hz = min(23.0, _LOWEST_CUTOFF * rate_hz)
    return FeatureSpec(rate_hz=rate_hz, cutoff_hz=cutoff_hz, raw=True, hfmh=False)


def _steps(pipeline: Any) -> tuple[RawSignal | HFMH, ECOCClassifier]:
    steps = real_steps(pipeline) if isinstance(pipeline, Pipeline) else [pipeline]
    kinds = ", ".join(type(step).__name__ for step in steps)
    wanted = (
        "classifier must be a fitted pipeline of RawSignal, HFMH or RawHFMH "
        f"({', '.join(SPACES)}) and ECOCClassifier"
    )
    if len(steps) != 2 or type(steps[0]) not in (RawSignal, HFMH, RawHFMH):
        raise TypeError(f"{wanted}, got {kinds}")
    if not isinstance(steps[1], ECOCClassifier):
        raise TypeError(f"{wanted}, got {kinds}")
    check_is_fitted(steps[1], ["dual_coef_", "_estimators"], all_or_any=any)
    if not hasattr(steps[1], "coef_"):
        raise TypeError(f"{wanted} of linear learners; these have no coef_")
    return steps[0], steps[1]


def _texts(classes: npt.NDArray[Any]) -> tuple[str, ...]:
    labels = classes.tolist()
    wrong = next((label for label in labels if not isinstance(label, str)), None)
    if wrong is not None:
        raise ValueError(f"classes must be texts, got {wrong!r}: fit on labels of type str")
    return tuple(labels)
