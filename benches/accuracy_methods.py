"""Methods that `accuracy.py` compares: ours by the names they have in the package, and their peers.

A method makes two scikit-learn estimators: one from recordings (n, T, C) to features, one from features to labels.
Everything runs on one thread.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.ensemble import RandomForestClassifier
from sklearn.linear_model import RidgeClassifierCV
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import FunctionTransformer, StandardScaler
from sklearn.svm import SVC

import granular_id as gid
from granular_id import spaces

# -- ours -------------------------------------------------------------------------------------------------------------
# Add a candidate by name. One that the package does not have (yet) is reported as not available.

OURS: dict[str, tuple[str, ...]] = {
    "best": ("best",),
    "multiband+whitening": ("multiband", "BlockScaler", "WithinClassWhitening"),
    "multiband": ("multiband",),
    "raw+hfmh": ("raw+hfmh",),
    "hfmh": ("hfmh",),
    "raw": ("raw",),
}
"""Row to a key of `feature_spaces`, and classes of `granular_id.spaces` that follow it. Where none follow comes the
classifier that belongs to the space, which scales columns itself; else `ECOCClassifier`."""

RIDGE_ALPHAS = np.logspace(-3, 3, 10)
"""Of all ridge classifiers, as aeon's own."""
TREES = 200
"""Of the forest behind Catch22, as aeon's own."""
HYDRA_BATCH = 64
"""Recordings that Hydra takes at a time: all at once fill the memory."""
SHORTEST = 9
"""Samples that a convolution kernel of the peers spans; one more where differences are taken."""


class NotAvailableError(RuntimeError):
    """A method that cannot run here; the message says why."""


@dataclass(frozen=True)
class Setting:
    """What a method may know before it sees recordings: rate in Hz, samples T, seed."""

    rate_hz: float
    n_samples: int
    seed: int = 0


Stages = tuple[Any, Any]


@dataclass(frozen=True)
class Method:
    """One row of the table.

    Attributes
    ----------
    name : str
        For ``--only``.
    what : str
        Features and classifier in words.
    make : callable
        From a `Setting` to features and classifier, not fitted.
    ours : bool
    needs : tuple of str
        Modules that must be installed.
    least : int
        Samples that a recording must have.
    """

    name: str
    what: str
    make: Callable[[Setting], Stages]
    ours: bool = False
    needs: tuple[str, ...] = ()
    least: int = 1

    def stages(self, setting: Setting) -> Stages:
        """Make features and classifier, or raise `NotAvailableError`."""
        missing = [module for module in self.needs if find_spec(module) is None]
        if missing:
            raise NotAvailableError(f"{' and '.join(missing)} not installed: see requirements-bench.txt")
        if setting.n_samples < self.least:
            raise NotAvailableError(
                f"needs at least {self.least} samples, recordings have {setting.n_samples}"
            )
        return self.make(setting)


class AxisScaler(TransformerMixin, BaseEstimator):
    """Recordings (n, T, C) less the mean, over the standard deviation, of each axis over all training samples."""

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


class OurFeatures(TransformerMixin, BaseEstimator):
    """A feature space and steps behind it, which are told how many columns each block of the space has."""

    def __init__(self, space, steps=()):
        self.space = space
        self.steps = steps

    def fit_transform(self, X, y=None):
        rows = self.space.fit(X, y).transform(X)
        for step in self.steps:
            self.tell_blocks(step)
            rows = step.fit(rows, y).transform(rows)
        return rows

    def fit(self, X, y=None):
        self.fit_transform(X, y)
        return self

    def transform(self, X):
        rows = self.space.transform(X)
        for step in self.steps:
            rows = step.transform(rows)
        return rows

    def tell_blocks(self, estimator):
        """Name the blocks of columns to an estimator that asks for them."""
        spaces.tell_blocks(estimator, spaces.block_sizes(self.space))


def _our_space(names: tuple[str, ...]) -> Callable[[Setting], Stages]:
    def make(setting: Setting) -> Stages:
        # The paper's bins, +-1.5 N, are those of one sensor and one tool: here they are learned from training rows.
        known = spaces.feature_spaces(rate_hz=setting.rate_hz, bin_range="auto", threads=1)
        if names[0] not in known:
            raise NotAvailableError(f"feature_spaces() has no {names[0]!r}")
        least_hz = 2 * spaces.HFMH().cutoff_hz
        if "hfmh" in names[0] and setting.rate_hz <= least_hz:
            raise NotAvailableError(f"needs more than {least_hz:g} Hz, recordings have {setting.rate_hz:g}")
        space, steps = known[names[0]], []
        for name in names[1:]:
            if not hasattr(spaces, name):
                raise NotAvailableError(f"granular_id.spaces has no {name}")
            steps.append(getattr(spaces, name)())
        # A classifier of a space standardises columns: behind whitening that would undo a part of it.
        own = None if steps else space.classifier
        return OurFeatures(space.transformer, steps), own or gid.ECOCClassifier()

    return make


