"""The convention for arrays, in every format that holds them, and the way out of everything else, followed."""

from __future__ import annotations

import re

import h5py
import numpy as np
import pytest
import scipy.io

from granular_id import Dataset
from granular_id.io import RecordingFileError, load
from layouts_written import LABELS, RAGGED, WRITERS, T, W, X, formats_of, written

AXES = ["fx", "fy", "fz", "tx", "ty", "tz"]
UNEQUAL = [X[0], X[1, :30], X[2], X[3, :49]]
PADDED = np.stack([np.pad(one, ((0, 50 - len(one)), (0, 0)), constant_values=np.nan) for one in UNEQUAL])
DAYS = ["mon", "tue", "mon", "tue"]
STRUCTS = [{"wrench": w, "material": y, "fs": 500.0} for w, y in zip(X, LABELS, strict=True)]

READ = {
    "X and y": ({"X": X, "y": LABELS, "fs": 500}, X, LABELS),
    "without labels": ({"X": X, "rate_hz": 500}, X, None),
    "sessions and names": (
        {"X": X, "y": LABELS, "Fs": 500, "session": DAYS, "name": list("abcd")},
        X,
        LABELS,
    ),
    "numbers as labels": ({"X": X, "y": np.array([1.0, 2, 1, 3]), "fs": 500}, X, ["1", "2", "1", "3"]),
    "lengths": (
        {"X": np.nan_to_num(PADDED), "y": LABELS, "fs": 500, "lengths": np.array([50, 30, 50, 49])},
        UNEQUAL,
        LABELS,
    ),
    "NaN behind shorter ones": ({"X": PADDED, "y": LABELS, "fs": 500}, UNEQUAL, LABELS),
    "a rate each": ({"X": X, "y": LABELS, "fs": np.full(4, 500.0)}, X, LABELS),
    "a clock for all": ({"X": X, "y": LABELS, "t": T}, X, LABELS),
    "units": ({"X": X, "y": LABELS, "fs": 500, "units": ["mN", "N mm"]}, X / 1000, LABELS),
    "axes in another order": (
        {"X": X[..., ::-1], "y": LABELS, "fs": 500, "axes": ["Tz", "Ty", "Tx", "Fz", "Fy", "Fx"]},
        X,
        LABELS,
    ),
    "a clock among the columns": (
        {"X": np.concatenate([np.tile(T[:, None], (4, 1, 1)), X], axis=2), "y": LABELS, "axes": ["t", *AXES]},
        X,
        LABELS,
    ),
    "one recording": ({"wrench": W, "fs": 500}, [W], None),
    "named as their labels": (
        {"rice": W, "peas_1": X[1], "peas_2": X[2], "fs": 500},
        X[:3],
        ["rice", "peas", "peas"],
    ),
    "groups of a label": (
        {"rice": {"w1": W, "w2": X[1]}, "peas": {"w1": X[2]}, "fs": 500},
        X[:3],
        ["rice", "rice", "peas"],
    ),
    "cells": ({"X": RAGGED, "y": LABELS, "fs": 500}, RAGGED, LABELS),
    "cells of a label": (
        {"rice": [*RAGGED[:2]], "peas": [RAGGED[2]], "fs": 500},
        RAGGED[:3],
        ["rice", "rice", "peas"],
    ),
}


@pytest.mark.parametrize(
    ("case", "form"), [(case, form) for case, (tree, *_) in READ.items() for form in formats_of(tree)]
)
def test_arrays_by_the_convention_are_read(tmp_path, case, form):
    tree, wrenches, labels = READ[case]
    data = load(written(tree, form, tmp_path))
    order = {tuple(np.round(w[0], 12)): i for i, w in enumerate(wrenches)}  # HDF5 sorts names
    places = [order[tuple(np.round(r.wrench[0], 12))] for r in data]
    assert sorted(places) == list(range(len(wrenches)))
    for place, recording in zip(places, data, strict=True):
        np.testing.assert_allclose(recording.wrench, wrenches[place], rtol=1e-15)
        assert recording.label == (None if labels is None else labels[place])
        assert recording.rate_hz == 500
    if case == "sessions and names":
        assert (data.sessions.tolist(), data.names) == (DAYS, ("a", "b", "c", "d"))


