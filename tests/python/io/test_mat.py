"""MATLAB files as GNU Octave, scipy, h5py and MATLAB itself wrote them: the same values whatever the version."""

from __future__ import annotations

import struct
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from granular_id.io import RecordingFileError, load
from granular_id.io.errors import attempt
from granular_id.io.matlab import read_variables
from granular_id.io.options import LoadOptions
from granular_id.io.source import FileSource

h5py = pytest.importorskip("h5py")

GOLDEN = Path(__file__).parents[2] / "data" / "mat"
NAMES = ["rice", "peas", "oat flakes"]
SCIPY_FILES = sorted((Path(scipy.io.matlab.__file__).parent / "tests" / "data").glob("*.mat"))


def push(i: int, n_samples: int = 24) -> np.ndarray:
    """Recording i of the golden files: see make_mat.m."""
    t, c = np.meshgrid(np.arange(1, n_samples + 1), np.arange(1, 7), indexing="ij")
    return 1000.0 * i + t + c / 8


def variables(path: Path) -> dict:
    return read_variables(FileSource.alone(path), LoadOptions())[0]


def left_out(path: Path) -> list[str]:
    return read_variables(FileSource.alone(path), LoadOptions())[1].left_out


def put(group, name: str, values, class_name: str | None = "double", **settings):
    """A dataset of version 7.3 as MATLAB marks it; values are already in the order of HDF5."""
    dataset = group.create_dataset(name, data=values, **settings)
    if class_name:
        dataset.attrs["MATLAB_class"] = np.bytes_(class_name)
    return dataset


def text(group, name: str, letters: str):
    return put(group, name, np.frombuffer(letters.encode("utf-16-le"), np.uint16)[:, None], "char")


def element(kind: int, data: bytes) -> bytes:
    """An element of version 5."""
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def head(array_class: int, dims: tuple[int, ...], name: str) -> bytes:
    """Flags, size and name of an array."""
    sizes = struct.pack(f"<{len(dims)}i", *dims)
    return element(6, struct.pack("<II", array_class, 0)) + element(5, sizes) + element(1, name.encode())


def doubles(values: list[float], dims: tuple[int, ...], name: str = "") -> bytes:
    return element(14, head(6, dims, name) + element(9, np.array(values, "<f8").tobytes()))


def mat(*elements: bytes) -> bytes:
    return b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM" + b"".join(elements)


# -- what other programs wrote


@pytest.mark.parametrize(
    ("name", "lengths", "labels"),
    [
        ("x_y_v6", [24] * 5, [0, 1, 2, 0, 1]),
        ("x_y_v7", [24] * 5, [0, 1, 2, 0, 1]),
        ("single_t6n_v7", [24] * 5, [0, 1, 2, 0, 1]),
        ("single_t6n_v73", [24] * 5, [0, 1, 2, 0, 1]),
        ("struct_array_v7", [25, 26, 27, 28], [0, 1, 2, 0]),
        ("struct_array_v73", [25, 26], [0, 1]),
        ("cell_per_material_v7", [24] * 5, [0, 0, 1, 2, 2]),
        ("struct_of_materials_v7", [24] * 5, [0, 0, 1, 1, 1]),
        ("ragged_cell_v7", [25, 26, 27], [0, 1, 2]),
        ("ragged_cell_v73", [25, 26, 27], [0, 1, 2]),
    ],
)
def test_golden_files_are_read_sample_for_sample(name: str, lengths: list[int], labels: list[int]) -> None:
    data = load(GOLDEN / f"{name}.mat")
    assert [r.label for r in data] == [NAMES[k] for k in labels]
    for i, (recording, n_samples) in enumerate(zip(data, lengths, strict=True)):
        assert recording.rate_hz == 500
        np.testing.assert_array_equal(recording.wrench, push(i + 1, n_samples))


