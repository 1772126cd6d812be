"""The container of MAT files of version 5 (``save -v6`` and ``save -v7``): variables one after the other.

Source: "MAT-File Format" (The MathWorks), Level 5.
"""

from __future__ import annotations

import struct
import zlib
from typing import Any, BinaryIO, Literal

import numpy as np

from granular_id.io.bulk import read_at
from granular_id.io.matlab.tree import LEFT_OUT, VARIABLE_PARTS, MatReading
from granular_id.io.matlab.v5_matrix import COMPRESSED, MATRIX, MatrixReader

HEADER_BYTES = 128
_PIECE_BYTES = 1 << 18
_STEP_BYTES = 1 << 20  # unpacked at a time, so that nothing large is there twice
_MOST_PER_BYTE = 1032
"""No deflate stream gives more bytes for one of its own."""


def read_v5(file: BinaryIO, reading: MatReading) -> dict[str, Any]:
    """Read all variables of a version 5 file.

    Parameters
    ----------
    file : binary file, seekable
    reading : MatReading
        Its limits, and where what cannot be read is noted.

    Returns
    -------
    dict
        Arrays (column-major, as stored, in the number class of MATLAB), str, dicts for structs, lists for cells
        and struct arrays.

    Raises
    ------
    RecordingFileError
        Naming the variable and the byte within it.
    """
    order, own_data_at = _checked_header(file, reading)
    variables: dict[str, Any] = {}
    at = HEADER_BYTES
    while at < reading.n_bytes:
        place = f"variable {len(variables) + 1}, byte {at}"
        reading.count(VARIABLE_PARTS, place)
        file.seek(at)
        tag = file.read(8)
        if len(tag) < 8:
            raise reading.fault(place, f"the file ends within the tag of a variable: {len(tag)} of 8 bytes")
        kind, size = struct.unpack(order + "II", tag)
        left = reading.n_bytes - at - 8
        if kind not in (MATRIX, COMPRESSED):
            raise reading.fault(place, f"an array is wanted, got an element of type {kind}")
        if size > left:
            raise reading.fault(
                place, f"an array claims {size} bytes, but {left} are left: the file is cut off"
            )
        if at != own_data_at:  # there MATLAB keeps what its objects are made of
            if kind == COMPRESSED:
                data = _inflated(file, size, order, reading, place)
            else:
                data = _plain(file, size, reading, place)
            name, value = MatrixReader(data, order, reading).variable(place)
            if name in variables:
                raise reading.fault(f"variable {name}", "occurs twice")
            if value is not LEFT_OUT:
                variables[name] = value
        at += 8 + size
    return variables


def _checked_header(file: BinaryIO, reading: MatReading) -> tuple[Literal["<", ">"], int]:
    """Return the order of bytes, and where MATLAB's own data lie (0 where there are none)."""
    file.seek(0)
    header = file.read(HEADER_BYTES)
    if len(header) < HEADER_BYTES:
        raise reading.fault(
            "header", f"the file ends after {len(header)} bytes of its {HEADER_BYTES}-byte header"
        )
    order: Literal["<", ">"]
    if header[126:] == b"IM":
        order = "<"
    elif header[126:] == b"MI":
        order = ">"
    else:
        raise reading.fault("header", f"the mark of byte order is {header[126:]!r}; wanted b'IM' or b'MI'")
    version, own_data_at = struct.unpack(order + "H", header[124:126])[0], header[116:124]
    if version != 0x0100:
        raise reading.fault("header", f"states version {version:#06x}; wanted 0x0100 (version 5)")
    return order, 0 if own_data_at.isspace() else int(struct.unpack(order + "Q", own_data_at)[0])


def _plain(file: BinaryIO, size: int, reading: MatReading, place: str) -> memoryview:
    """Read an array that is not packed: into memory that numpy made, which is faster than that of bytes."""
    data = np.empty(size, np.uint8)
    done = read_at(file.fileno(), file.tell(), data).n_bytes
    if done < size:
        raise reading.fault(place, f"the file ends after {done} of {size} bytes")
    return data.data


def _inflated(file: BinaryIO, n_packed: int, order: str, reading: MatReading, place: str) -> memoryview:
    """Unpack one array without its tag: the tag says how much there is, and no byte more is unpacked."""
    inflater = _Inflater(file, n_packed, reading, place)
    kind, size = struct.unpack(order + "II", inflater.take(8))
    if kind != MATRIX:
        raise reading.fault(place, f"an array is wanted, got a compressed element of type {kind}")
    if size > n_packed * _MOST_PER_BYTE:
        raise reading.fault(place, f"{n_packed} compressed bytes cannot hold the {size} that are claimed")
    reading.spend(size, place)
    data = inflater.take(size)
    inflater.check_end()
    return data


class _Inflater:
    """Unpacks exactly as many bytes as are asked for."""

    def __init__(self, file: BinaryIO, n_packed: int, reading: MatReading, place: str) -> None:
        self._file, self._left = file, n_packed
        self._reading, self._place = reading, place
        self._stream = zlib.decompressobj()
        self._packed = b""

    def take(self, size: int) -> memoryview:
        taken = np.empty(size, np.uint8).data
        filled = 0
        while filled < size:
            new, came = self._step(min(size - filled, _STEP_BYTES))
            if not new and not came:
                problem = f"the compressed array ends after {filled} of {size} bytes"
                raise self._reading.fault(self._place, problem)
            taken[filled : filled + len(new)] = new
            filled += len(new)
        return taken

    def check_end(self) -> None:
        while not self._stream.eof:
            new, came = self._step(1)
            if new or not came:
                what = "goes on beyond the size it states" if new else "has no end and no checksum"
                raise self._reading.fault(self._place, f"the compressed array {what}")

    def _step(self, most: int) -> tuple[bytes, bool]:
        """Return some bytes, at most `most`, and whether there was any input left to work on."""
        if not self._packed:
            self._packed = self._file.read(min(self._left, _PIECE_BYTES))
            self._left -= len(self._packed)
        came = bool(self._packed) and not self._stream.eof
        try:
            new = self._stream.decompress(self._packed, most)
        except zlib.error as error:
            raise self._reading.fault(self._place, f"the compressed array is damaged ({error})") from error
        self._packed = self._stream.unconsumed_tail
        return new, came
