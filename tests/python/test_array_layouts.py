"""What trees of named arrays are taken for: every layout that is known, and that all others are refused."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from granular_id.io import RecordingFileError
from granular_id.io.array_layouts import recordings_of
from granular_id.io.options import LoadOptions
from granular_id.io.source import FileSource
from granular_id.recording import Dataset

RNG = np.random.default_rng(1)
X = RNG.normal(size=(4, 50, 6))
RAGGED = [RNG.normal(size=(n, 6)) for n in (50, 40, 60, 50)]
LABELS = ["rice", "peas", "rice", "oats"]
SOURCE = FileSource.alone(Path("set.mat"))


def _read(tree, source=SOURCE, **settings):
    content = recordings_of(tree, source, LoadOptions(**settings), "variable")
    return Dataset(content.recordings), content.notes


def _matlab(values) -> np.ndarray:
    """A list as MATLAB keeps it: a matrix of one column."""
    return np.asarray(values)[:, None]


class _Lazy:
    """A leaf that is read when asked for."""

    def __init__(self, array):
        self.array, self.shape, self.dtype, self.reads = array, array.shape, array.dtype, 0

    def read(self):
        self.reads += 1
        return self.array


# -- one array of recordings


@pytest.mark.parametrize("order", [(0, 1, 2), (1, 2, 0), (0, 2, 1), (2, 0, 1), (1, 0, 2), (2, 1, 0)])
def test_labels_tell_which_axis_counts_recordings(order):
    array = np.empty(tuple(X.shape[i] for i in order))
    array[:] = X.transpose(order)
    data, notes = _read({"X": array, "labels": LABELS, "fs": np.array([[500]])})
    assert np.array_equal(data.X, X)
    assert data.y.tolist() == LABELS
    assert data.rate_hz == 500
    names = ["recordings", "samples", "axes"]
    assert notes == [f"X {array.shape} taken as {', '.join(names[i] for i in order)}"]


@pytest.mark.parametrize("order", [(1, 2, 0), (0, 2, 1), (2, 0, 1), (1, 0, 2)])
def test_stamps_tell_which_axis_counts_samples(order):
    data, notes = _read({"data": X[:, :8].transpose(order), "t": np.arange(8) / 100})
    assert np.array_equal(data.X, X[:, :8])
    assert data.rate_hz == 100
    assert "the stamps that all recordings share are even: 100 Hz" in notes


def test_a_shape_that_only_its_lengths_could_tell_is_refused_unless_they_differ_much():
    with pytest.raises(
        RecordingFileError, match=r"X has the shape \(8, 6, 4\): it cannot be told which axis counts"
    ):
        _read({"X": X[:, :8].transpose(1, 2, 0), "fs": np.array(500)})


@pytest.mark.parametrize("shape", [(6, 50, 6), (4, 6, 6), (6, 6, 50), (6, 6, 6)])
def test_two_axes_of_length_6_are_refused(shape):
    with pytest.raises(RecordingFileError, match=r"which of the axes of length 6 is which\. It holds X"):
        _read({"X": np.zeros(shape), "fs": np.array(500)})


@pytest.mark.parametrize("name", ["X", "data", "wrench", "recordings", "anything"])
def test_any_name_will_do_for_a_single_array(name):
    assert len(_read({name: X}, rate_hz=500)[0]) == 4


def test_only_what_is_used_is_read():
    block, other = _Lazy(X), _Lazy(RNG.normal(size=(4, 600)))
    _, notes = _read({"X": block, "hfmh": other, "rate_hz": np.array(500)})
    assert (block.reads, other.reads) == (1, 0)
    assert "not used: hfmh (4, 600) float64" in notes


def test_fields_of_a_structured_array_are_arrays():
    table = np.zeros(4, [("X", "f8", (50, 6)), ("label", "U8")])
    table["X"], table["label"] = X, LABELS
    data, _ = _read({"table": table}, rate_hz=500)
    assert data.y.tolist() == LABELS
    assert np.array_equal(data.X, X)


# -- labels


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("kind", [np.float64, np.uint8])
def test_numbers_count_in_the_names_of_classes(first, kind):
    codes = _matlab(np.array([2, 1, 2, 0], kind) + kind(first))
    data, notes = _read({"X": X, "y": codes, "class_names": ["oats", "peas", "rice"], "fs": np.array(500)})
    assert data.y.tolist() == LABELS
    assert f"labels are the numbers in y, counted from {first} in class_names" in notes


def test_numbers_without_names_stay_numbers_and_that_is_said():
    data, notes = _read({"X": X, "y": np.array([3, 1, 3, 2])}, rate_hz=500)
    assert data.y.tolist() == ["3", "1", "3", "2"]
    assert any("no names of classes were found" in note for note in notes)


@pytest.mark.parametrize("name", ["labels", "label", "y", "material", "Materials", "class", "target"])
@pytest.mark.parametrize("values", [LABELS, np.array(LABELS), _matlab([b"rice", b"peas", b"rice", b"oats"])])
def test_texts_are_labels_under_any_usual_name(name, values):
    assert _read({"X": X, name: values}, rate_hz=500)[0].y.tolist() == LABELS


def test_spaces_that_pad_texts_are_no_part_of_them():
    data, _ = _read({"X": X, "labels": np.array([f"{label:9}" for label in LABELS])}, rate_hz=500)
    assert data.y.tolist() == LABELS


def test_texts_beside_numbers_are_the_labels():
    data, _ = _read({"X": X, "y": np.array([0, 1, 0, 2]), "labels": LABELS}, rate_hz=500)
    assert data.y.tolist() == LABELS


BAD_LABELS = {
    "too few": (
        {"y": np.array([1, 2, 3])},
        "variable y: has 3 values for 4 recordings; wanted one label per rec",
    ),
    "fractions": ({"y": np.array([1, 2, 0.5, 3])}, "variable y: holds numbers that are not whole"),
    "NaN": ({"y": np.array([1, 2, np.nan, 3])}, "variable y: holds numbers that are not whole"),
    "one-hot": ({"y": np.eye(4)}, r"variable y: has the shape \(4, 4\)"),
    "truth values": ({"y": np.array([True] * 4)}, "variable y: .*wanted a text or a whole number"),
    "outside the names": (
        {"y": np.array([0, 1, 2, 3]), "classes": ["a", "b"]},
        "runs from 0 to 3, but classes has 2",
    ),
    "0 or 1": (
        {"y": np.array([1, 1, 2, 2]), "classes": ["a", "b", "c"]},
        "counts from 0 or 1 cannot be told",
    ),
    "two lists": ({"y": LABELS, "label": LABELS[::-1]}, "y, label: more than one list of labels"),
    "two lists of names": (
        {"y": np.array([1, 1, 2, 2]), "classes": ["a", "b"], "class_names": ["c", "d"]},
        "classes, class_names: more than one list of names",
    ),
    "empty": ({"y": np.zeros((0, 0))}, "variable y"),
    "control character": ({"y": ["a", "b", "c\x00d", "e"]}, r"label\[2\].*control character"),
    "no text": ({"y": np.array([0x7FFFFFFF] * 4, "u4").view("U1")}, "variable y: .*wanted a text"),
}


@pytest.mark.parametrize("case", BAD_LABELS)
def test_labels_that_do_not_fit_are_refused(case):
    entries, message = BAD_LABELS[case]
    with pytest.raises(RecordingFileError, match=message):
        _read({"X": X, "fs": np.array(500), **entries})


# -- lists (cells), materials, structs


def test_a_list_of_recordings_may_be_ragged():
    data, _ = _read({"recordings": RAGGED, "labels": LABELS, "fs": np.array(500)})
    assert [r.n_samples for r in data] == [50, 40, 60, 50]
    assert all(np.array_equal(r.wrench, wrench) for r, wrench in zip(data, RAGGED, strict=True))
    assert data.y.tolist() == LABELS


def test_recordings_in_a_list_may_have_their_axes_first():
    data, notes = _read({"c": [wrench.T for wrench in RAGGED]}, rate_hz=500)
    assert [r.n_samples for r in data] == [50, 40, 60, 50]
    assert "c[0] (6, 50) taken as axes, samples" in notes


@pytest.mark.parametrize("nested", [False, True])
def test_an_array_or_list_per_material(nested):
    tree = {"rice": X, "peas": X[:2].transpose(1, 2, 0), "oats": RAGGED}
    data, notes = _read(
        {"materials_set": tree, "fs": np.array(500)} if nested else {**tree, "fs": np.array(500)}
    )
    assert data.y.tolist() == ["rice"] * 4 + ["peas"] * 2 + ["oats"] * 4
    assert np.array_equal(data[5].wrench, X[1])
    assert "rice, peas, oats taken as labels of the recordings in them" in notes


def test_a_list_of_lists_has_one_label_for_each():
    data, _ = _read({"data": [RAGGED[:3], RAGGED[3:]], "materials": ["rice", "peas"]}, rate_hz=500)
    assert data.y.tolist() == ["rice", "rice", "rice", "peas"]


def test_a_table_of_cells_is_turned_where_its_columns_have_the_labels():
    data, _ = _read(
        {"data": [[X[0], X[1]], [X[2], X[3]], [X[0], X[1]]], "materials": ["rice", "peas"]}, rate_hz=500
    )
    assert data.y.tolist() == ["rice"] * 3 + ["peas"] * 3
    assert np.array_equal(data[4].wrench, X[3])


def test_a_list_of_structs_is_a_recording_each():
    structs = [
        {
            "wrench": wrench,
            "material": label,
            "fs": np.array([[f]]),
            "trigger_index": np.array(3),
            "tool": "rod",
        }
        for wrench, label, f in zip(RAGGED, LABELS, (500, 100, 500, 100), strict=True)
    ]
    data, _ = _read({"trials": structs})
    assert data.y.tolist() == LABELS
    assert [r.rate_hz for r in data] == [500, 100, 500, 100]
    assert data[2].trigger_index == 3
    assert dict(data[1].meta) == {"tool": "rod"}


def test_structs_under_the_names_of_recordings():
    tree = {f"rice_{i}": {"wrench": wrench, "session": f"day {i}"} for i, wrench in enumerate(RAGGED)}
    data, notes = _read(tree, rate_hz=500)
    assert data.y.tolist() == ["rice"] * 4
    assert data.names == ("rice_0", "rice_1", "rice_2", "rice_3")
    assert data.sessions.tolist() == ["day 0", "day 1", "day 2", "day 3"]
    assert any("the part before the number as label" in note for note in notes)


def test_names_without_numbers_are_no_labels():
    data, _ = _read({"first": RAGGED[0], "second": RAGGED[1]}, rate_hz=500)
    assert data.names == ("first", "second")
    assert [r.label for r in data] == [None, None]


# -- one recording


def test_a_vector_for_each_axis():
    names = ("Force_X", "Fy", "fz", "Tx", "torque.y", "Mz")
    tree = {name: X[0, :, i][:, None] for i, name in enumerate(names)}
    data, _ = _read(
        {**tree, "time": np.arange(50.0)[:, None] / 500, "label": "rice", "speed": np.array([[0.03]])}
    )
    assert np.array_equal(data[0].wrench, X[0])
    assert (data[0].label, data[0].rate_hz, data[0].name, dict(data[0].meta)) == (
        "rice",
        500,
        "set.mat",
        {"speed": 0.03},
    )


def test_a_matrix_for_each_axis():
    tree = {axis: X[..., i] for i, axis in enumerate(("fx", "fy", "fz", "tx", "ty", "tz"))}
    data, _ = _read({**tree, "y": LABELS}, rate_hz=500)
    assert np.array_equal(data.X, X)


def test_other_axes_are_named_in_the_file():
    data, _ = _read({"X": X[..., :2], "axes": ["force", "depth"], "fs": np.array(62.5)})
    assert data.axes == ("force", "depth")


# -- what stands beside the samples


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
    data, _ = _read(tree)
    assert data.sessions.tolist() == ["1", "1", "2", "2"]
    assert data.names == ("a", "b", "c", "d")
    assert [r.start_time for r in data] == [1.7e9, None, 5, 6]
    assert [r.trigger_index for r in data] == [None, 0, 49, 7]
    assert [r.rate_hz for r in data] == [500, 500, 100, 100]
    assert [int(r.flags.argmax()) for r in data] == [0, 1, 2, 3]


def test_stamps_of_each_recording():
    steps = RNG.uniform(0.01, 0.02, (4, 50))
    stamps = np.cumsum(steps, axis=1) + 1.7e9
    data, _ = _read({"X": X, "t": stamps, "label": LABELS})
    assert [r.start_time for r in data] == stamps[:, 0].tolist()
    assert all(np.array_equal(r.time_s, row - row[0]) for r, row in zip(data, stamps, strict=True))
    assert data.y.tolist() == LABELS


def test_stamps_in_a_list():
    stamps = [
        np.arange(len(wrench)) / rate for wrench, rate in zip(RAGGED, (500, 100, 500, 62.5), strict=True)
    ]
    data, _ = _read({"X": RAGGED, "time": stamps})
    assert [r.rate_hz for r in data] == [500, 100, 500, 62.5]


def test_uneven_stamps_that_all_share_stay_with_each():
    stamps = np.cumsum(RNG.uniform(0.01, 0.02, 50))
    data, _ = _read({"X": X, "time": stamps})
    assert all(np.array_equal(r.time_s, stamps - stamps[0]) for r in data)


def test_stamps_that_run_back_are_refused_or_repaired():
    stamps = np.arange(50) / 100
    stamps[7] = 0.01
    with pytest.raises(RecordingFileError, match=r"X, sample 7: time runs back"):
        _read({"X": X[0], "time": stamps})
    data, _ = _read({"X": X[0], "time": stamps}, on_time_error="repair")
    assert data[0].flags.any()


def test_nan_at_the_end_is_padding_and_that_is_said():
    padded = X.copy()
    padded[1, 30:] = np.nan
    padded[3, 49:] = np.nan
    data, notes = _read({"X": padded, "t": np.arange(50) / 100})
    assert [r.n_samples for r in data] == [50, 30, 50, 49]
    assert data.rate_hz == 100
    assert "X: NaN at the end of 2 recordings taken as padding and left out" in notes


def test_what_the_user_states_is_used_or_compared():
    assert _read({"X": X}, rate_hz=500)[0].rate_hz == 500
    with pytest.raises(RecordingFileError, match="the stated rate is 100 Hz, but the file says 500 Hz"):
        _read({"X": X, "fs": np.array(500)}, rate_hz=100)
    stated = FileSource(SOURCE.path, SOURCE.root, "a push", rate_hz=50.0, start_time=7.0, trigger_index=3)
    recording = _read({"X": X[0]}, stated)[0][0]
    assert (recording.name, recording.rate_hz, recording.start_time, recording.trigger_index) == (
        "a push",
        50,
        7,
        3,
    )


_AXES = ("fx", "fy", "fz", "tx", "ty", "tz")
_VECTORS = {axis: X[0, :, i] for i, axis in enumerate(_AXES)}
_HOLE = np.where(np.arange(X.size).reshape(X.shape) == 700, np.nan, X)

BAD_TREES = {
    "nothing": ({}, "no recordings are recognised.*It holds nothing"),
    "two arrays": ({"X": X, "X_filtered": X}, r"'X' and 'X_filtered' may all be.*X_filtered \(4, 50, 6\) float64"),
    "train and test": ({"X_train": X, "y_train": LABELS, "X_test": X}, "'X_train' and 'X_test' may all be"),
    "labels and names": ({"rice": X, "peas": X, "labels": LABELS * 2}, "labels in labels, and recordings under names"),
    "flattened": ({"X": X.reshape(4, -1), "y": LABELS}, r"X.reshape\(4, 6, 50\)\.transpose\(0, 2, 1\) in the first"),
    "complex": ({"X": X * 1j}, "variable X: has dtype complex128; wanted real numbers"),
    "text": ({"X": X.astype(str)}, r"no recordings are recognised.*X \(4, 50, 6\) <U32"),
    "NaN": ({"X": _HOLE}, "variable X: recording 2, sample 16, axis ty"),
    "only NaN": ({"X": np.full(X.shape, np.nan)}, "variable X: recording 0, no samples .or only NaN."),
    "infinite": ({"X": [X[0], X[1] * np.inf]}, r"variable X\[1\]: sample 0, axis fx is"),
    "NaN at the end of one": ({"X": np.where(np.arange(50)[:, None] > 40, np.nan, X[0])}, "sample 41, axis fx is nan"),
    "empty cell": ({"X": [X[0], np.zeros((0, 0))]}, r"variable X\[1\]: is no recording: wanted \(samples, 6\)"),
    "empty": ({"X": np.zeros((0, 50, 6))}, "no recordings are recognised"),
    "square": ({"X": np.zeros((6, 6))}, "cannot be told which axis counts samples"),
    "axes of different lengths": ({**_VECTORS, "fx": X[0, :9, 0]}, "the axes differ in shape"),
    "an axis twice": ({**_VECTORS, "mx": X[0, :, 0]}, "both mean tx"),
    "five axes": ({a: _VECTORS[a] for a in _AXES[:5]}, "no recordings are recognised"),
    "stamps too short": ({"X": X, "t": np.arange(49)}, "t: has 49 values for the 50 samples of recording 0"),
    "stamps of NaN": ({"X": X[0], "t": np.full(50, np.nan)}, "stamp of sample 0 is nan"),
    "stamps of text": ({"X": X[0], "t": np.array(["a"] * 50)}, "variable t: does not hold numbers"),
    "rate of text": ({"X": X, "fs": "fast"}, "variable fs: is no sampling rate"),
    "rate of zero": ({"X": X, "fs": np.array(0)}, r"rate_hz\[0\].* is 0.0"),
    "rates": ({"X": X, "fs": np.array([1, 2, 3])}, "variable fs: has 3 values for 4 recordings"),
    "sessions": ({"X": X, "session": ["a", "b"]}, "variable session: has 2 values for 4 recordings"),
    "trigger": ({"X": X, "trigger_index": np.array(50)}, r"trigger_index\[0\].* is 50"),
    "flags": ({"X": X, "flags": np.full((4, 50), 99)}, r"flags\[0\].* is 99; wanted bits of SampleFlag"),
    "flags of half": ({"X": X, "flags": np.zeros((4, 25))}, "variable flags: has 25 values"),
    "axes": ({"X": X, "axes": np.arange(6)}, "variable axes: does not hold names"),
    "deep": ({"X": None}, "no recordings are recognised"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_TREES)
def test_trees_that_cannot_be_understood_are_refused(case):
    tree, message = BAD_TREES[case]
    with pytest.raises(RecordingFileError, match=message) as caught:
        _read(tree, rate_hz=None if "fs" in tree or "t" in tree else 500)
    assert "set.mat" in str(caught.value)


def test_trees_nested_without_end_are_refused():
    tree = {"a": X}
    for _ in range(5000):
        tree = {"a": tree}
    with pytest.raises(RecordingFileError, match="more than 16 deep"):
        _read(tree, rate_hz=500)
    items = [X]
    for _ in range(5000):
        items = [items]
    with pytest.raises(RecordingFileError, match="more than 16 deep"):
        _read({"a": items}, rate_hz=500)


_SHAPES = st.lists(st.sampled_from([0, 1, 2, 5, 6]), max_size=4).map(tuple)
_LEAVES = st.one_of(
    st.builds(np.zeros, _SHAPES, st.sampled_from(["f8", "i4", "c16", "U3", "?"])),
    st.text(max_size=3),
    st.none(),
)
_NAMES = st.sampled_from(
    ["X", "y", "labels", "fs", "t", *_AXES, "rice", "session", "flags", "axes", "names", "a"]
)
_TREES = {
    "nothing": ({}, "no recordings are recognised.*It holds nothing"),
    "two arrays": ({"X": X, "X_filtered": X}, r"'X' and 'X_filtered' may all be.*X_filtered \(4, 50, 6\) float64"),
    "train and test": ({"X_train": X, "y_train": LABELS, "X_test": X}, "'X_train' and 'X_test' may all be"),
    "labels and names": ({"rice": X, "peas": X, "labels": LABELS * 2}, "labels in labels, and recordings under names"),
    "flattened": ({"X": X.reshape(4, -1), "y": LABELS}, r"X.reshape\(4, 6, 50\)\.transpose\(0, 2, 1\) in the first"),
    "complex": ({"X": X * 1j}, "variable X: has dtype complex128; wanted real numbers"),
    "text": ({"X": X.astype(str)}, r"no recordings are recognised.*X \(4, 50, 6\) <U32"),
    "NaN": ({"X": _HOLE}, "variable X: recording 2, sample 16, axis ty"),
    "only NaN": ({"X": np.full(X.shape, np.nan)}, "variable X: recording 0, no samples .or only NaN."),
    "infinite": ({"X": [X[0], X[1] * np.inf]}, r"variable X\[1\]: sample 0, axis fx is"),
    "NaN at the end of one": ({"X": np.where(np.arange(50)[:, None] > 40, np.nan, X[0])}, "sample 41, axis fx is nan"),
_TREES = st.recursive(
    _LEAVES,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(_NAMES, inner, max_size=4),
    max_leaves=8,
)


@given(st.dictionaries(_NAMES, _TREES, max_size=8))
def test_any_tree_gives_recordings_or_one_kind_of_error(tree):
    try:
        data, _ = _read(tree, rate_hz=500)
    except RecordingFileError:
        return
    assert all(np.isfinite(r.wrench).all() for r in data)
