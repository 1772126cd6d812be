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
STAMPS = np.cumsum(np.random.default_rng(1).uniform(0.01, 0.02, (4, 50)), axis=1) + 1.7e9
PADDED = X.copy()
PADDED[1, 30:] = PADDED[3, 49:] = np.nan
CUT = [X[0], X[1, :30], X[2], X[3, :49]]
CLASSES = ["oats", "peas", "rice"]
CODES = np.array([2, 1, 2, 0])
STRUCTS = [
    {"wrench": w, "material": label, "fs": rate, "trigger_index": 3, "tool": "rod"}
    for w, label, rate in zip(RAGGED, LABELS, (500, 100, 500, 100), strict=True)
]
MATERIALS = {"oats": X[:2].transpose(1, 2, 0), "peas": X}
HALVES = {"force": FORCES, "torque": TORQUES}


def at_500(wrenches=X, /, **arrays):
    """A case whose file states 500 Hz: a tree of arrays, and the samples in it."""
    return {**arrays, "fs": 500}, wrenches


ORDERS = {
    **{
        f"labels tell recordings {order}": (*at_500(X=X.transpose(order), labels=LABELS), {"labels": LABELS})
        for order in permutations(range(3))
    },
    **{
        f"stamps tell samples {order}": (
            {"data": X[:, :8].transpose(order), "t": T[:8] * 5},
            X[:, :8],
            {"rate": 100},
        )
        for order in [(1, 2, 0), (0, 2, 1), (2, 0, 1), (1, 0, 2)]
    },
    **{
        f"halves in the order {order}": at_500(
            force=FORCES.transpose(order), torque=TORQUES.transpose(order), y=LABELS
        )
        for order in [(1, 2, 0), (0, 2, 1), (2, 0, 1), (2, 1, 0)]
    },
}
NAMES = {
    **{f"samples as {name}": at_500(**{name: X}) for name in ("X", "data", "anything")},
    **{
        f"labels as {name}": (*at_500(X=X, **{name: LABELS}), {"labels": LABELS})
        for name in ("y", "Materials", "target")
    },
    **{
        f"{force} and {torque}": at_500(**{torque: TORQUES, force: FORCES})
        for force, torque in (
            *[("Force", "moment"), ("F", "T"), ("f", "tau"), ("ee_force", "ee_torque")],
            *[("forces_N", "moments_Nm"), ("Force [N]", "Torque [N m]")],
        )
    },
}
READ = {
    **ORDERS,
    **NAMES,
    # one array of recordings
    **{
        f"of type {kind}": at_500(np.rint(X * 10), X=np.rint(X * 10).astype(kind))
        for kind in ("f4", ">f8", "i2")
    },
    "column-major": at_500(X=np.asfortranarray(X)),
    "matrices beside it": (
        *at_500(calibration=np.eye(6), limits=np.ones((2, 6)), mean_push=X.mean(0), data=X),
        {"notes": "not used: calibration (6, 6) float64, limits (2, 6)"},
    ),
    "a matrix beside one recording": at_500([W], calibration=np.eye(6), rice=W),
    "padding of NaN": (
        {"X": PADDED, "t": np.arange(50) / 100},
        CUT,
        {"rate": 100, "notes": "X: NaN at the end of 2 recordings taken as padding and left out"},
    ),
    "other axes": at_500(X[..., :2], X=X[..., :2], axes=["force", "depth"]),
    # labels
    **{
        f"numbers from {first}": (
            *at_500(X=X, y=CODES + first, class_names=CLASSES),
            {"labels": LABELS, "notes": f"labels are the numbers in y, counted from {first} in class_names"},
        )
        for first in (0, 1)
    },
    "numbers without names": (
        *at_500(X=X, y=CODES),
        {"labels": ["2", "1", "2", "0"], "notes": "no names of classes were found"},
    ),
    "names of classes around": (
        {"classes": CLASSES, "set": {"X": X, "y": CODES, "fs": 500}},
        X,
        {"labels": LABELS},
    ),
    "texts beside numbers": (*at_500(X=X, y=CODES, labels=LABELS), {"labels": LABELS}),
    "padded texts": (*at_500(X=X, labels=np.array([f"{x:9}" for x in LABELS])), {"labels": LABELS}),
    "bytes": (*at_500(X=X, labels=np.array(LABELS, "S")), {"labels": LABELS, "only": ("npz", "h5")}),
    "an empty text": (
        *at_500(X=X, labels=["rice", "", "peas", ""]),
        {"labels": ["rice", None, "peas", None], "only": ("npz", "h5", "mat")},
    ),
    "one label for all, one name for the file": (
        *at_500(X=X, label="rice", name="kitchen", start_time=5.0),
        {"labels": ["rice"] * 4, "meta": {"name": "kitchen", "start_time": 5.0}, "starts": [None] * 4},
    ),
    "texts under a name that says nothing": (
        *at_500(X=X, arr_1=LABELS),
        {"labels": [None] * 4, "notes": "arr_1 holds a text per recording: if it names the materials"},
    ),
    # what stands beside
    "all of it": (
        *at_500(
            X=X,
            session=np.array([1, 1, 2, 2]),
            names=["a", "b", "c", "d"],
            start_time=np.array([1.7e9, np.nan, 5, 6]),
            trigger_index=np.array([-1, 0, 49, 7]),
            flags=np.eye(4, 50, dtype=np.uint8),
        ),
        {
            "sessions": ["1", "1", "2", "2"],
            "names": ["a", "b", "c", "d"],
            "starts": [1.7e9, None, 5, 6],
            "triggers": [None, 0, 49, 7],
            "flags": [0, 1, 2, 3],
        },
    ),
    "rates of each": ({"X": X, "fs": np.array([500, 500, 100, 100])}, X, {"rates": [500, 500, 100, 100]}),
    "stamps of each": (
        {"X": X, "t": STAMPS, "label": LABELS},
        X,
        {"labels": LABELS, "starts": STAMPS[:, 0].tolist()},
    ),
    "stamps of each in columns": ({"X": X, "t": STAMPS.T}, X, {"starts": STAMPS[:, 0].tolist()}),
    "stamps in cells": ({"X": RAGGED, "time": [np.arange(len(w)) / 500 for w in RAGGED]}, RAGGED),
    "uneven stamps that all share": (
        {"X": X, "time": STAMPS[0]},
        X,
        {"stamps": (STAMPS[0] - STAMPS[0, 0]).tolist()},
    ),
    # cells, materials, structs
    "cells of any length": (*at_500(RAGGED, c=RAGGED, labels=LABELS), {"labels": LABELS}),
    "cells with their axes first": (
        *at_500(RAGGED, c=[w.T for w in RAGGED]),
        {"notes": "c[0] (6, 50) taken as axes, samples"},
    ),
    "an array or cells per material": (
        {"materials_set": {**MATERIALS, "rice": RAGGED}, "fs": 500},
        [*X[:2], *X, *RAGGED],
        {
            "labels": ["oats"] * 2 + ["peas"] * 4 + ["rice"] * 4,
            "notes": "oats, peas, rice taken as labels of the recordings in them",
        },
    ),
    "an array per material": (
        {"a": MATERIALS, "fs": 500},
        [*X[:2], *X],
        {"labels": ["oats"] * 2 + ["peas"] * 4},
    ),
    "cells of cells": (
        *at_500(RAGGED, data=[RAGGED[:3], RAGGED[3:]], materials=["rice", "peas"]),
        # savemat cannot write rows of different lengths side by side
        {"labels": ["rice"] * 3 + ["peas"], "only": ("v73.mat",)},
    ),
    "a row of cells per material": (
        *at_500([*X, X[0], X[1]], data=[[X[0], X[1], X[2]], [X[3], X[0], X[1]]], materials=["rice", "peas"]),
        {"labels": ["rice"] * 3 + ["peas"] * 3},
    ),
    "cells of structs": (
        {"trials": STRUCTS},
        RAGGED,
        {"labels": LABELS, "rates": [500, 100, 500, 100], "triggers": [3] * 4, "meta": {"tool": "rod"}},
    ),
    "structs under the names of recordings": (
        *at_500(RAGGED, **{f"rice_{i}": {"wrench": w, "session": f"day {i}"} for i, w in enumerate(RAGGED)}),
        {
            "labels": ["rice"] * 4,
            "names": ["rice_0", "rice_1", "rice_2", "rice_3"],
            "sessions": ["day 0", "day 1", "day 2", "day 3"],
            "notes": "and the part before the number as label",
        },
    ),
    "names without numbers": (
        *at_500(RAGGED[:2], first=RAGGED[0], second=RAGGED[1]),
        {"names": ["first", "second"], "labels": [None] * 2},
    ),
    **{
        f"a single {inner} per material": (
            *at_500([X[1], X[0]], peas={inner: X[1]}, rice={inner: node}),
            {"labels": ["peas", "rice"], "names": [f"peas/{inner}", f"rice/{inner}"]},
        )
        for inner, node in (("rice_1", X[0]), ("trial0", {"wrench": X[0]}))
    },
    **{
        f"groups that are no materials: {outer}": (
            *at_500(X[:2], **{outer[0]: {inner: X[0]}, outer[1]: {inner: X[1]}}),
            {"labels": [None] * 2},
        )
        for outer, inner in ((("push1", "push2"), "ati1"), (("one", "two"), "ati"))
    },
    # a wrench in parts
    "a vector for each axis": (
        {
            **dict(zip(("Force_X", "Fy", "fz", "Tx", "torque_y", "Mz"), W.T, strict=True)),
            **{"time": T, "label": "rice", "speed": 0.03},
        },
        [W],
        {"labels": ["rice"], "meta": {"speed": 0.03}},
    ),
    "a matrix for each axis": at_500(SIX, **dict(zip(AXES, SIX.transpose(2, 0, 1), strict=True))),
    "halves and a calibration": (
        *at_500(**HALVES, calibration=np.eye(6)),
        {"notes": "force and torque joined: forces, then torques"},
    ),
    "halves of six recordings": at_500(SIX, force=SIX[..., :3], torque=SIX[..., 3:]),
    "halves of one, turned": ({"force": FORCES[0].T, "torque": TORQUES[0].T, "time": T}, [W]),
    "halves in cells": at_500(RAGGED, forces=[w[:, :3] for w in RAGGED], torques=[w[:, 3:] for w in RAGGED]),
    "halves in groups": (
        {
            m: {f"trial{i}": {"force": w[:, :3], "torque": w[:, 3:], "fs": 500} for i, w in enumerate(X)}
            for m in ("a", "b")
        },
        [*X, *X],
        {"labels": ["a"] * 4 + ["b"] * 4},
    ),
    "halves with padding": at_500(CUT, force=PADDED[..., :3], torque=PADDED[..., 3:]),
    "halves beside the whole": (*at_500(wrench=X, **HALVES), {"notes": "not used: force"}),
}
"""By name: a tree, the samples in it, and what else is known of the recordings."""

