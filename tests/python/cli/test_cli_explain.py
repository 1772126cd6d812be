"""`explain`: in the space that is asked for, with the classifier that belongs to it, on recordings held out."""

import numpy as np
import pytest

from cli_cases import ended_well, saved, written
from granular_id.io import save
from granular_id.recording import Dataset, Recording
from granular_id.splits import pair_partition
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
    assert read["split"]["protocol"] == "session"
    assert (len(read["split"]["train"]), len(read["split"]["explained"])) == (16, 8)


@pytest.mark.parametrize(
    ("sessions", "protocol", "explained"),
    [
        ({"rice": "mon tue", "oat": "mon tue", "peas": "mon tue"}, "session", "mon"),
        ({"rice": "mon tue", "oat": "mon tue", "peas": "tue"}, "session", "mon"),
        ({"rice": "mon", "oat": "mon tue", "peas": "mon tue"}, "chronological", "later half"),
        ({}, "kfold", "random half"),
    ],
)
def test_halves_are_as_strict_as_the_materials_allow(sessions, protocol, explained):
    named = {label: words.split() for label, words in sessions.items()}
    recordings = [
        Recording(
            np.zeros((4, 6)),
            500.0,
            label=label,
            session=named[label][k % len(named[label])] if named else None,
            start_time=1e9 + (60.0 * k if named else k // 2 * 60.0),
            name=f"{label} {k}",
        )
        for k in range(8)
        for label in ("rice", "oat", "peas")
    ]
    data = Dataset(recordings)
    part, note = pair_partition(data, "rice", "oat")
    assert part.protocol == protocol
    assert explained in note
    train, test = (Dataset([data[row] for row in rows]) for rows in (part.train.tolist(), part.test.tolist()))
    assert not set(train.names) & set(test.names)
    assert {(label, (test.y == label).sum()) for label in test.labels} == {("rice", 4), ("oat", 4)}
    if protocol == "session":
        assert not set(train.sessions) & set(test.sessions)
    elif protocol == "chronological":
        assert train.start_times.max() < test.start_times.min()
    assert set(train.labels) == {"rice", "oat", "peas"}