def test_sessions_version_4_and_what_was_guessed_and_left_out() -> None:
    data = load(GOLDEN / "x_y_v7.mat")
    assert [r.session for r in data] == ["mon", "mon", "mon", "tue", "tue"]
    data = load(GOLDEN / "int16_v6.mat")
    assert [r.label for r in data] == ["rice", "peas", "oat flakes", "rice", "peas"]
    t, c = np.meshgrid(np.arange(1, 25), np.arange(1, 7), indexing="ij")
    np.testing.assert_array_equal(data[4].wrench, 5000.0 + 10 * t + c)
    (recording,) = load(GOLDEN / "one_v4.mat")
    np.testing.assert_array_equal(recording.wrench, push(1))
    notes = load(GOLDEN / "single_t6n_v7.mat").history[-1].notes
    assert "force (24, 6, 5) taken as samples, axes, recordings" in notes
    notes = load(GOLDEN / "odd_v7.mat").history[-1].notes
    assert "variable sparse_part is a sparse matrix and was left out; save full(...) of it" in notes
    assert any(note.startswith("variable complex_part is an array of complex numbers") for note in notes)
    found = variables(GOLDEN / "odd_v7.mat")
    assert (found["note"], found["empty"].shape, found["on"].dtype) == ("grün", (0, 0), bool)
    one, (two, record) = found["nested"]
    assert (one, two, record) == (1, 2, {"a": []})


@pytest.mark.skipif(not SCIPY_FILES, reason="scipy came without its tests")
def test_files_that_matlab_wrote_on_many_machines_are_read() -> None:
    refused: list[RecordingFileError] = []
    read = {path.name: attempt(refused, variables, path) for path in SCIPY_FILES}
    assert len(read) - len(refused) > 60
    for version in ("4.2c", "6.1"):  # big-endian
        found = read[f"testdouble_{version}_SOL2.mat"]["testdouble"][0]
        np.testing.assert_allclose(found, np.arange(9) * np.pi / 4, atol=1e-15)
    (first, one, *_) = read["testcell_7.1_GLNX86.mat"]["testcell"]
    assert first == "This cell contains this string and 3 arrays of increasing length"
    assert one.tolist() == [[1]]
    assert read["testunicode_7.4_GLNX86.mat"]["testunicode"].startswith("Japanese: \nすべての人間は")


@pytest.mark.parametrize("kind", [4, 16, 17])  # 16-bit numbers, UTF-8, UTF-16
@pytest.mark.parametrize("word", ["Grieß", "Haferflocken", "小麦粉"])
def test_text_in_any_code(tmp_path: Path, kind: int, word: str) -> None:
    coded = word.encode("utf-8" if kind == 16 else "utf-16-le")
    path = tmp_path / "x.mat"
    path.write_bytes(mat(element(14, head(4, (1, len(word)), "label") + element(kind, coded))))
    assert variables(path) == {"label": word}


def test_classes_of_version_73(tmp_path: Path) -> None:
    path = tmp_path / "x.mat"
    with h5py.File(path, "w") as file:
        put(file, "on", np.ones((2, 1), np.uint8), "logical")
        put(file, "small", np.ones((2, 3), np.int16), "int16")
        put(file, "none", np.array([0, 3], np.uint64)).attrs["MATLAB_empty"] = np.uint8(1)
        put(file, "no_text", np.array([0, 0], np.uint64), "char").attrs["MATLAB_empty"] = np.uint8(1)
        put(file, "no_cells", np.array([0, 0], np.uint64), "cell").attrs["MATLAB_empty"] = np.uint8(1)
        text(file, "word", "grün 😀")
        put(file, "rows", np.array([list(b"ab"), list(b"c ")], np.uint16).T, "char")
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
    assert (found["no_text"], found["no_cells"], found["word"]) == ("", [], "grün 😀")
    assert found["rows"] == ["ab", "c"]
    assert found["data"] == {"label": "rice"}
    assert [line.split(" and was")[0] for line in left_out(path)] == [
        "variable f is a function handle",
        "variable names is a MATLAB string",
        "variable s is a sparse matrix",
        "variable z is an array of complex numbers",
    ]


# -- what cannot be read is said


def opaque(name: bytes, class_name: bytes) -> bytes:
    """An object as MATLAB stores it."""
    flags = element(6, struct.pack("<II", 17, 0))
    names = element(1, name) + element(1, b"MCOS") + element(1, class_name)
    return element(14, flags + names + doubles([1.0], (1, 1)))


def test_objects_of_matlab_are_named_with_the_way_out(tmp_path: Path) -> None:
    x = doubles([0.0] * (2 * 24 * 6), (2, 24, 6), "X")
    rate = doubles([500.0], (1, 1), "rate_hz")
    path = tmp_path / "rice_1.mat"
    path.write_bytes(mat(opaque(b"y", b"categorical"), x, rate, opaque(b"when", b"datetime")))
    assert left_out(path) == [
        "variable y is a MATLAB categorical and was left out; save cellstr(...) of it",
        "variable when is a MATLAB datetime and was left out; save posixtime(...) of it",
    ]
    with pytest.raises(RecordingFileError, match="without a label, but variable y is a MATLAB categorical"):
        load(path)
    # where the folder says the label, nothing is missing
    data = load(tmp_path)
    assert [r.label for r in data] == ["rice", "rice"]
    assert any("categorical" in note for note in data.history[-1].notes)


