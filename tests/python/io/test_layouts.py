"""What arrays are taken for, whatever file holds them: one table of layouts, read from NPZ, HDF5, MATLAB 5 and 7.3."""

from __future__ import annotations

from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

pytest.importorskip("h5py")

from granular_id.io import RecordingFileError, load
from granular_id.io.arrays.layouts import recordings_of
from granular_id.io.options import LoadOptions
from granular_id.io.source import FileSource
from layouts_written import (
    AXES,
    FORCES,
    LABELS,
    RAGGED,
    TORQUES,
    WRITERS,
    T,
    W,
    X,
    formats_of,
    written,
)

VECTORS = dict(zip(AXES, W.T, strict=True))
HOLE = np.where(np.arange(X.size).reshape(X.shape) == 700, np.nan, X)
SIX = np.concatenate([X, X])[:6]


def case(tree, wrenches=X, only=WRITERS, options=None, **expected):
    """A tree, the samples in it, the formats that can hold it, and what else is known of the recordings."""
    return tree, wrenches, [form for form in formats_of(tree) if form in only], options or {}, expected


def side_by_side(force, torque):
    tree = {torque: TORQUES, force: FORCES, "labels": LABELS, "fs": 500}
    note = f"{force} and {torque} joined: forces, then torques"
    return case(tree, labels=LABELS, notes=[note])


def per_material(**more):
    tree = {"oats": X[:2].transpose(1, 2, 0), "peas": X, **more}
    return {"materials_set": tree, "fs": 500}, [*X[:2], *X, *more.get("rice", ())]


STAMPS = np.cumsum(np.random.default_rng(1).uniform(0.01, 0.02, (4, 50)), axis=1) + 1.7e9
STRUCTS = [
    {"wrench": w, "material": label, "fs": rate, "trigger_index": 3, "tool": "rod"}
    for w, label, rate in zip(RAGGED, LABELS, (500, 100, 500, 100), strict=True)
]
PADDED = X.copy()
PADDED[1, 30:] = PADDED[3, 49:] = np.nan

