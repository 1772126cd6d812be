"""The compiled model that a fitted pipeline becomes, and the pipeline of a feature space."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.base import clone
from sklearn.pipeline import Pipeline
from sklearn.utils.validation import check_is_fitted

from granular_id import _core
from granular_id._checks import argument_error
from granular_id._estimators import real_steps, with_rate
from granular_id._memory import empty
from granular_id.ecoc import ECOCClassifier
from granular_id.features import FeatureSpec
from granular_id.identifier.model import SPACES
from granular_id.recording import unit_of
from granular_id.score import space_pipeline
from granular_id.spaces import (
    HFMH,
    BestClassifier,
    MultiBand,
    RawHFMH,
    RawSignal,
    axis_names,
    axis_units,
    feature_spaces,
    folded_back,
    is_linear_step,
)

FloatArray = npt.NDArray[np.float64]

OWN = "pipeline"
"""What the space of a pipeline of one's own is called."""

_AT_ONCE = 1024


def pipeline_of(space: Any, rate_hz: float, threads: int | None) -> tuple[str, Pipeline]:
    """Return the name of a feature space, and it with its classifier, not fitted, for recordings of a rate."""
    if isinstance(space, Pipeline):
        _steps(space, "space")
        return OWN, with_rate(clone(space), rate_hz)
    if space not in SPACES:
        raise argument_error(
            ValueError,
            "space",
            f"must be one of {', '.join(map(repr, SPACES))} or a pipeline, got {space!r:.60}: an identifier computes "
            "its features while samples arrive",
        )
    known = feature_spaces(rate_hz=rate_hz, threads=threads)[space]
    classifier = ECOCClassifier() if known.classifier is None else known.classifier
    return space, space_pipeline(known.transformer, classifier)


def model_of(
    pipeline: Any,
    rate_hz: float | None = None,
    *,
    axes: Sequence[str] | None = None,
    units: Sequence[str] | None = None,
    lead_s: float | None = None,
    samples: FloatArray | None = None,
    early: FloatArray | None = None,
    novelty: tuple[npt.ArrayLike, npt.ArrayLike, npt.ArrayLike] | None = None,
    trained: Mapping[str, Any] | None = None,
    training_sha256: str = "",
) -> _core.Model:
    """Build a model of a fitted pipeline: weights of blocks, scaling and whitening end in those of the learners.

    Parameters and errors are those of `granular_id.Identifier.from_classifier`; the last four are kept as they are.
    """
    space, between, classifier = _steps(pipeline)
    check_is_fitted(space)
    check_is_fitted(classifier, "coef_")
    known = getattr(space, "rate_hz_", None)
    if rate_hz is not None and known is not None and known != rate_hz:
        problem = f"={rate_hz:g}, but the feature space was made for {known:g} Hz"
        raise argument_error(ValueError, "rate_hz", problem)
    rate_hz = known if rate_hz is None else rate_hz
    if rate_hz is None:
        problem = "must be stated: the feature space does not know the rate of the recordings"
        raise argument_error(ValueError, "rate_hz", problem)
    shape = int(space.n_features_in_), int(space.n_axes_in_)
    if samples is not None and samples.shape[1:] != shape:
        raise ValueError(f"samples must have shape (n, {shape[0]}, {shape[1]}), got {samples.shape}")
    if axes is None and space.axes_in_ is not None:
        axes, units = space.axes_in_, units or space.units_in_
    if units is None:
        units = axis_units(shape[1]) if axes is None else [unit_of(axis) for axis in axes]
    arrays: dict[str, Any] = {}
    with np.errstate(over="ignore"):  # the model refuses what is not finite
        coef, intercept = folded_back(between, classifier.coef_, classifier.intercept_)
        spec, coef = _on_plain_features(space, coef, rate_hz)
        if samples is not None and isinstance(spec, FeatureSpec) and spec.raw:
            arrays["raw_mean"] = samples.mean(axis=0).T.ravel()
    return _core.Model(
        spec,
        coef,
        np.array(intercept, dtype=np.float64),
        classifier.coding_matrix_,
        _texts(classifier.classes_),
        loss=classifier.loss,
        n_samples=shape[0],
        n_axes=shape[1],
        early=early,
        novelty=novelty,
        metadata={
            "axes": json.dumps(list(axis_names(shape[1]) if axes is None else axes)),
            "units": json.dumps(list(units)),
            "training_sha256": training_sha256,
            "lead_s": "" if lead_s is None else repr(lead_s),
            "trained": json.dumps(trained or {}, ensure_ascii=False, sort_keys=True, allow_nan=False),
        },
        **arrays,
    )


