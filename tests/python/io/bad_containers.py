"""Files made to do harm: MATLAB, HDF5 and NumPy files, and our own, that lie, explode or lead elsewhere."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import h5py
import numpy as np

import mcap_attacks as mcap
from bad_contents import HISTORIES, MANY
from bad_files import GIB, ODD_PLACES, BadCase, outside, write_good, written
from bad_mat import COMPRESSED, DOUBLE, DOUBLES, FUNCTION, MATRIX, OPAQUE, element, head, mat
from good_files import WRENCH
from granular_id.recording import AXES

MIB = 1 << 20
BLOCK = MIB


def zeros_deflated(n_bytes: int) -> bytes:
    """Return a zlib stream of zeros; its blocks are all alike, so that none has to be made twice."""
    maker = zlib.compressobj(9, zlib.DEFLATED, -15)
    block = maker.compress(bytes(BLOCK)) + maker.flush(zlib.Z_FULL_FLUSH)
    checksum = struct.pack(">I", (n_bytes % 65521) << 16 | 1)
    return b"\x78\xda" + block * (n_bytes // BLOCK) + b"\3\0" + checksum


# -- MATLAB; bad_mat.py has more


def variable(name: str = "wrench", dims: tuple[int, int] = (3, 6), kind: int = DOUBLES) -> bytes:
    values = np.zeros(dims).tobytes()
    return element(MATRIX, head(kind, dims, name) + element(DOUBLE, values))


def stream(data: bytes) -> bytes:
    """Return a compressed variable, whatever is in it."""
    return element(COMPRESSED, data)


MATS: dict[str, bytes] = {
    "only a function": mat(variable(kind=FUNCTION)),
    "only an object": mat(variable(kind=OPAQUE)),
    "name with control characters": mat(variable("a\x1b[2Jb\n", (2, 9))),
    "11,000 variables": mat(*(variable(f"x{i}", (1, 1)) for i in range(11_000))),
    "100,000 empty tags": mat(element(MATRIX, b"") * 100_000),
    "packed gigabyte": mat(stream(zeros_deflated(GIB))),
    "packed gigabyte that says so": mat(stream(zlib.compress(struct.pack("<II", MATRIX, GIB) + bytes(MIB)))),
    "packed twice": mat(stream(zlib.compress(stream(zlib.compress(variable()))))),
    "version 4: complex": struct.pack("<5i", 0, 3, 6, 1, 7) + b"wrench\0" + bytes(288),
    "version 4: 100,000 empty arrays": b"".join(
        struct.pack("<5i6s", 0, 0, 0, 0, 6, b"%05d" % i) for i in range(100_000)
    ),
}


# -- HDF5


def _hdf5(fill: Callable[[h5py.File], object], folder: Path) -> Path:
    path = folder / "bad.hdf5"
    with h5py.File(path, "w", libver="latest") as file:
        fill(file)
    return path


def _chunk(file: h5py.File, stream: bytes, shape: tuple[int, ...], chunk: tuple[int, ...]) -> None:
    """Write a chunk as it is, whatever it unpacks to."""
    data = file.create_dataset("wrench", shape, float, chunks=chunk, compression="gzip")
    data.id.write_direct_chunk((0, 0), stream)


def _nest(file: h5py.File) -> None:
    group = file
    for _ in range(1000):
        group = group.create_group("a")
    group["wrench"] = WRENCH


def _loop(file: h5py.File) -> None:
    file.create_group("a")["b"] = file["/"]


def _many(file: h5py.File) -> None:
    for i in range(3000):
        file[f"x{i}"] = 0.0


def _virtual(file: h5py.File) -> None:
    layout = h5py.VirtualLayout(WRENCH.shape, float)
    layout[:] = h5py.VirtualSource(_elsewhere(file), "wrench", WRENCH.shape)
    file.create_virtual_dataset("wrench", layout)


def _elsewhere(file: h5py.File) -> str:
    """Return a pipe outside of the data set: whoever opens it waits for ever."""
    folder = outside(Path(file.filename).parent)
    path = folder / "bad.h5"
    return str(path if path.exists() else ODD_PLACES["pipe"]("hdf5", folder))


def _good_elsewhere(file: h5py.File) -> str:
    return str(write_good("hdf5 of others", outside(Path(file.filename).parent)))


HDF5S: dict[str, Callable[[h5py.File], object]] = {
    "nothing in it": lambda file: None,
    "external link to a pipe": lambda file: file.__setitem__(
        "wrench", h5py.ExternalLink(_elsewhere(file), "/wrench")
    ),
    "external link to a good file": lambda file: file.__setitem__(
        "wrench", h5py.ExternalLink(_good_elsewhere(file), "/wrench")
    ),
    "link by name to nothing": lambda file: file.__setitem__("wrench", h5py.SoftLink("/nothing")),
    "link by name to itself": lambda file: file.__setitem__("wrench", h5py.SoftLink("/wrench")),
    "values in a pipe": lambda file: file.create_dataset(
        "wrench", (3, 6), float, external=[(_elsewhere(file), 0, 144)]
    ),
    "values in the passwords": lambda file: file.create_dataset(
        "wrench", (3, 6), float, external=[("/etc/passwd", 0, 144)]
    ),
    "virtual dataset": _virtual,
    "a terabyte that is not there": lambda file: file.create_dataset(
        "wrench", (10**12, 6), float, chunks=(1000, 6)
    ),
    "a terabyte in one piece": lambda file: file.create_dataset("wrench", (10**11, 6), float),
    "2^60 texts": lambda file: file.create_dataset("label", (2**60,), "S1", chunks=(MIB,)),
    "gzip bomb": partial(_chunk, stream=zeros_deflated(GIB), shape=(GIB // 48, 6), chunk=(GIB // 48, 6)),
    "gzip bomb in a small chunk": partial(_chunk, stream=zeros_deflated(GIB), shape=(100, 6), chunk=(100, 6)),
    "gzip cut off": partial(_chunk, stream=zlib.compress(bytes(4800))[:9], shape=(100, 6), chunk=(100, 6)),
    "gzip of noise": partial(_chunk, stream=bytes(range(256)), shape=(100, 6), chunk=(100, 6)),
    "chunks of one value": lambda file: file.create_dataset("wrench", (60_000, 6), float, chunks=(1, 6)),
    "a filter that is not known": lambda file: file.create_dataset("wrench", data=WRENCH, scaleoffset=3),
    "lzf cut off": lambda file: file.create_dataset(
        "wrench", (100, 6), float, chunks=(100, 6), compression="lzf"
    ).id.write_direct_chunk((0, 0), bytes([31, 1])),
    "texts for samples": lambda file: file.create_dataset("wrench", data=WRENCH.astype("S8")),
    "texts of changing length": lambda file: file.create_dataset(
        "wrench", data=WRENCH.astype("S8").astype(object)
    ),
    "references for samples": lambda file: file.create_dataset(
        "wrench", data=np.full((9, 6), file.ref), dtype=h5py.ref_dtype
    ),
    "an empty dataset": lambda file: file.create_dataset("wrench", data=h5py.Empty(float)),
    "a type for a dataset": lambda file: file.__setitem__("wrench", np.dtype("f8")),
    "a group that holds itself": _loop,
    "groups 1000 deep": _nest,
    "3000 numbers": _many,
    "a rate of text": lambda file: (
        file.create_dataset("wrench", data=WRENCH),
        file.create_dataset("rate_hz", data="fast"),
    ),
    "a name with a control character": lambda file: file.create_dataset("a\x1b[2J\nb", data=WRENCH[:2]),
    "a name that is no text": lambda file: file.create_dataset(b"\xff\xfe", data=WRENCH[:2]),
}

OWN_META = f'{{"a":[{MANY}]}}\n{{}}'
OWN_HDF5 = {
    **{f"history {what}": {"history": text} for what, text in HISTORIES.items()},
    "meta of millions of objects": {"recordings/meta": OWN_META},
    "meta nested 100,000 deep": {"recordings/meta": "[" * 100_000},
    "meta of one line": {"recordings/meta": "{}"},
    "lengths that do not add up": {"recordings/n_samples": np.array([40, 41])},
    "lengths that overflow": {"recordings/n_samples": np.array([2**62, 2**62])},
    "a negative length": {"recordings/n_samples": np.array([-1, 81])},
    "rates of zero": {"recordings/rate_hz": np.array([0.0, np.nan])},
    "too few labels": {"recordings/label": np.array([b"rice"])},
    "triggers beyond the end": {"recordings/trigger_index": np.array([99, -1])},
    "flags that do not exist": {"flags": np.full(80, 128, np.uint8)},
    "NaN among the samples": {"wrench": np.full((80, 6), np.nan)},
    "five axes": {"wrench": np.zeros((80, 5))},
}


def _own_hdf5(changes: dict[str, object], folder: Path) -> Path:
    path = write_good("hdf5", folder)
    with h5py.File(path, "r+") as file:
        for name, value in changes.items():
            attributes = dict(file[name].attrs)
            del file[name]
            file[name] = (
                np.bytes_(value.encode("latin-1").rstrip(b"\0") or b" ") if isinstance(value, str) else value
            )
            file[name].attrs.update(attributes)
    return path


def _packed_npz(name: str, text: str, folder: Path) -> Path:
    """Write a good archive with another text, packed: megabytes of it become kilobytes."""
    path = write_good("npz", folder)
    with np.load(path) as archive:
        arrays = {**archive, name: np.frombuffer(text.encode(), np.uint8)}
    np.savez_compressed(path, **arrays)
    return path


def _row_npy(kind: str, folder: Path) -> Path:
    """Write an array of one axis, all zeros, on a disk that does not store them."""
    path = folder / "bad.npy"
    shape = (GIB // np.dtype(kind).itemsize,)
    with path.open("wb") as file:
        np.lib.format.write_array_header_1_0(file, {"descr": kind, "fortran_order": False, "shape": shape})
        file.truncate(file.tell() + GIB)
    return path


def _described_mcap(text: str, folder: Path) -> Path:
    """Write three messages and a description of them with this history."""
    entries = {"version": "1", "n_samples": "3", "rate_hz": "500", "axes": " ".join(AXES), "history": text}
    listed = b"".join(mcap.text(key) + mcap.text(value) for key, value in entries.items())
    body = mcap.text("granular_id") + struct.pack("<I", len(listed)) + listed
    return mcap.mcap(folder, mcap.chunk(mcap.whole_chunk()), mcap.record(mcap.METADATA, body))


def container_cases() -> Iterator[tuple[str, BadCase]]:
    """Yield files that no library would write."""
    for what, data in MATS.items():
        yield f"mat: {what}", BadCase("mat v5", partial(written, "mat v5", data))
    for what, fill in HDF5S.items():
        yield f"hdf5: {what}", BadCase("hdf5 of others", partial(_hdf5, fill))
    for what, changes in OWN_HDF5.items():
        yield f"own hdf5: {what}", BadCase("hdf5", partial(_own_hdf5, changes))
    for what, text in HISTORIES.items():
        yield f"own npz: history {what}", BadCase("npz", partial(_packed_npz, "history", text))
        yield f"own mcap: history {what}", BadCase("mcap", partial(_described_mcap, text))
    yield "own npz: meta of millions of objects", BadCase("npz", partial(_packed_npz, "meta", OWN_META))
    for kind in ("|u1", "|S1", "<f8"):
        yield f"npy: a gigabyte of {kind} in a row", BadCase("npy", partial(_row_npy, kind))
