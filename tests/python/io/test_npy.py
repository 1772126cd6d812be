"""NPY files: what numpy saves is loaded, and nothing is guessed in silence."""

import numpy as np
import pytest

from granular_id.io import RecordingFileError, load

RNG = np.random.default_rng(5)
ONE = RNG.normal(size=(50, 6))
MANY = RNG.normal(size=(4, 50, 6))


def _load(tmp_path, array, **settings):
    np.save(tmp_path / "push.npy", array)
    return load(tmp_path / "push.npy", **settings)


def test_one_recording(tmp_path):
    data = _load(tmp_path, ONE, rate_hz=500)
    assert np.array_equal(data[0].wrench, ONE)
    assert (data.names, data.rate_hz) == (("push.npy",), 500)


def test_one_recording_with_its_axes_first_is_turned_and_said(tmp_path):
    data = _load(tmp_path, ONE.T, rate_hz=500)
    assert np.array_equal(data[0].wrench, ONE)
    assert "values (6, 50) taken as axes, samples" in data.history[-1].notes


@pytest.mark.parametrize("order", [(0, 1, 2), (1, 2, 0)])
def test_several_recordings(tmp_path, order):
    data = _load(tmp_path, MANY.transpose(order), rate_hz=500)
    assert np.array_equal(data.X, MANY)
    assert any("taken as" in note for note in data.history[-1].notes)


@pytest.mark.parametrize("dtype", ["f4", ">f8", "<i2", "u1", "f2"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_other_types_and_orders_hold_what_numpy_reads(tmp_path, dtype, order):
    array = np.asarray(RNG.integers(0, 99, (4, 50, 6)), dtype, order=order)
    data = _load(tmp_path, array, rate_hz=500)
    assert np.array_equal(data.X, np.load(tmp_path / "push.npy"))


def test_fields_of_a_table_are_axes_and_time(tmp_path):
    table = np.zeros(
        50, [(name, "f8") for name in ("t", "Fx", "Fy", "Fz", "Mx", "My", "Mz")] + [("temp", "f4")]
    )
    table["t"] = np.arange(50) / 62.5
    for i, name in enumerate(table.dtype.names[1:7]):
        table[name] = ONE[:, i]
    data = _load(tmp_path, table)
    assert np.array_equal(data[0].wrench, ONE)
    assert data.rate_hz == 62.5
    assert "not used: temp (50,) float32" in data.history[-1].notes


def test_labels_come_from_the_names_of_files(tmp_path):
    for name in ("rice_1", "rice_2", "peas_1"):
        np.save(tmp_path / f"{name}.npy", ONE)
    assert load(tmp_path, rate_hz=500).y.tolist() == ["peas", "rice", "rice"]


def test_a_clock_is_no_array_of_samples(tmp_path):
    with pytest.raises(RecordingFileError, match=r"no recordings are recognised.*values \(50,\) float64"):
        _load(tmp_path, np.arange(50.0), rate_hz=500)


def test_what_an_npy_file_cannot_hold_is_not_advised(tmp_path):
    with pytest.raises(RecordingFileError, match=r"has neither a rate nor stamps; pass rate_hz=$"):
        _load(tmp_path, ONE)
    with pytest.raises(RecordingFileError, match=r"this holds one array: save an \.npz file with X of shape"):
        _load(tmp_path, ONE[:, :5], rate_hz=500)
    with pytest.raises(RecordingFileError, match=r"save values\[\.\.\., 1:\] as X"):
        _load(tmp_path, np.zeros((50, 7)), rate_hz=500)


def test_objects_are_refused_with_a_way_round(tmp_path):
    ragged = np.empty(2, object)
    ragged[:] = [ONE, ONE[:9]]
    with pytest.raises(RecordingFileError, match=r"could run code; save texts as .*rice_01=first"):
        _load(tmp_path, ragged, rate_hz=500)
    np.savez(tmp_path / "two.npz", rice_01=ONE, rice_02=ONE[:9])
    data = load(tmp_path / "two.npz", rate_hz=500)
    assert ([r.n_samples for r in data], data.labels) == ([50, 9], ("rice",))
