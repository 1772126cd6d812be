"""Feature spaces side by side, and how much each of them counts."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.base import clone
from sklearn.utils.metaestimators import _BaseComposition

from granular_id._checks import argument_error
from granular_id._estimators import Origin, learns, traced
from granular_id.spaces.base import (
    FeatureBlock,
    Recordings,
    RecordingTransformer,
    feature_blocks,
    shifted,
    steps_of,
)

FloatArray = npt.NDArray[np.float64]
BlockWeights = str | Sequence[float] | npt.NDArray[Any] | None


class BlockUnion(RecordingTransformer, _BaseComposition):  # type: ignore[misc]
    """Several feature spaces side by side, each weighted as a whole.

    Parameters
    ----------
    blocks : list of (name, transformer)
        Transformers of recordings (n, T, C) to features (n, D). The default, none, is refused by `fit`.
    block_weights : None, "unit" or one number per block, default None
        None: plain side by side, the paper. Newtons next to counts: the block with the larger norm has the
        larger say, however little it knows. "unit" multiplies each block by a factor that brings its mean
        Euclidean norm over the rows given to `fit` to one. Numbers are fixed factors. No choice wins on all data.

    Attributes
    ----------
    blocks_ : list of (name, transformer)
        Fitted blocks.
    block_weights_ : ndarray, shape (n_blocks,)
        The factors.
    n_features_in_, n_axes_in_ : int
        Samples T of a recording, and its axes C.

    Notes
    -----
    Names are those of the blocks. Where two blocks share a name, each is preceded by that of its block:
    ``slow__hfmh_fx_00``. Unlike scikit-learn's FeatureUnion this takes three-dimensional input, learns weights,
    and knows what its columns stand for.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id import BlockUnion, HFMH, RangeNormalizer
    >>> X = np.random.default_rng(0).normal(size=(3, 400, 6))
    >>> union = BlockUnion([("norm", RangeNormalizer()), ("hfmh", HFMH())], block_weights="unit").fit(X)
    >>> union.transform(X).shape
    (3, 3000)
    >>> union.block_weights_.round(4).tolist()
    [0.0376, 0.0098]
    """

    blocks_: list[tuple[str, Any]]
    block_weights_: FloatArray

    def __init__(
        self,
        blocks: Sequence[tuple[str, Any]] = (),
        *,
        block_weights: BlockWeights = None,
    ) -> None:
        self.blocks = blocks
        self.block_weights = block_weights

    @property
    def learns(self) -> bool:
        """True with ``block_weights="unit"``, or when a block learns."""
        return isinstance(self.block_weights, str) or any(learns(block) for _, block in self.checked_blocks())

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Parameters, with ``deep`` those of the blocks too, as ``<block>__<parameter>``."""
        params: dict[str, Any] = self._get_params("blocks", deep=deep)
        return params

    def set_params(self, **params: Any) -> Any:
        """Set parameters, replace a block by its name, or set ``<block>__<parameter>``."""
        self._set_params("blocks", **params)
        return self

    def fit(self, X: Recordings, y: object = None) -> Any:
        """Fit a clone of each block, and the weights where they are learned.

        Parameters
        ----------
        X : Dataset, or array-like of shape (n, T, C) or (n, T)
            Recordings, as in every feature space.
        y : array-like, optional
            Passed to the blocks.

        Returns
        -------
        self
        """
        self._fit(X, y)
        return self

    def fit_transform(self, X: Recordings, y: object = None) -> FloatArray:
        """`fit` and `transform` without computing features twice."""
        recordings, features, origin = self._fit(X, y)
        return self._traced(self._weighted(features or self._each(recordings)), origin)

    def feature_blocks(self) -> tuple[FeatureBlock, ...]:
        """Blocks of all parts, in their order; names are made unique as those of the features are."""
        offset = 0
        parts: list[tuple[str, tuple[FeatureBlock, ...]]] = []
        for name, block in self.blocks_:
            inner = feature_blocks(block)
            parts.append((name, shifted(inner, offset)))
            offset += max(part.columns.stop for part in inner)
        names = _unique([(name, [part.name for part in inner]) for name, inner in parts])
        every = [part for _, inner in parts for part in inner]
        return tuple(replace(part, name=name) for part, name in zip(every, names, strict=True))

    def checked_blocks(self) -> list[tuple[str, Any]]:
        """Return `blocks` as given, or refuse them.

        Raises
        ------
        TypeError, ValueError
            Not pairs of a name and a transformer, none of them, or names that are not unique or hold ``__``.
        """
        wanted = "blocks must be a list of (name, transformer)"
        try:
            pairs = [(name, block) for name, block in self.blocks]
        except (TypeError, ValueError):
            raise TypeError(f"{wanted}, got {self.blocks!r}") from None
        if not pairs:
            raise ValueError(f"{wanted} with at least one of them, got none")
        for name, block in pairs:
            if not isinstance(name, str) or not name:
                raise TypeError(f"{wanted}: a name must be non-empty text, got {name!r}")
            if isinstance(block, type) or not (hasattr(block, "fit") and hasattr(block, "transform")):
                raise TypeError(f"{wanted}: {name!r} has no fit and transform, got {block!r}")
        self._validate_names([name for name, _ in pairs])
        return pairs

    def _fit(self, X: Recordings, y: object) -> tuple[FloatArray, list[FloatArray], Origin]:
        """Fit; return the recordings, the features of each block where the weights needed them, and the origin."""
        blocks = self.checked_blocks()
        weights = check_block_weights(self.block_weights, [name for name, _ in blocks])
        recordings, origin = self._recordings(X, reset=True)
        known = traced(recordings, origin)
        self.blocks_ = [(name, clone(block).fit(known, y)) for name, block in blocks]
        if self.rate_hz_ is None:  # of arrays: the rate that the blocks take for granted
            rates = (getattr(block, "rate_hz_", None) for _, block in self.blocks_)
            self.rate_hz_ = next((rate for rate in rates if rate is not None), None)
        features = self._each(recordings) if weights == "unit" else []
        self.block_weights_ = block_factors(weights, len(blocks), features)
        return recordings, features, origin

    def _features(self, recordings: FloatArray) -> FloatArray:
        return self._weighted(self._each(recordings))

    def _each(self, recordings: FloatArray) -> list[FloatArray]:
        every = []
        for name, block in self.blocks_:
            features = np.asarray(block.transform(recordings), dtype=np.float64)
            if features.ndim != 2:
                raise ValueError(f"block {name!r} must give an array (n, D), got shape {features.shape}")
            every.append(features)
        return every

    def _weighted(self, blocks: list[FloatArray]) -> FloatArray:
        together = np.concatenate(blocks, axis=1)
        weigh(together, [block.shape[1] for block in blocks], self.block_weights_)
        return together

    def _own_names(self) -> list[str]:
        return _unique([(name, block.get_feature_names_out().tolist()) for name, block in self.blocks_])


