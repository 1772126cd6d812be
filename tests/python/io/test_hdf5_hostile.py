"""HDF5 files that are hostile, damaged or of no use: refused with their place, and within bounds."""

import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from granular_id.io import RecordingFileError, load, save
from granular_id.recording import Dataset, Recording

h5py = pytest.importorskip("h5py")

X = np.random.default_rng(4).standard_normal((4, 30, 6))


def other_file(path, write):
    with h5py.File(path, "w") as file:
        write(file)
    return path


@pytest.mark.parametrize("more", [{}, {"shuffle": True, "fletcher32": True}])
def test_lzf_that_makes_less_or_more_is_refused(tmp_path, more):
    for chunk in (bytes([0, 65]), bytes([0, 65]) + bytes([0xE0, 0xFF, 0]) * 500, bytes([31, 1])):
        with h5py.File(tmp_path / "x.h5", "w") as file:
            X_ = file.create_dataset("X", X.shape, "f8", chunks=X.shape, compression="lzf", **more)
            X_.id.write_direct_chunk((0, 0, 0), chunk + bytes(4 if more else 0))
        with pytest.raises(RecordingFileError, match="X: a chunk of 5760 bytes unpacks to another size"):
            load(tmp_path / "x.h5", rate_hz=500)


def _external_values(file):
    file.create_dataset("X", shape=X.shape, external=[("/etc/passwd", 0, X.nbytes)], dtype="f8")


def _virtual(file):
    layout = h5py.VirtualLayout(X.shape, "f8")
    layout[:] = h5py.VirtualSource("elsewhere.h5", "X", X.shape)
    file.create_virtual_dataset("X", layout)


def _loop(file):
    file["X"] = X
    inner = file.create_group("a/b")
    inner["c"] = file["a"]


def _texts_of_gigabytes(file):
    """Change the length that stands for a text in the file: the library would take the memory at once."""
    file["X"], file["y"] = X, ["rice"] * 4
    offset = file["y"].id.get_offset()
    file.flush()
    with Path(file.filename).open("r+b") as raw:
        raw.seek(offset)
        raw.write((0xF0000000).to_bytes(4, "little"))


def _attribute_of_gigabytes(file):
    """The same in an attribute that says what the file is."""
    file.attrs["format"] = "granular_id recordings"
    _change(file, b"\x16\0\0\0", (0xF0000000).to_bytes(4, "little"))


def _one_long_text_a_thousand_times(file):
    file["X"], file["y"] = X, ["a" * 1_000_000] + ["b"] * 999
    offset, path = file["y"].id.get_offset(), Path(file.filename)
    file.flush()
    data = path.read_bytes()
    path.write_bytes(data[:offset] + data[offset : offset + 16] * 1000 + data[offset + 16_000 :])


def _heap_elsewhere(file):
    file["X"], file["y"] = X, ["rice"] * 4
    _change(file, b"GCOL", b"GCOP")


def _heap_in_itself(file):
    """An object of a heap that claims to be larger than the heap."""
    file["X"], file["y"] = X, ["rice"] * 4
    _change(file, (4).to_bytes(8, "little") + b"rice", b"\xff" * 7)


def _change(file, old, new):
    file.flush()
    path = Path(file.filename)
    data = path.read_bytes()
    assert old in data
    path.write_bytes(data.replace(old, new + old[len(new) :], 1))


def _lzf_that_claims_gigabytes(file):
    """Change what stands in the file for the size of a chunk: the filter takes as much memory at once."""
    file.create_dataset("X", data=X, chunks=X.shape, compression="lzf")
    _change(file, (X.nbytes).to_bytes(4, "little") + bytes(4), (0xF0000000).to_bytes(4, "little"))


def _long_texts(file):
    file["X"] = X
    file["names"] = np.array(["a"] * 200_001, h5py.string_dtype())


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (lambda f: f.update({"X": h5py.ExternalLink("/etc/passwd", "/")}), "X: is a link to another file"),
        (lambda f: f.update({"X": h5py.SoftLink("/X")}), "X: is a link by name, which is not followed"),
        (_external_values, "X: keeps its values in other files"),
        (_virtual, "X: keeps its values in other files"),
        (_loop, "a group that lies at two places"),
        (
            lambda f: f.create_dataset("X", data=X, scaleoffset=3),
            r"X: is packed with scaleoffset \(filter 6 of HDF5\); wanted gzip, lzf or nothing: h5repack -f GZIP=4",
        ),
        (_lzf_that_claims_gigabytes, "X: is packed with lzf"),
        (lambda f: f.create_dataset("X", (10**6, 100, 6), "f8"), "would expand from"),
        (
            lambda f: f.create_dataset("X", (10**4, 1600, 6), "f8", compression="gzip", fillvalue=1),
            "chunks|expand",
        ),
        (_texts_of_gigabytes, "y: .*a text claims 4026531840 bytes where 4 are"),
        (_attribute_of_gigabytes, "."),
        (_one_long_text_a_thousand_times, "would expand from"),
        (_heap_elsewhere, "y: .*no heap of texts at byte"),
        (_heap_in_itself, "y: .*heap of texts at byte [0-9]+ is damaged"),
        (_long_texts, "200001"),
        (lambda f: f.update({"X": "only a text"}), "."),
        (lambda f: None, "."),
    ],
)
def test_hostile_and_useless_files(tmp_path, write, message):
    path = other_file(tmp_path / "x.h5", write)
    tracemalloc.start()
    try:
        with pytest.raises(RecordingFileError, match=message):
            load(path, rate_hz=500)
        assert tracemalloc.get_traced_memory()[1] < 100e6
    finally:
        tracemalloc.stop()


def test_a_bomb_of_zeros_is_refused(tmp_path):
    def write(file):
        bomb = file.create_dataset("X", (1, 40_000_000, 6), "f8", chunks=(1, 100_000, 6), compression="gzip")
        bomb[0, :100_000] = 0.0

    with pytest.raises(RecordingFileError, match="would expand from"):
        load(other_file(tmp_path / "x.h5", write), rate_hz=500)


@pytest.mark.parametrize("tenth", range(10))
def test_cut_off(tmp_path, tenth):
    path = save(Dataset([Recording(X[0], rate_hz=500, label="rice")]), tmp_path / "x.h5")
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * tenth // 10])
    with pytest.raises(RecordingFileError, match=r"x\.h5"):
        load(path)


def test_text_and_other_files_in_place_of_hdf5(tmp_path):
    for data in (b"", b"fx,fy\n1,2\n", bytes(range(256)) * 20, b"\x89HDF\r\n\x1a\n" + bytes(500)):
        (tmp_path / "x.h5").write_bytes(data)
        with pytest.raises(RecordingFileError, match=r"x\.h5"):
            load(tmp_path / "x.h5")
