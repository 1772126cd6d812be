"""NPZ archives and NPY files that others wrote, and what is refused of them."""

import tracemalloc
import zipfile

import numpy as np
import pytest

from granular_id.io import RecordingFileError, load, save
from granular_id.recording import Dataset, Recording

ONE = np.random.default_rng(5).normal(size=(50, 6))


def test_samples_are_held_once(tmp_path):
    block = np.zeros((50, 1600, 6))
    path = save(Dataset([Recording(wrench, rate_hz=500) for wrench in block]), tmp_path / "set.npz")
    load(path)
    tracemalloc.start()
    load(path).X  # noqa: B018  (X is made when it is asked for)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1.5 * block.nbytes


@pytest.mark.parametrize("write", [np.savez, np.savez_compressed])
def test_a_changed_byte_is_noticed(tmp_path, write):
    path = tmp_path / "x.npz"
    write(path, X=ONE, fs=500)
    data = path.read_bytes()
    start = data.index(b"NUMPY") + 128 if write is np.savez else 100
    path.write_bytes(data[:start] + bytes([data[start] ^ 1]) + data[start + 1 :])  # the checksum tells
    with pytest.raises(RecordingFileError, match="array X"):
        load(path)


def test_bombs_and_objects_are_refused(tmp_path):
    path = tmp_path / "x.npz"
    np.savez_compressed(path, X=np.zeros((100, 20_000, 6)))
    with pytest.raises(RecordingFileError, match="array X: would expand from"):
        load(path, rate_hz=500)
    np.savez(path, X=np.array([{"a": 1}], dtype=object))
    with pytest.raises(RecordingFileError, match="array X: holds Python objects"):
        load(path, rate_hz=500)


# -- .npy


def _npy(tmp_path, array, **settings):
    np.save(tmp_path / "push.npy", array)
    return load(tmp_path / "push.npy", **settings)


def test_one_recording(tmp_path):
    data = _npy(tmp_path, ONE, rate_hz=500)
    assert np.array_equal(data[0].wrench, ONE)
    assert (data.names, data.rate_hz) == (("push.npy",), 500)


def test_fields_of_a_table_are_axes_and_time(tmp_path):
    table = np.zeros(
        50, [(name, "f8") for name in ("t", "Fx", "Fy", "Fz", "Mx", "My", "Mz")] + [("temp", "f4")]
    )
    table["t"] = np.arange(50) / 62.5
    for i, name in enumerate(table.dtype.names[1:7]):
        table[name] = ONE[:, i]
    data = _npy(tmp_path, table)
    assert np.array_equal(data[0].wrench, ONE)
    assert data.rate_hz == 62.5
    assert "not used: temp (50,) float32" in data.history[-1].notes


def test_labels_come_from_the_names_of_files(tmp_path):
    for name in ("rice_1", "rice_2", "peas_1"):
        np.save(tmp_path / f"{name}.npy", ONE)
    assert load(tmp_path, rate_hz=500).y.tolist() == ["peas", "rice", "rice"]


def test_a_clock_is_no_array_of_samples(tmp_path):
    with pytest.raises(RecordingFileError, match=r"no recordings are recognised.*values \(50,\) float64"):
        _npy(tmp_path, np.arange(50.0), rate_hz=500)


def test_what_an_npy_file_cannot_hold_is_not_advised(tmp_path):
    with pytest.raises(RecordingFileError, match=r"has neither a rate nor stamps; pass rate_hz=$"):
        _npy(tmp_path, ONE)
    with pytest.raises(RecordingFileError, match=r"this holds one array: save an \.npz file with X of shape"):
        _npy(tmp_path, ONE[:, :5], rate_hz=500)
    with pytest.raises(RecordingFileError, match=r"save values\[\.\.\., 1:\] as X"):
        _npy(tmp_path, np.zeros((50, 7)), rate_hz=500)


def test_objects_are_refused_with_a_way_round(tmp_path):
    ragged = np.empty(2, object)
    ragged[:] = [ONE, ONE[:9]]
    with pytest.raises(RecordingFileError, match=r"could run code; save texts as .*rice_01=first"):
        _npy(tmp_path, ragged, rate_hz=500)
    np.savez(tmp_path / "two.npz", rice_01=ONE, rice_02=ONE[:9])
    data = load(tmp_path / "two.npz", rate_hz=500)
    assert ([r.n_samples for r in data], data.labels) == ([50, 9], ("rice",))


def test_members_that_are_no_arrays_are_said(tmp_path):
    path = tmp_path / "x.npz"
    np.savez(path, X=ONE, fs=500)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("README.txt", "hello")
    assert "members that are no arrays were not read: README.txt" in load(path).history[-1].notes


def test_an_array_and_a_group_of_one_name_are_refused(tmp_path):
    np.savez(tmp_path / "x.npz", **{"a": ONE, "a/b": ONE})
    with pytest.raises(RecordingFileError, match="both an array 'a' and arrays within"):
        load(tmp_path / "x.npz")
