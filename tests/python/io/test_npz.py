"""NPZ archives and NPY files that others wrote, and what is refused of them."""

import zipfile

import numpy as np
import pytest

from granular_id.io import RecordingFileError, load

ONE = np.random.default_rng(5).normal(size=(50, 6))


@pytest.mark.parametrize("write", [np.savez, np.savez_compressed])
def test_a_changed_byte_is_noticed(tmp_path, write):
    path = tmp_path / "x.npz"
    write(path, X=ONE, fs=500)
    data = path.read_bytes()
    start = data.index(b"NUMPY") + 128 if write is np.savez else 100
    path.write_bytes(data[:start] + bytes([data[start] ^ 1]) + data[start + 1 :])  # the checksum tells
    with pytest.raises(RecordingFileError, match="array X"):
        load(path)


def test_bombs_are_refused_and_members_that_are_no_arrays_said(tmp_path):
    path = tmp_path / "x.npz"
    np.savez_compressed(path, X=np.zeros((75, 20_000, 6), np.int8))  # as float64
    with pytest.raises(RecordingFileError, match="array X: would expand from"):
        load(path, rate_hz=500)
    np.savez(path, X=ONE, fs=500)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("README.txt", "hello")
    assert "members that are no arrays were not read: README.txt" in load(path).history[-1].notes


def test_an_array_and_a_group_of_one_name_are_refused(tmp_path):
    for arrays in ({"a": ONE, "a/b": ONE}, {"a/b": ONE, "a": ONE}):
        np.savez(tmp_path / "x.npz", **arrays)
        with pytest.raises(RecordingFileError, match="both an array 'a' and arrays within"):
            load(tmp_path / "x.npz")


def test_an_npy_file_holds_one_recording_and_its_name_the_label(tmp_path):
    for name in ("rice_1", "rice_2", "peas_1"):
        np.save(tmp_path / f"{name}.npy", ONE)
    data = load(tmp_path, rate_hz=500)
    assert data.y.tolist() == ["peas", "rice", "rice"]
    assert data.names[0] == "peas_1.npy"
    assert np.array_equal(data[0].wrench, ONE)


def _npy(tmp_path, array, **settings):
    np.save(tmp_path / "push.npy", array)
    return load(tmp_path / "push.npy", **settings)


def test_fields_of_a_table_are_axes_and_time(tmp_path):
    names = ("t", "Fx", "Fy", "Fz", "Mx", "My", "Mz")
    table = np.zeros(50, [*((name, "f8") for name in names), ("temp", "f4")])
    table["t"] = np.arange(50) / 62.5
    for i, name in enumerate(names[1:]):
        table[name] = ONE[:, i]
    data = _npy(tmp_path, table)
    assert np.array_equal(data[0].wrench, ONE)
    assert data.rate_hz == 62.5
    assert "not used: temp (50,) float32" in data.history[-1].notes


RAGGED = np.empty(2, object)
RAGGED[:] = [ONE, ONE[:9]]


@pytest.mark.parametrize(
    ("array", "rate_hz", "message"),
    [
        (np.arange(50.0), 500, r"no recordings are recognised.*values \(50,\) float64"),
        (ONE, None, r"has neither a rate nor stamps; pass rate_hz=$"),  # nothing can stand beside it
        (ONE[:, :5], 500, r"this holds one array: save an \.npz file with X of shape"),
        (np.zeros((50, 7)), 500, r"save values\[\.\.\., 1:\] as X"),
        (RAGGED, 500, r"Python objects .* could run code; save texts as .*rice_01=first"),
    ],
)
def test_what_an_npy_file_cannot_hold_is_refused_with_a_way_round(tmp_path, array, rate_hz, message):
    with pytest.raises(RecordingFileError, match=message):
        _npy(tmp_path, array, rate_hz=rate_hz)
