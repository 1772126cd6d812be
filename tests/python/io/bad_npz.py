"""Bytes of NPZ and NPY files that are damaged, hostile or no recordings, by what is wrong with them."""

from __future__ import annotations

import io
import struct
import zipfile

import numpy as np

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

NPZ_FILES: dict[str, tuple[bytes]] = {
    "empty": (b"",),
    "text": (b"time,fx\n1,2\n",),
    "binary": (bytes(range(256)) * 10,),
    "archive of nothing": (_zip([]),),
    "archive of texts": (_zip([("a.txt", b"hello")]),),
    "pickle": (_zip([("X.npy", _pickled())]),),
    "raw pickle": (_zip([("X.npy", b"\x80\x04K\x01.")]),),
    "32 GiB header": (_zip([("X.npy", _asking("(4294967296,)"))]),),
    "negative shape": (_zip([("X.npy", _asking("(-1, 6)"))]),),
    "empty, but endless": (_zip([("X.npy", _asking("(0, 2**70)"))]),),
    "empty, but huge": (_zip([("X.npy", _asking(f"(0, {2**70}, 6)"))]),),
    "many axes": (_zip([("X.npy", _asking(f"({'1,' * 100})") + bytes(8))]),),
    "values of no bytes": (_zip([("X.npy", _asking("(10**18,)", "'<U0'"))]),),
    "texts of no bytes": (_zip([("X.npy", _asking(f"({10**18},)", "'<U0'"))]),),
    "huge text": (_zip([("X.npy", _asking("(1,)", "'<U500000000'"))]),),
    "nested header": (_zip([("X.npy", _header("(" * 9000))]),),
    "long header": (_zip([("X.npy", _header(" " * 60_000))]),),
    "code in the header": (_zip([("X.npy", _header("__import__('os').system('true')"))]),),
    "header of version 9": (_zip([("X.npy", b"\x93NUMPY\x09\x00" + b"\0" * 99)]),),
    "header only": (_zip([("X.npy", _npy(X)[:60])]),),
    "shorter than its header": (_zip([("X.npy", _npy(X)[:-8])]),),
    "longer than its header": (_zip([("X.npy", _npy(X) + b"1")]),),
    "zip bomb": (_zip([("X.npy", BOMB)], zipfile.ZIP_DEFLATED),),
    "many arrays": (_zip([(f"a{i}.npy", b"") for i in range(3000)]),),
    "texts that fill memory": (
        _zip(
            [("X.npy", _npy(X)), ("y.npy", _asking("(2000000,)", "'<U1'") + bytes(8_000_000))],
            zipfile.ZIP_DEFLATED,
        ),
    ),
    "bytes that become float64": (
        _zip([("X.npy", _asking("(2000, 1000, 6)", "'|u1'") + bytes(12_000_000))], zipfile.ZIP_DEFLATED),
    ),
    "own: recordings without end": (
        _own(n_samples=np.ones(100_000, np.uint8), wrench=np.zeros((100_000, 6))),
    ),
    "zip in a zip": (_zip([("X.npy", _zip([("Y.npy", _npy(X))]))]),),
    "duplicates": (_duplicates(),),
    "path upwards": (_zip([("../../x.npy", _npy(X))]),),
    "absolute path": (_zip([("/etc/x.npy", _npy(X))]),),
    "control character": (_zip([("a\x1b[2J.npy", _npy(X))]),),
    "array and group": (_zip([("a.npy", _npy(X)), ("a/b.npy", _npy(X))]),),
    "group and array": (_zip([("a/b.npy", _npy(X)), ("a.npy", _npy(X))]),),
    "encrypted": (_encrypted(),),
    "bzip2": (_zip([("X.npy", _npy(X))], zipfile.ZIP_BZIP2),),
    "claims less": (_claiming(200),),
    "claims more": (_claiming(10_000),),
    "zip64 lie": (_zip64_lie(),),
    "huge directory": (_huge_directory(),),
    "flipped bit": (_patched(_zip([("X.npy", _npy(X)), ("fs.npy", _npy(9))]), b"\x51\x40", b"\x51\x41"),),
    "own: newer": (_own(format=np.array("granular_id recordings 2")),),
    "own: array missing": (_own(n_samples=None),),
    "own: label of bytes": (_own(label=np.array([b"rice", b""])),),
    "own: names in a table": (_own(name=np.array([["a", "b"]])),),
    "own: no character": (_own(label=np.array([0x7FFFFFFF, 0], "<u4").view("<U1")),),
    "own: meta is no UTF-8": (_own(meta=np.array([255], np.uint8)),),
    "own: meta of numbers": (_own(meta=np.zeros(2)),),
    "own: meta of one line": (_own(meta=np.frombuffer(b"{}", np.uint8)),),
    "own: lengths": (_own(n_samples=np.array([4, 7])),),
    "own: lengths in a table": (_own(n_samples=np.ones((4, 3), int)),),
    "own: NaN": (_own(wrench=np.full((12, 6), np.nan)),),
    "own: pickle": (_own(history=None)[:-22] + b"",),
}


NPY_FILES: dict[str, tuple[bytes]] = {
    "empty": (b"",),
    "text": (b"1,2,3\n",),
    "an archive": (_zip([("X.npy", _npy(X))]),),
    "pickle": (_pickled(),),
    "raw pickle": (b"\x80\x04K\x01.",),
    "32 GiB header": (_asking("(4294967296,)") + b"1234",),
    "cut off": (_npy(X)[:-1],),
    "complex": (_npy(X * 1j),),
    "text values": (_npy(X.astype(str)),),
    "a number": (_npy(5.0),),
    "four axes": (_npy(X[None]),),
    "NaN": (_npy(np.where(X == 9, np.nan, X)),),
    "infinite": (_npy(np.where(X == 9, np.inf, X)),),
    "no six axes": (_npy(X[..., :5]),),
    "square": (_npy(np.zeros((6, 6))),),
    "flattened": (_npy(np.zeros((3, 60))),),
    "fields of objects": (_asking("(1,)", "[('fx', '|O')]") + bytes(8),),
}
