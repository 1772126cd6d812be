"""What trees of named arrays are taken for: every layout that is known."""

import numpy as np
import pytest

from array_layout_cases import LABELS, RAGGED, X, read_tree
from granular_id.io import RecordingFileError

RNG = np.random.default_rng(1)


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
    data, notes = read_tree({"X": array, "labels": LABELS, "fs": np.array([[500]])})
    assert np.array_equal(data.X, X)
    assert data.y.tolist() == LABELS
    assert data.rate_hz == 500
    names = ["recordings", "samples", "axes"]
    assert notes == [f"X {array.shape} taken as {', '.join(names[i] for i in order)}"]


@pytest.mark.parametrize("order", [(1, 2, 0), (0, 2, 1), (2, 0, 1), (1, 0, 2)])
def test_stamps_tell_which_axis_counts_samples(order):
    data, notes = read_tree({"data": X[:, :8].transpose(order), "t": np.arange(8) / 100})
    assert np.array_equal(data.X, X[:, :8])
    assert data.rate_hz == 100
    assert "the stamps that all recordings share are even: 100 Hz" in notes


def test_a_shape_that_only_its_lengths_could_tell_is_refused_unless_they_differ_much():
    with pytest.raises(
        RecordingFileError, match=r"X has the shape \(8, 6, 4\): it cannot be told which axis counts"
    ):
        read_tree({"X": X[:, :8].transpose(1, 2, 0), "fs": np.array(500)})


@pytest.mark.parametrize("shape", [(6, 50, 6), (4, 6, 6), (6, 6, 50), (6, 6, 6)])
def test_two_axes_of_length_6_are_refused(shape):
    with pytest.raises(RecordingFileError, match=r"which of the axes of length 6 is which; .*\. It holds X"):
        read_tree({"X": np.zeros(shape), "fs": np.array(500)})


@pytest.mark.parametrize("name", ["X", "data", "wrench", "recordings", "anything"])
def test_any_name_will_do_for_a_single_array(name):
    assert len(read_tree({name: X}, rate_hz=500)[0]) == 4


def test_only_what_is_used_isread_tree():
    block, other = _Lazy(X), _Lazy(RNG.normal(size=(4, 600)))
    _, notes = read_tree({"X": block, "hfmh": other, "rate_hz": np.array(500)})
    assert (block.reads, other.reads) == (1, 0)
    assert "not used: hfmh (4, 600) float64" in notes


def test_matrices_beside_the_recordings_are_left_out_and_that_is_said():
    tree = {"calibration": np.eye(6), "limits": np.ones((2, 6)), "mean_push": X.mean(0), "data": X}
    data, notes = read_tree(tree, rate_hz=500)
    assert np.array_equal(data.X, X)
    assert notes[-1].startswith("not used: calibration (6, 6) float64, limits (2, 6)")
    data, _ = read_tree({"calibration": np.eye(6), "rice": X[0]}, rate_hz=500)
    assert np.array_equal(data.X, X[:1])


def test_fields_of_a_structured_array_are_arrays():
    table = np.zeros(4, [("X", "f8", (50, 6)), ("label", "U8")])
    table["X"], table["label"] = X, LABELS
    data, _ = read_tree({"table": table}, rate_hz=500)
    assert data.y.tolist() == LABELS
    assert np.array_equal(data.X, X)


# -- labels


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("kind", [np.float64, np.uint8])
def test_numbers_count_in_the_names_of_classes(first, kind):
    codes = _matlab(np.array([2, 1, 2, 0], kind) + kind(first))
    data, notes = read_tree(
        {"X": X, "y": codes, "class_names": ["oats", "peas", "rice"], "fs": np.array(500)}
    )
    assert data.y.tolist() == LABELS
    assert f"labels are the numbers in y, counted from {first} in class_names" in notes


def test_numbers_without_names_stay_numbers_and_that_is_said():
    data, notes = read_tree({"X": X, "y": np.array([3, 1, 3, 2])}, rate_hz=500)
    assert data.y.tolist() == ["3", "1", "3", "2"]
    assert any("no names of classes were found" in note for note in notes)


@pytest.mark.parametrize("name", ["labels", "label", "y", "material", "Materials", "class", "target"])
@pytest.mark.parametrize("values", [LABELS, np.array(LABELS), _matlab([b"rice", b"peas", b"rice", b"oats"])])
def test_texts_are_labels_under_any_usual_name(name, values):
    assert read_tree({"X": X, name: values}, rate_hz=500)[0].y.tolist() == LABELS


def test_spaces_that_pad_texts_are_no_part_of_them():
    data, _ = read_tree({"X": X, "labels": np.array([f"{label:9}" for label in LABELS])}, rate_hz=500)
    assert data.y.tolist() == LABELS


def test_an_empty_text_is_no_label():
    data, _ = read_tree({"X": X, "labels": ["rice", "", "peas", ""]}, rate_hz=500)
    assert [r.label for r in data] == ["rice", None, "peas", None]