CHOSEN = {
    "another name": ({"signal": X, "material": LABELS}, {"array": "signal", "label": "column:material"}),
    "one of two": ({"ee_wrench": X, "ee_wrench_filtered": X * 2, "y": LABELS}, {"array": "ee_wrench"}),
    "one of two in groups": (
        {
            f"demo_{i}": {"obs": {"ee": x, "filtered": x * 2, "joints": x[:, :5]}, "y": y}
            for i, (x, y) in enumerate(zip(X, LABELS, strict=True))
        },
        {"array": "obs/ee"},
    ),
    "time in the first column": (
        {"log": np.concatenate([np.tile(T[:, None], (4, 1, 1)), X], axis=2), "material": LABELS},
        {"array": "log", "axes": "time,fx,fy,fz,tx,ty,tz", "label": "column:material"},
    ),
    "structs": ({"pushes": STRUCTS}, {"array": "wrench", "label": "column:material"}),
}


@pytest.mark.parametrize(
    ("case", "form"), [(case, form) for case, (tree, _) in CHOSEN.items() for form in formats_of(tree)]
)
def test_array_and_label_choose_and_are_part_of_the_setup(tmp_path, case, form):
    tree, options = CHOSEN[case]
    data = load(written({**tree, "fs": 500}, form, tmp_path), **options)
    assert np.array_equal(data.X, X)
    assert data.y.tolist() == LABELS
    assert data[0].meta["read_as"].partition(", axes=")[0] == f"array={options['array']}"


WAYS_OUT = {
    "time first": {"data": X.transpose(1, 0, 2), "labels": LABELS},
    "axes first": {"data": X.transpose(2, 0, 1), "labels": LABELS},
    "axes in the middle": {"X": X.transpose(0, 2, 1), "y": LABELS},
    "time first beside X": {"X": X.transpose(1, 0, 2), "y": LABELS},
    "one, axes first": {"wrench": W.T},
    "forces and torques": {"force": X[..., :3], "torque": X[..., 3:], "labels": LABELS},
    "forces and torques of one": {"force": W[:, :3], "torque": W[:, 3:]},
    "F and M": {"F": W[:, :3], "M": W[:, 3:]},
    "vectors": dict(zip(AXES, W.T, strict=True)),
    "flat rows": {"features": X.reshape(4, -1), "labels": LABELS},
}


@pytest.mark.parametrize("form", WRITERS)
@pytest.mark.parametrize("case", WAYS_OUT)
def test_the_line_of_an_error_reads_the_file(tmp_path, case, form):
    tree = WAYS_OUT[case]
    path = written({**tree, "fs": 500}, form, tmp_path)
    with pytest.raises(RecordingFileError, match=r"it holds .*; in Python: ") as caught:
        load(path)
    line = caught.value.problem.rpartition("; in Python: ")[2].partition(" where the axes")[0]
    assignment, _, call = line.partition("; ")
    scope = {"numpy": np, "scipy": scipy, "h5py": h5py, "Dataset": Dataset}
    exec(assignment, scope)
    data = eval(call, scope)
    getattr(scope["f"], "close", int)()
    one = "labels" not in tree and "y" not in tree
    assert data.rate_hz == 500
    np.testing.assert_array_equal(data.X, X[:1] if one else X)
    if not one:
        assert data.y.tolist() == LABELS