READ = {
    # one array of recordings
    **{
        f"labels tell recordings {order}": case(
            {"X": X.transpose(order), "labels": LABELS, "fs": 500}, labels=LABELS, notes=["X ("]
        )
        for order in permutations(range(3))
    },
    **{
        f"stamps tell samples {order}": case(
            {"data": X[:, :8].transpose(order), "t": T[:8] * 5},
            X[:, :8],
            rate=100,
            notes=["the stamps that all recordings share are even: 100 Hz"],
        )
        for order in [(1, 2, 0), (0, 2, 1), (2, 0, 1), (1, 0, 2)]
    },
    **{
        f"a single array called {name}": case({name: X}, options={"rate_hz": 500})
        for name in ("X", "data", "recordings", "anything")
    },
    **{
        f"of type {kind}": case({"X": np.rint(X * 10).astype(kind), "fs": 500}, np.rint(X * 10))
        for kind in ("f4", ">f8", "i2")
    },
    "column-major": case({"X": np.asfortranarray(X), "fs": 500}),
    "matrices beside it": case(
        {"calibration": np.eye(6), "limits": np.ones((2, 6)), "mean_push": X.mean(0), "data": X, "fs": 500},
        notes=["not used: calibration (6, 6) float64, limits (2, 6)"],
    ),
    "a matrix beside one recording": case({"calibration": np.eye(6), "rice": W, "fs": 500}, [W]),
    "padding of NaN": case(
        {"X": PADDED, "t": np.arange(50) / 100},
        [X[0], X[1, :30], X[2], X[3, :49]],
        rate=100,
        notes=["X: NaN at the end of 2 recordings taken as padding and left out"],
    ),
    "other axes": case({"X": X[..., :2], "axes": ["force", "depth"], "fs": 62.5}, X[..., :2], rate=62.5),
    # labels
    **{
        f"numbers from {first}": case(
            {"X": X, "y": np.array([2, 1, 2, 0]) + first, "class_names": ["oats", "peas", "rice"], "fs": 500},
            labels=LABELS,
            notes=[f"labels are the numbers in y, counted from {first} in class_names"],
        )
        for first in (0, 1)
    },
    "numbers without names": case(
        {"X": X, "y": np.array([3, 1, 3, 2]), "fs": 500},
        labels=["3", "1", "3", "2"],
        notes=["no names of classes were found"],
    ),
    **{
        f"labels as {name}": case({"X": X, name: LABELS, "fs": 500}, labels=LABELS)
        for name in ("label", "y", "Materials", "class", "target")
    },
    "padded texts": case(
        {"X": X, "labels": np.array([f"{label:9}" for label in LABELS]), "fs": 500}, labels=LABELS
    ),
    "bytes": case({"X": X, "labels": np.array(LABELS, "S"), "fs": 500}, only=("npz", "h5"), labels=LABELS),
    "an empty text": case(
        {"X": X, "labels": ["rice", "", "peas", ""], "fs": 500},
        only=("npz", "h5", "mat"),
        labels=["rice", None, "peas", None],
    ),
    "one label for all, one name for the file": case(
        {"X": X, "label": "rice", "fs": 500, "name": "kitchen", "start_time": 5.0},
        labels=["rice"] * 4,
        meta={"name": "kitchen", "start_time": 5.0},
        starts=[None] * 4,
    ),
    "texts beside numbers": case(
        {"X": X, "y": np.array([0, 1, 0, 2]), "labels": LABELS, "fs": 500}, labels=LABELS
    ),
    "texts under a name that says nothing": case(
        {"X": X, "arr_1": LABELS, "fs": 500},
        labels=[None] * 4,
        notes=["arr_1 holds a text per recording: if it names the materials, save it as labels"],
    ),
    # what stands beside
    "all of it": case(
        {
            "X": X,
            "session": np.array([1, 1, 2, 2]),
            "names": ["a", "b", "c", "d"],
            "start_time": np.array([1.7e9, np.nan, 5, 6]),
            "trigger_index": np.array([-1, 0, 49, 7]),
            "fs": np.array([500, 500, 500, 500]),
            "flags": np.eye(4, 50, dtype=np.uint8),
        },
        sessions=["1", "1", "2", "2"],
        names=["a", "b", "c", "d"],
        starts=[1.7e9, None, 5, 6],
        triggers=[None, 0, 49, 7],
        flags=[0, 1, 2, 3],
    ),
    "rates of each": case({"X": X, "fs": np.array([500, 500, 100, 100])}, rates=[500, 500, 100, 100]),
    "stamps of each": case(
        {"X": X, "t": STAMPS, "label": LABELS}, labels=LABELS, starts=STAMPS[:, 0].tolist()
    ),
    "stamps of each in columns": case({"X": X, "t": STAMPS.T}, starts=STAMPS[:, 0].tolist()),
    "names of classes around": case(
        {"class_names": ["oats", "peas", "rice"], "set": {"X": X, "y": np.array([2, 1, 2, 0]), "fs": 500}},
        labels=LABELS,
    ),
    "stamps in cells": case(
        {"X": RAGGED, "time": [np.arange(len(w)) / 500 for w in RAGGED]}, RAGGED, labels=[None] * 4
    ),
    "uneven stamps that all share": case({"X": X, "time": STAMPS[0]}, stamps=STAMPS[0] - STAMPS[0, 0]),
    "stamps that run back, repaired": case(
        {"X": W, "time": np.where(np.arange(50) == 7, 0.001, T)},
        None,
        options={"on_time_error": "repair"},
    ),
    # cells, materials, structs
    "cells of any length": case({"c": RAGGED, "labels": LABELS, "fs": 500}, RAGGED, labels=LABELS),
    "cells with their axes first": case(
        {"c": [w.T for w in RAGGED], "fs": 500}, RAGGED, notes=["c[0] (6, 50) taken as axes, samples"]
    ),
    "an array per material": case(
        *per_material(),
        labels=["oats"] * 2 + ["peas"] * 4,
        notes=["oats, peas taken as labels of the recordings in them"],
    ),
    "an array or cells per material": case(
        *per_material(rice=RAGGED), labels=["oats"] * 2 + ["peas"] * 4 + ["rice"] * 4
    ),
    "cells of cells": case(
        {"data": [RAGGED[:3], RAGGED[3:]], "materials": ["rice", "peas"], "fs": 500},
        RAGGED,
        only=("v73.mat",),  # savemat cannot write rows of different lengths side by side
        labels=["rice"] * 3 + ["peas"],
    ),
    "a table of cells": case(
        {"data": [[X[0], X[1]], [X[2], X[3]], [X[0], X[1]]], "materials": ["rice", "peas"], "fs": 500},
        [X[0], X[2], X[0], X[1], X[3], X[1]],
        labels=["rice"] * 3 + ["peas"] * 3,
    ),
    "cells of structs": case(
        {"trials": STRUCTS},
        RAGGED,
        labels=LABELS,
        rates=[500, 100, 500, 100],
        triggers=[3] * 4,
        meta={"tool": "rod"},
    ),
    "structs under the names of recordings": case(
        {f"rice_{i}": {"wrench": w, "session": f"day {i}"} for i, w in enumerate(RAGGED)} | {"fs": 500},
        RAGGED,
        labels=["rice"] * 4,
        names=["rice_0", "rice_1", "rice_2", "rice_3"],
        sessions=["day 0", "day 1", "day 2", "day 3"],
        notes=["and the part before the number as label"],
    ),
    "names without numbers": case(
        {"first": RAGGED[0], "second": RAGGED[1], "fs": 500},
        RAGGED[:2],
        names=["first", "second"],
        labels=[None] * 2,
    ),
    **{
        f"a single {inner} per material": case(
            {"peas": {inner: X[1]}, "rice": {inner: node}, "fs": 500},
            [X[1], X[0]],
            labels=["peas", "rice"],
            names=[f"peas/{inner}", f"rice/{inner}"],
        )
        for inner, node in (("rice_1", X[0]), ("trial0", {"wrench": X[0]}))
    },
    **{
        f"groups that are no materials: {outer}": case(
            {outer[0]: {inner: X[0]}, outer[1]: {inner: X[1]}, "fs": 500}, X[:2], labels=[None] * 2
        )
        for outer, inner in ((("push1", "push2"), "ati1"), (("one", "two"), "ati"))
    },
    # one recording
    "a vector for each axis": case(
        {
            **dict(zip(("Force_X", "Fy", "fz", "Tx", "torque_y", "Mz"), W.T, strict=True)),
            "time": T,
            "label": "rice",
            "speed": 0.03,
        },
        [W],
        labels=["rice"],
        meta={"speed": 0.03},
    ),
    "a matrix for each axis": case({**dict(zip(AXES, SIX.transpose(2, 0, 1), strict=True)), "fs": 500}, SIX),
    # forces and torques side by side
    **{
        f"{force} and {torque}": side_by_side(force, torque)
        for force, torque in (
            *[("force", "torque"), ("Force", "moment"), ("F", "T"), ("F", "M"), ("f", "tau")],
            *[("forces_N", "moments_Nm"), ("Force [N]", "Torque [N m]"), ("ee_force", "ee_torque")],
        )
    },
    **{
        f"halves in the order {order}": case(
            {"force": FORCES.transpose(order), "torque": TORQUES.transpose(order), "y": LABELS, "fs": 500}
        )
        for order in [(1, 2, 0), (0, 2, 1), (2, 0, 1), (2, 1, 0)]
    },
    "halves and a calibration": case(
        {"force": FORCES, "torque": TORQUES, "calibration": np.eye(6), "fs": 500}
    ),
    "halves of six recordings": case({"force": SIX[..., :3], "torque": SIX[..., 3:], "fs": 500}, SIX),
    "halves of one": case(
        {"force": FORCES[0], "torque": TORQUES[0], "time": T}, [W], notes=["force and torque joined"]
    ),
    "halves of one, turned": case({"force": FORCES[0].T, "torque": TORQUES[0].T, "time": T}, [W]),
    "halves in cells": case(
        {
            "forces": [w[:, :3] for w in RAGGED],
            "torques": [w[:, 3:] for w in RAGGED],
            "y": LABELS,
            "fs": 500,
        },
        RAGGED,
        labels=LABELS,
    ),
    "halves in groups": case(
        {
            m: {f"trial{i}": {"force": w[:, :3], "torque": w[:, 3:], "fs": 500} for i, w in enumerate(X)}
            for m in ("peas", "rice")
        },
        [*X, *X],
        labels=["peas"] * 4 + ["rice"] * 4,
    ),
    "halves with padding": case(
        {"force": PADDED[..., :3], "torque": PADDED[..., 3:], "fs": 500}, [X[0], X[1, :30], X[2], X[3, :49]]
    ),
    "halves beside the whole": case(
        {"wrench": X, "force": FORCES, "torque": TORQUES, "fs": 500}, notes=["not used: force"]
    ),
}

