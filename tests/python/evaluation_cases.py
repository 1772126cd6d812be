"""Small data sets for the tests of the evaluation."""

from dataclasses import replace

import numpy as np
from sklearn.base import BaseEstimator, ClassifierMixin

from granular_id.recording import Dataset, Recording
from granular_id.score import Held
from granular_id.splits import Fold, Folds

LABELS = ("oat", "peas", "rice", "sugar")


def make_data(n=10, samples=80, separation=0.35, seed=0, **fields):
    """Recordings whose mean and roughness depend on the material, hard enough for mistakes."""
    rng = np.random.default_rng(seed)
    recordings = []
    for k, label in enumerate(LABELS):
        for i in range(n):
            wrench = rng.normal(separation * k * rng.normal(1, 0.5), 0.3 + 0.1 * k, (samples, 6))
            own = {
                "session": f"{label} day {i % 2}",
                "start_time": 1e9 + 60.0 * (i * len(LABELS) + k),
                "label": label,
                **fields,
            }
            recordings.append(Recording(wrench, rate_hz=500.0, name=f"{label}_{i}", **own))
    return Dataset(recordings)


def changed(data, **fields):
    """The same recordings with some fields computed anew, each by a function of the recording."""
    return Dataset([replace(r, **{field: get(r) for field, get in fields.items()}) for r in data])


QUIET = {"baselines": False, "progress": False}
THREE = ("raw+hfmh", "hfmh", "raw")


def flat(X):
    return X.reshape(len(X), -1)


class Centroids(ClassifierMixin, BaseEstimator):
    """Nearest class mean: trains in no time."""

    def fit(self, X, y):
        self.classes_ = np.unique(y)
        self.means_ = np.stack([X[y == k].mean(axis=0) for k in self.classes_])
        return self

    def decision_function(self, X):
        values = 2 * X @ self.means_.T - (self.means_**2).sum(axis=1)
        return values[:, 1] - values[:, 0] if len(self.classes_) == 2 else values

    def predict(self, X):
        return self.classes_[(2 * X @ self.means_.T - (self.means_**2).sum(axis=1)).argmax(axis=1)]


def of_levels(levels, labels, sessions, **fields):
    """Recordings of eight samples that hold a level (n, C) of each; `fields` have a value for each recording."""
    return Dataset(
        [
            Recording(
                np.tile(level, (8, 1)) + 1e-6 * np.arange(8)[:, np.newaxis],
                500.0,
                label=str(label),
                session=session,
                name=f"{k}",
                **{name: values[k] for name, values in fields.items()},
            )
            for k, (level, label, session) in enumerate(zip(levels, labels, sessions, strict=True))
        ]
    )


TOOLS = ("wide", "thin", "long")


def with_tools(**meta):
    """Twelve recordings of each material, four with each tool; a tool has sessions of its own."""
    tools = [TOOLS[k % 12 // 4] for k in range(48)]
    return Dataset(
        [
            replace(
                r,
                session=f"{tool} {k % 2}",
                meta={"source": {"tool": tool}, **{name: of(k, tool) for name, of in meta.items()}},
            )
            for k, (r, tool) in enumerate(zip(make_data(n=12), tools, strict=True))
        ]
    )


def held(right, truth, sessions):
    """Answers about recordings of two materials, in one fold."""
    right, truth, sessions = (
        np.asarray(right, dtype=bool),
        np.asarray(truth),
        np.asarray(sessions, dtype=object),
    )
    rows = np.arange(truth.size)
    return Held(
        classes=("m0", "m1"),
        rows=rows,
        fold=np.zeros(truth.size, dtype=np.intp),
        truth=truth,
        predicted=np.where(right, truth, 1 - truth),
        values=np.zeros((truth.size, 2)),
        sessions=sessions,
        clusters=sessions,
        folds=Folds("session", (Fold(rows[:0], rows, "all"),)),
    )