REFUSED = {
    "no rate": ({"X": X, "y": LABELS}, "has no clock .* and no rate is stated; pass rate_hz="),
    "labels of others": ({"X": X, "y": LABELS[:3], "fs": 500}, "y has 3 values, and X .* 4 recordings"),
    "lengths too long": ({"X": X, "fs": 500, "lengths": np.array([50, 51, 50, 50])}, r"lengths\[1\] is 51"),
    "lengths of texts": (
        {"X": X, "fs": 500, "lengths": ["a", "b", "c", "d"]},
        r"lengths\[0\] is a, and X .*\)$",
    ),
    "two rates": ({"X": X, "fs": 500, "rate_hz": 100}, r"fs and rate_hz say two things; .*\)$"),
    "rate of no number": ({"X": X, "fs": -1.0}, "fs is '-1'; wanted a rate above 0"),
    "units of others": ({"X": X, "fs": 500, "units": ["N", "N", "N", "N"]}, "units has 4 for 6"),
    "unit unknown": ({"X": X, "fs": 500, "units": ["lb", "N m"]}, "its unit is 'lb'"),
    "axes of others": ({"X": X, "fs": 500, "axes": AXES[:5]}, "axes has 5 names, but wrench has 6 columns"),
    "more recordings than samples": (
        {"X": X[:, :3], "fs": 500},
        "4 recordings of 3 samples; if that is so, pass array='X'",
    ),
    "signals, no materials": (
        {"ee_wrench": W, "ee_wrench_raw": W, "fs": 500},
        "pass array='ee_wrench' or array='ee_wrench_raw'",
    ),
    "seven columns": ({"X": np.ones((4, 50, 7)), "fs": 500}, "7 columns without names; pass axes="),
    "texts": ({"X": np.array([["a", "b"]]), "fs": 500}, "wanted numbers|no array"),
    "nothing": ({"fs": 500}, "it holds no arrays|it holds fs"),
    "partly empty": (
        {"X": np.where(np.arange(1200).reshape(4, 50, 6) == 7, np.nan, X), "fs": 500},
        "column fy, .*sample 1: is empty or NaN",
    ),
}


@pytest.mark.parametrize("form", WRITERS)
@pytest.mark.parametrize("case", REFUSED)
def test_arrays_that_contradict_themselves_are_refused(tmp_path, case, form):
    tree, problem = REFUSED[case]
    with pytest.raises(RecordingFileError, match=problem):
        load(written(tree, form, tmp_path))


def test_more_recordings_than_samples_are_read_where_stated(tmp_path):
    data = load(written({"X": X[:, :3], "fs": 500}, "npz", tmp_path), array="X")
    assert data.X.shape == (4, 3, 6)


def test_names_of_arrays_beside_a_folder_that_says_otherwise_are_refused(tmp_path):
    (tmp_path / "rice").mkdir()
    np.savez(tmp_path / "rice" / "day.npz", push_1=W, push_2=X[1], fs=500)
    assert load(tmp_path).y.tolist() == ["rice"] * 2
    np.savez(tmp_path / "rice" / "day.npz", wet_1=W, wet_2=X[1], fs=500)
    with pytest.raises(RecordingFileError, match="its arrays are called 'wet', and its folder 'rice'"):
        load(tmp_path)
    data = load(tmp_path, label="folder")
    assert data.y.tolist() == ["rice"] * 2
    np.savez(tmp_path / "rice" / "day.npz", wrench=W, fs=500)
    assert load(tmp_path).y.tolist() == ["rice"]


def test_npy_and_structured_arrays(tmp_path):
    np.save(tmp_path / "a.npy", X)
    assert np.array_equal(load(tmp_path / "a.npy", rate_hz=500).X, X)
    np.save(tmp_path / "a.npy", np.rec.fromarrays(W.T, names=AXES))
    with pytest.raises(RecordingFileError, match=re.escape("Dataset.from_frames({name: f[name]")) as caught:
        load(tmp_path / "a.npy", rate_hz=500)
    assignment, _, call = caught.value.problem.partition("in Python: ")[2].partition("; ")
    scope = {"numpy": np, "Dataset": Dataset, "RATE": 500}
    exec(assignment, scope)
    assert np.array_equal(eval(call, scope)[0].wrench, W)


@pytest.mark.parametrize("ending", ["npz", "npy"])
def test_pickled_objects_are_refused_unread(tmp_path, ending):
    path = tmp_path / f"a.{ending}"
    ragged = np.array([W, None], object)
    np.savez(path, X=ragged) if ending == "npz" else np.save(path, ragged, allow_pickle=True)
    with pytest.raises(RecordingFileError, match=r"Python objects \(pickled\), which could run code"):
        load(path)


