"""The table of feature spaces: names, transformers, accuracies of the paper.

Source: Hynninen, Nguyen Le, Kyrki, "Interactive Identification of Granular Materials using Force
Measurements" (arXiv 2403.17606), table of accuracies.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import takewhile
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.decomposition import PCA
from sklearn.pipeline import FeatureUnion, Pipeline

from granular_id.recording import Dataset
from granular_id.rica import RICA
from granular_id.spaces.base import RecordingFilter, block_sizes
from granular_id.spaces.best import BestClassifier
from granular_id.spaces.hfmh import DEFAULT_RANGE, HFMH, BinRange, BlockWeights, RawHFMH, RawHistogram
from granular_id.spaces.multiband import ALL_BLOCKS, BAND_SHRINKAGE, MultiBand
from granular_id.spaces.raw import RangeNormalizer, RawSignal, Tare, TimePermutation
from granular_id.spaces.spectral import DFT
from granular_id.splits import Groups


@dataclass(frozen=True)
class FeatureSpace:
    """One row of the paper's table, or a control beside it.

    Attributes
    ----------
    name : str
        Key in `feature_spaces`.
    transformer : estimator
        Not fitted; turns recordings (n, T, C) into features (n, D).
    paper_accuracy : float or None
        Mean accuracy that the paper reports, 11 materials and 20 random partitions. None where its table has none.
    control : bool, default False
        Not a feature space to choose, but a check on what the others show.
    classifier : estimator, optional
        The one that belongs to the space, where it is not the evaluation's.
    """

    name: str
    transformer: Any
    paper_accuracy: float | None
    control: bool = False
    classifier: Any = None


def feature_spaces(
    *,
    rate_hz: float = 500.0,
    cutoff_hz: float = 23.0,
    order: int = 8,
    n_bins: int = 100,
    bin_range: BinRange = DEFAULT_RANGE,
    initial: str = "zero",
    tare_s: float | None = None,
    block_weights: BlockWeights = None,
    threads: int | None = None,
) -> dict[str, FeatureSpace]:
    """Feature spaces by name, with the accuracy that the paper reports for each.

    Parameters
    ----------
    rate_hz, cutoff_hz, order, n_bins, bin_range, initial, threads
        As in `HFMH`; the defaults are the paper's. `n_bins` holds for the raw histogram too; its range is always
        learned.
    tare_s : float or None, default None
        Put `Tare` of this length in front of every space; None, the paper, takes recordings as they are.
    block_weights : None, "unit" or two numbers, default None
        Of "raw+hfmh", as in `RawHFMH`; None is the paper.

    Returns
    -------
    dict of str to FeatureSpace
        Those of the paper's table, best first: "raw+hfmh", "norm-raw+hfmh", "norm-raw", "hfmh", "raw+dft",
        "norm-raw+dft", "dft", "raw", "pca+rica", "pca", "raw-histogram". Then ours, "multiband" and
        "best", which bring their own classifier, and the control "time-permuted".

    Notes
    -----
    Normalised spaces normalise the raw block only. The paper's numbers have that pattern: "norm-raw+dft" falls
    to the value of the transform alone, whose values are much larger than 1.

    Examples
    --------
    >>> from granular_id import feature_spaces
    >>> spaces = feature_spaces()
    >>> {name: spaces[name].paper_accuracy for name in ("raw+hfmh", "hfmh", "raw")}
    {'raw+hfmh': 0.9705, 'hfmh': 0.8705, 'raw': 0.7614}
    >>> [name for name, space in spaces.items() if space.control]
    ['time-permuted']
    """
    # Every space gets transformers of its own: set_params on one must not reach into another.
    raw = partial(RawSignal, rate_hz=rate_hz, threads=threads)
    norm = partial(RangeNormalizer, rate_hz=rate_hz)
    dft = partial(DFT, rate_hz=rate_hz)
    filtering: dict[str, Any] = {"cutoff_hz": cutoff_hz, "order": order, "initial": initial}
    counting: dict[str, Any] = {
        "rate_hz": rate_hz,
        "n_bins": n_bins,
        "bin_range": bin_range,
        "threads": threads,
    }
    hfmh = partial(HFMH, **filtering, **counting)

    # As exact as the full decomposition of 550 x 9600, in two thirds of the time.
    pca = partial(PCA, 100, svd_solver="arpack", random_state=0)

    def union(**blocks: Any) -> FeatureUnion:
        return FeatureUnion(list(blocks.items()), verbose_feature_names_out=False)

    def pipeline(**steps: Any) -> Pipeline:
        return Pipeline(list(steps.items()))

    table = (
        FeatureSpace("raw+hfmh", RawHFMH(**filtering, **counting, block_weights=block_weights), 0.9705),
        FeatureSpace("norm-raw+hfmh", union(norm_raw=norm(), hfmh=hfmh()), 0.9303),
        FeatureSpace("norm-raw", norm(), 0.8731),
        FeatureSpace("hfmh", hfmh(), 0.8705),
        FeatureSpace("raw+dft", union(raw=raw(), dft=dft()), 0.7712),
        FeatureSpace("norm-raw+dft", union(norm_raw=norm(), dft=dft()), 0.7686),
        FeatureSpace("dft", dft(), 0.7621),
        FeatureSpace("raw", raw(), 0.7614),
        FeatureSpace("pca+rica", pipeline(raw=raw(), pca=pca(), rica=RICA(80)), 0.7602),
        FeatureSpace("pca", pipeline(raw=raw(), pca=pca()), 0.7527),
        FeatureSpace("raw-histogram", RawHistogram(n_bins=n_bins), 0.7072),
        FeatureSpace(
            "multiband",
            MultiBand(rate_hz=rate_hz, threads=threads),
            None,
            classifier=BestClassifier(shrinkages=(BAND_SHRINKAGE,), relative_costs=(1.0,)),
        ),
        FeatureSpace(
            "best",
            MultiBand(rate_hz=rate_hz, blocks=ALL_BLOCKS, threads=threads),
            None,
            classifier=BestClassifier(optional_blocks=("level",)),
        ),
        FeatureSpace(
            "time-permuted",
            pipeline(permute=TimePermutation(), raw=raw()),
            None,
            control=True,
        ),
    )
    spaces = table if tare_s is None else tuple(_tared(space, tare_s, rate_hz) for space in table)
    return {space.name: space for space in spaces}


def all_spaces(known: Mapping[str, FeatureSpace]) -> list[str]:
    """Name feature spaces without the control: "best", which is to be the headline's, others of ours, the paper's."""
    ours = [name for name, space in known.items() if space.paper_accuracy is None and not space.control]
    papers = [name for name, space in known.items() if space.paper_accuracy is not None]
    return ["best", *(name for name in ours if name != "best"), *papers]


def paper_spaces(known: Mapping[str, FeatureSpace]) -> list[str]:
    """Name the feature spaces of the paper's table, best first, then its control."""
    return [name for name, space in known.items() if space.paper_accuracy is not None or space.control]


