"""NPZ and NPY files that are damaged, hostile or no recordings: refused by name, quickly and within bounds."""

import gc
import io
import struct
import tracemalloc
import zipfile

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from granular_id.io import RecordingFileError, load, save
from granular_id.recording import Dataset, Recording

X = np.arange(72.0).reshape(3, 4, 6)


def _npy(array, **kwargs) -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array(stream, np.asarray(array), **kwargs)
    return stream.getvalue()


def _header(text: str, version: bytes = b"\x01\x00") -> bytes:
    body = text.encode("latin-1") + b"\n"
    length = struct.pack("<H" if version == b"\x01\x00" else "<I", len(body))
    return b"\x93NUMPY" + version + length + body


def _asking(shape: str, dtype: str = "'<f8'") -> bytes:
    return _header(f"{{'descr': {dtype}, 'fortran_order': False, 'shape': {shape}, }}")


def _zip(members, compression=zipfile.ZIP_STORED) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", compression) as archive:
        for name, data in members:
            archive.writestr(name, data)
    return stream.getvalue()


def _own(compression=zipfile.ZIP_DEFLATED, **changes) -> bytes:
    """A file of this format, with other arrays in place of some (None: without it)."""
    arrays = {
        "format": np.array("granular_id recordings 1"),
        "axes": np.array(["fx", "fy", "fz", "tx", "ty", "tz"]),
        "wrench": X.reshape(-1, 6),
        "n_samples": np.array([4, 8]),
        "rate_hz": np.array([500.0, 500.0]),
        "start_time": np.full(2, np.nan),
        "trigger_index": np.array([-1, -1]),
        "label": np.array(["rice", ""]),
        "session": np.array(["", ""]),
        "name": np.array(["a", "b"]),
        "meta": np.frombuffer(b"{}\n{}", np.uint8),
        "history": np.frombuffer(b"[]", np.uint8),
    }
    arrays.update(changes)
    return _zip(
        [(f"{name}.npy", _npy(array)) for name, array in arrays.items() if array is not None], compression
    )


def _patched(data: bytes, old: bytes, new: bytes) -> bytes:
    assert old in data
    return data.replace(old, new)


