"""Settings of features and classifier, the pipeline they stand for, and the model that a fitted pipeline becomes."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.pipeline import Pipeline
from sklearn.utils.validation import check_is_fitted

from granular_id import _core
from granular_id._checks import argument_error, named
from granular_id._estimators import describe_estimator, real_steps
from granular_id.ecoc import CODINGS, LOSSES, ECOCClassifier
from granular_id.features import FeatureSpec
from granular_id.identifier.metadata import BANDED, SPACES
from granular_id.recording import unit_of
from granular_id.spaces import (
    ALL_BLOCKS,
    BAND_LOSS,
    BAND_SHRINKAGE,
    DEFAULT_RANGE,
    HFMH,
    USUAL_BLOCKS,
    BestClassifier,
    BinRange,
    BlockScaler,
    BlockWeights,
    MultiBand,
    RawHFMH,
    RawSignal,
    WithinClassWhitening,
    axis_names,
    axis_units,
    folded_back,
    is_linear_step,
)

FloatArray = npt.NDArray[np.float64]

_OF_HISTOGRAMS = ("cutoff_hz", "order", "n_bins", "bin_range", "outside", "density", "initial")
_CHOSEN_BY_BEST = ("C", "coding", "loss", "shrinkage")


@dataclass(frozen=True)
class Recipe:
    """Settings of features and classifier, as in `granular_id.Identifier.fit`; refuses what is not for the space."""

    space: str = "best"
    cutoff_hz: float = 23.0
    order: int = 8
    n_bins: int = 100
    bin_range: BinRange = DEFAULT_RANGE
    outside: str = "drop"
    density: bool = False
    initial: str = "zero"
    block_weights: BlockWeights = None
    shrinkage: float | None = None
    C: float = 1.0
    coding: str | npt.ArrayLike = "onevsone"
    loss: str = "auto"
    random_state: int = 0

    def __post_init__(self) -> None:
        if self.space not in SPACES:
            raise argument_error(
                ValueError,
                "space",
                f"must be one of {', '.join(map(repr, SPACES))}, got {self.space!r}: an identifier computes its "
                "features while samples arrive",
            )
        is_banded = self.space in BANDED
        unused = _CHOSEN_BY_BEST if self.space == "best" else () if is_banded else ("shrinkage",)
        if is_banded:
            unused = (*_OF_HISTOGRAMS, *unused)
        defaults = {field.name: field.default for field in fields(self)}
        given = [name for name in unused if not _same(getattr(self, name), defaults[name])]
        if given:
            why = "has no use for it"
            if self.space == "best" and given[0] in _CHOSEN_BY_BEST:
                why = "always has a learner for each pair" if given[0] == "coding" else "chooses it itself"
            raise ValueError(
                f"{given[0]} must be left out with space={self.space!r}, which {why}; other spaces are "
                f"{', '.join(repr(space) for space in SPACES if space != self.space)}"
            )
        if self.block_weights is not None and self.space != "raw+hfmh":
            blocks = "always weighs its blocks alike" if is_banded else "has one block"
            raise ValueError(
                f"block_weights weigh the two blocks of 'raw+hfmh', and space={self.space!r} {blocks}: leave them out"
            )
        # The classifier looks at these names when it is fitted; recordings need not be read for that.
        if isinstance(self.coding, str):
            named(CODINGS, "coding", self.coding)
        named({"auto": None, **LOSSES}, "loss", self.loss)

    @property
    def blocks(self) -> tuple[str, ...]:
        """Blocks of multi-band features."""
        return ALL_BLOCKS if self.space == "best" else USUAL_BLOCKS

    def features(self, rate_hz: float) -> Any:
        """Return the feature space, not fitted, for recordings of a rate."""
        if self.space in BANDED:
            return MultiBand(rate_hz=rate_hz, blocks=self.blocks)
        if self.space == "raw":
            return RawSignal(rate_hz=rate_hz)
        options: dict[str, Any] = {name: getattr(self, name) for name in _OF_HISTOGRAMS}
        if self.space == "hfmh":
            return HFMH(rate_hz=rate_hz, **options)
        return RawHFMH(rate_hz=rate_hz, block_weights=self.block_weights, **options)

    def classifier(self) -> ECOCClassifier | BestClassifier:
        """Return the classifier, not fitted."""
        if self.space == "best":
            return BestClassifier(optional_blocks=("level",), random_state=self.random_state)
        usual = BAND_LOSS if self.space in BANDED else "hinge"
        loss = usual if self.loss == "auto" else self.loss
        if self._is_preset:  # as `feature_spaces` has it: C is a share of the spread of the whitened rows
            return BestClassifier(
                shrinkages=(self._whitening["shrinkage"],),
                relative_costs=(self.C,),
                loss=loss,
                random_state=self.random_state,
            )
        return ECOCClassifier(C=self.C, coding=self.coding, loss=loss)

    def pipeline(self, rate_hz: float, *, threads: int | None = None) -> Pipeline:
        """Return feature space, scaling and classifier as one pipeline, which `fit_pipeline` fits."""
        steps: list[tuple[str, Any]] = [("features", self.features(rate_hz).set_params(threads=threads))]
        if self.space == "multiband" and not self._is_preset:
            steps.append(("scaling", BlockScaler()))
            steps.append(("whitening", WithinClassWhitening(**self._whitening)))
        return Pipeline([*steps, ("classifier", self.classifier())])

    def to_dict(self, rate_hz: float) -> dict[str, Any]:
        """Return all settings, for recordings of a rate, in types that JSON knows."""
        features = describe_estimator(self.features(rate_hz))
        classifier = describe_estimator(self.classifier())
        settings = {
            "space": self.space,
            "features": {name: value for name, value in features.items() if name != "threads"},
            "classifier": {name: value for name, value in classifier.items() if name != "n_jobs"},
        }
        whitened = self.space == "multiband" and not self._is_preset
        return settings | {"whitening": self._whitening} if whitened else settings

    @property
    def _is_preset(self) -> bool:
        return self.space == "multiband" and isinstance(self.coding, str) and self.coding == "onevsone"

    @property
    def _whitening(self) -> dict[str, float]:
        return {"shrinkage": BAND_SHRINKAGE if self.shrinkage is None else self.shrinkage}


def _same(value: Any, default: Any) -> bool:
    return bool(np.array_equal(np.asarray(value, dtype=object), np.asarray(default, dtype=object)))


def model_of(
    pipeline: Any,
    rate_hz: float | None = None,
    *,
    axes: Sequence[str] | None = None,
    units: Sequence[str] | None = None,
    lead_s: float | None = None,
    samples: FloatArray | None = None,
    early: FloatArray | None = None,
    trained: Mapping[str, Any] | None = None,
    training_sha256: str = "",
    coding: str = "",
) -> _core.Model:
    """Build a model of a fitted pipeline: weights of blocks, scaling and whitening end in those of the learners.

    Parameters and errors are those of `granular_id.Identifier.from_classifier`; the last four are kept as they are.
    """
    space, between, classifier = _steps(pipeline)
    check_is_fitted(space)
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
        metadata={
            "axes": json.dumps(list(axis_names(shape[1]) if axes is None else axes)),
            "units": json.dumps(list(units)),
            "coding": coding,
            "posterior": "",
            "training_sha256": training_sha256,
            "lead_s": "" if lead_s is None else repr(lead_s),
            "trained": json.dumps(trained or {}, ensure_ascii=False, sort_keys=True, allow_nan=False),
        },
        **arrays,
    )


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
    check_is_fitted(classifier, "coef_")
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
        return _without_silent_blocks(space.extractor_, coef)
    if isinstance(space, RawHFMH):
        n_raw = space.n_features_in_ * space.n_axes_in_
        weights = np.repeat(space.block_weights_, [n_raw, coef.shape[1] - n_raw])
        return space.spec_, coef * weights
    if isinstance(space, HFMH):
        return space.spec_, coef
    # The filter is never used: a cut-off that fits any rate.
    return FeatureSpec(rate_hz=rate_hz, cutoff_hz=min(23.0, rate_hz / 4), raw=True, hfmh=False), coef


def plain_features(
    space: Any, features: FloatArray, spec: FeatureSpec | _core.MultiBandExtractor
) -> FloatArray | None:
    """Return what the weights of a model are for, of the features of its training; None where these are weighted."""
    if isinstance(space, RawHFMH):
        return features if (space.block_weights_ == 1).all() else None
    if isinstance(spec, FeatureSpec):
        return features
    sizes = space.extractor_.block_sizes
    kept = spec.block_sizes  # without those that recordings are too short for
    if sizes == kept:
        return features
    parts = dict(zip(sizes, np.split(features, np.cumsum(list(sizes.values()))[:-1], axis=1), strict=True))
    return np.concatenate([parts[name] for name in kept], axis=1)


def _without_silent_blocks(
    spec: _core.MultiBandExtractor, coef: FloatArray
) -> tuple[_core.MultiBandExtractor, FloatArray]:
    """Leave blocks out of which all weights are 0: no score changes, and nobody computes them."""
    ends = np.cumsum(list(spec.block_sizes.values()))
    parts = dict(zip(spec.block_sizes, np.split(coef, ends[:-1], axis=1), strict=True))
    heard = [name for name, part in parts.items() if part.any()]
    if not heard or len(heard) == len(parts):
        return spec, coef
    smaller = _core.MultiBandExtractor(
        spec.n_samples,
        spec.n_axes,
        rate_hz=spec.rate_hz,
        blocks=heard,
        scales=spec.scales,
        level_scales=spec.level_scales,
    )
    return smaller, np.concatenate([parts[name] for name in heard], axis=1)