REFUSED = {
    # labels
    "too few": ({"X": X, "y": np.array([1, 2, 3])}, "y: has 3 values for 4 recordings"),
    "fractions": ({"X": X, "y": np.array([1, 2, 0.5, 3])}, "y: holds numbers that are not whole"),
    "one-hot": ({"X": X, "y": np.eye(4)}, r"y: has the shape \(4, 4\)"),
    "outside the names": ({"X": X, "y": CODES, "classes": ["a", "b"]}, "runs from 0 to 2, but classes has 2"),
    "0 or 1": ({"X": X, "y": np.array([1, 1, 2, 2]), "classes": CLASSES}, "counts from 0 or 1 cannot be"),
    "two lists": ({"X": X, "y": LABELS, "label": LABELS[::-1]}, "more than one list of labels"),
    "two lists of names": (
        {"X": X, "y": np.array([1, 1, 2, 2]), "classes": ["a", "b"], "class_names": ["c", "d"]},
        "more than one list of names",
    ),
    "no labels": ({"X": X, "y": np.zeros((0, 0))}, " y"),
    "labels and names": ({"peas": X, "rice": X, "labels": LABELS * 2}, "labels in labels, and recordings un"),
    "a table of cells": ({"c": [[W, W], [W, W], [W, W]], "materials": ["rice", "peas"]}, "3 x 2 cells"),
    # which array, which axis
    "nothing": ({"fs": 500}, "no recordings are recognised"),
    "two arrays": ({"X": X, "X_filtered": X}, r"'X' and 'X_filtered' may all be.*X_filtered \(4, 50, 6\)"),
    "train and test": ({"X_test": X, "X_train": X, "y_train": LABELS}, "'X_test' and 'X_train' may all be"),
    "a shape that lengths cannot tell": ({"X": X[:, :8].transpose(1, 2, 0)}, "it cannot be told which axis"),
    **{
        f"two axes of six: {shape}": ({"X": np.zeros(shape)}, "which of the axes of length 6 is which; .*It")
        for shape in ((6, 50, 6), (4, 6, 6), (6, 6, 6))
    },
    "square": ({"X": np.zeros((6, 6))}, "cannot be told which axis counts samples"),
    "square with stamps": ({"X": np.zeros((6, 6)), "t": T[:6]}, "cannot be told which axis counts samples"),
    "flattened": ({"X": X.reshape(4, -1), "y": LABELS}, r"X.reshape\(4, 6, 50\)\.transpose\(0, 2, 1\) if"),
    "time as first column": ({"a": {"X": np.zeros((50, 7))}}, r"save a/X\[..., 1:\] as X and a/X\[:, 0\] as"),
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
    "no samples": ({"X": np.zeros((0, 6))}, r"X \(0, 6\) is empty: it holds no samples"),
    # what stands beside
    "stamps of three": ({"X": X, "t": STAMPS[:3]}, r"t: has the shape \(3, 50\) for 4 recordings"),
    "stamps too short": ({"X": X, "t": np.arange(49)}, "t: has 49 values for the 50 samples of recording 0"),
    "stamps of NaN": ({"X": W, "t": np.full(50, np.nan)}, "stamp of sample 0 is nan"),
    "stamps of text": ({"X": W, "t": ["a"] * 50}, "t: "),
    "stamps that run back": ({"X": W, "time": np.where(np.arange(50) == 7, 0.01, T)}, "sample 7: time runs"),
    "rate of zero": ({"X": X, "fs": 0}, "fs: is no sampling rate"),
    "rates": ({"X": X, "fs": np.array([1, 2, 3])}, "fs: has 3 values for 4 recordings"),
    "trigger": ({"X": X, "trigger_index": 50}, r"trigger_index\[0\].* is 50"),
    "flags": ({"X": X, "flags": np.full((4, 50), 99)}, r"flags\[0\].* is 99; wanted bits of SampleFlag"),
    # forces and torques
    "lengths": ({"force": FORCES, "torque": TORQUES[:, 1:]}, r"\(4, 50, 3\) and torque \(4, 49, 3\) differ"),
    "cells": ({"force": list(FORCES), "torque": list(TORQUES)[1:]}, "force 4 and torque 3 recordings"),
    "a list and an array": ({"force": FORCES, "torque": list(TORQUES)}, "both in lists"),
    "two of a kind": ({"F": FORCES, "force": FORCES, "torque": TORQUES}, "'F' and 'force' may both be the"),
    "forces alone": ({"force": FORCES}, r"force \(4, 50, 3\) has 3 axes.*save force and torque as arrays of"),
    "other units": ({"force_mN": FORCES, "torque": TORQUES}, "has 3 axes"),
    "three of three": ({"force": FORCES[:3], "torque": TORQUES[:3]}, "which of the axes of length 3 is"),
}
"""By name: a tree, and what its refusal must say; recorded at 500 Hz, where it has no clock."""


@pytest.mark.parametrize(
    ("name", "form"),
    [
        (name, form)
        for name, (tree, _, *more) in READ.items()
        for form in formats_of(tree)
        if form in (more[0] if more else {}).get("only", WRITERS)
    ],
)
def test_layouts(tmp_path: Path, name: str, form: str) -> None:
    tree, wrenches, *more = READ[name]
    expected = dict(more[0]) if more else {}
    said = expected.pop("notes", "")
    expected.pop("only", None)
    data = load(written(tree, form, tmp_path))
    assert len(data) == len(wrenches)
    assert all(np.array_equal(r.wrench, wrench) for r, wrench in zip(data, wrenches, strict=True))
    assert said in "; ".join(data.history[-1].notes)
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
    assert {key: found[key] for key in expected} == expected


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


def test_complex_numbers_are_no_samples_and_fields_of_a_structured_array_are_arrays() -> None:
    with pytest.raises(RecordingFileError, match="X: has dtype complex128; wanted real numbers"):
        read_tree({"X": X * 1j}, rate_hz=500)
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