def _tared(space: FeatureSpace, tare_s: float, rate_hz: float) -> FeatureSpace:
    plain = space.transformer
    steps = plain.steps if isinstance(plain, Pipeline) else [("features", plain)]
    return replace(space, transformer=Pipeline([("tare", Tare(tare_s, rate_hz=rate_hz)), *steps]))


def limit_components(estimator: Any, n_rows: int) -> str:
    """Lower the number of principal components, and what is made of them, to what centred training rows span.

    Returns what was done in words; none where nothing was.
    """
    parameters: dict[str, Any] = getattr(estimator, "get_params", dict)()
    many = {
        f"{name}__n_components": n_rows - 1
        for name, step in parameters.items()
        if isinstance(step, PCA | RICA) and isinstance(step.n_components, int) and step.n_components >= n_rows
    }
    if not many:
        return ""
    estimator.set_params(**many)
    return f"{n_rows - 1} components, as {n_rows} recordings train"


def fit_pipeline(
    pipeline: Pipeline,
    X: Dataset | npt.NDArray[np.float64],
    y: npt.NDArray[np.str_],
    groups: Groups | None = None,
) -> Pipeline:
    """Fit a feature space and what follows it in place, on recordings, a data set or X (n, T, C), and labels y (n,).

    Steps that leave `blocks` open get those of the feature space, and those whose `fit` takes them sessions, order and
    conditions of the recordings.
    """
    steps = [step for _, step in pipeline.steps]
    n_front = 1 + sum(1 for _ in takewhile(lambda step: isinstance(step, RecordingFilter), steps))
    values: Any = X
    for step in steps[:n_front]:
        values = step.fit(values, y).transform(values)
    fit_on_features(pipeline, values, y, groups, n_front)
    return pipeline


def fit_on_features(
    pipeline: Pipeline,
    values: npt.NDArray[np.float64],
    y: npt.NDArray[np.str_],
    groups: Groups | None,
    n_front: int = 1,
) -> None:
    """Fit in place what follows the first `n_front` steps, filters and a feature space, on its values (n, D)."""
    sizes = block_sizes(pipeline.steps[n_front - 1][1])
    rest = Pipeline(pipeline.steps[n_front:])
    for _, step in rest.steps:
        if sizes is not None and step.get_params().get("blocks", ...) is None:
            step.set_params(blocks=sizes)
    rest.fit(values, y, **({} if groups is None else groups.fit_arguments(rest)))
