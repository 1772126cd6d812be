"""``benches/accuracy.py``: folders that it reads, and how they are split."""

import numpy as np
import pytest

from bench_accuracy_cases import bench, recordings, saved, split
from granular_id.recording import Dataset, Recording

__all__ = ["bench"]

# -- partitions


def test_sessions_are_held_out_whole_where_there_are_sessions(bench):
    data = recordings(6, sessions=3)
    partitions, how = split(bench, data)
    assert how == "sessions: 3 held out whole, in 3 folds"
    for partition in partitions:
        assert not set(data.sessions[partition.train]) & set(data.sessions[partition.test])
    assert sorted(np.concatenate([p.test for p in partitions])) == list(range(len(data)))


@pytest.mark.parametrize("sessions", [0, 1])
def test_halves_in_time_both_ways_where_sessions_cannot_be_held_out(bench, sessions):
    (forward, backward), how = split(bench, recordings(4, sessions=sessions))
    assert how.startswith("halves of each class, both ways, by file order")
    assert "session protocol left out: " in how
    np.testing.assert_array_equal(forward.train, backward.test)
    np.testing.assert_array_equal(forward.train, [0, 1, 4, 5, 8, 9])


def test_a_set_that_asks_for_folds_gets_them_unless_the_command_line_says_otherwise(bench):
    data = recordings(5)
    partitions, how = split(bench, data, asks="kfold", n_folds=5, seeds=3, seed=7)
    assert how == "5 stratified folds, 3 seeds from 7"
    assert len(partitions) == 15
    assert any(
        not np.array_equal(a.test, b.test) for a, b in zip(partitions[:5], partitions[5:10], strict=True)
    )
    assert len(split(bench, data, "halves", asks="kfold")[0]) == 2


def test_random_partitions_test_a_fifth_of_each_class(bench):
    data = recordings(10)
    partitions, _ = split(bench, data, "random", draws=4)
    assert len(partitions) == 4
    for partition in partitions:
        assert np.unique(data.y[partition.test], return_counts=True)[1].tolist() == [2, 2, 2]
        assert not set(partition.train) & set(partition.test)


def test_sessions_asked_for_and_not_there_are_refused(bench):
    with pytest.raises(ValueError, match="no recording says which session it is from"):
        split(bench, recordings(), "sessions")


# -- folders


def test_windows_of_a_file_share_its_session(bench):
    data = bench["data"].windows(recordings(2, n_samples=97), 0.5)
    assert len(data) == 6 * 3
    assert {r.n_samples for r in data} == {25}
    assert data[1].name == "oat_0 window 2"
    assert data[1].session == data[0].session == "oat_0"
    source = recordings(2, n_samples=97)[0].wrench
    np.testing.assert_array_equal(data[2].wrench, source[50:75])
    partitions, how = split(bench, data)
    assert how == "sessions: 6 held out whole, in 2 folds"
    assert len(partitions) == 2


def test_windows_keep_sessions_and_times(bench):
    one = Recording(np.zeros((40, 6)), rate_hz=20, label="a", session="monday", start_time=100.0, name="x")
    first, second = bench["data"].windows(Dataset([one]), 1.0)
    assert (first.session, second.session) == ("monday", "monday")
    assert (first.start_time, second.start_time) == (100.0, 101.0)


@pytest.mark.parametrize(
    ("window_s", "message"),
    [(9.0, "longer than every recording; the longest has"), (1e-9, "no sample at 50 Hz")],
)
def test_windows_that_cannot_be_are_refused(bench, window_s, message):
    with pytest.raises(ValueError, match=message):
        bench["data"].windows(recordings(), window_s)


def failures(folder, text):
    folder.mkdir(exist_ok=True)
    (folder / "lp1.data").write_text(text)
    return folder


def instance(label, rows=15):
    return f"{label}\n" + "\t1 2 3 4 5 6\n" * rows


def test_failure_sets_are_read(bench, tmp_path):
    folder = failures(tmp_path / "robot", "\n".join([instance("normal"), instance("collision"), "\n\n"]))
    (one,) = bench["data"].read_folder(folder, bench["data"].Preparation())
    assert (one.name, one.group, one.split) == ("robot/lp1", "robot", "kfold")
    assert one.data.X.shape == (2, 15, 6)
    assert one.data.y.tolist() == ["normal", "collision"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (instance("normal", rows=14), r"instance 1 has shape \(14, 6\), wanted \(15, 6\)"),
        (instance("normal").replace("3", "x"), "instance 1 is no table of numbers"),
        ("\n\n", "holds no instance"),
    ],
)
def test_damaged_failure_sets_are_refused(bench, tmp_path, text, message):
    with pytest.raises(bench["data"].FolderError, match=message):
        bench["data"].read_folder(failures(tmp_path / "robot", text), bench["data"].Preparation())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda r: Recording(r.wrench, time_s=np.arange(20) ** 1.2 / 50, label=r.label, name=r.name),
            "--rate-hz",
        ),
        (
            lambda r: Recording(r.wrench, rate_hz=80, label=r.label, name=r.name),
            "differ in rate: say --rate-hz",
        ),
    ],
)
def test_recordings_without_one_rate_are_refused_and_resampled_when_told(bench, tmp_path, change, message):
    data = recordings()
    folder = saved(tmp_path, Dataset([change(data[0]), *data[1:]]))
    with pytest.raises(bench["data"].FolderError, match=message) as refused:
        bench["data"].read_folder(folder, bench["data"].Preparation())
    assert str(folder) in str(refused.value)
    (one,) = bench["data"].read_folder(folder, bench["data"].Preparation(rate_hz=25, max_gap_s=1.0))
    assert one.data.rate_hz == 25
    assert one.notes[0] == "resampled to 25 Hz"


def test_lengths_that_differ_are_cut_and_told(bench, tmp_path):
    data = Dataset([*recordings(n_samples=20), *recordings(1, n_samples=30)])
    data = Dataset(
        [Recording(r.wrench, rate_hz=50, label=r.label, name=f"{r.label}_{k}") for k, r in enumerate(data)]
    )
    (one,) = bench["data"].read_folder(saved(tmp_path, data), bench["data"].Preparation())
    assert one.data.X.shape == (15, 20, 6)
    assert one.notes == ("cut to the shortest: 20 of up to 30 samples",)
