"""Accuracy of our methods beside peers of aeon and scikit-learn, on recordings of others: make bench BENCH=accuracy.

All methods get the same partitions: whole sessions held out where there are sessions, else halves in order, both
ways; the robot-failure sets have no order, so stratified folds. Features are timed on one thread, in processor time,
compilation not counted. Peers that are not installed are left out: pip install --group accuracy
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.ensemble import ExtraTreesClassifier, RandomForestClassifier
from sklearn.linear_model import RidgeClassifierCV
from sklearn.pipeline import make_pipeline, make_union
from sklearn.preprocessing import FunctionTransformer, StandardScaler
from sklearn.svm import SVC
from threadpoolctl import threadpool_limits

import granular_id as gid
from granular_id._files import write_json
from granular_id.spaces import block_sizes
from granular_id.splits import Fold, groups_of, hold_out
from results import about

PACKAGES = ("numpy", "scipy", "scikit-learn", "aeon", "numba", "torch")
SEED = 0
TREES = 200  # of the forests behind Catch22 and QUANT, as aeon's own
BATCH = 64  # recordings that Hydra and QUANT take at a time: all at once fill the memory, or are refused
FAILURE_SAMPLES = 15
FAILURE_RATE_HZ = FAILURE_SAMPLES / 0.315


# Recordings.


@dataclass(frozen=True)
class BenchSet:
    """Recordings of one shape, and how they are split."""

    data: gid.Dataset
    partitions: list[Fold]
    how: str


def read(folder: Path, seeds: int) -> list[BenchSet]:
    """Read a folder: one data set, or five where it holds the robot-failure sets."""
    if failures := sorted(folder.glob("lp[1-5].data")):
        return [folds(failure_set(file), seeds) for file in failures]
    data = gid.load(folder).resample(100, max_gap_s=1).align("shortest")
    drawn = hold_out(data)
    return [BenchSet(data, list(drawn), "; ".join(drawn.notes))]


def failure_set(file: Path) -> gid.Dataset:
    """Read a label line, then 15 rows of six integers; instances between blank lines."""
    recordings = []
    for block in file.read_text(encoding="ascii").strip().split("\n\n"):
        label, *rows = block.strip().splitlines()
        wrench = np.array([row.split() for row in rows], dtype=np.float64).reshape(FAILURE_SAMPLES, 6)
        name = f"{file.stem}_{len(recordings) + 1:03d}"
        recordings.append(gid.Recording(wrench, rate_hz=FAILURE_RATE_HZ, label=label.strip(), name=name))
    return gid.Dataset(recordings)


def folds(data: gid.Dataset, seeds: int) -> BenchSet:
    partitions = [fold for seed in range(seeds) for fold in hold_out(data, "random", 5, seed)]
    return BenchSet(data, partitions, f"5 stratified folds, {seeds} draws")


# Methods: features of recordings (n, T, C), and a classifier.


class AxisScaler(TransformerMixin, BaseEstimator):
    """Less the mean, over the standard deviation, of each axis over all training samples."""

    def fit(self, X, y=None):  # noqa: ARG002 - scikit-learn passes y
        self.mean_ = X.mean(axis=(0, 1))
        spread = X.std(axis=(0, 1))
        self.scale_ = np.where(spread > 0, spread, 1.0)
        return self

    def transform(self, X):
        return (X - self.mean_) / self.scale_


class AxesFirst(TransformerMixin, BaseEstimator):
    """A peer's transformer behind `AxisScaler`, in the layout that aeon wants: (n, C, T)."""

    def __init__(self, inner, dtype=np.float32, batch=None):
        self.inner = inner
        self.dtype = dtype
        self.batch = batch

    def fit(self, X, y=None):  # noqa: ARG002 - scikit-learn passes y
        self.scaler_ = AxisScaler().fit(X)
        self.inner.fit(self._ordered(X))
        return self

    def transform(self, X):
        step = self.batch or len(X)
        parts = [self.inner.transform(self._ordered(X[i : i + step])) for i in range(0, len(X), step)]
        return np.concatenate([np.asarray(part) for part in parts])

    def _ordered(self, X):
        return np.ascontiguousarray(self.scaler_.transform(X).transpose(0, 2, 1), dtype=self.dtype)


class SparseScaler(TransformerMixin, BaseEstimator):
    """Scaling of Hydra's counts: square root, then mean and spread, with zeros left zero (Dempster et al. 2023)."""

    def fit(self, X, y=None):  # noqa: ARG002 - scikit-learn passes y
        roots = np.sqrt(np.maximum(X, 0.0))
        self.mean_ = roots.mean(axis=0)
        self.scale_ = roots.std(axis=0, ddof=1) + (roots == 0).mean(axis=0) ** 4 + 1e-8
        return self

    def transform(self, X):
        roots = np.sqrt(np.maximum(X, 0.0))
        return (roots - self.mean_) * (roots != 0) / self.scale_


def aeon(module: str, name: str, **settings: Any) -> Any:
    return getattr(import_module(f"aeon.transformations.collection.{module}"), name)(**settings)


def rocket(name: str) -> Any:
    features = AxesFirst(aeon("convolution_based", name, n_jobs=1, random_state=SEED))
    return make_pipeline(features, StandardScaler(with_mean=False))


