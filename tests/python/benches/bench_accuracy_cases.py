"""What the tests of ``benches/accuracy.py`` share: its modules, and small sets of recordings."""

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

import granular_id as gid
from granular_id.recording import Dataset, Recording

BENCHES = Path(__file__).resolve().parents[3] / "benches"
NAMES = (
    "accuracy",
    "accuracy_data",
    "accuracy_methods",
    "accuracy_peers",
    "accuracy_run",
    "accuracy_stages",
    "accuracy_table",
)


@pytest.fixture(scope="module")
def bench():
    """The modules of the bench by name, without the prefix."""
    sys.path.insert(0, str(BENCHES))
    yield {name.removeprefix("accuracy_"): importlib.import_module(name) for name in NAMES}
    sys.path.remove(str(BENCHES))
    for name in NAMES:
        del sys.modules[name]


LEVELS = {"oat": 0.0, "peas": 1.0, "rice": 2.0}


def recordings(n_per_class=4, n_samples=20, sessions=0, rate_hz=50.0):
    """Materials that differ in level; sessions are dealt out in turn."""
    rng = np.random.default_rng(0)
    return Dataset(
        [
            Recording(
                level + rng.normal(scale=0.1, size=(n_samples, 6)),
                rate_hz=rate_hz,
                label=label,
                session=f"s{k % sessions}" if sessions else None,
                name=f"{label}_{k}",
            )
            for label, level in LEVELS.items()
            for k in range(n_per_class)
        ]
    )


def split(bench, data, how="auto", *, asks="auto", **options):
    return bench["data"].split(bench["data"].BenchSet("a", "a", data, split=asks), how, **options)


def saved(tmp_path, data, name="set"):
    folder = tmp_path / name
    gid.save(data, folder, format="csv")
    return folder