def test_what_is_left_out_of_a_cell_leaves_out_the_cell_and_no_imaginary_part_is_lost(tmp_path: Path) -> None:
    path = tmp_path / "x.mat"
    tree = {"c": np.array([1.0, 1j], object), "s": {"a": 1j, "b": 2.0}, "W": push(1) * 1j, "wrench": push(1)}
    scipy.io.savemat(path, tree)
    found = variables(path)
    assert set(found) == {"s", "wrench"}
    assert set(found["s"]) == {"b"}
    assert [text.split(" is ")[0] for text in left_out(path)] == [
        "variable c{2}",
        "variable s.a",
        "variable W",
    ]


def test_what_was_left_out_is_said_where_nothing_else_is_there(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "x.mat", {"W": push(1) * 1j, "rate_hz": 500.0})
    with pytest.raises(RecordingFileError, match=r"no recordings.*variable W is an array of complex numbers"):
        load(tmp_path / "x.mat")
    x = doubles([1.0], (1, 1), "X")
    (tmp_path / "x.mat").write_bytes(mat(x, x))
    with pytest.raises(RecordingFileError, match="variable X: occurs twice"):
        load(tmp_path / "x.mat")


def labels_of_matlab_alone(file) -> None:
    put(file, "X", np.stack([push(1), push(2)]).transpose())
    put(file, "rate_hz", np.array([[500.0]]))
    put(file, "y", np.ones((6, 1), np.uint32), "string").attrs["MATLAB_object_decode"] = np.int32(3)


def values_elsewhere(file) -> None:
    made = file.create_dataset("X", (2, 6), "f8", external=[("/etc/hostname", 0, 96)])
    made.attrs["MATLAB_class"] = np.bytes_("double")


def null_reference(file) -> None:
    file.create_dataset("X", (1, 2), h5py.ref_dtype).attrs["MATLAB_class"] = np.bytes_("cell")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (labels_of_matlab_alone, r"y is a MATLAB string .* save cellstr\(\.\.\.\) of it"),
        (values_elsewhere, "variable X: keeps its values in other files"),
        (null_reference, "variable X"),
        (lambda f: f.update({"X": h5py.ExternalLink("other.h5", "X")}), "variable X: is a link"),
        (lambda f: f.create_group("X").attrs.update(OCTAVE_NEW_FORMAT=np.uint8(1)), "wanted save -v7"),
        (lambda f: put(f, "X", np.zeros((1, 2)), None), "variable X: has no attribute MATLAB_class"),
        (lambda f: put(f, "X", np.zeros((1, 2)), "quaternion"), "X: is of the class 'quaternion'"),
    ],
)
def test_what_version_73_must_not_hold_is_refused(tmp_path: Path, make: Callable, message: str) -> None:
    path = tmp_path / "bad.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        make(file)
    with pytest.raises(RecordingFileError, match=message):
        load(path)


def test_a_file_of_version_73_that_is_cut_off_says_so(tmp_path: Path) -> None:
    path = tmp_path / "cut.mat"
    path.write_bytes((GOLDEN / "ragged_cell_v73.mat").read_bytes()[:500])
    with pytest.raises(RecordingFileError, match="it is cut off or damaged"):
        load(path)


def test_octaves_text_files_that_are_too_large_and_a_missing_h5py(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(RecordingFileError, match=r"octave_text\.mat, header: is text .* save it with -v7"):
        load(GOLDEN / "octave_text.mat")
    with pytest.raises(RecordingFileError, match="more than max_file_bytes=100"):
        load(GOLDEN / "x_y_v7.mat", max_file_bytes=100)
    scipy.io.savemat(tmp_path / "bomb.mat", {"X": np.zeros((1, 9_000_000), np.int8)}, do_compression=True)
    with pytest.raises(RecordingFileError, match="variable X: would expand from"):  # as float64
        load(tmp_path / "bomb.mat")
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(ImportError, match=r"h5py is needed to read \.mat files of version 7\.3: pip install"):
        load(GOLDEN / "ragged_cell_v73.mat")