REFUSED = {
    # labels
    "too few": ({"X": X, "y": np.array([1, 2, 3])}, "y: has 3 values for 4 recordings; wanted one label"),
    "fractions": ({"X": X, "y": np.array([1, 2, 0.5, 3])}, "y: holds numbers that are not whole"),
    "one-hot": ({"X": X, "y": np.eye(4)}, r"y: has the shape \(4, 4\)"),
    "outside the names": (
        {"X": X, "y": np.array([0, 1, 2, 3]), "classes": ["a", "b"]},
        "runs from 0 to 3, but classes has 2",
    ),
    "0 or 1": (
        {"X": X, "y": np.array([1, 1, 2, 2]), "classes": ["a", "b", "c"]},
        "counts from 0 or 1 cannot be",
    ),
    "two lists": ({"X": X, "y": LABELS, "label": LABELS[::-1]}, "more than one list of labels"),
    "two lists of names": (
        {"X": X, "y": np.array([1, 1, 2, 2]), "classes": ["a", "b"], "class_names": ["c", "d"]},
        "more than one list of names",
    ),
    "no labels": ({"X": X, "y": np.zeros((0, 0))}, " y"),
    "labels and names": ({"peas": X, "rice": X, "labels": LABELS * 2}, "labels in labels, and recordings un"),
    # which array, which axis
    "nothing": ({"fs": 500}, "no recordings are recognised"),
    "two arrays": ({"X": X, "X_filtered": X}, r"'X' and 'X_filtered' may all be.*X_filtered \(4, 50, 6\)"),
    "train and test": ({"X_test": X, "X_train": X, "y_train": LABELS}, "'X_test' and 'X_train' may all be"),
    "a shape that lengths cannot tell": ({"X": X[:, :8].transpose(1, 2, 0)}, "it cannot be told which axis"),
    **{
        f"two axes of six: {shape}": ({"X": np.zeros(shape)}, "which of the axes of length 6 is which; .*It")
        for shape in ((6, 50, 6), (4, 6, 6), (6, 6, 50), (6, 6, 6))
    },
    "square": ({"X": np.zeros((6, 6))}, "cannot be told which axis counts samples"),
    "flattened": (
        {"X": X.reshape(4, -1), "y": LABELS},
        r"X.reshape\(4, 6, 50\)\.transpose\(0, 2, 1\) in the",
    ),
    "time as first column": ({"a": {"X": np.zeros((50, 7))}}, r"save a/X\[..., 1:\] as X and a/X\[:, 0\] as"),
    "time as first columns": ({"X": np.zeros((4, 50, 7))}, r"X\[..., 1:\] as X and X\[0, :, 0\] as t \(s\)"),
    "many arrays": ({f"a{i:02}": np.zeros(4) for i in range(30)}, "a07 .* and 22 more"),
    "five axes": ({a: VECTORS[a] for a in AXES[:5]}, "no recordings are recognised"),
    "an axis twice": ({**VECTORS, "mx": W[:, 0]}, "both mean tx"),
    "axes of different lengths": ({**VECTORS, "fx": W[:9, 0]}, "the axes differ in shape"),
    "names of axes as numbers": ({"X": X, "axes": np.ones((2, 3))}, "axes: does not hold names"),
    "a cell that is empty": ({"X": [W, np.zeros((0, 0))]}, r"X\[1\]: is no recording: wanted \(samples, 6\)"),
    # samples
    "NaN": ({"X": HOLE}, "X: recording 2, sample 16, axis ty"),
    "only NaN": ({"X": np.full(X.shape, np.nan)}, "X: recording 0, no samples .or only NaN."),
    "infinite": ({"X": [W, X[1] * np.inf]}, r"X\[1\]: sample 0, axis fx is"),
    "NaN at the end of one": (
        {"X": np.where(np.arange(50)[:, None] > 40, np.nan, W)},
        "sample 41, axis fx is",
    ),
    "no recordings": ({"X": np.zeros((0, 50, 6))}, r"X \(0, 50, 6\) is empty: it holds no samples"),
    "no samples": ({"X": np.zeros((0, 6))}, r"X \(0, 6\) is empty: it holds no samples"),
    # what stands beside
    "stamps of three": ({"X": X, "t": STAMPS[:3]}, r"t: has the shape \(3, 50\) for 4 recordings"),
    "stamps too short": ({"X": X, "t": np.arange(49)}, "t: has 49 values for the 50 samples of recording 0"),
    "stamps of NaN": ({"X": W, "t": np.full(50, np.nan)}, "stamp of sample 0 is nan"),
    "stamps of text": ({"X": W, "t": ["a"] * 50}, "t: "),
    "stamps that run back": ({"X": W, "time": np.where(np.arange(50) == 7, 0.01, T)}, "sample 7: time runs"),
    "rate of text": ({"X": X, "fs": "fast"}, "fs: is no sampling rate"),
    "rate of zero": ({"X": X, "fs": 0}, "fs: is no sampling rate"),
    "rates": ({"X": X, "fs": np.array([1, 2, 3])}, "fs: has 3 values for 4 recordings"),
    "sessions": ({"X": X, "session": ["a", "b"]}, "session: has 2 values for 4 recordings"),
    "trigger": ({"X": X, "trigger_index": 50}, r"trigger_index\[0\].* is 50"),
    "flags": ({"X": X, "flags": np.full((4, 50), 99)}, r"flags\[0\].* is 99; wanted bits of SampleFlag"),
    "flags of half": ({"X": X, "flags": np.zeros((4, 25))}, "flags: has 25 values"),
    # forces and torques
    "lengths": ({"force": FORCES, "torque": TORQUES[:, 1:]}, r"\(4, 50, 3\) and torque \(4, 49, 3\) differ"),
    "orders": (
        {"force": FORCES[0], "torque": TORQUES[0].T},
        r"\(50, 3\) and torque \(3, 50\) differ in shape",
    ),
    "cells": ({"force": list(FORCES), "torque": list(TORQUES)[1:]}, "force holds 4 and torque 3 recordings"),
    "a list and an array": ({"force": FORCES, "torque": list(TORQUES)}, "force and torque"),
    "two of a kind": ({"F": FORCES, "force": FORCES, "torque": TORQUES}, "'F' and 'force' may both be the"),
    "forces alone": ({"force": FORCES}, r"force \(4, 50, 3\) has 3 axes.*save force and torque as arrays of"),
    "other units": ({"force_mN": FORCES, "torque": TORQUES}, "has 3 axes"),
    "three of three": ({"force": FORCES[:3], "torque": TORQUES[:3]}, "which of the axes of length 3 is"),
    "square halves": ({"force": W[:3, :3], "torque": W[:3, 3:]}, "cannot be told which axis counts samples"),
}


