"""MATLAB files as GNU Octave, scipy and MATLAB itself wrote them, against scipy's reader."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings, strategies as st
from hypothesis.extra import numpy as hnp

from effort import cases
from granular_id.io import RecordingFileError, load
from granular_id.io.matlab.tree import nested
from mat_cases import GOLDEN, left_out, push, variables

NAMES = ["rice", "peas", "oat flakes"]
SCIPY_FILES = sorted((Path(scipy.io.matlab.__file__).parent / "tests" / "data").glob("*.mat"))


@pytest.mark.parametrize(
    ("name", "lengths", "labels"),
    [
        ("x_y_v6", [24] * 5, [0, 1, 2, 0, 1]),
        ("x_y_v7", [24] * 5, [0, 1, 2, 0, 1]),
        ("single_t6n_v7", [24] * 5, [0, 1, 2, 0, 1]),
        ("struct_array_v7", [25, 26, 27, 28], [0, 1, 2, 0]),
        ("cell_per_material_v7", [24] * 5, [0, 0, 1, 2, 2]),
        ("struct_of_materials_v7", [24] * 5, [0, 0, 1, 1, 1]),
        ("ragged_cell_v7", [25, 26, 27], [0, 1, 2]),
    ],
)
def test_what_octave_wrote_is_read_sample_for_sample(
    name: str, lengths: list[int], labels: list[int]
) -> None:
    data = load(GOLDEN / f"{name}.mat")
    assert [r.label for r in data] == [NAMES[k] for k in labels]
    for i, (recording, n_samples) in enumerate(zip(data, lengths, strict=True)):
        assert recording.rate_hz == 500
        np.testing.assert_array_equal(recording.wrench, push(i + 1, n_samples))


def test_sessions_are_read() -> None:
    assert [r.session for r in load(GOLDEN / "x_y_v7.mat")] == ["mon", "mon", "mon", "tue", "tue"]
    assert [r.session for r in load(GOLDEN / "struct_array_v7.mat")] == ["day1", "day2", "day3", "day4"]


def test_int16_samples_and_labels_as_numbers() -> None:
    data = load(GOLDEN / "int16_v6.mat")
    assert [r.label for r in data] == ["rice", "peas", "oat flakes", "rice", "peas"]
    t, c = np.meshgrid(np.arange(1, 25), np.arange(1, 7), indexing="ij")
    np.testing.assert_array_equal(data[4].wrench, 5000.0 + 10 * t + c)


def test_version_4() -> None:
    (recording,) = load(GOLDEN / "one_v4.mat")
    np.testing.assert_array_equal(recording.wrench, push(1))


def test_what_was_guessed_and_left_out_is_said() -> None:
    notes = load(GOLDEN / "single_t6n_v7.mat").history[-1].notes
    assert "force (24, 6, 5) taken as samples, axes, recordings" in notes
    notes = load(GOLDEN / "odd_v7.mat").history[-1].notes
    assert "variable sparse_part is a sparse matrix and was left out; save full(...) of it" in notes
    assert any(note.startswith("variable complex_part is an array of complex numbers") for note in notes)


def test_text_empty_logical_and_nested_cells() -> None:
    found = variables(GOLDEN / "odd_v7.mat")
    assert found["note"] == "grün"
    assert found["empty"].shape == (0, 0)
    assert found["on"].dtype == bool
    one, (two, record) = found["nested"]
    assert (one, two, record) == (1, 2, {"a": []})


def test_octaves_own_text_format_is_refused_with_the_way_out() -> None:
    with pytest.raises(RecordingFileError, match=r"octave_text\.mat, header: is text .* save it with -v7"):
        load(GOLDEN / "octave_text.mat")


def plain(value):
    """What scipy returns, as read_variables has it."""
    if not isinstance(value, np.ndarray):
        return value
    if value.dtype.names or value.dtype == object:
        items = [
            {name: plain(item[name]) for name in value.dtype.names} if value.dtype.names else plain(item)
            for item in value.ravel(order="F")
        ]
        return items[0] if value.dtype.names and value.size == 1 else nested(items, value.shape)
    if value.dtype.kind == "U":
        texts = value.ravel().tolist()
        return "" if not texts else texts[0] if len(texts) == 1 else [text.rstrip(" \0") for text in texts]
    return value


def assert_same(ours, theirs) -> None:
    assert type(ours) is type(theirs)
    if isinstance(ours, dict):
        assert ours.keys() == theirs.keys()
        for key in ours:
            assert_same(ours[key], theirs[key])
    elif isinstance(ours, list):
        assert len(ours) == len(theirs)
        for one, other in zip(ours, theirs, strict=True):
            assert_same(one, other)
    elif isinstance(ours, np.ndarray):
        assert ours.shape == theirs.shape
        assert ours.dtype == theirs.dtype.newbyteorder("=")
        np.testing.assert_array_equal(ours, theirs)
    else:
        assert ours == theirs


def scipy_reads(source) -> dict:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # scipy says what it makes of damaged and doubled names
        found = scipy.io.loadmat(source, mat_dtype=True)
    return {key: plain(value) for key, value in found.items() if not key.startswith("__")}


REFUSED = {  # files in scipy's tests that are damaged
    "bad_miuint32.mat": "has the size -2147483647 x 10",
    "corrupted_zlib_checksum.mat": "incorrect data check",
    "corrupted_zlib_data.mat": "goes on beyond the size it states",
    "debigged_m4.mat": "more than are left",
    "malformed1.mat": "an array claims 658840 bytes, but 2072 are left",
    "nasty_duplicate_fieldnames.mat": "has two fields of one name",
}
OTHERWISE = {  # and where scipy takes another way: unpaired bytes, an empty struct, a name that is no ASCII
    "bad_miutf8_array_name.mat",
    "broken_utf8.mat",
    "test_empty_struct.mat",
    "testhdf5_7.4_GLNX86.mat",
}


@pytest.mark.skipif(not SCIPY_FILES, reason="scipy came without its tests")
def test_files_that_matlab_4_to_7_wrote_on_many_machines_read_as_scipy_reads_them() -> None:
    compared = unread_only = 0
    for path in SCIPY_FILES:
        if path.name in REFUSED:
            with pytest.raises(RecordingFileError, match=REFUSED[path.name]):
                variables(path)
            continue
        if path.name in OTHERWISE:
            continue
        try:
            ours, unread = variables(path), left_out(path)
        except RecordingFileError as error:
            unread_only += "holds no variable that can be read: variable" in str(error)
            continue
        theirs = scipy_reads(path)
        inner = [text for text in unread if "." in text.split()[1]]
        if inner:  # a field was left out: scipy has it
            continue
        assert_same(ours, {key: theirs[key] for key in ours})
        assert {text.split()[1] for text in unread} == theirs.keys() - ours.keys()
        compared += len(ours)
    assert compared > 60
    assert unread_only == 20  # sparse, complex, functions


_DTYPES = ("f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "bool")
_arrays = st.sampled_from(_DTYPES).flatmap(
    lambda code: hnp.arrays(code, hnp.array_shapes(min_dims=2, max_dims=4, min_side=0, max_side=5))
)
_texts = st.text(
    st.characters(exclude_categories=["Cs", "Cc"], exclude_characters="\0"), min_size=1, max_size=9
)
_names = st.from_regex(r"[a-z][a-z0-9_]{0,20}", fullmatch=True)


def _cells(items):
    column = np.empty((len(items), 1), object)
    column[:, 0] = items
    return column


_values = st.recursive(
    _arrays | _texts,
    lambda inner: (
        st.lists(inner, min_size=1, max_size=4).map(_cells)
        | st.dictionaries(_names, inner, min_size=1, max_size=4)
    ),
    max_leaves=8,
)


@settings(max_examples=cases(25), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.dictionaries(_names, _values, min_size=1, max_size=4), st.booleans())
def test_what_scipy_writes_is_read_as_scipy_reads_it(tmp_path: Path, tree: dict, compress: bool) -> None:
    path = tmp_path / "x.mat"
    scipy.io.savemat(path, tree, do_compression=compress)
    assert_same(variables(path), scipy_reads(path))


@settings(max_examples=cases(25), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    hnp.arrays(
        "f8",
        st.tuples(st.integers(1, 4), st.integers(24, 40), st.just(6)),
        elements=st.floats(allow_nan=False, allow_infinity=False),
    ),
    st.booleans(),
)
def test_samples_keep_their_bits(tmp_path: Path, samples: np.ndarray, compress: bool) -> None:
    path = tmp_path / "x.mat"
    scipy.io.savemat(path, {"X": samples, "rate_hz": 500.0}, do_compression=compress)
    data = load(path)
    assert np.stack([r.wrench for r in data]).tobytes() == samples.tobytes()


def test_version_4_as_scipy_writes_it(tmp_path: Path) -> None:
    tree = {"wrench": push(1), "i": np.arange(4, dtype=np.int16).reshape(2, 2), "text": "abc"}
    path = tmp_path / "x.mat"
    scipy.io.savemat(path, tree, format="4")
    assert_same(variables(path), scipy_reads(path))
