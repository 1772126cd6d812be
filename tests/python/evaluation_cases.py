"""Small data sets for the tests of the evaluation."""

import numpy as np

from granular_id.recording import Dataset, Recording

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
    same = ("rate_hz", "label", "session", "start_time", "name")
    return Dataset(
        [
            Recording(
                r.wrench, **{**{f: getattr(r, f) for f in same}, **{f: get(r) for f, get in fields.items()}}
            )
            for r in data
        ]
    )


SMALL = {
    "n_partitions": 3,
    "train_per_class": 6,
    "test_per_class": 3,
    "n_folds": 3,
    "controls": False,
    "progress": False,
}
THREE = ("raw+hfmh", "hfmh", "raw")


def flat(X):
    return X.reshape(len(X), -1)
