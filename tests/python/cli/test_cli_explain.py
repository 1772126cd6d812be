"""`explain`: in the space that is asked for, with the classifier that belongs to it, on recordings held out."""

from dataclasses import replace

import numpy as np
import pytest
from sklearn.pipeline import make_pipeline

from cli_cases import ended_well, refused, saved, written
from granular_id import ECOCClassifier, RawSignal
from granular_id.explanation import explain_held_out
from granular_id.io import save
from granular_id.recording import Dataset, Recording
from multiband_cases import louder


@pytest.fixture(scope="module")
def data():
    return Dataset(
        [
            Recording(wrench, 500.0, label=str(label), session=f"day {number % 3}", name=f"{number:02d}")
            for number, (wrench, label) in enumerate(zip(*louder(), strict=True))
        ]
    )


@pytest.fixture(scope="module")
def recordings(data, tmp_path_factory):
    return saved(data, tmp_path_factory.mktemp("explain") / "recordings")


@pytest.mark.parametrize("space", ["raw", "multiband"])
def test_explain_names_axes_as_the_recordings_do(tmp_path, space):
    pytest.importorskip("matplotlib")
    X, y = louder()
    axes = ("up", "right", "left")
    rows = enumerate(zip(X[..., [2, 1, 0]], y, strict=True))
    data = [
        Recording(wrench, 500.0, label=str(label), name=f"{k:02d}", axes=axes) for k, (wrench, label) in rows
    ]
    save(Dataset(data), tmp_path / "recordings.npz")
    words = ("--space", space, "--figure", tmp_path / "why.png", "--json", tmp_path / "why.json")
    lines = ended_well("explain", tmp_path / "recordings.npz", "rice", "oat", *words).splitlines()
    assert [line.split() for line in lines if line.startswith("block ")] == [["block", *axes, "sum"]]
    assert (tmp_path / "why.png").stat().st_size > 10_000
    read = written(tmp_path / "why.json")
    assert sum(read["features"]["contributions"]) == pytest.approx(read["difference"])
    assert ("band" in read["tables"]) == (space == "multiband")


def test_explain_lowers_components_to_the_recordings(recordings):
    printed = ended_well("explain", recordings, "rice", "oat", "--space", "pca")
    assert "pca: trained on 16 of 24 recordings; 15 components, as 16 recordings train" in printed


@pytest.mark.parametrize("other", ["red_clay", "peas"])
def test_explain_tells_labels_apart_that_differ_by_a_blank(data, other, tmp_path):
    names = {"rice": "red clay", "oat": other}
    path = tmp_path / "clays.npz"
    save(Dataset([replace(one, label=names[one.label]) for one in data]), path)
    words = ("explain", path, "red clay", "red_clay", "--space", "raw")
    if other == "peas":  # then both mean the one clay
        assert "must be two materials, got 'red clay' twice" in refused(*words)
    else:
        lines = [line.split("  ")[0] for line in ended_well(*words).splitlines()]
        assert [line for line in lines if line.startswith("red")] == ["red clay", "red_clay"]


def test_explain_trains_and_names_the_model_of_train(recordings, tmp_path):
    printed = ended_well("explain", recordings, "rice", "oat", "--json", tmp_path / "best.json")
    line = next(line for line in printed.splitlines() if line.startswith("best: "))
    assert line.startswith(
        "best: trained on 16 of 24 recordings; the mean of the candidate models that were chosen, "
    )
    read = written(tmp_path / "best.json")
    assert max(read["by_axis"], key=read["by_axis"].get) == "fz"
    assert (read["space"], f"best: {read['model']}") == ("best", line)
    assert f"explained on recordings held out: {read['split']['held_out']}" in printed.splitlines()
    assert read["split"]["folds"] == "held-out sessions"
    assert (len(read["split"]["train"]), len(read["split"]["explained"])) == (16, 8)


@pytest.mark.parametrize(
    ("sessions", "folds"),
    [
        ({"rice": "mon tue", "oat": "mon tue", "peas": "mon tue"}, "held-out sessions"),
        ({"rice": "mon tue", "oat": "mon tue", "peas": "tue"}, "held-out sessions"),
        # no fold holds out both
        ({"rice": "r1 r2", "oat": "o1 o2", "peas": "p1 p2 p3 p4 p5 p6 p7 p8"}, "held-out sessions"),
        ({"rice": "mon", "oat": "mon", "peas": "mon tue"}, "halves in time order"),
        ({}, "random folds"),
    ],
)
def test_explain_holds_out_what_the_materials_allow(sessions, folds):
    named = {label: words.split() for label, words in sessions.items()}
    data = Dataset(
        [
            Recording(
                np.random.default_rng(k).normal(size=(4, 6)),
                500.0,
                label=label,
                session=named[label][k % len(named[label])] if named else None,
                start_time=1e9 + (60.0 * k if named else k // 2 * 60.0),
                name=f"{label} {k}",
            )
            for k in range(8)
            for label in ("rice", "oat", "peas")
        ]
    )
    explanation, model, split = explain_held_out(
        data, make_pipeline(RawSignal(), ECOCClassifier()), "rice", "oat"
    )
    assert split["folds"] == folds
    assert not set(split["train"]) & set(split["explained"])
    assert sum(explanation.counts) == len(split["explained"])
    assert model == f"trained on {len(split['train'])} of 24 recordings"