@pytest.mark.parametrize(
    ("name", "form"), [(name, form) for name, (_, _, forms, *_) in READ.items() for form in forms]
)
def test_layouts(tmp_path: Path, name: str, form: str) -> None:
    tree, wrenches, _, options, expected = READ[name]
    data = load(written(tree, form, tmp_path), **options)
    assert wrenches is None or len(data) == len(wrenches)
    for recording, wrench in zip(data, data if wrenches is None else wrenches, strict=True):
        assert wrenches is None or np.array_equal(recording.wrench, wrench)
    notes = data.history[-1].notes
    expected = dict(expected)
    assert all(any(part in note for note in notes) for part in expected.pop("notes", ()))
    found = {
        "labels": [r.label for r in data],
        "sessions": [r.session for r in data],
        "names": [r.name for r in data],
        "starts": [r.start_time for r in data],
        "triggers": [r.trigger_index for r in data],
        "rates": [r.rate_hz for r in data],
        "rate": data[0].rate_hz,
        "meta": dict(data[0].meta),
        "flags": [int(r.flags.argmax()) for r in data if r.flags is not None],
        "stamps": None if data[0].time_s is None else data[0].time_s.tolist(),
    }
    if data[0].time_s is None and "rates" not in expected:
        expected.setdefault("rate", 500)
    assert {key: found[key] for key in expected} == {
        key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in expected.items()
    }


