"""What all feature spaces share: how recordings come in, how features are named, what their columns stand for."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator, OneToOneFeatureMixin, TransformerMixin
from sklearn.pipeline import FeatureUnion, Pipeline
from sklearn.utils import Tags
from sklearn.utils.validation import _check_feature_names_in, check_is_fitted, validate_data

from granular_id._checks import argument_error, positive_number
from granular_id._core import AXES, GranularIdError
from granular_id._estimators import real_steps
from granular_id.features import FeatureSpec, extract_features, feature_names
from granular_id.recording import (
    Dataset,
    Recording,
    column_names,
    common_units,
    refuse_tables,
    unit_differences,
)

FloatArray = npt.NDArray[np.float64]
Recordings = Dataset | Sequence[Recording] | npt.ArrayLike

_MOST_AXES = 12
"""Most axes that a sensor, or two, would have: two dimensions that end in as few may be samples and axes."""

PAPER_RATE_HZ = 500.0
"""What spaces that need a rate take where nobody states one: that of the paper's sensor."""


class Known(NamedTuple):
    """What recordings bring with them, as far as it is known."""

    axes: tuple[str, ...] | None = None
    units: tuple[str, ...] = ()
    rate_hz: float | None = None
    dataset: Dataset | None = None
    n_dims: int = 3


