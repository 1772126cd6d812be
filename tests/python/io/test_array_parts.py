"""Wrenches in parts: forces and torques in arrays of their own, or a vector for each axis."""

import h5py
import numpy as np
import pytest
import scipy.io

from array_layout_cases import LABELS, RAGGED, X, read_tree
from granular_id.io import RecordingFileError, load

FORCES, TORQUES = X[..., :3], X[..., 3:]


@pytest.mark.parametrize(
    ("force", "torque"),
    [
        *[("force", "torque"), ("forces", "torques"), ("Force", "moment"), ("F", "T"), ("F", "M")],
        *[("f", "tau"), ("forces_N", "moments_Nm"), ("Force [N]", "Torque [N m]"), ("ee_force", "ee_torque")],
    ],
)
def test_forces_and_torques_side_by_side_are_joined_whatever_they_are_called(force, torque):
    data, notes = read_tree({torque: TORQUES, force: FORCES, "labels": LABELS, "fs": np.array(500)})
    assert np.array_equal(data.X, X)
    assert data.y.tolist() == LABELS
    both = f"{force} and {torque}"
    assert notes == [
        f"{both} {FORCES.shape} taken as recordings, samples, axes",
        f"{both} joined: forces, then torques",
    ]


def test_calibration_beside_the_parts_is_no_recording():
    tree = {"force": FORCES, "torque": TORQUES, "calibration": np.eye(6)}
    assert np.array_equal(read_tree(tree, rate_hz=500)[0].X, X)


@pytest.mark.parametrize("order", [(0, 1, 2), (1, 2, 0), (0, 2, 1), (2, 0, 1), (2, 1, 0)])
def test_any_order_of_axes_that_can_be_told_will_do(order):
    tree = {"force": FORCES.transpose(order), "torque": TORQUES.transpose(order), "y": LABELS}
    assert np.array_equal(read_tree(tree, rate_hz=500)[0].X, X)


def test_forces_and_torques_of_six_recordings_are_halves_all_the_same():
    tree = {"force": FORCES, "torque": TORQUES, "labels": LABELS}
    six = {name: [*values, *values][:6] for name, values in tree.items()}
    data, _ = read_tree({"force": np.array(six["force"]), "torque": np.array(six["torque"])}, rate_hz=500)
    assert np.array_equal(data.X, np.concatenate([X, X])[:6])


def test_three_recordings_of_three_axes_are_refused_as_six_of_six_are():
    with pytest.raises(RecordingFileError, match="which of the axes of length 3 is which"):
        read_tree({"force": FORCES[:3], "torque": TORQUES[:3]}, rate_hz=500)


@pytest.mark.parametrize("turned", [False, True])
def test_forces_and_torques_of_one_recording(turned):
    tree = {"force": FORCES[0], "torque": TORQUES[0], "time": np.arange(50) / 100}
    if turned:
        tree |= {"force": FORCES[0].T, "torque": TORQUES[0].T}
    data, notes = read_tree(tree)
    assert np.array_equal(data[0].wrench, X[0])
    assert data.rate_hz == 100
    assert any("joined" in note for note in notes)


def test_forces_and_torques_in_cells_of_any_lengths():
    cells = {"forces": [w[:, :3] for w in RAGGED], "torques": [w[:, 3:] for w in RAGGED], "y": LABELS}
    data, notes = read_tree(cells, rate_hz=500)
    assert all(np.array_equal(r.wrench, wrench) for r, wrench in zip(data, RAGGED, strict=True))
    assert data.y.tolist() == LABELS
    assert any("joined" in note for note in notes)


def test_padding_of_forces_and_torques_is_left_out():
    padded = X.copy()
    padded[1, 40:] = np.nan
    data, _ = read_tree({"force": padded[..., :3], "torque": padded[..., 3:]}, rate_hz=500)
    assert [r.n_samples for r in data] == [50, 40, 50, 50]


def test_groups_of_forces_and_torques_in_hdf5_and_matlab(tmp_path):
    with h5py.File(tmp_path / "lab.h5", "w") as file:
        for label in ("rice", "peas"):
            for i, wrench in enumerate(X):
                group = file.create_group(f"{label}/trial{i}")
                group["force"], group["torque"], group["fs"] = wrench[:, :3], wrench[:, 3:], 500
    data = load(tmp_path / "lab.h5")
    assert data.y.tolist() == ["peas"] * 4 + ["rice"] * 4
    assert np.array_equal(data.X, np.concatenate([X, X]))
    scipy.io.savemat(
        tmp_path / "lab.mat", {"forces": FORCES, "torques": TORQUES, "labels": LABELS, "fs": 500}
    )
    assert np.array_equal(load(tmp_path / "lab.mat").X, X)


def test_wrenches_in_one_array_come_first():
    data, notes = read_tree({"wrench": X, "force": FORCES, "torque": TORQUES}, rate_hz=500)
    assert np.array_equal(data.X, X)
    assert any(note.startswith("not used: force") for note in notes)


BAD_PARTS = {
    "lengths": ({"force": FORCES, "torque": TORQUES[:, 1:]}, r"force \(4, 50, 3\) and torque \(4, 49, 3\) differ"),
    "orders": ({"force": FORCES[0], "torque": TORQUES[0].T}, r"force \(50, 3\) and torque \(3, 50\) differ in shape"),
    "cells": ({"force": list(FORCES), "torque": list(TORQUES)[1:]}, "force holds 4 and torque 3 recordings"),
    "a cell": ({"force": [FORCES[0]], "torque": [TORQUES[0, 1:]]}, r"force\[0\] .* and torque\[0\] .* differ in shape"),
    "an empty cell": ({"force": [FORCES[0], None], "torque": [TORQUES[0], None]}, r"force\[1\] is no array"),
    "a list and an array": ({"force": FORCES, "torque": list(TORQUES)}, "force and torque"),
    "two of a kind": ({"force": FORCES, "F": FORCES, "torque": TORQUES}, "'force' and 'F' may both be the forces"),
    "forces alone": ({"force": FORCES}, r"force \(4, 50, 3\) has 3 axes.*save force and torque as arrays of one shape"),
    "other units": ({"force_mN": FORCES, "torque": TORQUES}, "has 3 axes"),
    "NaN": ({"force": FORCES, "torque": np.where(np.arange(50)[:, None] == 7, np.nan, TORQUES)}, "7, axis tx is nan"),
    "text": ({"force": FORCES.astype(str), "torque": TORQUES}, "no recordings are recognised"),
    "complex": ({"force": FORCES * 1j, "torque": TORQUES}, "force: has dtype complex128; wanted real numbers"),
    "square": ({"force": FORCES[0, :3], "torque": TORQUES[0, :3]}, "cannot be told which axis counts samples"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_PARTS)
def test_parts_that_do_not_fit_are_refused(case):
    tree, message = BAD_PARTS[case]
    with pytest.raises(RecordingFileError, match=message):
        read_tree(tree, rate_hz=500)


def test_six_recordings_in_a_matrix_for_each_axis():
    block = np.random.default_rng(3).normal(size=(6, 50, 6))
    tree = {axis: block[..., i] for i, axis in enumerate(("fx", "fy", "fz", "tx", "ty", "tz"))}
    assert np.array_equal(read_tree(tree, rate_hz=500)[0].X, block)
