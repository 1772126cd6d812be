"""Samples, features and scalar products in temporary files give what they give in memory, to the last bit."""

import errno
import os
import tempfile

import numpy as np
import pytest
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.pipeline import make_pipeline

import granular_id as gid
from evaluation_cases import make_data
from granular_id import _memory
from granular_id._checks import locked
from granular_id.evaluation.report_data import by_columns
from granular_id.identifier import Identifier
from granular_id.recording import Recording
from granular_id.score import _features
from granular_id.spaces import feature_spaces

SPACES = ("raw+hfmh", "dft", "raw-histogram", "multiband")


@pytest.fixture(scope="module")
def data():
    return make_data(n=12, samples=200)


@pytest.fixture
def small(monkeypatch, tmp_path):
    """Everything is large, and worked on in many pieces."""
    monkeypatch.setenv(_memory.LARGE_ARRAY_MB, "0.02")
    monkeypatch.setattr(_memory, "_PIECE_BYTES", 50_000)
    monkeypatch.setattr(_memory, "_file_system", lambda folder: "ext4")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))


def in_file(array):
    while isinstance(array, np.ndarray):
        array = array.base
    return isinstance(array, _memory.TemporaryMap)


def figures(result):
    """All that a result says, but for how long it took."""

    def plain(value):
        if isinstance(value, dict):
            return {key: plain(one) for key, one in value.items() if key not in ("seconds", "wall_s")}
        return list(map(plain, value)) if isinstance(value, list) else value

    return plain(result.to_dict())


def evaluated(data):
    return figures(gid.evaluate(data, SPACES, progress=False))


@pytest.fixture(scope="module")
def in_memory(data):
    return evaluated(data)


def test_an_evaluation_says_the_same(data, in_memory, small):
    assert evaluated(data) == in_memory


def test_samples_of_an_archive_lie_in_a_file(data, in_memory, small, tmp_path):
    loaded = gid.load(gid.save(data, tmp_path / "archive", "parquet"))
    assert in_file(loaded.X)
    same = ("spaces", "baselines")
    said = evaluated(loaded)
    assert [said[key] for key in same] == [in_memory[key] for key in same]


def test_a_model_has_the_same_bytes(data, request):
    before = Identifier.fit(data, "raw+hfmh", target_error=None).core.to_bytes()
    request.getfixturevalue("small")
    assert Identifier.fit(data, "raw+hfmh", target_error=None).core.to_bytes() == before


@pytest.mark.parametrize("name", ["norm-raw+hfmh", "raw+dft", "dft"])
def test_features_made_in_pieces_are_the_same(data, name, request):
    space = feature_spaces(rate_hz=500)[name].transformer
    before = _features(space, data.X, name)
    request.getfixturevalue("small")
    np.testing.assert_array_equal(_features(space, data.X, name), before)


class Means(TransformerMixin, BaseEstimator):
    """A step of somebody else's, of recordings (n, T, C)."""

    def fit(self, X, y=None):
        self.n_axes_ = X.shape[2]
        return self

    def transform(self, X):
        return X.mean(axis=1)


def test_recordings_that_were_filtered_go_on_to_steps_of_others(data, request):
    transformer = make_pipeline(gid.Tare(rate_hz=500), Means())
    before = _features(transformer, data.X, "tared means")
    request.getfixturevalue("small")
    np.testing.assert_array_equal(_features(transformer, data.X, "tared means"), before)


@pytest.mark.parametrize("statistic", [np.mean, np.std])
@pytest.mark.parametrize("shape", [(300, 40, 6), (300, 61, 1), (3000, 1, 1)])
def test_statistics_over_recordings_are_the_same(statistic, shape, small):
    X = np.random.default_rng(0).normal(size=shape)
    rows = np.arange(0, len(X), 3)
    np.testing.assert_array_equal(by_columns(statistic, X, rows), statistic(X[rows], axis=0))


def test_recordings_that_were_cropped_are_gathered_in_a_file(data, small):
    assert in_file(data.align(150).X)


def test_recordings_in_a_file_are_not_copied_again(small):
    samples = _memory.stacked([np.ones(6)] * 5000, "samples")
    samples.flags.writeable = False
    assert locked(samples[:100]).base is samples
    assert Recording(samples[:100], rate_hz=500).wrench.base is samples


def test_no_file_can_be_seen_or_is_left(small, tmp_path):
    array = _memory.stacked([np.ones(6)] * 5000, "samples")
    assert array.sum() == 30_000
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not hasattr(os, "posix_fallocate"), reason="takes the room in another way")
def test_a_disk_without_room_for_an_array_is_told(small, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(OSError, match="the samples: temporary files of 8e-05 GB"):
        _memory.empty((10, 1000), "the samples")


def test_temporary_files_in_memory_are_told(small, monkeypatch):
    monkeypatch.setattr(_memory, "_file_system", lambda folder: "tmpfs")
    with pytest.warns(UserWarning, match=r"take memory, too \(tmpfs\): set TMPDIR"):
        _memory.empty((10, 1000), "the samples")


@pytest.mark.parametrize("stated", ["many", "0", "-1", "inf", "nan"])
def test_the_limit_is_a_number(stated, monkeypatch):
    monkeypatch.setenv(_memory.LARGE_ARRAY_MB, stated)
    with pytest.raises(ValueError, match=f"GRANULAR_ID_LARGE_ARRAY_MB='{stated}' must be a positive number"):
        _memory.large_bytes()


def test_without_a_limit_it_is_an_eighth_of_the_memory(monkeypatch):
    monkeypatch.delenv(_memory.LARGE_ARRAY_MB, raising=False)
    monkeypatch.setattr(_memory, "_memory_bytes", lambda: 16 << 30)
    assert _memory.large_bytes() == 2 << 30


def test_limits_of_control_groups_count_up_to_the_root(tmp_path):
    own, root = tmp_path / "cgroup", tmp_path / "fs"
    job = root / "slurm" / "job_1"
    job.mkdir(parents=True)
    (job / "memory.max").write_text("max\n")
    (root / "slurm" / "memory.max").write_text("4000\n")
    own.write_text("0::/slurm/job_1\n")
    assert list(_memory._limits(own, root)) == [4000]


def test_limits_of_old_control_groups_count(tmp_path):
    own, root = tmp_path / "cgroup", tmp_path / "fs"
    (root / "memory" / "job").mkdir(parents=True)
    (root / "memory" / "job" / "memory.limit_in_bytes").write_text("5000\n")
    own.write_text("3:memory:/job\n2:cpu:/job\n")
    assert list(_memory._limits(own, root)) == [5000]
