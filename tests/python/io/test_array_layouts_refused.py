"""Trees of named arrays that cannot be understood are refused by name, with what they hold; nothing else is raised."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from array_layout_cases import LABELS, X, read_tree
from granular_id.io import RecordingFileError

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
        read_tree({"X": X, "fs": np.array(500), **entries})


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
    "empty": ({"X": np.zeros((0, 50, 6))}, r"recognised: X \(0, 50, 6\) is empty: it holds no samples"),
    "no samples": ({"X": np.zeros((0, 6))}, r"recognised: X \(0, 6\) is empty: it holds no samples"),
    "time as first column": ({"a": {"X": np.zeros((50, 7))}}, r"save a/X\[..., 1:\] as X and a/X\[:, 0\] as t \(s\)"),
    "time as first columns": ({"X": np.zeros((4, 50, 7))}, r"X\[..., 1:\] as X and X\[0, :, 0\] as t \(s\)"),
    "many arrays": ({f"a{i}": np.zeros(4) for i in range(99)}, r"a7 \(4,\) float64 and 91 more"),
    "square": ({"X": np.zeros((6, 6))}, "cannot be told which axis counts samples"),
    "axes of different lengths": ({**_VECTORS, "fx": X[0, :9, 0]}, "the axes differ in shape"),
    "an axis twice": ({**_VECTORS, "mx": X[0, :, 0]}, "both mean tx"),
    "five axes": ({a: _VECTORS[a] for a in _AXES[:5]}, "no recordings are recognised"),
    "stamps too short": ({"X": X, "t": np.arange(49)}, "t: has 49 values for the 50 samples of recording 0"),
    "stamps of NaN": ({"X": X[0], "t": np.full(50, np.nan)}, "stamp of sample 0 is nan"),
    "stamps of text": ({"X": X[0], "t": np.array(["a"] * 50)}, "variable t: does not hold numbers"),
    "rate of text": ({"X": X, "fs": "fast"}, "variable fs: is no sampling rate"),
    "rate of zero": ({"X": X, "fs": np.array(0)}, "variable fs: is no sampling rate"),
    "rates": ({"X": X, "fs": np.array([1, 2, 3])}, "variable fs: has 3 values for 4 recordings"),
    "sessions": ({"X": X, "session": ["a", "b"]}, "variable session: has 2 values for 4 recordings"),
    "trigger": ({"X": X, "trigger_index": np.array(50)}, r"trigger_index\[0\].* is 50"),
    "flags": ({"X": X, "flags": np.full((4, 50), 99)}, r"flags\[0\].* is 99; wanted bits of SampleFlag"),
    "flags of half": ({"X": X, "flags": np.zeros((4, 25))}, "variable flags: has 25 values"),
    "axes": ({"X": X, "axes": np.ones((2, 3))}, "variable axes: does not hold names"),
    "deep": ({"X": None}, "no recordings are recognised"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_TREES)
def test_trees_that_cannot_be_understood_are_refused(case):
    tree, message = BAD_TREES[case]
    with pytest.raises(RecordingFileError, match=message) as caught:
        read_tree(tree, rate_hz=None if "fs" in tree or "t" in tree else 500)
    assert "set.mat" in str(caught.value)


def test_trees_nested_without_end_are_refused():
    tree = {"a": X}
    for _ in range(5000):
        tree = {"a": tree}
    with pytest.raises(RecordingFileError, match="more than 16 deep"):
        read_tree(tree, rate_hz=500)
    items = [X]
    for _ in range(5000):
        items = [items]
    with pytest.raises(RecordingFileError, match="more than 16 deep"):
        read_tree({"a": items}, rate_hz=500)


_SHAPES = st.lists(st.sampled_from([0, 1, 2, 3, 6, 7]), max_size=4).map(tuple)
_LEAVES = st.one_of(
    st.builds(np.zeros, _SHAPES, st.sampled_from(["f8", "i4", "c16", "U3", "?"])),
    st.builds(np.full, _SHAPES, st.sampled_from([0.002, 1.0, 2.0, 7])),
    st.text(max_size=3),
    st.sampled_from(["mN", "N, N m", "fx, fy, fz, tx, ty, tz", "time, axis", "ms"]),
    st.sampled_from([["mN"] * 6, list(_AXES), ["time", *_AXES], ["recording", "time", "axis"]]),
    st.none(),
)
_STATED = "units t_units force_units columns lengths mask dims dt time_ms joint_pos ft_1 scale_factor _FillValue trial"
_NAMES = st.sampled_from(
    [
        *(
            "X",
            "y",
            "labels",
            "fs",
            "t",
            "force",
            "T",
            *_AXES,
            "rice",
            "session",
            "flags",
            "axes",
            "names",
            "a",
        ),
        *_STATED.split(),
    ]
)


_TREES = st.recursive(
    _LEAVES,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(_NAMES, inner, max_size=4),
    max_leaves=8,
)


@given(st.dictionaries(_NAMES, _TREES, max_size=8))
def test_any_tree_gives_recordings_or_one_kind_of_error(tree):
    try:
        data, _ = read_tree(tree, rate_hz=500)
    except RecordingFileError:
        return
    assert all(np.isfinite(r.wrench).all() for r in data)
