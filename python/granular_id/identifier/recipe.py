"""How an identifier is made: the settings of features and classifier, and the scikit-learn pipeline they stand for."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.pipeline import Pipeline

from granular_id import _core
from granular_id.best import BestClassifier
from granular_id.ecoc import ECOCClassifier
from granular_id.ecoc.codings import CODINGS, design
from granular_id.ecoc.decoding import DECODINGS
from granular_id.ecoc.losses import fitting_loss
from granular_id.ecoc.posterior import POSTERIORS
from granular_id.ecoc.training import named
from granular_id.evaluation.describe import describe_estimator
from granular_id.identifier.banded import blocks_of
from granular_id.spaces import HFMH, BlockScaler, RawHFMH, RawSignal, WithinClassWhitening
from granular_id.spaces.hfmh import DEFAULT_RANGE, BinRange
from granular_id.spaces.multiband import BAND_LOSS, MultiBand
from granular_id.spaces.weights import BlockWeights

__all__ = ["BANDED", "GROWING", "SPACES", "Recipe"]

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
        `granular_id.best.BestClassifier`: the most accurate on recordings of other sessions. ``"multiband"`` gives
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
