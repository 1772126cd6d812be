"""The convention for arrays, in every format that holds them, and the way out of everything else, followed."""

from __future__ import annotations

import json

import h5py
import numpy as np
import pytest
import scipy.io

from granular_id.io import RecordingFileError, load
from granular_id.recording import Setup
from layouts_written import LABELS, RAGGED, WRITERS, T, W, X, formats_of, has_lists, written
from remedies import lines_of, options_of, refusal, run

AXES = ["fx", "fy", "fz", "tx", "ty", "tz"]
DAYS = ["mon", "tue", "mon", "tue"]
UNITS = ["mN"] * 3 + ["N mm"] * 3
PAIRS = list(zip(X, LABELS, strict=True))
UNEQUAL = [X[0], X[1, :30], X[2], X[3, :49]]
PADDED = np.stack([np.pad(one, ((0, 50 - len(one)), (0, 0)), constant_values=np.nan) for one in UNEQUAL])
WITH_CLOCK = np.concatenate([np.tile(T[:, None], (4, 1, 1)), X], axis=2)
TIME_FIRST, AXES_LATER = X.transpose(1, 0, 2), X.transpose(0, 2, 1)

READ = {
    "X and y": ({"X": X, "y": LABELS, "fs": 500}, X, LABELS),
    "without labels": ({"X": X, "rate_hz": 500}, X, None),
    "sessions, names": ({"X": X, "y": LABELS, "Fs": 500, "session": DAYS, "name": list("abcd")}, X, LABELS),
    "numbers as labels": ({"X": X, "y": np.array([1.0, 2, 1, 3]), "fs": 500}, X, [1, 2, 1, 3]),
    "lengths": (
        {"X": np.nan_to_num(PADDED), "y": LABELS, "fs": 500, "lengths": np.array([50, 30, 50, 49])},
        UNEQUAL,
        LABELS,
    ),
    "NaN behind shorter ones": ({"X": PADDED, "y": LABELS, "fs": 500}, UNEQUAL, LABELS),
    "a rate each": ({"X": X, "y": LABELS, "fs": np.full(4, 500.0)}, X, LABELS),
    "a clock for all": ({"X": X, "y": LABELS, "t": T}, X, LABELS),
    "units": ({"X": 1000 * X, "y": LABELS, "fs": 500, "units": ["mN", "N mm"]}, X, LABELS),
    "axes in another order": (
        {"X": X[..., ::-1], "fs": 500, "axes": ["Tz", "Ty", "Tx", "Fz", "Fy", "Fx"]},
        X,
        None,
    ),
    "a clock among the columns": ({"X": WITH_CLOCK, "y": LABELS, "axes": ["t", *AXES]}, X, LABELS),
    "one recording": ({"wrench": W, "fs": 500}, [W], None),
    "named as their labels": (
        {"rice": W, "peas_1": X[1], "peas_2": X[2], "fs": 500},
        X[:3],
        ["rice", "peas", "peas"],
    ),
    "counted runs": ({"trial_1": W, "trial_2": X[1], "fs": 500}, X[:2], None),
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


def in_each_form(table):
    return pytest.mark.parametrize(
        ("case", "form"), [(case, form) for case, (tree, *_) in table.items() for form in formats_of(tree)]
    )


def assert_holds(data, wrenches, labels, sessions=None):
    """Find each recording by its first sample, as HDF5 sorts names."""
    places = {round(wrench[0, 0], 9): i for i, wrench in enumerate(wrenches)}
    found = [places.pop(round(r.wrench[0, r.axes.index("fx")], 9)) for r in data]
    assert not places
    for i, recording in zip(found, data, strict=True):
        columns = [recording.axes.index(axis) for axis in AXES]
        np.testing.assert_allclose(recording.wrench[:, columns], wrenches[i], rtol=1e-12)
        assert recording.label == (labels and str(labels[i]))
        assert recording.session == (sessions and sessions[i])
        assert recording.rate_hz == 500


@in_each_form(READ)
def test_arrays_by_the_convention_are_read(tmp_path, case, form):
    tree, wrenches, labels = READ[case]
    data = load(written(tree, form, tmp_path))
    assert_holds(data, wrenches, labels, tree.get("session"))
    if "name" in tree:
        assert data.names == tuple(tree["name"])


CHOSEN = {
    "another name": ({"signal": X, "material": LABELS}, {"array": "signal", "label": "column:material"}),
    "one of two": ({"ee_wrench": X, "ee_wrench_filtered": X * 2, "y": LABELS}, {"array": "ee_wrench"}),
    "one of two in groups": (
        {
            f"demo_{i}": {"obs": {"ee": x, "raw": x * 2, "joints": x[:, :5]}, "y": y}
            for i, (x, y) in enumerate(PAIRS)
        },
        {"array": "obs/ee"},
    ),
    "time in the first column": (
        {"log": WITH_CLOCK, "material": LABELS},
        {"array": "log", "axes": "time,fx,fy,fz,tx,ty,tz", "label": "column:material"},
    ),
    "structs": (
        {"pushes": [{"wrench": w, "material": y, "fs": 500.0} for w, y in PAIRS]},
        {"array": "wrench", "label": "column:material"},
    ),
}


@in_each_form(CHOSEN)
def test_array_and_label_choose_and_are_part_of_the_setup(tmp_path, case, form):
    tree, options = CHOSEN[case]
    data = load(written({**tree, "fs": 500}, form, tmp_path), **options)
    assert_holds(data, X, LABELS)
    assert data[0].meta["read_as"].partition(", axes=")[0] == f"array={options['array']}"


OF_X = {
    "time first": {"data": TIME_FIRST, "labels": LABELS},
    "axes first": {"data": X.transpose(2, 0, 1), "labels": LABELS},
    "axes in the middle": {"X": AXES_LATER, "y": LABELS},
    "time first beside X": {"X": TIME_FIRST, "y": LABELS},
    "time first beside texts": {"recs": TIME_FIRST, "powder": LABELS},
    "forces and torques": {"force": X[..., :3], "torque": X[..., 3:], "labels": LABELS},
    "units and days": {"X": 1000 * AXES_LATER, "y": LABELS, "session": DAYS, "units": UNITS},
    "units by commas": {"data": 1000 * TIME_FIRST, "labels": LABELS, "units": "mN,N mm"},
    "axes the other way round": {"X": X[..., ::-1].transpose(0, 2, 1), "y": LABELS, "axes": AXES[::-1]},
    "a day of all": {"X": AXES_LATER, "y": LABELS, "session": "mon"},
    "parts for training": {"X_train": X[:3], "y_train": LABELS[:3], "X_test": X[3:], "y_test": LABELS[3:]},
    "cells turned": {"X": [one.T for one in X], "labels": LABELS},
    "structs turned": {"set": [{"ft": x.T, "stoff": y} for x, y in PAIRS]},
    "structs of parts": {"set": [{"F": x[:, :3], "M": x[:, 3:], "material": y} for x, y in PAIRS]},
}
LINES = {
    **{case: (tree, X, LABELS) for case, tree in OF_X.items()},
    "one, axes first": ({"wrench": W.T}, [W], None),
    "F and M of one": ({"F": 1000 * W[:, :3], "M": 1000 * W[:, 3:], "units": UNITS}, [W], None),
    "vectors": (dict(zip(AXES, W.T, strict=True)), [W], None),
    "several recordings a material": ({"rice": X[:2], "peas": X[2:3]}, X[:3], ["rice", "rice", "peas"]),
    "one-hot": ({"X": X, "y": np.eye(3)[[0, 1, 0, 2]]}, X, [0, 1, 0, 2]),
    "turned": ({"rice": W.T, "peas_2": X[1].T}, X[:2], ["rice", "peas"]),
}


@in_each_form(LINES)
def test_the_line_of_an_error_reads_all_of_the_file(tmp_path, case, form):
    tree, wrenches, labels = LINES[case]
    problem = refusal(written({**tree, "fs": 500}, form, tmp_path))
    if has_lists(tree) and form == "v73.mat":
        assert problem.endswith("save it with -v7, of which Python reads cells and structs")
        return
    sessions = ["mon"] * 4 if tree.get("session") == "mon" else tree.get("session")
    assert_holds(run(lines_of(problem)[0]), wrenches, labels, sessions)


REFUSED = {
    "no rate": ({"X": X, "y": LABELS}, "has no clock .* and no rate is stated; pass rate_hz="),
    "labels of others": ({"X": X, "y": LABELS[:3], "fs": 500}, "y has 3 values, and X .* 4 recordings"),
    "lengths too long": ({"X": X, "fs": 500, "lengths": np.array([50, 51, 50, 50])}, r"lengths\[1\] is 51"),
    "lengths of texts": ({"X": X, "fs": 500, "lengths": list("abcd")}, r"lengths\[0\] is a, and X .*\)$"),
    "two rates": ({"X": X, "fs": 500, "rate_hz": 100}, r"fs and rate_hz say two things; .*\)$"),
    "rate of no number": ({"X": X, "fs": -1.0}, "fs is '-1'; wanted a rate above 0"),
    "units of others": ({"X": X, "fs": 500, "units": ["N", "N", "N", "N"]}, "units has 4 for 6"),
    "unit unknown": ({"X": X, "fs": 500, "units": ["lb", "N m"]}, "its unit is 'lb'"),
    "axes of others": ({"X": X, "fs": 500, "axes": AXES[:5]}, "axes has 5 names, but wrench has 6 columns"),
    "more recordings than samples": ({"X": X[:, :3], "fs": 500}, "4 recordings of 3 samples; .*array='X'"),
    "signals": ({"ee": W, "ee_raw": W, "fs": 500}, "pass array='ee' .* or array='ee_raw'"),
    "seven columns": ({"X": np.ones((4, 50, 7)), "fs": 500}, "7 columns without names; pass axes="),
    "texts": ({"X": np.array([["a", "b"]]), "fs": 500}, "wanted numbers|no array"),
    "nothing": ({"fs": 500}, "it holds no arrays|it holds fs"),
}


@pytest.mark.parametrize("form", WRITERS)
@pytest.mark.parametrize("case", REFUSED)
def test_arrays_that_contradict_themselves_are_refused(tmp_path, case, form):
    tree, problem = REFUSED[case]
    with pytest.raises(RecordingFileError, match=problem):
        load(written(tree, form, tmp_path))


@pytest.mark.parametrize("form", WRITERS)
def test_partly_empty_samples_have_a_line_that_leaves_them_out(tmp_path, form):
    holed = X.copy()
    holed[1, 7, 2], holed[3, 9, 0] = np.nan, np.inf
    path = written({"X": holed, "y": LABELS, "fs": 500}, form, tmp_path)
    with pytest.raises(RecordingFileError, match=r"column fz, .*sample 7: is empty or NaN") as caught:
        load(path)
    data = run(*lines_of(caught.value.problem))
    assert (data.y.tolist(), [len(one.wrench) for one in data]) == (LABELS, [50, 49, 50, 49])
    assert np.array_equal(data[1].wrench, np.delete(X[1], 7, axis=0))
    assert (data[1].rate_hz, np.diff(data[1].times()).max()) == (None, pytest.approx(0.004))


@pytest.mark.parametrize("form", ["mat", "h5"])
@pytest.mark.parametrize(
    ("odd", "lost"),
    [
        ({"ft": np.where(np.arange(300).reshape(50, 6) == 7, np.nan, X[2])}, 0),
        ({"ft": X[2, :, :5]}, 1),
        ({"ft": np.zeros(0)}, 1),
        ({"material": np.zeros(0)}, 1),
    ],
)
def test_the_line_for_one_odd_struct_has_what_was_typed(tmp_path, form, odd, lost):
    groups = {
        f"push_{i}": {"ft": x, "material": y, "day": day, **(odd if i == 2 else {})}
        for i, (x, y, day) in enumerate(zip(X, LABELS, DAYS, strict=True))
    }
    tree = {"pushes": list(groups.values())} if form == "mat" else groups
    path = written({**tree, "fs": 500}, form, tmp_path)
    data = run(*lines_of(refusal(path, array="ft", label="column:material", session="column:day")))
    left = [0, 1, *([] if lost else [2]), 3]
    assert data.y.tolist() == [LABELS[i] for i in left]
    assert data.sessions.tolist() == [DAYS[i] for i in left]


def test_more_recordings_than_samples_are_read_where_stated(tmp_path):
    data = load(written({"X": X[:, :3], "fs": 500}, "npz", tmp_path), array="X")
    assert data.X.shape == (4, 3, 6)


def test_names_of_arrays_against_the_folder_are_refused(tmp_path):
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
    (line,) = lines_of(refusal(tmp_path / "a.npy"))
    assert np.array_equal(run(line)[0].wrench, W)


def test_attributes_of_hdf5_say_what_an_array_is(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for i, (label, units) in enumerate(zip(LABELS[:2], (["mN", "mN m"], ",".join(UNITS)), strict=True)):
            file[f"{label}/1"] = X[i] * 1000
            file[f"{label}/1"].attrs["units"] = units
            file[label].attrs["rate_hz"], file[label].attrs["session"] = 500, DAYS[i]
    assert_holds(load(tmp_path / "a.h5"), X[:2], LABELS[:2], DAYS[:2])
    for layout in ((0, 2, 1), (1, 0, 2)):
        with h5py.File(tmp_path / "b.h5", "w") as file:
            file["wrench"], file["material"] = 1000 * X.transpose(layout), LABELS
            file["wrench"].attrs["units"], file["wrench"].attrs["fs"] = "mN,mN m", 500
        assert_holds(run(lines_of(refusal(tmp_path / "b.h5"))[0], rate_hz=None), X, LABELS)


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


def test_matlab_objects_are_left_out_with_a_note(tmp_path):
    scipy.io.savemat(tmp_path / "a.mat", {"X": X, "fs": 500, "z": np.array([1 + 2j])})
    notes = load(tmp_path / "a.mat").history[-1].notes
    assert any(note.startswith("z left out") for note in notes)
    (tmp_path / "b.mat").write_bytes(b"# Created by Octave 8.4\n# name: X\n")
    with pytest.raises(RecordingFileError, match="save it with -v7"):
        load(tmp_path / "b.mat")


NAMED = {
    "rice/left rice/right peas/left": [["rice", "rice", "peas"], ["left", "right", "left"]],
    "monday/1 monday/2 day_2/1": [[None] * 3],
    "anna/rice/1/ft anna/peas/2/ft bert/peas/3/ft": [["anna", "anna", "bert"], ["rice", "peas", "peas"]],
    "day1/rice day1/peas day2/rice": [["rice", "peas", "rice"]],
}


@pytest.mark.parametrize("names", NAMED)
def test_names_that_may_be_two_things_have_a_line_each(tmp_path, names):
    places = names.split()
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for i, name in enumerate(places):
            file[name] = X[i]
        file["fs"] = 500
    order = np.argsort(places)
    for line, labels in zip(lines_of(refusal(tmp_path / "a.h5")), NAMED[names], strict=True):
        data = run(line)
        assert [recording.label for recording in data] == [labels[i] for i in order]
        assert all(np.array_equal(one.wrench, X[i]) for one, i in zip(data, order, strict=True))
        assert data.rate_hz == 500


def test_material_run_and_name_are_read_where_the_name_is_chosen(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for i, place in enumerate(["rice/1", "rice/2", "peas/run_1"]):
            file[f"{place}/wrench"], file[f"{place}/joints"] = X[i], np.ones((50, 7))
        file.attrs["fs"] = 500
    assert options_of(tmp_path / "a.h5") == [{"array": "wrench"}]
    data = load(tmp_path / "a.h5", array="wrench")
    assert [(one.label, one.rate_hz) for one in data] == [("peas", 500), ("rice", 500), ("rice", 500)]


def test_columns_in_groups_and_compound_arrays_have_a_line(tmp_path):
    for as_groups in (True, False):
        with h5py.File(tmp_path / f"{as_groups}.h5", "w") as file:
            for label, wrench in (("rice_1", X[0]), ("peas_1", X[1])):
                columns = {"t": T, **dict(zip(AXES, wrench.T, strict=True))}
                if as_groups:
                    for name, values in columns.items():
                        file[f"{label}/{name}"] = values
                else:
                    file[label] = np.rec.fromarrays(list(columns.values()), names=list(columns))
        assert_holds(run(*lines_of(refusal(tmp_path / f"{as_groups}.h5"))), X[:2], LABELS[:2])


@pytest.mark.parametrize("form", ["npz", "compound"])
def test_a_value_a_sample_with_ids_and_units_has_a_line(tmp_path, form):
    rows, n = np.concatenate(X) * [1, 1, 1, 1e3, 1e3, 1e3], len(W)
    names = ["fx", "fy", "fz", "tx_Nmm", "ty_Nmm", "tz_Nmm"]
    columns = dict(zip(names, rows.T, strict=True)) | {
        "t": np.tile(T, 4),
        "trial": np.repeat(np.arange(4), n),
    }
    columns["material"] = np.repeat(np.array(LABELS, "S4"), n)
    if form == "npz":
        np.savez(tmp_path / "a.npz", **(columns | {"material": np.repeat(LABELS, n)}))
    else:
        with h5py.File(tmp_path / "a.h5", "w") as file:
            file["log"] = np.rec.fromarrays(list(columns.values()), names=list(columns))
    (path,) = tmp_path.iterdir()
    assert_holds(run(*lines_of(refusal(path))), X, LABELS)


def test_units_in_names_of_single_axes_stay_in_the_line(tmp_path):
    names = [*AXES[:3], *(f"{axis}_Nmm" for axis in AXES[3:])]
    rows = X[0] * [1, 1, 1, 1e3, 1e3, 1e3]
    np.savez(tmp_path / "a.npz", t=T, **dict(zip(names, rows.T, strict=True)))
    np.testing.assert_allclose(run(*lines_of(refusal(tmp_path / "a.npz"))).X[0], X[0], atol=1e-12)


@pytest.mark.parametrize("ending", ["npz", "npy"])
def test_pickled_objects_have_a_line_for_who_wrote_them(tmp_path, ending):
    path, ragged = tmp_path / f"a.{ending}", np.empty(2, object)
    ragged[:] = [X[0], X[1, :40]]
    np.savez(path, X=ragged) if ending == "npz" else np.save(path, ragged, allow_pickle=True)
    problem = refusal(path)
    assert "which could run code" in problem
    assert [len(one.wrench) for one in run(*lines_of(problem))] == [50, 40]


SIX = np.random.default_rng(3).normal(size=(6, 50, 6))
OF_SIX = ["rice", "peas", "oats"] * 2
ROWS = list(zip(SIX, OF_SIX, strict=True))
NO_Y = {
    "labels beside X": ({"X": SIX, "labels": OF_SIX}, ["label=column:labels"]),
    "another name of both": ({"recs": SIX, "targets": OF_SIX}, ["array=recs label=column:targets"]),
    "texts of any name": ({"X": SIX, "powder": OF_SIX}, ["label=column:powder"]),
    "in a group": ({"recs": SIX, "about": {"powder": OF_SIX}}, ["array=recs label=column:about/powder"]),
    "names beside": (
        {"recs": SIX, "ids": list("abcdef"), "powder": OF_SIX},
        ["array=recs label=column:powder"],
    ),
    "two texts": (
        {"recs": SIX, "operator": ["anna", "bert", "anna"] * 2, "powder": OF_SIX},
        ["array=recs label=column:powder", "array=recs label=column:operator"],
    ),
    "structs": ({"set": [{"ft": x, "material": y} for x, y in ROWS]}, ["array=ft label=column:material"]),
    "structs of any name": (
        {"set": [{"ft": x, "stoff": y, "rig": "b"} for x, y in ROWS]},
        ["array=ft label=column:stoff"],
    ),
}


@in_each_form(NO_Y)
def test_labels_of_another_name_are_in_the_way_out(tmp_path, case, form):
    tree, expected = NO_Y[case]
    for path in (written({**tree, "fs": 500}, form, tmp_path), tmp_path):
        found = [{name: way[name] for name in way if name != "rate_hz"} for way in options_of(path)]
        assert [" ".join(f"{name}={value}" for name, value in way.items()) for way in found] == expected
        assert_holds(load(path, **found[0]), SIX, OF_SIX)


@pytest.mark.parametrize("in_group", [True, False])
def test_attributes_that_may_be_labels_are_in_the_way_out(tmp_path, in_group):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["fs"] = 500
        for i, (x, y) in enumerate(ROWS):
            place = f"run{i}/ft" if in_group else f"run{i}"
            file[place] = x
            (file[place].parent if in_group else file[place]).attrs["stuff"] = y
    (way,) = options_of(tmp_path)
    assert load(tmp_path, **way).y.tolist() == OF_SIX


FILES = {
    "labels beside another order": ([{"wrench": x.T, "material": y} for x, y in ROWS], None),
    "texts beside another order": ([{"wrench": x.T, "powder": y} for x, y in ROWS], None),
    "forces and torques with a clock": (
        [{"F": x[:, :3], "M": x[:, 3:], "t": T, "material": y, "session": y[:2]} for x, y in ROWS],
        [y[:2] for y in OF_SIX],
    ),
}


@pytest.mark.parametrize("form", WRITERS)
@pytest.mark.parametrize("case", FILES)
def test_the_line_of_an_error_reads_all_files_like_it(tmp_path, case, form):
    trees, sessions = FILES[case]
    for i, tree in enumerate(trees):
        written(tree if "t" in tree else {**tree, "fs": 500}, form, tmp_path, f"rec_{i}")
    assert_holds(run(lines_of(refusal(tmp_path))[0]), SIX, OF_SIX, sessions)


@pytest.mark.parametrize("n_files", [2, 4])
@pytest.mark.parametrize("form", WRITERS)
def test_texts_against_names_of_files_have_both_ways(tmp_path, form, n_files):
    for name in ("mo", "di", "mi", "do")[:n_files]:
        written({"recs": SIX, "powder": OF_SIX, "fs": 500}, form, tmp_path / name)
    offered = [way["label"] for way in options_of(tmp_path)]
    assert offered == (["column:powder", "folder"] if n_files == 2 else ["folder", "column:powder"])


@pytest.mark.parametrize("form", WRITERS)
def test_time_first_beside_labels_has_one_line(tmp_path, form):
    path = written({"X": SIX[:5].transpose(1, 0, 2), "classes": list("aabbc"), "fs": 500}, form, tmp_path)
    assert options_of(path) == []
    data = run(*lines_of(refusal(path)))
    assert (data.y.tolist(), np.array_equal(data.X, SIX[:5])) == (list("aabbc"), True)


def test_axes_that_fit_twice_are_named_in_a_note(tmp_path):
    for values, text in (
        (SIX, "X (6, 50, 6) is read as 6 recordings, 50 samples, 6 axes"),
        (X[:, :6], "X (4, 6, 6) is read as 4 recordings, 6 samples, 6 axes"),
        (X, None),
    ):
        np.savez(tmp_path / "a.npz", X=values, y=LABELS if len(values) == 4 else OF_SIX, fs=500)
        notes = load(tmp_path / "a.npz").history[-1].notes
        assert any(note.startswith(text) for note in notes) if text else "is read as" not in "".join(notes)


def test_units_under_another_name_are_refused(tmp_path):
    np.savez(tmp_path / "a.npz", X=X * [1, 1, 1, 1e3, 1e3, 1e3], y=LABELS, fs=500, torque_unit="Nmm")
    with pytest.raises(RecordingFileError, match=r"'torque_unit' states units.* pass units="):
        load(tmp_path / "a.npz")
    np.testing.assert_allclose(load(tmp_path / "a.npz", units=["N", "Nmm"]).X, X, atol=1e-12)


@pytest.mark.parametrize("stated", ["N", "N,lbf in"])
def test_units_stated_against_those_of_a_file_are_refused(tmp_path, stated):
    np.savez(tmp_path / "a.npz", X=X, y=LABELS, fs=500, force_unit="mN", torque_unit="N m")
    with pytest.raises(RecordingFileError, match=r"states '.*', and units= '"):
        load(tmp_path / "a.npz", units=stated)


@pytest.mark.parametrize("how", ["array", "attribute"])
def test_set_up_beside_arrays_is_read_and_compared(tmp_path, how):
    for name, frame in (("a", "flange"), ("b", "sensor")):
        if how == "array":
            np.savez(tmp_path / f"{name}.npz", X=X, y=LABELS, fs=500, frame=frame, Tool="rod")
            continue
        with h5py.File(tmp_path / f"{name}.h5", "w") as file:
            file["X"], file["y"], file["fs"] = X, LABELS, 500
            file["X"].attrs["frame"], file.attrs["Tool"] = frame, "rod"
    one, other = (Setup.of(load(path)[0].meta) for path in sorted(tmp_path.iterdir()))
    assert (one.frame, one.tool) == ("flange", "rod")
    assert [str(found) for found in one.differences(other)] == ["frame 'sensor', in training 'flange'"]


def test_units_in_texts_of_json_are_refused(tmp_path):
    about = json.dumps({"rig": 3, "units": {"force": "mN", "torque": "N mm"}})
    np.savez(tmp_path / "a.npz", X=X * 1000, y=LABELS, fs=500, meta=about)
    with pytest.raises(RecordingFileError, match=r"'meta.units.force' states units"):
        load(tmp_path / "a.npz")


def test_ends_of_recordings_beside_rows_have_a_line(tmp_path):
    rows, ends = np.concatenate(X), np.cumsum([len(one) for one in X])
    np.savez(tmp_path / "a.npz", wrench=rows, episode_ends=ends, labels=LABELS, fs=500)
    assert_holds(run(*lines_of(refusal(tmp_path / "a.npz"))), X, LABELS)


def test_structured_arrays_of_a_folder_have_one_line(tmp_path):
    for i, label in enumerate(("rice", "rice", "peas")):
        columns = {"t": T, **dict(zip(AXES, X[i].T, strict=True))}
        np.save(tmp_path / f"{label}_{i}.npy", np.rec.fromarrays(list(columns.values()), names=list(columns)))
    assert run(lines_of(refusal(tmp_path))[0]).y.tolist() == ["peas", "rice", "rice"]


def test_labels_beside_cells_of_one_name_are_in_the_way_out(tmp_path):
    cells = np.empty(4, object)
    cells[:] = list(X)
    scipy.io.savemat(tmp_path / "a.mat", {"data": cells, "Klasse": np.array(LABELS, object), "fs": 500})
    (way,) = options_of(tmp_path / "a.mat")
    assert load(tmp_path / "a.mat", **way).y.tolist() == LABELS


@pytest.mark.parametrize("name", ["T", "df"])
def test_one_group_in_each_file_is_no_label(tmp_path, name):
    for i, label in enumerate(("rice", "rice", "peas")):
        columns = dict(zip(AXES, X[i].T, strict=True)) | {"time": T}
        (tmp_path / label).mkdir(exist_ok=True)
        scipy.io.savemat(tmp_path / label / f"{i}.mat", {name: columns})
    assert run(lines_of(refusal(tmp_path))[0]).y.tolist() == ["peas", "rice", "rice"]


def test_units_stated_of_the_axes_of_a_file_are_read(tmp_path):
    np.savez(tmp_path / "a.npz", X=X[..., :3], y=LABELS, fs=500, axes=["ax", "ay", "az"])
    assert load(tmp_path / "a.npz", units="m/s2,m/s2,g")[0].meta["units"] == {
        "ax": "m/s2",
        "ay": "m/s2",
        "az": "g",
    }


@pytest.mark.parametrize("name", ["timestamps", "sec", "datetime", "stamp"])
def test_clocks_under_another_name_give_way_to_a_rate(tmp_path, name):
    np.savez(tmp_path / "a.npz", X=X, y=LABELS, fs=500, **{name: np.cumsum(np.arange(len(W)) % 3 + 1.0)})
    assert load(tmp_path / "a.npz").rate_hz == 500


def test_fields_of_arrays_in_compound_tables_are_passed_over(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        kinds = [("fx", "f8"), ("ragged", h5py.vlen_dtype(np.float64))]
        table = file.create_dataset("log", (2,), np.dtype(kinds))
        table[0], table[1] = (1.0, np.ones(2)), (2.0, np.ones(3))
    assert "it holds log/fx (2,)" in refusal(tmp_path / "a.h5") or "array" in refusal(tmp_path / "a.h5")


@pytest.mark.parametrize(
    ("name", "value"), [("dt", 0.002), ("time_step_ms", 2), ("sampling_rate", 500), ("control_freq", 500)]
)
def test_rates_under_another_name_are_in_the_way_out(tmp_path, name, value):
    np.savez(tmp_path / "a.npz", X=X, y=LABELS, **{name: value})
    assert options_of(tmp_path / "a.npz") == [{"rate_hz": 500}]


@pytest.mark.parametrize(("name", "per_s"), [("timestamps", 1), ("t_ms", 1000)])
def test_clocks_under_another_name_are_read(tmp_path, name, per_s):
    np.savez(tmp_path / "a.npz", X=X, y=LABELS, **{name: T * per_s}, camera_time=np.arange(7))
    data = load(tmp_path / "a.npz")
    assert data.rate_hz == 500
    assert any(note.endswith("not read: camera_time") for note in data.history[-1].notes)


@pytest.mark.parametrize("how", ["attribute", "field"])
def test_units_of_attributes_and_fields_are_refused(tmp_path, how):
    scaled = X * [1, 1, 1, 1000, 1000, 1000]
    if how == "attribute":
        with h5py.File(tmp_path / "a.h5", "w") as file:
            file["X"], file["fs"] = scaled, 500
            file["X"].attrs["torque_unit"] = "N mm"
    else:
        structs = [{"wrench": one, "fs": 500, "torque_unit": "N mm"} for one in scaled]
        scipy.io.savemat(tmp_path / "a.mat", {"data": np.array(structs, object)})
    (path,) = tmp_path.iterdir()
    ways = options_of(path)
    assert ways[0]["units"] == "N,N mm"
    np.testing.assert_allclose(load(path, **ways[0]).X, X, atol=1e-12)


def test_padding_by_zeros_is_refused_with_a_line(tmp_path):
    np.savez(tmp_path / "a.npz", X=np.nan_to_num(PADDED), y=LABELS, fs=500, n_valid=[50, 30, 50, 49])
    data = run(lines_of(refusal(tmp_path / "a.npz"))[0])
    assert [one.n_samples for one in data] == [len(one) for one in UNEQUAL]
    assert data.y.tolist() == LABELS
    assert load(tmp_path / "a.npz", array="X").X.shape == X.shape


def test_labels_of_samples_beside_rows_have_a_line(tmp_path):
    rows, trials = np.concatenate(X), np.repeat(np.arange(4), len(W))
    np.savez(tmp_path / "a.npz", X=rows, y=np.repeat(LABELS, len(W)), trial=trials, fs=500)
    data = run(lines_of(refusal(tmp_path / "a.npz"))[0])
    assert data.y.tolist() == LABELS
    np.testing.assert_allclose(data.X, X)


@pytest.mark.parametrize("name", ["channels", "ChannelNames", "x"])
def test_axes_under_another_name_are_refused(tmp_path, name):
    np.savez(
        tmp_path / "a.npz", X=X[..., [3, 4, 5, 0, 1, 2]], fs=500, **{name: [*AXES[3:], "Fx [N]", "Fy", "Fz"]}
    )
    with pytest.raises(
        RecordingFileError, match=rf"'{name}' names the columns.* pass axes='tx,ty,tz,fx,fy,fz'"
    ):
        load(tmp_path / "a.npz")
    data = load(tmp_path / "a.npz", axes="tx,ty,tz,fx,fy,fz")
    np.testing.assert_allclose(data.select(axes=AXES).X, X, atol=1e-12)


def test_other_axes_under_another_name_are_refused(tmp_path):
    np.savez(tmp_path / "a.npz", X=X, fs=500, columns=["wx", "wy", "wz", "ax", "ay", "az"])
    with pytest.raises(RecordingFileError, match="pass axes='wx,wy,wz,ax,ay,az'"):
        load(tmp_path / "a.npz")
    np.savez(tmp_path / "a.npz", X=X, fs=500, columns=AXES)
    assert load(tmp_path / "a.npz").axes == tuple(AXES)


@pytest.mark.parametrize("ending", ["npz", "npy"])
def test_what_is_no_array_file_has_its_own_sentence(tmp_path, ending):
    (tmp_path / f"a.{ending}").write_bytes(b"no array in here" * 9)
    assert "is no N" in (problem := refusal(tmp_path / f"a.{ending}"))
    assert "pickle" not in problem


@pytest.mark.parametrize("n", [4, 6])
def test_rows_of_one_recording_each_have_both_readings(tmp_path, n):
    whole = np.random.default_rng(2).normal(size=(n, 50, 6))
    np.savez(tmp_path / "a.npz", X=whole.transpose(0, 2, 1).reshape(n, -1), y=["a", "b"] * (n // 2), fs=500)
    problem = refusal(tmp_path / "a.npz")
    assert "only you know which is right" in problem
    by_axis, by_sample = map(run, lines_of(problem))
    np.testing.assert_array_equal(by_axis.X, whole)
    assert by_sample.X.shape == whole.shape


@pytest.mark.parametrize("form", WRITERS)
def test_rows_of_counted_recordings_raise_a_question(tmp_path, form):
    for label in ("rice", "peas"):
        tree = {"X": X[:2].reshape(-1, 6), "push": np.repeat([1, 2], 50), "fs": 500}
        written(tree, form, tmp_path, f"{label}_1")
    data = run(lines_of(refusal(tmp_path))[0])
    np.testing.assert_array_equal(data.X, [*X[:2], *X[:2]])
    assert data.y.tolist() == ["peas", "peas", "rice", "rice"]
    assert len(load(tmp_path, array="X")) == 2