def _pickled() -> bytes:
    stream = io.BytesIO()
    np.save(stream, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    return stream.getvalue()


def _duplicates() -> bytes:
    data = _zip([("X.npy", _npy(X)), ("Y.npy", _npy(X)), ("fs.npy", _npy(500))])
    return _patched(data, b"Y.npy", b"X.npy")


def _encrypted() -> bytes:
    data = bytearray(_zip([("X.npy", _npy(X))]))
    data[6] |= 1  # in the local header
    data[data.rindex(b"PK\x01\x02") + 8] |= 1  # in the directory
    return bytes(data)


def _claiming(size: int) -> bytes:
    """The directory says that the member is of another size than it is."""
    data = bytearray(_zip([("X.npy", _npy(X))], zipfile.ZIP_DEFLATED))
    place = data.rindex(b"PK\x01\x02")
    data[place + 24 : place + 28] = struct.pack("<I", size)
    return bytes(data)


def _zip64_lie() -> bytes:
    """The directory puts the size into a zip64 field, which says 2 ** 62."""
    data = _zip([("X.npy", _npy(X))])
    place = data.rindex(b"PK\x01\x02")
    extra = struct.pack("<HHQ", 1, 8, 2**62)
    head = bytearray(data[place : place + 46 + 5])
    head[24:28] = b"\xff" * 4
    head[30:32] = struct.pack("<H", len(extra))
    end = bytearray(data[place + 51 :])
    end[12:16] = struct.pack("<I", len(head) + len(extra))
    return data[:place] + bytes(head) + extra + bytes(end)


def _huge_directory() -> bytes:
    """60,000 members that all point at the same bytes."""
    data = _zip([("X.npy", _npy(X))])
    place = data.rindex(b"PK\x01\x02")
    entry, end = data[place : place + 51], bytearray(data[place + 51 :])
    padded = bytearray(entry)
    padded[28:30] = struct.pack("<H", 100)
    many = (bytes(padded[:46]) + b"A" * 96 + b".npy") * 60_000
    end[8:10] = end[10:12] = struct.pack("<H", 60_000)
    end[12:16] = struct.pack("<I", len(many))
    return data[:place] + many + bytes(end)


BOMB = _asking("(12500000,)") + bytes(100_000_000)

NPZ_FILES = {
    "empty": (b"", r"no whole NPZ archive: its end, .* is missing \(cut off"),
    "text": (b"time,fx\n1,2\n", "no whole NPZ archive"),
    "binary": (bytes(range(256)) * 10, "no whole NPZ archive"),
    "archive of nothing": (_zip([]), "no recordings are recognised.* holds nothing"),
    "archive of texts": (_zip([("a.txt", b"hello")]), "no recordings are recognised"),
    "pickle": (_zip([("X.npy", _pickled())]), "array X: holds Python objects"),
    "raw pickle": (_zip([("X.npy", b"\x80\x04K\x01.")]), "array X: is no array in numpy's format"),
    "32 GiB header": (
        _zip([("X.npy", _asking("(4294967296,)"))]),
        "needs 34359738368 bytes, but there are 0",
    ),
    "negative shape": (_zip([("X.npy", _asking("(-1, 6)"))]), "impossible array"),
    "empty, but endless": (
        _zip([("X.npy", _asking("(0, 2**70)"))]),
        "array X: is no array in numpy's format",
    ),
    "empty, but huge": (_zip([("X.npy", _asking(f"(0, {2**70}, 6)"))]), "impossible array"),
    "many axes": (_zip([("X.npy", _asking(f"({'1,' * 100})") + bytes(8))]), r"impossible.*\(100 axes\)"),
    "values of no bytes": (_zip([("X.npy", _asking("(10**18,)", "'<U0'"))]), "array X: is no array"),
    "texts of no bytes": (_zip([("X.npy", _asking(f"({10**18},)", "'<U0'"))]), "impossible array"),
    "huge text": (_zip([("X.npy", _asking("(1,)", "'<U500000000'"))]), "needs 2000000000 bytes"),
    "nested header": (_zip([("X.npy", _header("(" * 9000))]), "array X: is no array"),
    "long header": (_zip([("X.npy", _header(" " * 60_000))]), "array X: is no array"),
    "code in the header": (_zip([("X.npy", _header("__import__('os').system('true')"))]), "is no array"),
    "header of version 9": (_zip([("X.npy", b"\x93NUMPY\x09\x00" + b"\0" * 99)]), "array X: is no array"),
    "header only": (_zip([("X.npy", _npy(X)[:60])]), "array X: is no array"),
    "shorter than its header": (_zip([("X.npy", _npy(X)[:-8])]), "needs 576 bytes, but there are 568"),
    "longer than its header": (_zip([("X.npy", _npy(X) + b"1")]), "needs 576 bytes, but there are 577"),
    "zip bomb": (_zip([("X.npy", BOMB)], zipfile.ZIP_DEFLATED), "array X: would expand from"),
    "many arrays": (
        _zip([(f"a{i}.npy", b"") for i in range(3000)]),
        "holds 3000 arrays in .* bytes, more than 2000; save recordings as one array",
    ),
    "texts that fill memory": (
        _zip(
            [("X.npy", _npy(X)), ("y.npy", _asking("(2000000,)", "'<U1'") + bytes(8_000_000))],
            zipfile.ZIP_DEFLATED,
        ),
        "array y: would expand from",
    ),
    "bytes that become float64": (
        _zip([("X.npy", _asking("(2000, 1000, 6)", "'|u1'") + bytes(12_000_000))], zipfile.ZIP_DEFLATED),
        "array X: would expand from",
    ),
    "own: recordings without end": (
        _own(n_samples=np.ones(100_000, np.uint8), wrench=np.zeros((100_000, 6))),
        "array n_samples: would expand from",
    ),
    "zip in a zip": (_zip([("X.npy", _zip([("Y.npy", _npy(X))]))]), "array X: is no array in numpy's format"),
    "duplicates": (_duplicates(), "holds two arrays called 'X'"),
    "path upwards": (_zip([("../../x.npy", _npy(X))]), r"member called '\.\./\.\./x\.npy'"),
    "absolute path": (_zip([("/etc/x.npy", _npy(X))]), "member called '/etc/x.npy'"),
    "control character": (_zip([("a\x1b[2J.npy", _npy(X))]), r"member called 'a\\x1b"),
    "array and group": (
        _zip([("a.npy", _npy(X)), ("a/b.npy", _npy(X))]),
        "both an array 'a' and arrays within",
    ),
    "group and array": (
        _zip([("a/b.npy", _npy(X)), ("a.npy", _npy(X))]),
        "both an array 'a' and arrays within",
    ),
    "encrypted": (_encrypted(), "'X.npy' is encrypted"),
    "bzip2": (_zip([("X.npy", _npy(X))], zipfile.ZIP_BZIP2), "compressed by method 12"),
    "claims less": (_claiming(200), "array X: .*Bad CRC-32"),
    "claims more": (_claiming(10_000), "needs 576 bytes, but there are 9872"),
    "zip64 lie": (_zip64_lie(), "directory does not fit what is there"),
    "huge directory": (_huge_directory(), "its directory has more than 4194304 bytes"),
    "flipped bit": (
        _patched(_zip([("X.npy", _npy(X)), ("fs.npy", _npy(9))]), b"\x51\x40", b"\x51\x41"),
        "checksum",
    ),
    "own: newer": (
        _own(format=np.array("granular_id recordings 2")),
        "is of the format 'granular_id recordings 2'",
    ),
    "own: array missing": (_own(n_samples=None), "the array 'n_samples' is missing"),
    "own: label of bytes": (
        _own(label=np.array([b"rice", b""])),
        "array label: has shape .*wanted a list of texts",
    ),
    "own: names in a table": (_own(name=np.array([["a", "b"]])), "array name: has shape"),
    "own: no character": (
        _own(label=np.array([0x7FFFFFFF, 0], "<u4").view("<U1")),
        "array label: holds numbers that no character has",
    ),
    "own: meta is no UTF-8": (_own(meta=np.array([255], np.uint8)), "array meta: is not UTF-8"),
    "own: meta of numbers": (_own(meta=np.zeros(2)), "array meta: has shape"),
    "own: meta of one line": (
        _own(meta=np.frombuffer(b"{}", np.uint8)),
        "meta has 1 values for 2 recordings",
    ),
    "own: lengths": (_own(n_samples=np.array([4, 7])), "n_samples adds up to 11, but wrench has 12"),
    "own: lengths in a table": (_own(n_samples=np.ones((4, 3), int)), r"n_samples has shape \(4, 3\)"),
    "own: NaN": (_own(wrench=np.full((12, 6), np.nan)), r"wrench\[0, 0\]"),
    "own: pickle": (_own(history=None)[:-22] + b"", "no whole NPZ archive"),
}

NPY_FILES = {
    "empty": (b"", "no array in numpy's format"),
    "text": (b"1,2,3\n", "no array in numpy's format"),
    "an archive": (_zip([("X.npy", _npy(X))]), "no array in numpy's format"),
    "pickle": (_pickled(), "holds Python objects"),
    "raw pickle": (b"\x80\x04K\x01.", "no array in numpy's format"),
    "32 GiB header": (_asking("(4294967296,)") + b"1234", "needs 34359738368 bytes, but there are 4"),
    "cut off": (_npy(X)[:-1], "needs 576 bytes, but there are 575"),
    "complex": (_npy(X * 1j), "has dtype complex128; wanted real numbers"),
    "text values": (_npy(X.astype(str)), "no recordings are recognised"),
    "a number": (_npy(5.0), "no recordings are recognised"),
    "four axes": (_npy(X[None]), "no recordings are recognised"),
    "NaN": (_npy(np.where(X == 9, np.nan, X)), "recording 0, sample 1, axis tx is nan"),
    "infinite": (_npy(np.where(X == 9, np.inf, X)), "recording 0, sample 1, axis tx is inf"),
    "no six axes": (_npy(X[..., :5]), "no recordings are recognised"),
    "square": (_npy(np.zeros((6, 6))), "cannot be told which axis counts samples"),
    "flattened": (_npy(np.zeros((3, 60))), r"reshape\(3, 6, 10\)\.transpose\(0, 2, 1\)"),
    "fields of objects": (
        _asking("(1,)", "[('fx', '|O')]") + bytes(8),
        "holds Python objects",
    ),
}


def _refused(path, data, message):
    path.write_bytes(data)
    tracemalloc.start()
    try:
        with pytest.raises(RecordingFileError, match=message) as caught:
            load(path, rate_hz=500)
        assert tracemalloc.get_traced_memory()[1] < 32e6
    finally:
        tracemalloc.stop()
    assert str(path) in str(caught.value)
    assert "\x1b" not in str(caught.value)


@pytest.mark.parametrize("case", NPZ_FILES)
def test_bad_npz_files_are_refused_by_name(tmp_path, case):
    _refused(tmp_path / "bad.npz", *NPZ_FILES[case])


@pytest.mark.parametrize("case", NPY_FILES)
def test_bad_npy_files_are_refused_by_name(tmp_path, case):
    _refused(tmp_path / "bad.npy", *NPY_FILES[case])


def test_files_without_a_rate_are_refused(tmp_path):
    np.save(tmp_path / "x.npy", X)
    with pytest.raises(RecordingFileError, match="neither a rate nor stamps; pass rate_hz="):
        load(tmp_path / "x.npy")


@pytest.mark.parametrize("compression", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_files_cut_anywhere_are_refused(tmp_path, compression):
    data = _zip([("X.npy", _npy(X)), ("fs.npy", _npy(500))], compression)
    path = tmp_path / "cut.npz"
    path.write_bytes(data)
    assert len(load(path)) == 3
    for i in range(10):
        path.write_bytes(data[: i * len(data) // 10])
        with pytest.raises(RecordingFileError):
            load(path)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    changes=st.lists(
        st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 255)), min_size=1, max_size=4
    )
)
def test_damaged_files_are_refused_or_give_finite_samples(tmp_path, changes):
    data = bytearray(_own(zipfile.ZIP_STORED))
    for place, value in changes:
        data[int(place * len(data))] = value
    path = tmp_path / "damaged.npz"
    path.write_bytes(data)
    try:
        read = load(path, rate_hz=500)
    except RecordingFileError:
        return
    assert all(np.isfinite(r.wrench).all() for r in read)


def test_links_out_of_the_folder_are_not_followed(tmp_path):
    outside = save(Dataset([Recording(X[0], rate_hz=500)]), tmp_path / "outside.npz")
    folder = tmp_path / "folder"
    (folder / "rice").mkdir(parents=True)
    (folder / "rice" / "a.npz").symlink_to(outside)
    with pytest.raises(RecordingFileError, match="link that leaves the folder"):
        load(folder)


def test_a_bad_file_among_good_ones_is_skipped_where_asked(tmp_path):
    for name in ("rice_1.npz", "rice_2.npz"):
        save(Dataset([Recording(X[0], rate_hz=500)]), tmp_path / name)
    (tmp_path / "rice_3.npz").write_bytes(NPZ_FILES["pickle"][0])
    data = load(tmp_path, on_error="skip")
    assert data.y.tolist() == ["rice", "rice"]
    assert "rice_3.npz" in str(data.history[-1])


def test_a_member_that_does_not_begin_where_it_should_leaves_nothing_behind(tmp_path, recwarn):
    path = tmp_path / "x.npz"
    np.savez(path, X=X, rate_hz=500.0)
    data = bytearray(path.read_bytes())
    data[:2] = b"no"
    path.write_bytes(data)
    with pytest.raises(RecordingFileError, match="no member begins where the directory says"):
        load(path)
    gc.collect()
    assert not list(recwarn)


def test_axes_without_samples_are_no_recordings(tmp_path):
    path = tmp_path / "x.npz"
    np.savez(path, **{axis: np.zeros((0, 0)) for axis in ("fx", "fy", "fz", "tx", "ty", "tz")})
    with pytest.raises(RecordingFileError, match="no recordings are recognised"):
        load(path, rate_hz=500)
