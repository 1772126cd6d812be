"""evaluate: one clear error for each bad argument and each bad data set."""

import numpy as np
import pytest
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer, StandardScaler

from evaluation_cases import SMALL, changed, make_data
from granular_id.evaluation import evaluate
from granular_id.recording import Dataset, Recording
from granular_id.spaces import HFMH, RawHFMH, RawSignal, feature_spaces


@pytest.fixture(scope="module")
def data():
    return make_data()


def cut(data, **labels):
    return data.select(
        indices=[i for i, r in enumerate(data) if int(r.name.split("_")[1]) < labels.get(r.label, 99)]
    )


@pytest.mark.parametrize(
    ("change", "kind", "message"),
    [
        ({"data": np.zeros((4, 5, 6))}, TypeError, "data must be a granular_id.Dataset, got ndarray"),
        ({"spaces": "wavelets"}, ValueError, "spaces must be among 'all', 'paper', .*, got 'wavelets'"),
        ({"spaces": []}, ValueError, "at least one feature space, got none"),
        ({"spaces": ["raw", "raw"]}, ValueError, "each feature space once"),
        ({"spaces": {"mine": object()}}, TypeError, r"spaces\['mine'\] must have fit and transform"),
        ({"spaces": {"": StandardScaler()}}, TypeError, "a name must be non-empty text"),
        (
            {"spaces": {"flat": FunctionTransformer()}},
            ValueError,
            r"'flat' must give an array \(n, D\), got shape",
        ),
        (
            {"protocol": "leave-one-out"},
            ValueError,
            "protocol must be 'auto' or among 'paper', 'session', .*, got 'leave-one-out'",
        ),
        ({"protocol": []}, ValueError, "protocol must name one or more"),
        ({"protocol": ["paper", "paper"]}, ValueError, "each once"),
        ({"n_partitions": 0}, ValueError, "n_partitions must be at least 1, got 0"),
        ({"train_per_class": 1.5}, TypeError, "train_per_class must be a whole number"),
        (
            {"train_per_class": 9},
            ValueError,
            r"class 'oat' has 10 recordings, wanted 12 \(9 to train, 3 to test\)",
        ),
        ({"random_state": -1}, ValueError, "random_state must be at least 0"),
        ({"random_state": "x"}, TypeError, "random_state must be a whole number or None, got 'x'"),
        ({"progress": "yes"}, TypeError, "progress must be a bool or callable, got str"),
    ],
)
def test_bad_arguments(data, change, kind, message):
    arguments = {"data": data, "spaces": "raw", **SMALL, **change}
    with pytest.raises(kind, match=message):
        evaluate(arguments.pop("data"), **arguments)


def test_bad_progress_leaves_no_checkpoint_behind(data, tmp_path):
    with pytest.raises(TypeError, match="progress must be a bool or callable, got str") as caught:
        evaluate(data, "raw", **{**SMALL, "progress": "yes"}, checkpoint=tmp_path / "kept")
    assert caught.value.argument == "progress"
    assert list(tmp_path.iterdir()) == []


def test_bad_data(data):
    with pytest.raises(ValueError, match="at least 2 classes, got only 'oat'"):
        evaluate(data.select(labels="oat"), "raw", **SMALL)
    with pytest.raises(
        ValueError,
        match=r"class 'rice' has 4 recordings, wanted 9.*: pass train_per_class=3, test_per_class=1$",
    ):
        evaluate(cut(data, rice=4), "raw", **SMALL)
    with pytest.raises(ValueError, match=r"class 'rice' has 1 recording; the chronological protocol"):
        evaluate(cut(data, rice=1), "raw", "chronological", **SMALL)
    nameless = Dataset([*data, Recording(np.zeros((80, 6)), rate_hz=500.0, name="lost")])
    with pytest.raises(ValueError, match="has no label, the first is 'lost'"):
        evaluate(nameless, "raw", **SMALL)
    longer = Dataset([*data, Recording(np.zeros((81, 6)), rate_hz=500.0, label="oat", name="long")])
    with pytest.raises(ValueError, match=r"differ in length \(80 to 81 samples\)"):
        evaluate(longer, "raw", **SMALL)
    faster = Dataset([*data, Recording(np.zeros((80, 6)), rate_hz=501.0, label="oat", name="fast")])
    with pytest.raises(ValueError, match="differ in rate"):
        evaluate(faster, "raw", **SMALL)
    timed = Recording(np.zeros((3, 6)), time_s=[0.0, 0.1, 0.3], label="oat", name="irregular")
    with pytest.raises(ValueError, match="irregular"):
        evaluate(Dataset([*data, timed]), "raw", **SMALL)
    with pytest.raises(ValueError, match="irregular"):
        evaluate(Dataset([*data, timed]), "raw", **{**SMALL, "train_per_class": 99})
    half_timed = changed(data, start_time=lambda r: None if r.name == "rice_3" else r.start_time)
    with pytest.raises(ValueError, match=r"recording 'rice_3' has no start time .*: no order in time"):
        evaluate(half_timed, "raw", "chronological", **SMALL)


@pytest.mark.parametrize(
    ("transformer", "kind"),
    [
        (HFMH(rate_hz=100), "HFMH"),
        (feature_spaces(rate_hz=100.0)["raw+hfmh"], "RawHFMH"),
        (make_pipeline(RawHFMH(rate_hz=100.0), StandardScaler()), "RawHFMH"),
        (make_pipeline(make_pipeline(HFMH(rate_hz=100.0)), StandardScaler()), "HFMH"),
    ],
)
def test_a_transformer_of_another_rate_than_the_recordings_is_refused(data, transformer, kind):
    wanted = (
        rf"spaces\['mine'\]: {kind} has rate_hz=100, the recordings have 500 Hz: pass {kind}\(rate_hz=500\)$"
    )
    with pytest.raises(ValueError, match=wanted):
        evaluate(data, {"raw": RawSignal(), "mine": transformer}, **SMALL)


def test_transformers_of_the_right_rate_or_none_are_accepted(data):
    spaces = {"piped": make_pipeline(HFMH(rate_hz=500), StandardScaler()), "raw": RawSignal()}
    assert [space.name for space in evaluate(data, spaces, **SMALL).spaces] == ["piped", "raw"]
