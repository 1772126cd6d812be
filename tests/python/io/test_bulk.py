"""Large arrays, read, checked and reordered by several threads, against numpy alone."""

from __future__ import annotations

import os
import threading

import numpy as np
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings, strategies as st
from hypothesis.extra import numpy as hnp

from effort import cases
from granular_id._core import interleave
from granular_id.io import bulk, load, save
from granular_id.recording import Dataset, Recording

N = 3_000_001  # float64: three parts, the last one short


@pytest.fixture(autouse=True)
def three_threads(monkeypatch):
    monkeypatch.setattr(bulk, "available_cores", lambda: 3)


@pytest.fixture(scope="module")
def values():
    return np.random.default_rng(0).normal(size=N)


def test_an_array_is_read_from_its_place_in_a_file_whose_position_stays(tmp_path, values):
    path = tmp_path / "values"
    path.write_bytes(b"header!" + values.tobytes() + b"more")
    target = np.empty(N)
    with path.open("rb") as file:
        assert bulk.read_at(file.fileno(), 7, target) == bulk.Filled(target.nbytes, finite=True)
        assert file.tell() == 0
    np.testing.assert_array_equal(target, values)


@pytest.mark.parametrize("there", [0, 1, 5 << 20, 8 * N - 1])
def test_it_says_how_much_of_a_file_that_is_cut_off_is_there(tmp_path, values, there):
    path = tmp_path / "values"
    path.write_bytes(values.tobytes()[:there])
    with path.open("rb") as file:
        assert bulk.read_at(file.fileno(), 0, np.empty(N)).n_bytes == there


def test_nothing_is_read_into_an_empty_array(tmp_path):
    path = tmp_path / "values"
    path.write_bytes(b"abc")
    with path.open("rb") as file:
        assert bulk.read_at(file.fileno(), 0, np.empty((0, 6))) == bulk.Filled(0, finite=True)


@pytest.mark.parametrize("place", [0, 262_143, 262_144, 1_048_576, N - 1])
def test_reading_sees_what_is_not_finite(tmp_path, values, place):
    spoiled = values.copy()
    spoiled[place] = np.nan
    path = tmp_path / "values"
    path.write_bytes(spoiled.tobytes())
    with path.open("rb") as file:
        assert bulk.read_at(file.fileno(), 0, np.empty(N)) == bulk.Filled(8 * N, finite=False)


@pytest.mark.parametrize("dtype", [">f8", "<f4", "u1", "<i8"])
def test_only_numbers_that_need_no_conversion_are_called_finite(tmp_path, dtype):
    path = tmp_path / "values"
    path.write_bytes(np.ones(10, dtype).tobytes())
    with path.open("rb") as file:
        target = np.empty(10, dtype)
        assert bulk.read_at(file.fileno(), 0, target) == bulk.Filled(target.nbytes, finite=False)
    assert (target == 1).all()


@pytest.mark.parametrize("place", [0, 1_048_575, 1_048_576, 1_500_000, N - 1])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_one_value_that_is_not_finite_is_found_wherever_it_stands(values, place, bad):
    spoiled = values.copy()
    spoiled[place] = bad
    assert bulk.all_finite(values)
    assert not bulk.all_finite(spoiled)
    assert not bulk.all_finite(spoiled[::-1])


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 0, 2), (2, 0, 1), (0, 2, 1)])
@pytest.mark.parametrize("shape", [(211, 2003, 6), (20_001, 35, 2), (1, 7, 3), (3, 1, 1)])
def test_any_order_of_axes_becomes_row_major_without_changing_a_value(order, shape):
    block = np.arange(np.prod(shape), dtype=float).reshape([shape[i] for i in order])
    block = block.transpose(np.argsort(order))
    turned = bulk.row_major(block)
    assert block.shape == shape
    assert turned.flags.c_contiguous
    assert turned is block or not block.flags.c_contiguous
    np.testing.assert_array_equal(turned, block)


@pytest.mark.parametrize("missing", ["preadv", "threads"])
@pytest.mark.parametrize("form", ["npy", "npz", "h5", "mat", "parquet"])
def test_files_are_read_where_the_system_has_no_preadv_or_no_threads(tmp_path, monkeypatch, form, missing):
    wrench = np.random.default_rng(1).normal(size=(140, 1600, 6))  # 10.8 MB: more than one part
    data = Dataset([Recording(push, rate_hz=500, label="rice") for push in wrench])
    path = tmp_path / f"pushes.{form}"
    if form == "npy":
        np.save(path, wrench)
    elif form == "mat":
        scipy.io.savemat(path, {"X": wrench, "fs": 500.0})
    else:
        save(data, path, form if form == "parquet" else None)
    if missing == "preadv":
        monkeypatch.delattr(os, "preadv")
    else:
        monkeypatch.setattr(bulk, "available_cores", lambda: 3)
        monkeypatch.setattr(threading.Thread, "start", _no_thread)
    loaded = load(path, **({"rate_hz": 500} if form == "npy" else {}))
    assert loaded.X.tobytes() == wrench.tobytes()


def _no_thread(_):
    raise RuntimeError("can't start new thread")


def no_threads():
    return not [thread for thread in threading.enumerate() if thread.name.startswith("ThreadPool")]


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=cases(50))
@given(hnp.arrays(float, hnp.array_shapes(min_dims=2, max_dims=2, max_side=300)), st.integers(0, 3))
def test_columns_side_by_side_are_the_bits_that_numpy_stacks(columns, more):
    room = np.full((columns.shape[1] + more, len(columns)), 7.0)
    finite = interleave(list(columns), room[more:])
    assert room[more:].tobytes() == np.stack(list(columns), axis=1).tobytes()
    assert finite == np.isfinite(columns).all()
    assert (room[:more] == 7.0).all()


@pytest.mark.parametrize(
    ("columns", "out", "error", "problem"),
    [
        ([np.zeros(3), np.zeros(2)], np.zeros((3, 2)), ValueError, "columns must hold 3 values, got 2"),
        ([np.zeros(3)], np.zeros((3, 2)), ValueError, r"out must have shape \(3, 1\), got \(3, 2\)"),
        ([np.zeros(3, "f4")], np.zeros((3, 1)), TypeError, "1-D array of float64, got .*float32"),
        ([[1.0]], np.zeros((1, 1)), TypeError, "1-D array of float64, got "),
        ([np.zeros(6)[::2]], np.zeros((3, 1)), ValueError, "columns must be contiguous"),
        ([np.zeros(3)], np.zeros((3, 2))[:, :1], ValueError, "out must be C-contiguous"),
    ],
)
def test_what_cannot_stand_side_by_side_is_named(columns, out, error, problem):
    with pytest.raises(error, match=problem):
        interleave(columns, out)


def test_columns_are_not_read_where_they_are_written():
    samples = np.zeros((3, 1))
    with pytest.raises(ValueError, match="out must not overlap columns"):
        interleave([samples[:, 0]], samples)
    samples.flags.writeable = False
    with pytest.raises(ValueError, match="out must be writable"):
        interleave([np.zeros(3)], samples)
