"""Features of archives: the bits of the transformers, what is refused, and how they come into scikit-learn."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sklearn.base import BaseEstimator
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer

import granular_id as gid
from archive_cases import partitions_in, poison, small_partitions, some_archive, some_recordings
from granular_id.archive import Features, PartitionError, extract
from granular_id.recording import Dataset

pq = pytest.importorskip("pyarrow.parquet")


@pytest.fixture(autouse=True)
def partitions_of_four(monkeypatch):
    small_partitions(monkeypatch)
    monkeypatch.setattr("granular_id.archive.work._LEAST_ROWS", 1)


@pytest.fixture(scope="module")
def archive(tmp_path_factory) -> Path:
    """24 recordings of 60 samples at 500 Hz, in row groups of 2."""
    return some_archive(tmp_path_factory.mktemp("archives") / "archive")


@pytest.fixture
def out(tmp_path) -> Path:
    return tmp_path / "out"


def features_of(archive, out, space=None, **options) -> Features:
    extract(archive, out, space, progress=False, **options)
    return Features(out)


SPACES = [
    "raw+hfmh",
    "norm-raw+hfmh",
    "norm-raw",
    "hfmh",
    "raw+dft",
    "norm-raw+dft",
    "dft",
    "raw",
    "time-permuted",
]
OWN = {
    "hfmh of its own": gid.HFMH(cutoff_hz=40, n_bins=7, bin_range=(-1, 2), initial="steady"),
    "weighed": gid.RawHFMH(block_weights=(2.0, 0.5)),
    "raw histogram": gid.RawHistogram(n_bins=9, bin_range=(-1, 1)),
    "tare": make_pipeline(gid.Tare(0.02), gid.HFMH(n_bins=5)),
}


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("space", [*SPACES, *OWN])
def test_every_space_has_the_bits_of_its_transformer(archive, out, space, dtype):
    data = some_recordings()
    transformer = OWN.get(space) or gid.feature_spaces()[space].transformer
    features = features_of(archive, out, OWN.get(space, space), dtype=dtype)
    wanted = np.asarray(transformer.fit_transform(data))
    assert features.X.dtype == dtype
    assert features.X.tobytes() == wanted.astype(dtype).tobytes()
    assert list(features.names) == list(transformer.get_feature_names_out())


@pytest.mark.parametrize("space", ["hfmh", "raw+hfmh", "multiband"])
def test_features_of_a_model_have_its_bits(archive, tmp_path, space):
    data = some_recordings()
    model = gid.Identifier.fit(data, space, estimate=False)
    model.save(tmp_path / "model.safetensors")
    features = features_of(archive, tmp_path / "out", model=tmp_path / "model.safetensors")
    spec = model.spec
    wanted = spec.extract(data.X) if space == "multiband" else gid.extract_features(data.X, spec=spec)
    assert features.X.tobytes() == wanted.tobytes()
    assert len(features.names) == wanted.shape[1]
    assert all(axis in "".join(features.names) for axis in ("fx", "tz"))


def test_a_space_that_leaves_the_rate_open_takes_that_of_the_archive(tmp_path, out):
    data = some_recordings(4, rate_hz=250.0)
    assert (gid.HFMH().fit_transform(data) == features_of(some_archive(tmp_path / "a", data), out).X).all()


def test_counts_need_no_one_length(tmp_path, out):
    data = some_recordings(0, [60, 60, 50, 70, 70, 70, 90])
    features = features_of(some_archive(tmp_path / "a", data, per_group=3), out)
    assert ([gid.extract_features(r.wrench, raw=False) for r in data] == features.X).all()


def test_other_axes_give_their_names(tmp_path, out):
    data = Dataset([replace(r, axes=("ax", "ay", "az", "wx", "wy", "wz")) for r in some_recordings(4)])
    features = features_of(some_archive(tmp_path / "a", data), out)
    assert features.names[0] == "hfmh_ax_00"
    assert (gid.HFMH().fit_transform(data) == features.X).all()


# How they come into scikit-learn.


def test_features_fit_a_classifier(archive, out):
    features, data = features_of(archive, out), some_recordings()
    classifier = gid.ECOCClassifier().fit(features.X, features.y)
    assert (
        classifier.predict(features.X) == gid.ECOCClassifier().fit(features.X, data.y).predict(features.X)
    ).all()
    assert features.y.tolist() == data.y.tolist()
    assert features.sessions.tolist() == data.sessions.tolist()
    assert features.recordings["name"].to_pylist() == list(data.names)
    assert repr(features).endswith("out': 24 recordings, 600 features)")


def test_partitions_come_one_by_one(archive, out):
    features = features_of(archive, out)
    parts = list(features)
    assert [len(part) for part in parts] == [4] * 6
    assert (np.concatenate([part.X for part in parts]) == features.X).all()
    assert np.concatenate([part.y for part in parts]).tolist() == features.y.tolist()


def test_a_single_row_group_is_not_copied(tmp_path, out):
    features = features_of(some_archive(tmp_path / "a", some_recordings(2)), out)
    assert not features.X.flags.writeable
    assert features.X.shape == (2, 600)


def test_labels_that_are_missing_are_named(tmp_path, out):
    data = Dataset([replace(r, label=None if i == 2 else r.label) for i, r in enumerate(some_recordings(4))])
    features = features_of(some_archive(tmp_path / "a", data), out)
    with pytest.raises(ValueError, match="1 recording without a label, the first is 'push 2'"):
        features.y  # noqa: B018


def test_what_is_not_finished_is_refused(tmp_path, out):
    source = some_archive(tmp_path / "a")
    poison(source, 2)
    with pytest.raises(PartitionError):
        extract(source, out, progress=False)
    with pytest.raises(ValueError, match=r"1 partition failed, the first is .*row group 2.*partial=True"):
        Features(out)
    assert Features(out, partial=True).X.shape == (20, 600)
    (out / partitions_in(out)[0]).unlink()
    with pytest.raises(ValueError, match="is gone or cut off"):
        Features(out, partial=True)
    (out / "_manifest.json").write_text("{}")
    with pytest.raises(ValueError, match=r"_manifest.json is no manifest"):
        Features(out)
    (out / "_manifest.json").unlink()
    with pytest.raises(FileNotFoundError, match="the features are not finished"):
        Features(out)


def test_other_work_is_no_features(archive, out):
    features_of(archive, out)
    manifest = json.loads((out / "_manifest.json").read_bytes())
    manifest["spec"]["work"] = {"answers": {}}
    (out / "_manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(ValueError, match="holds no features, but answers"):
        Features(out)


def test_damaged_features_are_refused_with_their_file(archive, out):
    features = features_of(archive, out)
    path = out / partitions_in(out)[0]
    damaged = bytearray(path.read_bytes())
    column = pq.read_metadata(path).row_group(0).column(5)
    damaged[column.data_page_offset + column.total_compressed_size - 8] ^= 0xFF
    path.write_bytes(damaged)
    with pytest.raises(gid.RecordingFileError, match=path.name):
        features.X  # noqa: B018


def test_other_features_in_the_same_folder_are_refused(archive, out):
    features_of(archive, out, gid.HFMH(cutoff_hz=30))
    with pytest.raises(ValueError, match=r"holds other work already: cutoff_hz 30.0 there, 23.0 wanted"):
        extract(archive, out, progress=False)
    with pytest.raises(ValueError, match=r"dtype 'float64' there, 'float32' wanted"):
        extract(archive, out, gid.HFMH(cutoff_hz=30), dtype="float32", progress=False)


# What is refused before any work.


class Unnamed(BaseEstimator):
    learns = False

    def fit(self, X, y=None):
        return self

    def transform(self, X):
        return np.zeros((len(X), 2, 2))

    def get_feature_names_out(self):
        return ["a"]


class Nothing(Unnamed):
    """No features at all."""

    def transform(self, X):
        return np.zeros((len(X), 0))

    def get_feature_names_out(self):
        return []


@pytest.mark.parametrize(
    ("space", "said"),
    [
        ("spectral", "space must be one of 'raw\\+hfmh'"),
        ("multiband", "'multiband' learns from recordings: train a model"),
        ("raw-histogram", "learns from recordings.*RawHistogram may be told its range"),
        (gid.HFMH(bin_range="auto"), "HFMH learns from recordings"),
        (gid.HFMH, "space must be a name or a transformer"),
        (gid.HFMH(rate_hz=100.0), "rate_hz=100, but the recordings have 500 Hz"),
        (
            Unnamed(),
            r"must make one row of features of a recording.* of samples \(1, 60, 6\) came \(1, 2, 2\)",
        ),
        (Nothing(), r"came \(1, 0\) and 0 names"),
        (FunctionTransformer(), "space=FunctionTransformer must say by learns = False"),
    ],
)
def test_spaces_that_cannot_be_are_refused(archive, out, space, said):
    with pytest.raises((ValueError, TypeError), match=said):
        extract(archive, out, space, progress=False)
    assert not out.exists()


@pytest.mark.parametrize(
    ("changed", "space", "said"),
    [
        (
            some_recordings(0, [60, 60, 50]),
            "raw",
            "'push 2' has 50 samples, 'raw' wants 60 of each.*space='hfmh'",
        ),
        (
            Dataset([*some_recordings(2), replace(some_recordings(1, rate_hz=250)[0], name="slow")]),
            "hfmh",
            r"'slow' has 250 Hz, 'hfmh' wants 500 Hz: call .resample\(500\)",
        ),
        (
            Dataset([*some_recordings(2), replace(some_recordings(1, 3)[0], rate_hz=None, time_s=[0, 1, 4])]),
            "hfmh",
            "'push 0' is sampled irregularly, 'hfmh' wants 500 Hz",
        ),
        (
            Dataset([replace(some_recordings(1, 3)[0], rate_hz=None, time_s=[0, 1, 4])]),
            "hfmh",
            "'push 0' is sampled irregularly",
        ),
    ],
    ids=["lengths", "rates", "one irregular", "all irregular"],
)
def test_recordings_that_do_not_suit_are_named(tmp_path, out, changed, space, said):
    with pytest.raises(ValueError, match=said):
        extract(some_archive(tmp_path / "a", changed), out, space, progress=False)
    assert not out.exists()


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (some_recordings(4, 70), "'push 0' has 70 samples, the hfmh features of the model want 60"),
        (some_recordings(4, rate_hz=250), "'push 0' has 250 Hz, the model was trained at 500 Hz"),
        (
            some_recordings(4).select(axes=("fy", "fx", "fz", "tx", "ty", "tz")),
            r"call .select\(axes=\['fx', 'fy'",
        ),
    ],
)
def test_a_model_of_other_recordings_is_refused(tmp_path, out, data, said):
    model = gid.Identifier.fit(some_recordings(), "hfmh", estimate=False)
    with pytest.raises(ValueError, match=said):
        extract(some_archive(tmp_path / "a", data), out, model=model, progress=False)


def test_a_model_of_another_set_up_is_refused_unless_it_is_accepted(tmp_path, out):
    def framed(frame):
        return Dataset([replace(one, meta={"frame": frame}) for one in some_recordings()])

    model = gid.Identifier.fit(framed("flange"), "hfmh", estimate=False)
    archive = some_archive(tmp_path / "a", framed("base"))
    with pytest.raises(ValueError, match=r"frame 'base', in training 'flange'.*accept=\('frame',\)"):
        extract(archive, out, model=model, progress=False)
    with pytest.warns(UserWarning, match="frame 'base', in training 'flange'"):
        assert extract(archive, out, model=model, accept="frame", progress=False).n_recordings == 24


class Own(Unnamed):
    """One feature of each recording."""

    def __init__(self, make=None):
        self.make = make

    def get_params(self, deep=True):
        return {"make": self.make}

    def set_params(self, **params):
        return self

    def transform(self, X):
        X = np.asarray(X)
        return X.mean(axis=(1, 2))[:, None] if self.make is None or not X.any() else self.make(X)


def test_a_transformer_of_ones_own_is_taken(archive, out):
    extract(archive, out, Own(), progress=False)
    expected = [[one.wrench[None].mean(axis=(1, 2))[0]] for one in some_recordings()]
    assert Features(out).X.tolist() == expected


@pytest.mark.parametrize(
    "make",
    [
        lambda X: np.full((len(X), 1), np.nan),
        lambda X: np.zeros((len(X) + 1, 1)),
        lambda X: np.zeros((len(X), 1), complex),
    ],
    ids=["NaN", "rows", "complex"],
)
def test_what_is_no_feature_fails(archive, out, make):
    with pytest.raises(
        gid.archive.PartitionError, match=r"Own must make finite real features of shape \(2, 1\), got"
    ):
        extract(archive, out, Own(make), progress=False)


def test_a_damaged_partition_says_how_it_is_mended(archive, out):
    features_of(archive, out)
    path = out / partitions_in(out)[0]
    damaged = bytearray(path.read_bytes())
    damaged[len(damaged) // 3] ^= 0xFF
    path.write_bytes(damaged)
    with pytest.raises(gid.io.RecordingFileError, match="remove it, and run the same extraction again"):
        _ = Features(out).X


def test_features_do_not_go_into_the_archive(archive):
    for out in (archive, archive / "features"):
        with pytest.raises(ValueError, match=r"out=.* is or lies in the archive"):
            extract(archive, out, progress=False)


def test_a_model_has_its_own_space(archive, out):
    model = gid.Identifier.fit(some_recordings(), "hfmh", estimate=False)
    with pytest.raises(ValueError, match="space is that of the model: give one of both"):
        extract(archive, out, "raw", model=model, progress=False)


@pytest.mark.parametrize("dtype", ["float16", "text", 3])
def test_other_numbers_are_refused(archive, out, dtype):
    with pytest.raises(ValueError, match="dtype must be 'float64' or 'float32', got"):
        extract(archive, out, dtype=dtype, progress=False)


@pytest.mark.parametrize("space", ["raw", "norm-raw", gid.RawHFMH(block_weights=(1e300, 1.0))])
def test_features_beyond_float32_are_an_error(tmp_path, out, space):
    data = Dataset([replace(r, wrench=r.wrench * 1e100) for r in some_recordings(2)])
    source = some_archive(tmp_path / "a", data)
    if space == "norm-raw":
        assert np.isfinite(features_of(source, out, space, dtype="float32").X).all()
        return
    with pytest.raises(PartitionError, match="float32"):
        extract(source, out, space, dtype="float32", progress=False)
