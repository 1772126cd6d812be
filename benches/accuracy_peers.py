"""The peers in `accuracy.py`: features of aeon and numpy, classifiers of scikit-learn, one thread each."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.ensemble import ExtraTreesClassifier, RandomForestClassifier
from sklearn.linear_model import RidgeClassifierCV
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import Pipeline, make_pipeline, make_union
from sklearn.preprocessing import FunctionTransformer, StandardScaler
from sklearn.svm import SVC

from accuracy_stages import Setting, Stages

RIDGE_ALPHAS = np.logspace(-3, 3, 10)
"""Of all ridge classifiers, as aeon's own."""
TREES = 200
"""Of the forests behind Catch22 and QUANT, as aeon's own."""
BATCH = 64
"""Recordings that Hydra and QUANT take at a time: all at once fill the memory, or are refused."""
SHORTEST = 9
"""Samples that a convolution kernel of the peers spans; one more where differences are taken."""


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


def _aeon(module: str, name: str, **settings: Any) -> Any:
    return getattr(import_module(f"aeon.transformations.collection.{module}"), name)(**settings)


def rocket(name: str) -> Callable[[Setting], Stages]:
    def make(setting: Setting) -> Stages:
        features = AxesFirst(_aeon("convolution_based", name, n_jobs=1, random_state=setting.seed))
        return Pipeline([("features", features), ("scale", StandardScaler(with_mean=False))]), _ridge()

    return make


def hydra(setting: Setting) -> Stages:
    features = _aeon(
        "convolution_based", "HydraTransformer", n_jobs=1, random_state=setting.seed, output_type="numpy"
    )
    return make_pipeline(AxesFirst(features, batch=BATCH), SparseScaler()), _ridge()


def multirocket_hydra(setting: Setting) -> Stages:
    return make_union(hydra(setting)[0], rocket("MultiRocket")(setting)[0]), _ridge()


def quant(setting: Setting) -> Stages:
    """Transformer and trees of QUANT (Dempster et al. 2024), as aeon's classifier joins them."""
    import_module("torch").set_num_threads(1)
    trees = ExtraTreesClassifier(
        TREES, max_features=0.1, criterion="entropy", random_state=setting.seed, n_jobs=1
    )
    return AxesFirst(_aeon("interval_based", "QUANTTransformer"), batch=BATCH), trees


def catch22(setting: Setting) -> Stages:
    features = _aeon("feature_based", "Catch22", n_jobs=1, catch24=True, outlier_norm=True, replace_nans=True)
    return AxesFirst(features, dtype=np.float64), RandomForestClassifier(
        TREES, random_state=setting.seed, n_jobs=1
    )


def _ridge() -> RidgeClassifierCV:
    return RidgeClassifierCV(alphas=RIDGE_ALPHAS)


def samples(X: np.ndarray) -> np.ndarray:
    return X.reshape(len(X), -1)


def spectrum(X: np.ndarray) -> np.ndarray:
    return samples(np.abs(np.fft.rfft(X, axis=1)))


def svm(features: Callable[[np.ndarray], np.ndarray]) -> Callable[[Setting], Stages]:
    def make(_setting: Setting) -> Stages:
        return make_pipeline(FunctionTransformer(features), StandardScaler()), SVC(kernel="linear")

    return make


def nearest(_setting: Setting) -> Stages:
    return make_pipeline(AxisScaler(), FunctionTransformer(samples)), KNeighborsClassifier(
        1, algorithm="brute"
    )