def works_one_by_one(step: Any) -> bool:
    """Whether a step is of this package and gives each recording what it would give it alone, to the last bit."""
    if isinstance(step, BlockUnion):
        return all(works_one_by_one(inner) for _, block in step.checked_blocks() for inner in steps_of(block))
    return isinstance(step, RecordingTransformer) and type(step).__module__.startswith("granular_id.")


def _unique(parts: list[tuple[str, list[str]]]) -> list[str]:
    plain = [inner for _, names in parts for inner in names]
    if len(set(plain)) == len(plain):
        return plain
    return [f"{name}__{inner}" for name, names in parts for inner in names]


def check_block_weights(block_weights: Any, names: Sequence[str]) -> str | tuple[float, ...] | None:
    """Return None, "unit", or one number per block; refuse anything else."""
    if block_weights is None or (isinstance(block_weights, str) and block_weights == "unit"):
        return block_weights
    wanted = f"None, 'unit' or {len(names)} numbers, one for each of {', '.join(names)}"
    try:
        numbers = np.asarray(block_weights, dtype=np.float64)
    except (TypeError, ValueError):
        kind = ValueError if isinstance(block_weights, str) else TypeError
        raise argument_error(kind, "block_weights", f"must be {wanted}, got {block_weights!r}") from None
    if numbers.shape != (len(names),):
        raise argument_error(ValueError, "block_weights", f"must be {wanted}, got {block_weights!r}")
    if not (np.isfinite(numbers).all() and (numbers > 0).all()):
        raise argument_error(
            ValueError, "block_weights", f"must be positive and finite, got {block_weights!r}"
        )
    return tuple(numbers.tolist())


def block_factors(
    checked: str | tuple[float, ...] | None, n_blocks: int, features: Iterable[FloatArray]
) -> FloatArray:
    """Factor of each block; the features of each, over the training rows, are looked at with "unit" only."""
    if checked == "unit":
        return np.array([unit_weight(row_norms(block)) for block in features])
    return np.ones(n_blocks) if checked is None else np.asarray(checked, dtype=np.float64)


def row_norms(rows: FloatArray) -> FloatArray:
    """Euclidean norms (n,) of rows, without overflow where the norm itself has none."""
    reach = float(max(rows.max(initial=0.0), -rows.min(initial=0.0)))
    if reach == 0.0:
        return np.zeros(len(rows))
    norms = np.empty(len(rows))
    for i, row in enumerate(rows):  # a copy of one row at a time, not of all
        scaled = row / reach
        norms[i] = reach * np.sqrt(scaled @ scaled)
    return norms


def weigh(features: FloatArray, widths: Iterable[int], weights: FloatArray) -> None:
    """Multiply each block of columns by its weight, in place."""
    start = 0
    for width, weight in zip(widths, weights, strict=True):
        block = features[:, start : start + width]
        start += width
        if weight == 1.0:
            continue
        with np.errstate(over="ignore"):  # reported below
            block *= weight
        if not np.isfinite(block).all():
            raise argument_error(
                ValueError,
                "block_weights",
                f"must keep features in the range of float64, got a weight of {weight:g}",
            )


def unit_weight(norms: npt.ArrayLike) -> float:
    """Factor that brings rows with these Euclidean norms to a mean norm of one; 1 for rows that are all zero."""
    mean = float(np.mean(np.asarray(norms, dtype=np.float64)))
    if mean == 0.0:
        return 1.0
    weight = 1.0 / mean if mean > 0.0 else np.nan
    if not (np.isfinite(mean) and np.isfinite(weight) and weight > 0.0):
        raise argument_error(
            ValueError,
            "block_weights",
            f"='unit' needs features in the range of float64, got a mean norm of {mean:g}",
        )
    return float(weight)
