"""Features of archives: the bits of the transformers, what is refused, and how they come into scikit-learn."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import granular_id as gid
from archive_cases import small_partitions, some_archive, some_recordings
from granular_id.archive import Features, extract
from granular_id.recording import Dataset


@pytest.fixture(autouse=True)
def partitions_of_four(monkeypatch):
    small_partitions(monkeypatch)


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


@pytest.mark.parametrize(("space", "rate_hz"), [("hfmh", 250.0), ("raw+hfmh", 500.0), ("raw", 250.0)])
def test_space_has_the_bits_of_its_transformer(tmp_path, out, space, rate_hz):
    data = some_recordings(6, rate_hz=rate_hz)
    transformer = gid.feature_spaces(rate_hz=rate_hz)[space].transformer
    features = features_of(some_archive(tmp_path / "a", data), out, space)
    assert features.X.tobytes() == np.asarray(transformer.fit_transform(data)).tobytes()
    assert list(features.names) == list(transformer.get_feature_names_out())


def test_spec_has_the_bits_of_extract_features(archive, out, tmp_path):
    spec = gid.FeatureSpec(cutoff_hz=40, n_bins=7, bin_range=(-1, 2), raw=False)
    features = features_of(archive, out, spec)
    assert features.X.tobytes() == gid.extract_features(some_recordings().X, spec=spec).tobytes()
    with pytest.raises(ValueError, match=r"holds other work already: cutoff_hz 40.0 there, 23.0 wanted"):
        extract(archive, out, progress=False)
    with pytest.raises(ValueError, match="'push 0' has 500 Hz, features of this spec want 250 Hz"):
        extract(archive, tmp_path / "slow", gid.FeatureSpec(rate_hz=250), progress=False)


@pytest.mark.parametrize("space", ["raw+hfmh", "multiband"])
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


def test_counts_need_no_one_length_and_axes_give_names(tmp_path, out):
    data = some_recordings(0, [60, 60, 50, 70, 70, 70, 90])
    data = Dataset([replace(r, axes=("ax", "ay", "az", "wx", "wy", "wz")) for r in data])
    features = features_of(some_archive(tmp_path / "a", data, per_group=3), out)
    assert ([gid.extract_features(r.wrench, raw=False) for r in data] == features.X).all()
    assert features.names[0] == "hfmh_ax_00"


def test_features_fit_a_classifier(archive, out):
    features, data = features_of(archive, out), some_recordings()
    assert gid.ECOCClassifier().fit(features.X, features.y).predict(features.X).tolist() == data.y.tolist()
    assert features.y.tolist() == data.y.tolist()
    assert features.sessions.tolist() == data.sessions.tolist()
    assert features.recordings["name"].to_pylist() == list(data.names)
    assert repr(features) == f"Features({str(out)!r}: 24 recordings)"


def test_labels_that_are_missing_are_named(tmp_path, out):
    two, three = some_recordings(2), replace(some_recordings(3)[2], label=None)
    features = features_of(some_archive(tmp_path / "a", Dataset([*two, three])), out)
    with pytest.raises(ValueError, match="1 recording without a label, the first is 'push 2'"):
        features.y  # noqa: B018


IRREGULAR = replace(some_recordings(1, 3)[0], rate_hz=None, time_s=[0, 1, 4])
SLOW = replace(some_recordings(1, rate_hz=250)[0], name="slow")


@pytest.mark.parametrize(
    ("data", "space", "message"),
    [
        (some_recordings(2), "spectral", "space='spectral' is none of 'hfmh', 'raw"),
        (some_recordings(2), "multiband", "for what a space learns from recordings, train a model"),
        (some_recordings(0, [60, 60, 50]), "raw", "'push 2' has 50 samples, 'raw' features want 60 of each"),
        (Dataset([*some_recordings(2), SLOW]), "hfmh", r"'slow' has 250 Hz, .* call .resample\(500\)"),
        (Dataset([*some_recordings(2), IRREGULAR]), "hfmh", "is sampled irregularly, .* want 500 Hz"),
        (Dataset([IRREGULAR]), "hfmh", "'push 0' is sampled irregularly"),
    ],
    ids=["unknown", "learns", "lengths", "rates", "one irregular", "all irregular"],
)
def test_space_that_does_not_suit_is_refused(tmp_path, out, data, space, message):
    with pytest.raises(gid.GranularIdError, match=message):
        extract(some_archive(tmp_path / "a", data), out, space, progress=False)
    assert not out.exists()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (some_recordings(4, 70), "'push 0' has 70 samples, the hfmh features of the model want 60"),
        (some_recordings(4, rate_hz=250), "'push 0' has 250 Hz, the model was trained at 500 Hz"),
        (
            some_recordings(4).select(axes=("fy", "fx", "fz", "tx", "ty", "tz")),
            r"call .select\(axes=\['fx', ",
        ),
    ],
    ids=["lengths", "rates", "axes"],
)
def test_model_of_other_recordings_is_refused(tmp_path, out, data, message):
    model = gid.Identifier.fit(some_recordings(), "hfmh", estimate=False)
    with pytest.raises(gid.GranularIdError, match=message):
        extract(some_archive(tmp_path / "a", data), out, model=model, progress=False)
    with pytest.raises(gid.GranularIdError, match="space is that of the model: give one of both"):
        extract(tmp_path / "a", out, "raw", model=model, progress=False)


def test_model_of_another_setup_is_refused_unless_accepted(tmp_path, out):
    def framed(frame):
        return Dataset([replace(one, meta={"frame": frame}) for one in some_recordings()])

    model = gid.Identifier.fit(framed("flange"), "hfmh", estimate=False)
    archive = some_archive(tmp_path / "a", framed("base"))
    with pytest.raises(ValueError, match=r"frame 'base', in training 'flange'.*accept='frame'"):
        extract(archive, out, model=model, progress=False)
    with pytest.warns(UserWarning, match="frame 'base', in training 'flange'") as caught:
        assert extract(archive, out, model=model, accept="frame", progress=False).n_recordings == 24
    assert caught[0].filename == __file__
