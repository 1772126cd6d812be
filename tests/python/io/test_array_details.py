"""What stands beside recordings in trees of named arrays: sessions, stamps, rates, padding, what the user states."""

import numpy as np
import pytest

from array_layout_cases import LABELS, RAGGED, SOURCE, X, read_tree
from granular_id.io import RecordingFileError
from granular_id.io.source import FileSource

RNG = np.random.default_rng(2)


def test_sessions_names_starts_triggers_rates_and_flags():
    tree = {
        "X": X,
        "session": np.array([1, 1, 2, 2]),
        "names": ["a", "b", "c", "d"],
        "start_time": np.array([1.7e9, np.nan, 5, 6]),
        "trigger_index": np.array([-1, 0, 49, 7]),
        "fs": np.array([500, 500, 100, 100]),
        "flags": np.eye(4, 50, dtype=np.uint8),
    }
    data, _ = read_tree(tree)
    assert data.sessions.tolist() == ["1", "1", "2", "2"]
    assert data.names == ("a", "b", "c", "d")
    assert [r.start_time for r in data] == [1.7e9, None, 5, 6]
    assert [r.trigger_index for r in data] == [None, 0, 49, 7]
    assert [r.rate_hz for r in data] == [500, 500, 100, 100]
    assert [int(r.flags.argmax()) for r in data] == [0, 1, 2, 3]


def test_stamps_of_each_recording():
    steps = RNG.uniform(0.01, 0.02, (4, 50))
    stamps = np.cumsum(steps, axis=1) + 1.7e9
    data, _ = read_tree({"X": X, "t": stamps, "label": LABELS})
    assert [r.start_time for r in data] == stamps[:, 0].tolist()
    assert all(np.array_equal(r.time_s, row - row[0]) for r, row in zip(data, stamps, strict=True))
    assert data.y.tolist() == LABELS


def test_stamps_in_a_list():
    stamps = [
        np.arange(len(wrench)) / rate for wrench, rate in zip(RAGGED, (500, 100, 500, 62.5), strict=True)
    ]
    data, _ = read_tree({"X": RAGGED, "time": stamps})
    assert [r.rate_hz for r in data] == [500, 100, 500, 62.5]


def test_uneven_stamps_that_all_share_stay_with_each():
    stamps = np.cumsum(RNG.uniform(0.01, 0.02, 50))
    data, _ = read_tree({"X": X, "time": stamps})
    assert all(np.array_equal(r.time_s, stamps - stamps[0]) for r in data)


def test_stamps_that_run_back_are_refused_or_repaired():
    stamps = np.arange(50) / 100
    stamps[7] = 0.01
    with pytest.raises(RecordingFileError, match=r"X, sample 7: time runs back"):
        read_tree({"X": X[0], "time": stamps})
    data, _ = read_tree({"X": X[0], "time": stamps}, on_time_error="repair")
    assert data[0].flags.any()


def test_nan_at_the_end_is_padding_and_that_is_said():
    padded = X.copy()
    padded[1, 30:] = np.nan
    padded[3, 49:] = np.nan
    data, notes = read_tree({"X": padded, "t": np.arange(50) / 100})
    assert [r.n_samples for r in data] == [50, 30, 50, 49]
    assert data.rate_hz == 100
    assert "X: NaN at the end of 2 recordings taken as padding and left out" in notes


def test_what_the_user_states_is_used_or_compared():
    assert read_tree({"X": X}, rate_hz=500)[0].rate_hz == 500
    with pytest.raises(RecordingFileError, match="the stated rate is 100 Hz, but the file says 500 Hz"):
        read_tree({"X": X, "fs": np.array(500)}, rate_hz=100)
    stated = FileSource(SOURCE.path, SOURCE.root, "a push", rate_hz=50.0, start_time=7.0, trigger_index=3)
    recording = read_tree({"X": X[0]}, stated)[0][0]
    assert (recording.name, recording.rate_hz, recording.start_time, recording.trigger_index) == (
        "a push",
        50,
        7,
        3,
    )


def test_texts_under_a_name_that_says_nothing_are_pointed_out():
    data, notes = read_tree({"arr_0": X, "arr_1": np.array(LABELS)}, rate_hz=500)
    assert data.labels == ()
    assert "arr_1 holds a text per recording: if it names the materials, save it as labels" in notes
    assert not any(
        "save it as" in note for note in read_tree({"X": X, "y": LABELS, "b": LABELS}, rate_hz=500)[1]
    )