def test_attributes_of_hdf5_say_what_an_array_is(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name, label in (("rice/1", "rice"), ("peas/1", "peas")):
            file[name] = W * 1000
            file[name].attrs["units"] = ["mN", "mN m"]
            file[name].parent.attrs["rate_hz"], file[name].parent.attrs["session"] = 500, f"day of {label}"
    data = load(tmp_path / "a.h5")
    np.testing.assert_allclose(data.X, [W, W], rtol=1e-15)
    assert (data.y.tolist(), data.sessions.tolist()) == (["peas", "rice"], ["day of peas", "day of rice"])


@pytest.mark.parametrize("link", ["soft", "external", "external data"])
def test_links_and_values_elsewhere_are_not_followed(tmp_path, link):
    (tmp_path / "secret.bin").write_bytes(bytes(9600))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        if link == "external data":
            file.create_dataset("X", (4, 50, 6), "f8", external=[(str(tmp_path / "secret.bin"), 0, 9600)])
        else:
            file["X"] = h5py.SoftLink("/y") if link == "soft" else h5py.ExternalLink("other.h5", "/X")
    with pytest.raises(RecordingFileError, match=r"is a link|other files"):
        load(tmp_path / "a.h5")


def test_matlab_objects_are_left_out_and_said(tmp_path):
    scipy.io.savemat(tmp_path / "a.mat", {"X": X, "fs": 500, "z": np.array([1 + 2j])})
    notes = load(tmp_path / "a.mat").history[-1].notes
    assert any(note.startswith("z left out") for note in notes)
    (tmp_path / "b.mat").write_bytes(b"# Created by Octave 8.4\n# name: X\n")
    with pytest.raises(RecordingFileError, match="save it with -v7"):
        load(tmp_path / "b.mat")


def follow(problem, path):
    """Do what the error says in Python."""
    scope = {"numpy": np, "h5py": h5py, "Dataset": Dataset}
    opening, _, call = problem.partition("in Python: ")[2].partition(", if these are")[0].partition("; ")
    exec(opening, scope)
    return eval(call, scope)


def test_groups_of_what_is_no_material_are_refused(tmp_path):
    path = tmp_path / "a.h5"
    for names in (["monday/1", "monday/2", "day 2/1"], ["rice/left", "rice/right", "peas/left"]):
        with h5py.File(path, "w") as file:
            for i, name in enumerate(names):
                file[name] = X[i]
            file["fs"] = 500
        with pytest.raises(RecordingFileError, match="if these are the labels") as caught:
            load(path)
        data = follow(caught.value.problem, path)
        assert sorted(data.y) == sorted(name.partition("/")[0] for name in names)
        assert data.rate_hz == 500


def test_arrays_of_several_recordings_a_material_have_a_line(tmp_path):
    np.savez(tmp_path / "a.npz", rice=X[:2], peas=X[:1], fs=500)
    with pytest.raises(RecordingFileError, match="if these are the labels") as caught:
        load(tmp_path / "a.npz")
    data = follow(caught.value.problem, tmp_path / "a.npz")
    assert [recording.label for recording in data] == ["rice", "rice", "peas"]
    assert np.array_equal(data[1].wrench, X[1])


def test_counted_runs_are_no_labels(tmp_path):
    np.savez(tmp_path / "a.npz", trial_1=W, trial_2=X[1], fs=500)
    assert [recording.label for recording in load(tmp_path / "a.npz")] == [None, None]


def test_turned_arrays_have_lines_that_read_them_all(tmp_path):
    for arrays, y in (
        ({"X": X.transpose(1, 0, 2)}, [None] * len(X)),
        ({"rice": W.T, "peas_2": W.T}, ["rice", "peas"]),
    ):
        np.savez(tmp_path / "a.npz", fs=500, **arrays)
        with pytest.raises(RecordingFileError) as caught:
            load(tmp_path / "a.npz")
        data = follow(caught.value.problem, tmp_path / "a.npz")
        assert [recording.label for recording in data] == y
        assert np.array_equal(data[0].wrench, X[0] if "X" in arrays else W)


def test_units_under_another_name_are_refused(tmp_path):
    np.savez(
        tmp_path / "a.npz", X=X * [1, 1, 1, 1e3, 1e3, 1e3], y=["rice"] * len(X), fs=500, torque_unit="Nmm"
    )
    with pytest.raises(RecordingFileError, match=r"'torque_unit' states units.* pass units="):
        load(tmp_path / "a.npz")
    np.testing.assert_allclose(load(tmp_path / "a.npz", units=["N", "Nmm"]).X, X, atol=1e-12)