def _aeon(module: str, name: str, **settings: Any) -> Any:
    return getattr(import_module(f"aeon.transformations.collection.{module}"), name)(n_jobs=1, **settings)


def _rocket(name: str) -> Callable[[Setting], Stages]:
    def make(setting: Setting) -> Stages:
        rocket = AxesFirst(_aeon("convolution_based", name, random_state=setting.seed))
        return Pipeline([("features", rocket), ("scale", StandardScaler(with_mean=False))]), _ridge()

    return make


def _hydra(setting: Setting) -> Stages:
    hydra = _aeon("convolution_based", "HydraTransformer", random_state=setting.seed, output_type="numpy")
    return make_pipeline(AxesFirst(hydra, batch=HYDRA_BATCH), SparseScaler()), _ridge()


def _catch22(setting: Setting) -> Stages:
    catch22 = _aeon("feature_based", "Catch22", catch24=True, outlier_norm=True, replace_nans=True)
    return AxesFirst(catch22, dtype=np.float64), RandomForestClassifier(
        TREES, random_state=setting.seed, n_jobs=1
    )


def _ridge() -> RidgeClassifierCV:
    return RidgeClassifierCV(alphas=RIDGE_ALPHAS)


def _rows(X: np.ndarray) -> np.ndarray:
    return X.reshape(len(X), -1)


def _spectrum(X: np.ndarray) -> np.ndarray:
    return _rows(np.abs(np.fft.rfft(X, axis=1)))


def _svm(features: Callable[[np.ndarray], np.ndarray]) -> Callable[[Setting], Stages]:
    def make(_setting: Setting) -> Stages:
        return make_pipeline(FunctionTransformer(features), StandardScaler()), SVC(kernel="linear")

    return make


def _nearest(_setting: Setting) -> Stages:
    return make_pipeline(AxisScaler(), FunctionTransformer(_rows)), KNeighborsClassifier(1, algorithm="brute")


METHODS: tuple[Method, ...] = (
    *(Method(name, ", ".join(steps), _our_space(steps), ours=True) for name, steps in OURS.items()),
    Method("minirocket", "MiniRocket, ridge", _rocket("MiniRocket"), needs=("aeon",), least=SHORTEST),
    Method("multirocket", "MultiRocket, ridge", _rocket("MultiRocket"), needs=("aeon",), least=SHORTEST + 1),
    Method("hydra", "Hydra, ridge", _hydra, needs=("aeon", "torch"), least=SHORTEST),
    Method("catch22+rf", f"Catch22 with mean and SD, {TREES} trees", _catch22, needs=("aeon",)),
    Method("1nn", "nearest neighbour, Euclidean, axes standardised", _nearest),
    Method("dft+svm", "abs(DFT), standardised, linear SVM", _svm(_spectrum)),
    Method("raw+svm", "samples, standardised, linear SVM", _svm(_rows)),
)
"""All rows, ours first; the first that ran is what the others are compared with."""


def chosen_methods(only: str | None, reference: str | None = None) -> list[Method]:
    """Methods by names separated by commas; ``"ours"`` and ``"peers"`` stand for all of a kind, None for all.

    `reference`, if any, must be among them.

    Raises
    ------
    ValueError
        An unknown name; the message lists those that are known.
    """
    wanted = {"ours", "peers"} if only is None else {word.strip() for word in only.split(",")}
    known = {method.name for method in METHODS} | {"ours", "peers"}
    unknown = sorted(wanted - known)
    if unknown:
        listed = ", ".join(["ours", "peers", *(method.name for method in METHODS)])
        raise ValueError(f"--only got {unknown[0]!r}, wanted names among {listed}")
    chosen = [m for m in METHODS if m.name in wanted or ("ours" if m.ours else "peers") in wanted]
    if reference is not None and reference not in {m.name for m in chosen}:
        listed = ", ".join(m.name for m in chosen)
        raise ValueError(f"--reference got {reference!r}, wanted a method of this run: {listed}")
    return chosen