def _steps(pipeline: Any, name: str = "pipeline") -> tuple[Any, list[Any], ECOCClassifier | BestClassifier]:
    steps = real_steps(pipeline) if isinstance(pipeline, Pipeline) else [pipeline]
    kinds = ", ".join(type(step).__name__ for step in steps)
    problem = (
        "must be a pipeline of RawSignal, HFMH, RawHFMH or MultiBand, steps that scale or whiten, "
        f"and ECOCClassifier or BestClassifier, got {kinds}"
    )
    if len(steps) < 2 or type(steps[0]) not in (RawSignal, HFMH, RawHFMH, MultiBand):
        raise argument_error(TypeError, name, problem)
    space, *between, classifier = steps
    if not (isinstance(classifier, (ECOCClassifier, BestClassifier)) and all(map(is_linear_step, between))):
        raise argument_error(TypeError, name, problem)
    return space, between, classifier


def _texts(classes: npt.NDArray[Any]) -> list[str]:
    labels = classes.tolist()
    wrong = next((label for label in labels if not isinstance(label, str)), None)
    if wrong is not None:
        raise ValueError(f"classes must be texts, got {wrong!r}: fit on labels of type str")
    return list(labels)


def _on_plain_features(
    space: Any, coef: FloatArray, rate_hz: float
) -> tuple[FeatureSpec | _core.MultiBandExtractor, FloatArray]:
    """Return what `_core` extracts, and the weights of that, from those of a feature space's columns."""
    if isinstance(space, MultiBand):
        return _without_unused_blocks(space.extractor_, coef)
    if isinstance(space, RawHFMH):
        n_raw = space.n_features_in_ * space.n_axes_in_
        weights = np.repeat(space.block_weights_, [n_raw, coef.shape[1] - n_raw])
        return space.spec_, coef * weights
    if isinstance(space, HFMH):
        return space.spec_, coef
    # The filter is never used: a cut-off that fits any rate.
    return FeatureSpec(rate_hz=rate_hz, cutoff_hz=min(23.0, rate_hz / 4), raw=True, hfmh=False), coef


def features_of(core: _core.Model, X: FloatArray, threads: int | None = None) -> FloatArray:
    """Extract what the weights of a model are for, (n, D), from recordings (n, T, C)."""
    spec = core.spec
    features = empty((len(X), core.n_features), "features of the recordings")
    for start in range(0, len(X), _AT_ONCE):
        rows = slice(start, start + _AT_ONCE)
        if isinstance(spec, FeatureSpec):
            features[rows] = _core.extract_features(X[rows], spec, threads, None, np.float64)
        else:
            features[rows] = spec.extract(X[rows], threads)
    return features


def plain_features(
    space: Any, features: FloatArray, spec: FeatureSpec | _core.MultiBandExtractor
) -> FloatArray | None:
    """Return what the weights of a model are for, of the features of its training; None where these are weighted."""
    if isinstance(space, RawHFMH):
        return features if (space.block_weights_ == 1).all() else None
    if isinstance(spec, FeatureSpec):
        return features
    sizes = space.extractor_.block_sizes
    present = spec.block_sizes  # without those that recordings are too short for
    if sizes == present:
        return features
    parts = dict(zip(sizes, np.split(features, np.cumsum(list(sizes.values()))[:-1], axis=1), strict=True))
    return np.concatenate([parts[name] for name in present], axis=1)


def _without_unused_blocks(
    spec: _core.MultiBandExtractor, coef: FloatArray
) -> tuple[_core.MultiBandExtractor, FloatArray]:
    """Leave blocks out of which all weights are 0: no score changes, and nobody computes them."""
    ends = np.cumsum(list(spec.block_sizes.values()))
    parts = dict(zip(spec.block_sizes, np.split(coef, ends[:-1], axis=1), strict=True))
    used = [name for name, part in parts.items() if part.any()]
    if not used or len(used) == len(parts):
        return spec, coef
    smaller = _core.MultiBandExtractor(
        spec.n_samples,
        spec.n_axes,
        rate_hz=spec.rate_hz,
        blocks=used,
        scales=spec.scales,
        level_scales=spec.level_scales,
    )
    return smaller, np.concatenate([parts[name] for name in used], axis=1)
