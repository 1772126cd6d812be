"""MAT files of version 7.3: what hdf5storage wrote, what h5py can make of them, and traps."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from granular_id.io import RecordingFileError, load
from mat_cases import GOLDEN, assert_refused, left_out, push, variables

h5py = pytest.importorskip("h5py")
NAMES = ["rice", "peas", "oat flakes"]


def put(group, name: str, values, class_name: str | None = "double", **settings):
    """A dataset as MATLAB marks it; values are already in the order of HDF5."""
    dataset = group.create_dataset(name, data=values, **settings)
    if class_name:
        dataset.attrs["MATLAB_class"] = np.bytes_(class_name)
    return dataset


def text(group, name: str, letters: str):
    return put(group, name, np.array([[ord(c)] for c in letters], np.uint16), "char")


@pytest.mark.parametrize(
    ("name", "lengths", "labels"),
    [
        ("single_t6n_v73", [24] * 5, [0, 1, 2, 0, 1]),
        ("ragged_cell_v73", [25, 26, 27], [0, 1, 2]),
        ("struct_array_v73", [25, 26], [0, 1]),
    ],
)
def test_golden_files_are_read_sample_for_sample(name: str, lengths: list[int], labels: list[int]) -> None:
    data = load(GOLDEN / f"{name}.mat")
    assert [r.label for r in data] == [NAMES[k] for k in labels]
    for i, (recording, n_samples) in enumerate(zip(data, lengths, strict=True)):
        assert recording.rate_hz == 500
        np.testing.assert_array_equal(recording.wrench, push(i + 1, n_samples))


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"chunks": (2, 5, 3)},
        {"chunks": (6, 24, 5), "compression": "gzip"},
        {"chunks": (4, 7, 2), "compression": "gzip", "shuffle": True},
        {"chunks": (4, 7, 2), "compression": "gzip", "shuffle": True, "fletcher32": True},
        {"chunks": (4, 7, 2), "fletcher32": True},
    ],
)
def test_however_hdf5_stores_it(tmp_path: Path, settings: dict) -> None:
    block = np.stack([push(i) for i in range(1, 6)])  # (n, T, 6) in MATLAB, (6, T, n) in the file
    path = tmp_path / "x.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        put(file, "X", block.transpose(), **settings)
        put(file, "rate_hz", np.array([[500.0]]))
    data = load(path)
    assert np.stack([r.wrench for r in data]).tobytes() == block.tobytes()


def test_chunks_that_were_never_written_hold_the_fill_value(tmp_path: Path) -> None:
    path = tmp_path / "x.mat"
    with h5py.File(path, "w") as file:
        made = file.create_dataset("X", (4, 4), "f8", chunks=(2, 2), compression="gzip", fillvalue=7.0)
        made.attrs["MATLAB_class"] = np.bytes_("double")
        made[:2, :2] = 1.0
    with h5py.File(path) as file:
        theirs = file["X"][()]
    np.testing.assert_array_equal(variables(path)["X"], theirs.T)


def test_classes(tmp_path: Path) -> None:
    path = tmp_path / "x.mat"
    with h5py.File(path, "w") as file:
        put(file, "on", np.ones((2, 1), np.uint8), "logical")
        put(file, "small", np.ones((2, 3), np.int16), "int16")
        put(file, "none", np.array([0, 3], np.uint64)).attrs["MATLAB_empty"] = np.uint8(1)
        put(file, "no_text", np.array([0, 0], np.uint64), "char").attrs["MATLAB_empty"] = np.uint8(1)
        put(file, "no_cells", np.array([0, 0], np.uint64), "cell").attrs["MATLAB_empty"] = np.uint8(1)
        text(file, "word", "grün")
        put(file, "z", np.ones((1, 1), [("real", "f8"), ("imag", "f8")]))
        put(file, "f", np.ones((1, 1), np.uint8), "function_handle")
        put(file, "names", np.ones((6, 1), np.uint32), "string").attrs["MATLAB_object_decode"] = np.int32(3)
        sparse = file.create_group("s")
        sparse.attrs["MATLAB_class"], sparse.attrs["MATLAB_sparse"] = np.bytes_("double"), np.uint64(3)
        inner = file.create_group("data")
        inner.attrs["MATLAB_class"] = np.bytes_("struct")
        text(inner, "label", "rice")
    found = variables(path)
    assert found["on"].dtype == bool
    assert (found["small"].shape, found["small"].dtype) == ((3, 2), np.int16)
    assert found["none"].shape == (0, 3)
    assert (found["no_text"], found["no_cells"], found["word"]) == ("", [], "grün")
    assert found["data"] == {"label": "rice"}
    assert [line.split(" and was")[0] for line in left_out(path)] == [
        "variable f is a function handle",
        "variable names is a MATLAB string",
        "variable s is a sparse matrix",
        "variable z is an array of complex numbers",
    ]


def test_labels_that_only_matlab_can_read_are_no_missing_labels(tmp_path: Path) -> None:
    path = tmp_path / "x.mat"
    with h5py.File(path, "w") as file:
        put(file, "X", np.stack([push(1), push(2)]).transpose())
        put(file, "rate_hz", np.array([[500.0]]))
        put(file, "y", np.ones((6, 1), np.uint32), "string").attrs["MATLAB_object_decode"] = np.int32(3)
    with pytest.raises(
        RecordingFileError, match=r"variable y is a MATLAB string .* save cellstr\(\.\.\.\) of it"
    ):
        load(path)


def bomb(file) -> None:
    dataset = put(file, "X", np.zeros((64, 64)), chunks=(64, 64), compression="gzip")
    dataset.id.write_direct_chunk((0, 0), zlib.compress(bytes(1 << 27), 1))


def short_chunk(file) -> None:
    dataset = put(file, "X", np.zeros((64, 64)), chunks=(64, 64), compression="gzip")
    dataset.id.write_direct_chunk((0, 0), zlib.compress(bytes(100)))


def no_zlib(file) -> None:
    dataset = put(file, "X", np.zeros((64, 64)), chunks=(64, 64), compression="gzip")
    dataset.id.write_direct_chunk((0, 0), b"x" * 100)


def huge(file) -> None:
    file.create_dataset("X", (1 << 20, 1 << 20), "f8", chunks=(1 << 10, 1 << 10)).attrs["MATLAB_class"] = (
        np.bytes_("double")
    )


def huge_chunk(file) -> None:
    made = file.create_dataset(
        "X", (1, 1), "f8", maxshape=(None, None), chunks=(1 << 13, 1 << 13), compression="gzip"
    )
    made.attrs["MATLAB_class"] = np.bytes_("double")


def many_chunks(file) -> None:
    file.create_dataset("X", (300, 300), "f8", chunks=(1, 1)).attrs["MATLAB_class"] = np.bytes_("double")


def external_storage(file) -> None:
    made = file.create_dataset("X", (2, 6), "f8", external=[("/etc/hostname", 0, 96)])
    made.attrs["MATLAB_class"] = np.bytes_("double")


def virtual(file) -> None:
    layout = h5py.VirtualLayout((2, 6), "f8")
    layout[:] = h5py.VirtualSource("other.h5", "X", (2, 6))
    file.create_virtual_dataset("X", layout).attrs["MATLAB_class"] = np.bytes_("double")


def external_link(file) -> None:
    file["X"] = h5py.ExternalLink("other.h5", "X")


def soft_link(file) -> None:
    file["X"] = h5py.SoftLink("/X")


def scaled(file) -> None:
    put(file, "X", np.zeros((64, 6)), chunks=(64, 6), scaleoffset=3)


def strings_of_any_length(file) -> None:
    put(file, "X", ["a", "b"], "char", dtype=h5py.string_dtype())


def cell_in_itself(file) -> None:
    made = file.create_dataset("X", (1, 1), h5py.ref_dtype)
    made.attrs["MATLAB_class"] = np.bytes_("cell")
    made[0, 0] = made.ref


def cells_unfold(file) -> None:
    below = put(file.create_group("#refs#"), "a", np.zeros((1, 1)))
    for level in range(12):  # ten in each of ten in each of ten ...
        cell = file["#refs#"].create_dataset(f"b{level}", (10, 1), h5py.ref_dtype)
        cell.attrs["MATLAB_class"] = np.bytes_("cell")
        cell[...] = below.ref
        below = cell
    made = file.create_dataset("X", (1, 1), h5py.ref_dtype)
    made.attrs["MATLAB_class"] = np.bytes_("cell")
    made[0, 0] = below.ref


def deep(file) -> None:
    group = file
    for _ in range(100):
        group = group.create_group("X")
        group.attrs["MATLAB_class"] = np.bytes_("struct")
    put(group, "x", np.zeros((1, 1)))


def reference_to_nothing(file) -> None:
    made = file.create_dataset("X", (1, 2), h5py.ref_dtype)
    made.attrs["MATLAB_class"] = np.bytes_("cell")


def cell_of_numbers(file) -> None:
    put(file, "X", np.zeros((1, 2)), "cell")


def no_class(file) -> None:
    put(file, "X", np.zeros((1, 2)), None)


def other_class(file) -> None:
    put(file, "X", np.zeros((1, 2)), "quaternion")


def class_is_an_array(file) -> None:
    put(file, "X", np.zeros((1, 2)), None).attrs["MATLAB_class"] = np.zeros(6000)


def empty_of_many(file) -> None:
    put(file, "X", np.zeros(100, np.uint64)).attrs["MATLAB_empty"] = np.uint8(1)


def empty_that_is_not(file) -> None:
    put(file, "X", np.array([5, 5], np.uint64)).attrs["MATLAB_empty"] = np.uint8(1)


def from_octave(file) -> None:
    file.create_group("X").attrs["OCTAVE_NEW_FORMAT"] = np.uint8(1)


def null_space(file) -> None:
    file.create_dataset("X", data=h5py.Empty("f8")).attrs["MATLAB_class"] = np.bytes_("double")


BAD: list[tuple[Callable, str]] = [
    (bomb, "variable X: a chunk of 32768 bytes unpacks to more"),
    (short_chunk, "variable X: a chunk of 32768 bytes unpacks to 100 bytes"),
    (no_zlib, "variable X: a chunk is damaged"),
    (huge, "variable X: has the size 1048576 x 1048576, which is damage or a trap"),
    (huge_chunk, "variable X: would expand"),
    (many_chunks, "variable X: lies in 90000 chunks"),
    (external_storage, "variable X: keeps its values in other files"),
    (virtual, "variable X: keeps its values in other files"),
    (external_link, "variable X: is a link to another file, which is not followed"),
    (soft_link, "variable X: is a link by name, which is not followed"),
    (scaled, r"variable X: is packed with scaleoffset \(filter 6 of HDF5\); .*h5repack"),
    (strings_of_any_length, "variable X: is called char, but holds object"),
    (cell_in_itself, r"variable X\{1\}.*: is a struct or cell that lies at two places"),
    (cells_unfold, "is a struct or cell that lies at two places of the file"),
    (deep, "cells and structs lie more than 32 deep"),
    (reference_to_nothing, r"variable X\{1\}: is a reference to nothing"),
    (cell_of_numbers, "variable X: is called a cell, but holds float64"),
    (no_class, "variable X: has no attribute MATLAB_class"),
    (other_class, "variable X: is of the class 'quaternion'"),
    (class_is_an_array, "variable X: is of the class"),
    (empty_of_many, "variable X: is called empty, but holds 100 values"),
    (empty_that_is_not, r"variable X: is called empty, but its size is \[5, 5\]"),
    (from_octave, "was written by Octave's save -hdf5; wanted save -v7"),
    (null_space, "variable X: holds nothing"),
]


@pytest.mark.parametrize(("make", "message"), BAD, ids=[make.__name__ for make, _ in BAD])
def test_one_clear_error_and_little_memory(tmp_path: Path, make: Callable, message: str) -> None:
    path = tmp_path / "bad.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        make(file)
    assert_refused(path, message, 64 << 20)


def test_a_missing_h5py_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(ImportError, match=r"h5py is needed to read \.mat files of version 7\.3: pip install"):
        load(GOLDEN / "ragged_cell_v73.mat")


def test_a_damaged_file_is_closed_so_that_a_good_one_at_its_place_is_read(tmp_path: Path) -> None:
    good = (GOLDEN / "ragged_cell_v73.mat").read_bytes()
    path = tmp_path / "x.mat"
    refused = 0
    for at in range(592, 672, 4):  # the header of the file and of its root group
        damaged = bytearray(good)
        damaged[at] ^= 0xFF
        path.write_bytes(damaged)
        try:
            load(path)
        except RecordingFileError:
            refused += 1
        path.write_bytes(good)  # the same file to the operating system
        assert len(load(path)) == 3
    assert refused > 5