def test_one_label_or_rate_is_for_all_but_one_name_or_start_is_about_the_file():
    tree = {"X": X, "label": "rice", "fs": np.array(500), "name": "kitchen", "start_time": np.array([[5.0]])}
    data, _ = read_tree(tree)
    assert data.y.tolist() == ["rice"] * 4
    assert data.names == tuple(f"set.mat[{i}]" for i in range(4))
    assert all(r.start_time is None for r in data)
    assert dict(data[0].meta) == {"name": "kitchen", "start_time": 5.0}


def test_texts_beside_numbers_are_the_labels():
    data, _ = read_tree({"X": X, "y": np.array([0, 1, 0, 2]), "labels": LABELS}, rate_hz=500)
    assert data.y.tolist() == LABELS


# -- lists (cells), materials, structs


def test_a_list_of_recordings_may_be_ragged():
    data, _ = read_tree({"recordings": RAGGED, "labels": LABELS, "fs": np.array(500)})
    assert [r.n_samples for r in data] == [50, 40, 60, 50]
    assert all(np.array_equal(r.wrench, wrench) for r, wrench in zip(data, RAGGED, strict=True))
    assert data.y.tolist() == LABELS


def test_recordings_in_a_list_may_have_their_axes_first():
    data, notes = read_tree({"c": [wrench.T for wrench in RAGGED]}, rate_hz=500)
    assert [r.n_samples for r in data] == [50, 40, 60, 50]
    assert "c[0] (6, 50) taken as axes, samples" in notes


@pytest.mark.parametrize("nested", [False, True])
def test_an_array_or_list_per_material(nested):
    tree = {"rice": X, "peas": X[:2].transpose(1, 2, 0), "oats": RAGGED}
    data, notes = read_tree(
        {"materials_set": tree, "fs": np.array(500)} if nested else {**tree, "fs": np.array(500)}
    )
    assert data.y.tolist() == ["rice"] * 4 + ["peas"] * 2 + ["oats"] * 4
    assert np.array_equal(data[5].wrench, X[1])
    assert "rice, peas, oats taken as labels of the recordings in them" in notes


def test_a_list_of_lists_has_one_label_for_each():
    data, _ = read_tree({"data": [RAGGED[:3], RAGGED[3:]], "materials": ["rice", "peas"]}, rate_hz=500)
    assert data.y.tolist() == ["rice", "rice", "rice", "peas"]


def test_a_table_of_cells_is_turned_where_its_columns_have_the_labels():
    data, _ = read_tree(
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
    data, _ = read_tree({"trials": structs})
    assert data.y.tolist() == LABELS
    assert [r.rate_hz for r in data] == [500, 100, 500, 100]
    assert data[2].trigger_index == 3
    assert dict(data[1].meta) == {"tool": "rod"}


def test_structs_under_the_names_of_recordings():
    tree = {f"rice_{i}": {"wrench": wrench, "session": f"day {i}"} for i, wrench in enumerate(RAGGED)}
    data, notes = read_tree(tree, rate_hz=500)
    assert data.y.tolist() == ["rice"] * 4
    assert data.names == ("rice_0", "rice_1", "rice_2", "rice_3")
    assert data.sessions.tolist() == ["day 0", "day 1", "day 2", "day 3"]
    assert any("and the part before the number as label" in note for note in notes)


def test_names_without_numbers_are_no_labels():
    data, _ = read_tree({"first": RAGGED[0], "second": RAGGED[1]}, rate_hz=500)
    assert data.names == ("first", "second")
    assert [r.label for r in data] == [None, None]


def test_a_single_recording_per_material_has_the_label_of_its_group():
    for inner in ("rice_1", "1", "trial0"):
        for node in (X[0], {"wrench": X[0]}):
            data, notes = read_tree({"rice": {inner: node}, "peas": {inner: X[1]}}, rate_hz=500)
            assert data.y.tolist() == ["rice", "peas"]
            assert data.names == (f"rice/{inner}", f"peas/{inner}")
            assert "rice, peas taken as labels of the recordings in them" in notes
    for tree in (
        {"push1": {"ati1": X[0]}, "push2": {"ati1": X[1]}},
        {"one": {"ati": X[0]}, "two": {"ati": X[1]}},
    ):
        assert read_tree(tree, rate_hz=500)[0].labels == ()


# -- one recording


def test_a_vector_for_each_axis():
    names = ("Force_X", "Fy", "fz", "Tx", "torque.y", "Mz")
    tree = {name: X[0, :, i][:, None] for i, name in enumerate(names)}
    data, _ = read_tree(
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
    data, _ = read_tree({**tree, "y": LABELS}, rate_hz=500)
    assert np.array_equal(data.X, X)


def test_other_axes_are_named_in_the_file():
    data, _ = read_tree({"X": X[..., :2], "axes": ["force", "depth"], "fs": np.array(62.5)})
    assert data.axes == ("force", "depth")
