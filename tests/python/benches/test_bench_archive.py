"""`benches/archive.py` and its peers: the same features on both sides, and what is measured of a process."""

import importlib
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import granular_id as gid

BENCHES = Path(__file__).resolve().parents[3] / "benches"
NAMES = ("archive_peer", "archive")


@pytest.fixture(scope="module")
def bench():
    """The modules of the bench by name."""
    for needed in ("pandas", "distributed", "psutil"):
        pytest.importorskip(needed, exc_type=ImportError)
    sys.path.insert(0, str(BENCHES))
    yield {name: importlib.import_module(name) for name in NAMES}
    sys.path.remove(str(BENCHES))
    for name in NAMES:
        del sys.modules[name]


@pytest.fixture(scope="module")
def data():
    """Few recordings of some materials."""
    return gid.synthesize(["rice", "dry peas"], n_per_class=3, seed=1)


@pytest.fixture(scope="module")
def folder(data, tmp_path_factory):
    """They, as an archive."""
    return gid.save(data, tmp_path_factory.mktemp("bench") / "archive", "parquet")


@pytest.mark.parametrize("name", ["one_by_one", "by_row_group", "counted_at_once"])
def test_peers_make_the_features_that_they_are_beside(bench, data, name):
    assert np.array_equal(
        getattr(bench["archive_peer"], name)(data.X), gid.extract_features(data.X)[:, 9600:]
    )


def test_a_peer_writes_a_row_per_recording(bench, folder, tmp_path):
    import pandas as pd

    peer = bench["archive_peer"]
    peer.extract_file(folder / "samples" / "part-00000.parquet", tmp_path, peer.by_row_group)
    assert pd.read_parquet(tmp_path / "part-00000.parquet").shape == (6, 600)


def test_bare_decoding_gives_the_samples(bench, data, folder):
    peer = bench["archive_peer"]
    found = [peer.array_of(table) for table in peer.tables(folder / "samples" / "part-00000.parquet")]
    assert np.array_equal(np.concatenate(found), data.X)


def test_pieces_are_the_same_in_every_run(bench, tmp_path, monkeypatch):
    monkeypatch.setattr(bench["archive"], "PIECE", 44)
    first, again = (gid.load(bench["archive"].piece(tmp_path / name, 3)) for name in ("a", "b"))
    assert list(first) == list(again)
    assert len(set(first.sessions)) == 4
    assert len(set(first.y)) == 11


def grown(n_bytes):
    return {"seconds": 1.0, "sum": int(np.ones(n_bytes, np.uint8).sum())}


def test_a_measurement_has_the_peak_of_its_process(bench):
    found = bench["archive"].measured(partial(grown, 200_000_000))
    assert found["sum"] == 200_000_000
    assert found["rss"] >= found["anonymous"] > 0