@pytest.mark.parametrize(
    ("name", "form"), [(name, form) for name, (tree, _) in REFUSED.items() for form in formats_of(tree)]
)
def test_what_cannot_be_understood_is_refused(tmp_path: Path, name: str, form: str) -> None:
    tree, message = REFUSED[name]
    path = written(tree, form, tmp_path)
    with pytest.raises(RecordingFileError, match=message) as caught:
        load(path, rate_hz=None if {"fs", "t", "time"} & set(tree) else 500)
    assert path.name in str(caught.value)


# -- trees that no file need hold


def read_tree(tree, source=None, **settings):
    source = source or FileSource.alone(Path("set.mat"))
    return recordings_of(tree, source, LoadOptions(**settings), "variable")


def test_what_the_user_states_is_used_or_compared() -> None:
    assert read_tree({"X": X}, rate_hz=500).recordings[0].rate_hz == 500
    with pytest.raises(RecordingFileError, match="the stated rate is 100 Hz, but the file says 500 Hz"):
        read_tree({"X": X, "fs": np.array(500)}, rate_hz=100)
    place = Path("set.mat")
    stated = FileSource(place, place.parent, "a push", rate_hz=50.0, start_time=7.0, trigger_index=3)
    (recording,) = read_tree({"X": W}, stated).recordings
    assert (recording.name, recording.rate_hz, recording.start_time) == ("a push", 50, 7)
    assert recording.trigger_index == 3


