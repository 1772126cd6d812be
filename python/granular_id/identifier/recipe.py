"""How an identifier is made: the settings of features and classifier, and the scikit-learn pipeline they stand for."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from sklearn.pipeline import Pipeline
from sklearn.utils.validation import check_is_fitted

from granular_id import _core
from granular_id._checks import named
from granular_id._estimators import describe_estimator, real_steps
from granular_id._text import counted, verb
from granular_id.ecoc import CODINGS, DECODINGS, POSTERIORS, ECOCClassifier, Posterior, design, fitting_loss
from granular_id.features import FeatureSpec
from granular_id.identifier.metadata import axes_of, begins_at_first, lead_of
from granular_id.recording import Dataset, Difference, Setup, other_units, other_values, settled, setups_in
from granular_id.spaces import (
    ALL_BLOCKS,
    BAND_LOSS,
    DECODING,
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
    folded_back,
    is_linear_step,
)

GROWING = ("raw", "hfmh", "raw+hfmh")
"""Feature spaces of which scores grow with each sample: a linear score of samples and counts, nothing else."""

BANDED = ("best", "multiband")
"""Those of multi-band features, most of the work on which waits until an answer is asked for."""

SPACES = (*BANDED, *GROWING)
"""Those of `granular_id.spaces.feature_spaces` that can be computed while samples arrive."""

_OF_HISTOGRAMS = ("cutoff_hz", "order", "n_bins", "bin_range", "outside", "density", "initial")
_CHOSEN_BY_BEST = ("C", "coding", "loss", "decoding", "shrinkage")


@dataclass(frozen=True)
class Recipe:
    """Settings of features and classifier; but for the space, the defaults are the paper's.

    Parameters
    ----------
    space : {"best", "multiband", "raw+hfmh", "hfmh", "raw"}
        Feature space, those of `granular_id.spaces.feature_spaces`. ``"best"`` takes the features of
        `granular_id.MultiBand` and chooses blocks, whitening and `C` by holding recordings of the training out, see
        `granular_id.BestClassifier`: the most accurate on recordings of other sessions. ``"multiband"`` gives
        each of their usual blocks the same weight. The other three, the paper's, grow with each sample.
    cutoff_hz, order, n_bins, bin_range, outside, density, initial
        As in `granular_id.HFMH`; without effect on ``"raw"``, refused with multi-band features.
    block_weights : None, "unit" or two numbers
        Of ``"raw+hfmh"``, as in `granular_id.RawHFMH`; they end in the weights of the model.
    shrinkage : float, optional
        Of `granular_id.spaces.WithinClassWhitening` between multi-band features and classifier. None: no whitening.
    C, coding, loss, decoding, posterior
        As in `granular_id.ECOCClassifier`, but that the loss ``"auto"`` is ``"root"`` with multi-band features, as in
        `granular_id.spaces.feature_spaces`; ``"best"`` chooses all but `posterior` itself.
    random_state : int
        Draws random codings and the folds of `posterior`.

    Raises
    ------
    ValueError
        An unknown space, coding, loss, decoding or posterior (the message names those that work), or a setting that
        is not for the space.

    Examples
    --------
    >>> from granular_id.identifier.recipe import Recipe
    >>> [name for name, _ in Recipe(space="hfmh").pipeline(500.0).steps]
    ['features', 'classifier']
    """

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
    decoding: str = "loss_weighted"
    posterior: str | None = None
    random_state: int = 0

    def __post_init__(self) -> None:
        if self.space not in SPACES:
            raise ValueError(
                f"space must be one of {', '.join(map(repr, SPACES))}, got {self.space!r}: an identifier computes its "
                "features while samples arrive"
            )
        unused = _CHOSEN_BY_BEST if self.space == "best" else () if self.space in BANDED else ("shrinkage",)
        if self.space in BANDED:
            unused = (*_OF_HISTOGRAMS, *unused)
        given = [name for name in unused if not _same(getattr(self, name), _default(name))]
        if given:
            why = "has no use for it"
            if self.space == "best" and given[0] in _CHOSEN_BY_BEST:
                why = "always has a learner for each pair" if given[0] == "coding" else "chooses it itself"
            raise ValueError(
                f"{given[0]} must be left out with space={self.space!r}, which {why}; other spaces are "
                f"{', '.join(repr(space) for space in SPACES if space != self.space)}"
            )
        if self.block_weights is not None and self.space != "raw+hfmh":
            blocks = "always weighs its blocks alike" if self.space in BANDED else "has one block"
            raise ValueError(
                f"block_weights weigh the two blocks of 'raw+hfmh', and space={self.space!r} {blocks}: leave them out"
            )

        # The classifier looks at these names when it is fitted; recordings need not be read for that.
        if isinstance(self.coding, str):
            named(CODINGS, "coding", self.coding)
        fitting_loss(self.loss, "real")
        named(DECODINGS, "decoding", self.decoding)
        if self.posterior is not None:
            named(POSTERIORS, "posterior", self.posterior)

    def features(self, rate_hz: float) -> Any:
        """Return the feature space, not fitted, for recordings of a rate."""
        if self.space == "raw":
            return RawSignal(rate_hz=rate_hz)
        blocks = blocks_of(self.space)
        if blocks is not None:
            return MultiBand(rate_hz=rate_hz, blocks=blocks)
        options: dict[str, Any] = {name: getattr(self, name) for name in _OF_HISTOGRAMS}
        if self.space == "hfmh":
            return HFMH(rate_hz=rate_hz, **options)
        return RawHFMH(rate_hz=rate_hz, block_weights=self.block_weights, **options)

    def classifier(self, *, posterior: bool = True) -> ECOCClassifier | BestClassifier:
        """Return the classifier, not fitted; without `posterior` even where the settings ask for one."""
        if self.space == "best":
            return BestClassifier(optional_blocks=("level",), random_state=self.random_state)
        return ECOCClassifier(
            C=self.C,
            coding=self.coding,
            loss=BAND_LOSS if self.loss == "auto" and self.space in BANDED else self.loss,
            decoding=self.decoding,
            posterior=self.posterior if posterior else None,
            random_state=self.random_state,
        )

    def pipeline(self, rate_hz: float, *, posterior: bool = True, threads: int | None = None) -> Pipeline:
        """Return feature space, scaling and classifier as one pipeline, not fitted; no number depends on `threads`.

        A step with a parameter ``blocks`` wants the columns of each block there, once the features know them:
        `granular_id.identifier.training.fit_pipeline` sees to it.
        """
        steps: list[tuple[str, Any]] = [("features", self.features(rate_hz).set_params(threads=threads))]
        if self.space in BANDED and self.space != "best":
            steps.append(("scaling", BlockScaler()))
            if self.shrinkage is not None:
                steps.append(("whitening", WithinClassWhitening(self.shrinkage)))
        return Pipeline([*steps, ("classifier", self.classifier(posterior=posterior))])

    def n_learners(self, n_classes: int) -> int:
        """Count the binary learners that `coding` makes of so many classes."""
        return int(design(self.coding, n_classes, np.random.default_rng(0)).shape[1])

    def n_features(self, n_samples: int, n_axes: int) -> tuple[int, int]:
        """Count raw samples among the features, and all features, of recordings of a size."""
        blocks = blocks_of(self.space)
        if blocks is not None:
            return 0, _core.MultiBandExtractor(n_samples, n_axes, blocks=blocks).n_features
        n_raw = n_samples * n_axes if "raw" in self.space else 0
        return n_raw, n_raw + (self.n_bins * n_axes if "hfmh" in self.space else 0)

    def to_dict(self, rate_hz: float) -> dict[str, Any]:
        """Return all settings, for recordings of a rate, in types that JSON knows."""
        features = describe_estimator(self.features(rate_hz))
        classifier = describe_estimator(self.classifier())
        settings = {
            "space": self.space,
            "features": {name: value for name, value in features.items() if name != "threads"},
            "classifier": {name: value for name, value in classifier.items() if name != "n_jobs"},
        }
        return settings if self.shrinkage is None else settings | {"whitening": {"shrinkage": self.shrinkage}}


def _default(name: str) -> Any:
    return next(field.default for field in fields(Recipe) if field.name == name)


def _same(value: Any, default: Any) -> bool:
    return bool(np.array_equal(np.asarray(value, dtype=object), np.asarray(default, dtype=object)))


# From a fitted pipeline to the parts of a model: what is extracted, weights, codes, sigmoids.

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
        `RawSignal`, `HFMH`, `RawHFMH` or `MultiBand`, then any of `granular_id.spaces.scaling.LINEAR_STEPS` (scaling,
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


# Recordings as a model takes them: its axes, its rate, its length, with its rest before the motion.

Begin = Literal["auto", "first", "trigger"]

_AS_TRAINED = "begins at the first sample, as in the training"


def refuse_others(data: Dataset, core: _core.Model, accept: str | Sequence[str] = ()) -> tuple[str, ...]:
    """Refuse recordings of other axes, another rate or another set-up than a model was trained on.

    Parameters
    ----------
    data : Dataset
    core : granular_id._core.Model
    accept : str or sequence of str
        What of the set-up may differ though it is refused otherwise, see `Setup`.

    Returns
    -------
    tuple of str
        What else is not as in the training, by name, each once.

    Raises
    ------
    ValueError
        Naming the first such recording, and the step that helps.
    """
    axes, rate_hz = axes_of(core), core.rate_hz
    for recording in data:
        if recording.axes != axes:
            help_ = f": call .select(axes={list(axes)})" if set(recording.axes) >= set(axes) else ""
            raise ValueError(
                f"recording {recording.name!r} has the axes {' '.join(recording.axes)}; the model was trained on "
                f"{' '.join(axes)}{help_}"
            )
        if recording.rate_hz != rate_hz:
            came = "is sampled irregularly" if recording.rate_hz is None else f"has {recording.rate_hz:g} Hz"
            raise ValueError(
                f"recording {recording.name!r} {came}, the model was trained at {rate_hz:g} Hz; nothing is resampled "
                f"unasked: call .resample({rate_hz:g})"
            )
    compared = comparison(core)
    told: dict[str, None] = {}
    for recording, setup in zip(data, setups_in(data), strict=True):
        found = settled(compared(setup, recording.meta), accept, f"recording {recording.name!r} has ")
        told.update(dict.fromkeys(found))
    return tuple(told)


def comparison(core: _core.Model) -> Callable[[Setup, Mapping[str, Any]], list[Difference]]:
    """Return what compares a set-up, and units in metadata, with those that a model was trained with."""
    trained = json.loads(core.metadata["trained"]).get("setup", {})
    units = dict(zip(axes_of(core), json.loads(core.metadata["units"]), strict=True))
    return lambda setup, meta: [*other_units(units, meta), *other_values(trained, setup)]


def fitted(
    data: Dataset,
    core: _core.Model,
    *,
    begin_at: Begin = "auto",
    lead_s: float | None = None,
    on_short: Literal["raise", "skip"] = "raise",
) -> Dataset:
    """Crop recordings to the length of a model.

    Parameters
    ----------
    data : Dataset
        Of the rate and axes of the model, see `refuse_others`.
    core : granular_id._core.Model
    begin_at : {"auto", "first", "trigger"}, default "auto"
        Where to begin: at the first sample; at the trigger, less the lead; or, automatically, at the first sample
        of recordings that have the length already, and of longer ones as in the training: at the trigger where all
        had the same lead, else at the first sample where that is how they were cropped.
    lead_s : float, optional
        Seconds kept ahead of the trigger. Default: as in the recordings of the training, where all had the same.
    on_short : {"raise", "skip"}
        What to do with a recording that is too short, or longer and without trigger: refuse, or leave it out.

    Returns
    -------
    Dataset
        The same one where every recording has the length already; else ``history[-1]`` says what was cropped.

    Raises
    ------
    ValueError
        A recording is too short, has no trigger or too little rest before it; or `lead_s` is neither stated nor known.
    """
    n, rate_hz = core.n_samples, core.rate_hz
    lengths = [recording.n_samples for recording in data]
    if begin_at == "auto" and set(lengths) == {n}:
        return data
    short = [recording for recording in data if recording.n_samples < n]
    if short and on_short == "raise":
        raise ValueError(
            f"recording {short[0].name!r} has {short[0].n_samples} samples ({short[0].n_samples / rate_hz:g} s), the "
            f"model takes {n} ({n / rate_hz:g} s); {len(short)} of {counted(len(data))} "
            f"{verb(len(short), 'is', 'are')} shorter: pass "
            "on_short='skip' to leave such recordings out"
        )
    if begin_at == "first" or (begin_at == "auto" and max(lengths) <= n):
        return data.align(n, on_short=on_short)
    if begin_at == "auto" and lead_s is None and begins_at_first(core):
        *before, step = (cropped := data.align(n, on_short=on_short)).history
        return Dataset(cropped.recordings, [*before, replace(step, notes=[_AS_TRAINED])])
    lead = lead_of(core) if lead_s is None else lead_s
    if lead is None:
        longer = next((r for r in data if r.n_samples > n), data[0])
        raise ValueError(
            f"recording {longer.name!r} has {longer.n_samples} samples, the model takes {n}, and does not know how "
            "much rest comes before the motion: state lead_s, or pass begin_at='first'"
        )
    marked = data
    if begin_at == "auto":
        start = round(lead * rate_hz)
        recordings = [replace(r, trigger_index=start) if r.n_samples <= n else r for r in data]
        marked = Dataset(recordings, data.history)
    return marked.align(n, trigger="recorded", lead_s=lead, on_short=on_short, on_missing=on_short)


# Multi-band features in a model: which blocks there are.


def blocks_of(space: str) -> tuple[str, ...] | None:
    """Return the blocks that a feature space of `Recipe` computes; None where it has no bands."""
    return {"multiband": USUAL_BLOCKS, "best": ALL_BLOCKS}.get(space)


def without_silent_blocks(
    spec: _core.MultiBandExtractor, coef: FloatArray
) -> tuple[_core.MultiBandExtractor, FloatArray]:
    """Leave blocks out of which all weights are 0: no score changes, and nobody computes them.

    Parameters
    ----------
    spec : granular_id._core.MultiBandExtractor
    coef : ndarray, shape (L, D)
    """
    ends = np.cumsum(list(spec.block_sizes.values()))
    parts = dict(zip(spec.block_sizes, np.split(coef, ends[:-1], axis=1), strict=True))
    heard = [name for name, part in parts.items() if part.any()]
    if not heard or len(heard) == len(parts):
        return spec, coef
    kept = _core.MultiBandExtractor(
        spec.n_samples,
        spec.n_axes,
        rate_hz=spec.rate_hz,
        blocks=heard,
        scales=spec.scales,
        level_scales=spec.level_scales,
    )
    return kept, np.concatenate([parts[name] for name in heard], axis=1)