def hydra() -> Any:
    settings = {"n_jobs": 1, "random_state": SEED, "output_type": "numpy"}
    features = aeon("convolution_based", "HydraTransformer", **settings)
    return make_pipeline(AxesFirst(features, batch=BATCH), SparseScaler())


def quant() -> Any:
    import_module("torch").set_num_threads(1)
    return AxesFirst(aeon("interval_based", "QUANTTransformer"), batch=BATCH)


def catch22() -> Any:
    settings = {"catch24": True, "outlier_norm": True, "replace_nans": True}
    return AxesFirst(aeon("feature_based", "Catch22", n_jobs=1, **settings), dtype=np.float64)


def ridge() -> Any:
    return RidgeClassifierCV(alphas=np.logspace(-3, 3, 10))


def trees(kind: type, **settings: Any) -> Any:
    return kind(TREES, random_state=SEED, n_jobs=1, **settings)


def rdst() -> Any:
    features = aeon("shapelet_based", "RandomDilatedShapeletTransform", n_jobs=1, random_state=SEED)
    return make_pipeline(AxesFirst(features, dtype=np.float64), StandardScaler())


def freshprince() -> tuple[Any, Any]:
    features = aeon("feature_based", "TSFresh", default_fc_parameters="comprehensive", n_jobs=1)
    forest = import_module("aeon.classification.sklearn").RotationForestClassifier
    return AxesFirst(features, dtype=np.float64), trees(forest)


def samples(X: np.ndarray) -> np.ndarray:
    return X.reshape(len(X), -1)


def space(name: str, rate_hz: float) -> tuple[Any, Any]:
    # The paper's bins, +-1.5 N, are those of one sensor and one tool: here they are learned from training rows.
    made = gid.feature_spaces(rate_hz=rate_hz, bin_range="auto", threads=1)[name]
    return made.transformer, made.classifier or gid.ECOCClassifier()


OURS = ("best", "multiband", "raw+hfmh")
PEERS: dict[str, Callable[[], tuple[Any, Any]]] = {
    "minirocket": lambda: (rocket("MiniRocket"), ridge()),
    "multirocket": lambda: (rocket("MultiRocket"), ridge()),
    "multirocket+hydra": lambda: (make_union(hydra(), rocket("MultiRocket")), ridge()),
    "quant": lambda: (quant(), trees(ExtraTreesClassifier, max_features=0.1, criterion="entropy")),
    "rdst": lambda: (rdst(), ridge()),
    "freshprince": freshprince,
    "catch22+rf": lambda: (catch22(), trees(RandomForestClassifier)),
    "raw+svm": lambda: (
        make_pipeline(FunctionTransformer(samples), StandardScaler()),
        SVC(kernel="linear"),
    ),
}


# A run.


def score(method: str, bench_set: BenchSet) -> Iterator[tuple[float, float]]:
    """Yield accuracy, and seconds of the features of a tested recording, of each partition."""
    data, make = bench_set.data, PEERS.get(method) or (lambda: space(method, bench_set.data.rate_hz))
    groups = groups_of(data)
    for number, partition in enumerate(bench_set.partitions):
        features, classifier = make()
        if number == 0:  # compilation and loading are no time of its own
            features.fit_transform(data.X[partition.train], data.y[partition.train])
        with threadpool_limits(1):
            rows = features.fit_transform(data.X[partition.train], data.y[partition.train])
            known = {}
            if method in OURS:  # a classifier of ours may ask for blocks, sessions and order in time
                if "blocks" in classifier.get_params():
                    classifier.set_params(blocks=block_sizes(features))
                known = groups.take(partition.train).fit_arguments(classifier)
            classifier.fit(rows, data.y[partition.train], **known)
            start = time.process_time()
            tested = features.transform(data.X[partition.test])
            seconds = (time.process_time() - start) / len(partition.test)
            hits = classifier.predict(tested) == data.y[partition.test]
        yield float(np.mean(hits)), seconds


def run(folder: Path, seeds: int) -> dict[str, Any]:
    """Print a line for each method; return the means that the page shows."""
    sets = read(folder, seeds)
    first = sets[0]
    shape = " x ".join(map(str, first.data.X.shape[1:]))
    how = f"{sum(len(s.data) for s in sets)} recordings of {shape}, {first.how}"
    print(f"{folder.name}: {how}\n{'':<20}{'accuracy':>9}{'features, ms':>14}")
    found: dict[str, dict[str, float]] = {}
    for method in (*OURS, *PEERS):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                both = np.array([list(score(method, bench_set)) for bench_set in sets])
        except ImportError as error:
            print(f"{method:<20}left out: {error}")
            continue
        accuracy = float(both[..., 0].mean())  # over the sets of a folder, partition by partition
        seconds = float(np.median(both[..., 1], axis=1).mean())
        print(f"{method:<20}{100 * accuracy:9.1f}{1e3 * seconds:14.3f}", flush=True)
        found[method] = {"accuracy": accuracy, "features_s": seconds}
    return {"data": how, "methods": found}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER", help="recordings, a data set each")
    parser.add_argument("--seeds", type=int, default=4, metavar="N", help="draws of the folds (default 4)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write JSON")
    options = parser.parse_args()
    made = about(PACKAGES)
    folders = {folder.resolve().name: run(folder, options.seeds) for folder in options.folders}
    if options.out:
        write_json(options.out, {"made": made, "seeds": options.seeds, "folders": folders})


if __name__ == "__main__":
    main()