def test_only_what_is_used_is_read() -> None:
    class Lazy:
        def __init__(self, array):
            self.array, self.shape, self.dtype, self.reads = array, array.shape, array.dtype, 0

        def read(self):
            self.reads += 1
            return self.array

    block, other = Lazy(X), Lazy(np.zeros((4, 600)))
    content = read_tree({"X": block, "hfmh": other, "rate_hz": np.array(500)})
    assert (block.reads, other.reads) == (1, 0)
    assert "not used: hfmh (4, 600) float64" in content.notes


def test_complex_numbers_are_no_samples() -> None:
    with pytest.raises(RecordingFileError, match="X: has dtype complex128; wanted real numbers"):
        read_tree({"X": X * 1j}, rate_hz=500)


def test_fields_of_a_structured_array_are_arrays() -> None:
    table = np.zeros(4, [("X", "f8", (50, 6)), ("label", "U8")])
    table["X"], table["label"] = X, LABELS
    assert [r.label for r in read_tree({"table": table}, rate_hz=500).recordings] == LABELS


@pytest.mark.parametrize("wrap", [lambda inner: {"a": inner}, lambda inner: [inner]])
def test_trees_nested_without_end_are_refused(wrap) -> None:
    tree = X
    for _ in range(5000):
        tree = wrap(tree)
    with pytest.raises(RecordingFileError, match="more than 16 deep"):
        read_tree({"a": tree}, rate_hz=500)


_SHAPES = st.lists(st.sampled_from([0, 1, 2, 3, 6, 7]), max_size=4).map(tuple)
_LEAVES = st.one_of(
    st.builds(np.zeros, _SHAPES, st.sampled_from(["f8", "i4", "c16", "U3", "?"])),
    st.builds(np.full, _SHAPES, st.sampled_from([0.002, 1.0, 2.0, 7])),
    st.text(max_size=3),
    st.sampled_from(["mN", "N, N m", "fx, fy, fz, tx, ty, tz", "time, axis", "ms"]),
    st.sampled_from([["mN"] * 6, AXES, ["time", *AXES], ["recording", "time", "axis"]]),
    st.none(),
)
_WORDS = (
    "X y labels fs t force T fx fy fz tx ty tz rice session flags axes names a units t_units force_units columns "
    "lengths mask dims dt time_ms joint_pos ft_1 scale_factor _FillValue trial"
)
_NAMES = st.sampled_from(_WORDS.split(" "))
_TREES = st.recursive(
    _LEAVES,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(_NAMES, inner, max_size=4),
    max_leaves=8,
)


@given(st.dictionaries(_NAMES, _TREES, max_size=8))
def test_any_tree_gives_recordings_or_one_kind_of_error(tree) -> None:
    try:
        content = read_tree(tree, rate_hz=500)
    except RecordingFileError:
        return
    assert all(np.isfinite(r.wrench).all() for r in content.recordings)