class RecordingTransformer(TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """Recordings (n, T, C) to one row of features each.

    A subclass fills in `_features` and `_names`; `_learn` where it has parameters to check or something to learn, and
    then `learns`; and `feature_blocks` where its columns are read along one coordinate.

    Attributes
    ----------
    n_features_in_, n_axes_in_ : int
        Samples T of a recording, and its axes C.
    axes_in_ : tuple of C str, or None
        Names of the axes; None where recordings had none: features then say axis0, axis1, ...
    units_in_ : tuple of C str
        Units of the axes; "" where not known.
    rate_hz_ : float or None
        Sampling rate in use, Hz: `rate_hz` or, without it, that of the `Dataset`, or the space's default.
    """

    n_features_in_: int
    n_axes_in_: int
    axes_in_: tuple[str, ...] | None
    units_in_: tuple[str, ...]
    rate_hz_: float | None

    _default_rate_hz: ClassVar[float | None] = None

    @property
    def learns(self) -> bool:
        """Whether `fit` takes anything from the data but their shape."""
        return False

    def fit(self, X: Recordings, y: object = None) -> Any:  # noqa: ARG002 - scikit-learn passes y
        """Check the parameters, remember the shape of a recording, and learn where there is something to learn.

        Parameters
        ----------
        X : Dataset, or array-like of shape (n, T, C) or (n, T)
            Recordings: n of T samples on C axes. Two dimensions are n signals of one axis. A `Dataset` (or a list of
            `Recording`) of one length brings names and units of its axes, and its rate. Where
            axes have names, `transform` wants the same.
        y : ignored

        Returns
        -------
        self

        Raises
        ------
        TypeError, ValueError
            Parameters out of range, a `rate_hz` that is not that of the `Dataset`, recordings of several lengths,
            NaN or infinity.

        Warns
        -----
        UserWarning
            Two dimensions that look like one recording: as few samples as a sensor has axes, and more signals.
        """
        recordings, _ = self._recordings(X, reset=True)
        self._learn(recordings)
        return self

    def transform(self, X: Recordings) -> FloatArray:
        """Features (n, D) of recordings of the shape given to `fit`.

        Raises
        ------
        ValueError
            Another shape, other axes, units or rate where they are known, NaN or infinity.
        """
        check_is_fitted(self)
        return self._features(self._recordings(X, reset=False)[0])

    def get_feature_names_out(self, input_features: npt.ArrayLike | None = None) -> npt.NDArray[Any]:
        """Names (D,) of the features, for instance ``fx_0000`` or ``hfmh_tz_99``; axes without names are axis0 ...

        Parameters
        ----------
        input_features : array-like of str, shape (T,), optional
            Must equal the names seen by `fit`, if there were any. The names given out do not depend on it.
        """
        check_is_fitted(self)
        _check_feature_names_in(self, input_features, generate_names=False)
        return np.asarray(renamed(self._names(), self._axes), dtype=object)

    @property
    def _axes(self) -> tuple[str, ...]:
        """Names of the axes, those of nameless ones included."""
        return self.axes_in_ or tuple(f"axis{k}" for k in range(self.n_axes_in_))

    def feature_blocks(self) -> tuple[FeatureBlock, ...]:
        """Say what the columns stand for: instants, bins or frequencies of each axis.

        Raises
        ------
        TypeError
            They have no one coordinate to be read along: statistics, or recordings, for instance.
        """
        raise TypeError(f"the columns of {type(self).__name__} have no one coordinate to be read along")

    def __sklearn_tags__(self) -> Tags:
        """Tags: recordings are three-dimensional, and two dimensions are welcome."""
        tags = super().__sklearn_tags__()
        tags.input_tags.three_d_array = True
        return tags

    def _learn(self, recordings: FloatArray) -> None:
        """Check parameters; learn, if anything, from recordings (n, T, C)."""

    def _features(self, recordings: FloatArray) -> FloatArray:
        """Features (n, D) of finite recordings (n, T, C), which must not be changed."""
        raise NotImplementedError

    def _names(self) -> list[str]:
        """Names of the D features, with the axes that `axis_names` gives."""
        raise NotImplementedError

    def _recordings(self, X: Any, *, reset: bool) -> tuple[FloatArray, Known]:
        """Check recordings, and with `reset` learn their shape, axes and rate; otherwise compare them."""
        X, known = _taken(X)
        if reset:
            self._learn_rate(known.rate_hz)
        if len(X.shape) > 3:
            raise GranularIdError(f"X must have shape (n, T, C) or (n, T), got {len(X.shape)} dimensions")
        if not reset and (len(X.shape) == 3 or self.n_axes_in_ > 1):
            self._refuse_other_shape(X.shape)
        values = validate_data(self, X, reset=reset, dtype=np.float64, allow_nd=True, ensure_all_finite=False)
        known = known._replace(n_dims=values.ndim)
        if values.ndim == 2:
            if reset and 2 <= values.shape[1] <= _MOST_AXES and len(values) > values.shape[1]:
                n, n_axes = values.shape
                warnings.warn(
                    f"X of shape {values.shape} is taken as {n} recordings of {n_axes} samples on one axis. If it is "
                    f"one recording of {n} samples on {n_axes} axes, pass X[np.newaxis]; if not, X[:, :, np.newaxis] "
                    "says so",
                    UserWarning,
                    stacklevel=3,
                )
            values = values[:, :, np.newaxis]
        if 0 in values.shape:
            raise GranularIdError(
                f"X must have at least one sample and at least one axis, got shape {values.shape}"
            )
        if not np.isfinite(values).all():
            recording, sample, axis = np.argwhere(~np.isfinite(values))[0].tolist()
            value = f"{values[recording, sample, axis]}".replace("nan", "NaN")
            raise GranularIdError(
                f"X must be finite, got {value} at recording {recording}, sample {sample}, axis {axis}"
            )
        if reset:
            self.n_axes_in_ = values.shape[2]
            self.axes_in_, self.units_in_ = known.axes, known.units or ("",) * self.n_axes_in_
        else:
            self._refuse_other(known)
        return values, known

    def _learn_rate(self, rate_hz: float | None) -> None:
        stated = getattr(self, "rate_hz", None)
        if stated is None:
            self.rate_hz_ = self._default_rate_hz if rate_hz is None else rate_hz
            return
        self.rate_hz_ = positive_number("rate_hz", stated, "a number of hertz or None")
        if rate_hz is not None and not np.isclose(self.rate_hz_, rate_hz, rtol=1e-6):
            problem = f"={stated:g}, but the recordings have {rate_hz:g} Hz: leave it out, or resample them"
            raise argument_error(GranularIdError, "rate_hz", problem)

    def _refuse_other(self, now: Known) -> None:
        """Refuse recordings of other axes, units or another rate than `fit` saw, as far as both are known."""
        if self.axes_in_ is not None and now.axes is not None:
            if now.axes != self.axes_in_:
                raise GranularIdError(
                    f"X has the axes {' '.join(now.axes)}, in fit they were {' '.join(self.axes_in_)}: "
                    "call .select(axes=...)"
                )
            for unit in unit_differences(
                dict(zip(self.axes_in_, self.units_in_, strict=True)),
                {"units": dict(zip(now.axes, now.units, strict=True))},
            ):
                raise GranularIdError(
                    f"X has the unit {unit.now}, in fit it was {unit.trained[0]}: convert the samples"
                )
        own, other = self.rate_hz_, now.rate_hz
        if own is not None and other is not None and not np.isclose(own, other, rtol=1e-6):
            raise GranularIdError(f"X has {other:g} Hz, in fit it was {own:g}: call .resample({own:g}) first")

    def _refuse_other_shape(self, shape: tuple[int, ...]) -> None:
        fitted = (self.n_features_in_, self.n_axes_in_)
        if len(shape) != 3 or shape[1:] != fitted:
            one = ", of one recording: pass X[np.newaxis]" if shape == fitted else ""
            raise GranularIdError(
                f"X must have shape (n, {fitted[0]}, {fitted[1]}) as in fit, with any n, got {shape}{one}"
            )


class CoreTransformer(RecordingTransformer):
    """What the core extracts in one pass, as the `spec_` says that `_learn` has made; a subclass has `threads`."""

    spec_: FeatureSpec

    def _features(self, recordings: FloatArray) -> FloatArray:
        return extract_features(recordings, spec=self.spec_, threads=self.threads)

    def _names(self) -> list[str]:
        return self.spec_.feature_names(self.n_features_in_, self.n_axes_in_)


class RecordingFilter(OneToOneFeatureMixin, RecordingTransformer):  # type: ignore[misc]
    """Recordings to recordings of the same shape, to stand in front of any feature space of a pipeline.

    A subclass fills in `_learn` and `_filtered`. A `Dataset` stays one, with all that it knows; else the result is an
    array, whatever `set_output` says: a data frame has two dimensions. Names, one for each instant, pass through.
    """

    keeps_time: ClassVar[bool] = True
    """Whether sample t of the result still belongs to instant t."""

    def __init_subclass__(cls, **keywords: Any) -> None:
        super().__init_subclass__(auto_wrap_output_keys=None, **keywords)

    def set_output(self, *, transform: str | None = None) -> Any:  # noqa: ARG002
        """Do nothing, so that a pipeline can set its steps behind; recordings stay arrays."""
        return self

    def transform(self, X: Recordings) -> FloatArray | Dataset:  # type: ignore[override]
        """Filter recordings; the result is a `Dataset` where `X` is one, else it has as many dimensions as `X`.

        Raises
        ------
        ValueError
            Another shape than in `fit`, NaN or infinity.
        """
        check_is_fitted(self)
        recordings, known = self._recordings(X, reset=False)
        filtered = self._filtered(recordings)
        if known.dataset is not None:
            pairs = zip(known.dataset, filtered, strict=True)
            return Dataset([replace(recording, wrench=wrench) for recording, wrench in pairs])
        return filtered[:, :, 0] if known.n_dims == 2 else filtered

    def _filtered(self, recordings: FloatArray) -> FloatArray:
        raise NotImplementedError


def axis_series(recordings: FloatArray) -> FloatArray:
    """Return a copy (n, C, T) in which each axis of each recording is contiguous."""
    n, n_samples, n_axes = recordings.shape
    rows = extract_features(recordings, hfmh=False, threads=1)  # the transposing copy at memory speed
    return rows.reshape(n, n_axes, n_samples)


def _taken(X: Any) -> tuple[Any, Known]:
    """Return the samples of what a caller passes, and what it says of them."""
    if isinstance(X, Recording):
        raise TypeError("X must be a batch, got one Recording: pass [X]")
    if isinstance(X, (list, tuple)) and X and all(isinstance(one, Recording) for one in X):
        X = Dataset(X)  # what scikit-learn makes of a Dataset when it takes some of its rows
    if isinstance(X, Dataset):
        return X.X, Known(X.axes, tuple(common_units(X)), X.rate_hz, X)
    names = column_names(X, "X")
    if names is None or {name.strip().lower() for name in names} >= set(
        AXES
    ):  # a row of others is a recording
        refuse_tables(X, "X")
    return X if hasattr(X, "shape") else np.asarray(X), Known()


BlockKind = Literal["time", "magnitude", "frequency"]


@dataclass(frozen=True, eq=False)
class FeatureBlock:
    """Columns that lie side by side and are read along one coordinate, the same one for each of their axes.

    Attributes
    ----------
    name : str
        Name of the block, for instance "raw" or "hfmh"; unique within a feature space.
    kind : {"time", "magnitude", "frequency"}
        What the coordinate is.
    axes : tuple of str
        Axes of the sensor, for instance ``("fx", ..., "tz")``.
    coordinates : ndarray, shape (m,)
        Instants, centres of bins or frequencies.
    unit : str
        Unit of the coordinates: "s" or "sample", "Hz" or "1/sample" when the rate is not known; of magnitudes that of
        the axes, such as "N, N m" where they differ, "" where not known.
    columns : slice
        Where the block lies in the feature vector. Axis-major: axis ``a`` occupies the ``m`` columns from
        ``columns.start + a * m``.
    units : tuple of str
        Of magnitudes, the unit of each axis; else empty.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id import RawSignal
    >>> (block,) = RawSignal(rate_hz=500).fit(np.zeros((1, 1600, 6))).feature_blocks()
    >>> block.name, block.kind, block.unit, block.coordinates[:3].tolist()
    ('raw', 'time', 's', [0.0, 0.002, 0.004])
    """

    name: str
    kind: BlockKind
    axes: tuple[str, ...]
    coordinates: FloatArray
    unit: str
    columns: slice
    units: tuple[str, ...] = ()


def axis_names(n_axes: int) -> tuple[str, ...]:
    """Names of the axes as the core spells them in feature names: ``fx ... tz`` for six, else ``axis0 ...``."""
    return tuple(name.rpartition("_")[0] for name in feature_names(n_samples=1, n_axes=n_axes, hfmh=False))


def renamed(names: Sequence[str], axes: Sequence[str]) -> list[str]:
    """Return names of features with these axes in place of those that `axis_names` gives."""
    own = dict(zip(axis_names(len(axes)), axes, strict=True))
    return ["_".join([own.get(part, part) for part in name.split("_")]) for name in names]


def time_block(name: str, n_samples: int, axes: tuple[str, ...], rate_hz: float | None) -> FeatureBlock:
    """Every sample of every axis."""
    step, unit = (1.0, "sample") if rate_hz is None else (1.0 / rate_hz, "s")
    instants: FloatArray = np.arange(n_samples, dtype=np.float64) * step
    return FeatureBlock(name, "time", axes, instants, unit, slice(0, n_samples * len(axes)))


def range_blocks(
    name: str, bounds: FloatArray, n_bins: int, axes: tuple[str, ...], units: tuple[str, ...]
) -> tuple[FeatureBlock, ...]:
    """Histograms: one block where all axes share a range, else one an axis, named ``<name>_<axis>``."""
    parts = [(name, axes, units)]
    if (bounds != bounds[0]).any():
        parts = [(f"{name}_{axis}", (axis,), (unit,)) for axis, unit in zip(axes, units, strict=True)]
    blocks: list[FeatureBlock] = []
    for (called, own, of_own), (low, high) in zip(parts, bounds, strict=False):
        edges = np.linspace(low, high, n_bins + 1)
        columns = slice(n_bins * len(blocks), n_bins * (len(blocks) + len(own)))
        centres, unit = edges[:-1] + np.diff(edges) / 2, joined_units(of_own)
        blocks.append(FeatureBlock(called, "magnitude", own, centres, unit, columns, of_own))
    return tuple(blocks)


def joined_units(units: Sequence[str]) -> str:
    """Return the units that are known, each once, as one text."""
    return ", ".join(dict.fromkeys(filter(None, units)))


def shifted(blocks: Sequence[FeatureBlock], by: int) -> tuple[FeatureBlock, ...]:
    """Return the same blocks, further right in the feature vector."""
    return tuple(
        replace(block, columns=slice(block.columns.start + by, block.columns.stop + by)) for block in blocks
    )


def steps_of(transformer: Any) -> list[Any]:
    """List the steps of a pipeline that do something; any other transformer is its own only step."""
    return real_steps(transformer) if isinstance(transformer, Pipeline) else [transformer]


def steps_behind_filters(transformer: Any) -> list[Any]:
    """List the steps behind filters that keep time, such as `Tare`."""
    steps = steps_of(transformer)
    while steps and isinstance(steps[0], RecordingFilter) and steps[0].keeps_time:
        del steps[0]
    return steps


def feature_blocks(transformer: Any) -> tuple[FeatureBlock, ...]:
    """Say what the columns of a fitted feature space stand for, with or without filters in front that keep time.

    Blocks of a `FeatureUnion` come in its order; where two share a name, each is preceded by that of its part.
    """
    steps = steps_behind_filters(transformer)
    if len(steps) == 1 and isinstance(steps[0], FeatureUnion):
        found: list[tuple[str, FeatureBlock]] = []
        for part, inner in steps[0].transformer_list:
            stop = found[-1][1].columns.stop if found else 0
            found += [(part, block) for block in shifted(feature_blocks(inner), stop)]
        if len({block.name for _, block in found}) == len(found):
            return tuple(block for _, block in found)
        return tuple(replace(block, name=f"{part}__{block.name}") for part, block in found)
    if len(steps) != 1 or not hasattr(steps[0], "feature_blocks"):
        kinds = ", ".join(type(step).__name__ for step in steps) or "nothing behind filters"
        raise TypeError(
            "transformer must give columns that stand for instants, bins or frequencies: one feature space, with or "
            f"without filters in front that keep time, got {kinds}"
        )
    blocks: tuple[FeatureBlock, ...] = steps[0].feature_blocks()
    return blocks


def block_sizes(transformer: Any) -> dict[str, int] | None:
    """Columns of each block of a fitted feature space that has blocks of statistics, as `MultiBand`; else None."""
    sizes: dict[str, int] | None = getattr(steps_of(transformer)[-1], "block_sizes_", None)
    return None if sizes is None else dict(sizes)
