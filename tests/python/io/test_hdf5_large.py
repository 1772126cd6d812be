"""Datasets that are read from the bytes of the file, and chunks that are unpacked by several threads."""

import os

import numpy as np
import pytest

from granular_id.io import RecordingFileError, load
from granular_id.io.hdf5 import chunks, guard

h5py = pytest.importorskip("h5py")

X = np.random.default_rng(6).standard_normal((3, 40, 6))


@pytest.fixture(autouse=True)
def everything_is_large(monkeypatch):
    monkeypatch.setattr(guard, "_LARGE", 0)
    monkeypatch.setattr(chunks, "_LARGE", 0)
    monkeypatch.setattr(chunks, "bulk_threads", lambda: 3)


def written(path, userblock=0, **settings):
    with h5py.File(path, "w", userblock_size=userblock) as file:
        file.create_dataset("X", **{"data": X, **settings})
        file["rate_hz"] = 500.0
    return path


@pytest.mark.parametrize("userblock", [0, 512])
@pytest.mark.parametrize("dtype", ["<f8", ">f8", "<f4", "<i2"])
def test_values_are_those_that_the_library_reads(tmp_path, userblock, dtype):
    values = (100 * X).astype(dtype)
    path = written(tmp_path / "x.h5", userblock, data=values)
    assert (values == load(path).X).all()


def test_the_bytes_of_the_file_are_what_is_read(tmp_path, monkeypatch):
    path = written(tmp_path / "x.h5")
    read, read_at = [], guard.read_at
    monkeypatch.setattr(guard, "read_at", lambda *where: read.append(where) or read_at(*where))
    assert load(path).X.tobytes() == X.tobytes()
    assert X.size in [target.size for _, _, target in read]


def test_what_was_never_written_is_what_the_library_fills_in(tmp_path):
    path = tmp_path / "x.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("X", shape=(2, 9, 6), dtype="f8", fillvalue=2.5)
        file["rate_hz"] = 500.0
    assert (load(path).X == 2.5).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_values_that_are_not_finite_are_found_in_them(tmp_path, bad):
    values = X.copy()
    values[1, 7, 2] = bad
    with pytest.raises(RecordingFileError, match=f"recording 1, sample 7, axis fz is {bad}"):
        load(written(tmp_path / "x.h5", data=values))


def test_a_file_that_shrinks_while_it_is_read_is_cut_off(tmp_path, monkeypatch):
    path = written(tmp_path / "x.h5")
    whole = guard.read_at

    def shrunk(descriptor, offset, target):
        os.truncate(path, offset + 1000)
        return whole(descriptor, offset, target)

    monkeypatch.setattr(guard, "read_at", shrunk)
    with pytest.raises(RecordingFileError, match=f"X: is cut off: 1000 of {X.nbytes} bytes are there"):
        load(path)


def test_another_driver_that_the_environment_asks_for_changes_nothing(tmp_path, monkeypatch):
    path = written(tmp_path / "x.h5")
    monkeypatch.setenv("HDF5_DRIVER", "core")
    assert load(path).X.tobytes() == X.tobytes()


@pytest.mark.parametrize("shuffle", [False, True])
def test_chunks_are_put_together_by_threads(tmp_path, shuffle):
    path = written(tmp_path / "x.h5", chunks=(1, 17, 6), compression="gzip", shuffle=shuffle)
    assert load(path).X.tobytes() == X.tobytes()


def test_of_several_damaged_chunks_one_is_told_and_it_is_always_the_same(tmp_path):
    path = written(tmp_path / "x.h5", chunks=(1, 10, 6), compression="gzip")
    with h5py.File(path, "r+") as file:
        for sample in (30, 10):
            file["X"].id.write_direct_chunk((1, sample, 0), b"no stream at all" * sample)
    problems = set()
    for _ in range(5):
        with pytest.raises(RecordingFileError, match="a chunk is damaged") as caught:
            load(path)
        problems.add(str(caught.value))
    assert len(problems) == 1


def test_memory_for_chunks_of_all_threads_is_counted(tmp_path):
    path = tmp_path / "x.h5"
    rows = 1 << 19  # of six: a chunk of 25 MB for four rows; one is allowed, those of four threads are not
    for n, refused in ((1, False), (4, True)):
        with h5py.File(path, "w") as file:
            values = file.create_dataset(
                "X", (n, 2, 6), chunks=(1, rows, 6), compression="gzip", maxshape=(n, rows, 6), dtype="f8"
            )
            values[:] = 1
            file["rate_hz"] = 500.0
        if refused:
            with pytest.raises(RecordingFileError, match="would expand"):
                load(path)
        else:
            assert load(path).X.shape == (n, 2, 6)
