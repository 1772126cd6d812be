"""MAT files of version 4 (``save -v4``): full matrices of two dimensions, and text.

Source: "MAT-File Format" (The MathWorks), Level 4.
"""

from __future__ import annotations

import struct
from typing import Any, BinaryIO

import numpy as np

from granular_id.io.matlab.tree import (
    COMPLEX,
    LEFT_OUT,
    MAX_NAME,
    SPARSE,
    VARIABLE_PARTS,
    MatReading,
    name_of,
    text_of,
)

_HEADER_BYTES = 20
_STORED = ("f8", "f4", "i4", "i2", "u2", "u1")
_TEXT, _SPARSE_KIND = 1, 2


def read_v4(file: BinaryIO, reading: MatReading) -> dict[str, Any]:
    """Read all variables of a version 4 file, as `read_v5` does."""
    variables: dict[str, Any] = {}
    at = 0
    while at < reading.n_bytes:
        place = f"variable {len(variables) + 1}, byte {at}"
        reading.count(VARIABLE_PARTS, place)
        file.seek(at)
        header = file.read(_HEADER_BYTES)
        if len(header) < _HEADER_BYTES:
            raise reading.fault(
                place, f"the file ends after {len(header)} of the {_HEADER_BYTES} header bytes"
            )
        order, stored, kind = _matrix_type(header, reading, place)
        _, rows, columns, has_imaginary, name_bytes = struct.unpack(order + "5i", header)
        count = reading.checked_dims((rows, columns), place)
        size = count * stored.itemsize * (2 if has_imaginary else 1)
        at += _HEADER_BYTES + name_bytes + size
        if not 0 < name_bytes <= MAX_NAME:
            raise reading.fault(place, f"a name of {name_bytes} bytes; that is damage, or no MAT file at all")
        if at > reading.n_bytes:
            problem = (
                f"{rows} x {columns} numbers take {size} bytes, {at - reading.n_bytes} more than are left"
            )
            raise reading.fault(place, problem)
        name = name_of(file.read(name_bytes))
        place = f"variable {name}"
        if name in variables:
            raise reading.fault(place, "occurs twice")
        if kind == _SPARSE_KIND:
            value: Any = reading.leave_out(place, *SPARSE)
        elif has_imaginary:
            value = reading.leave_out(place, *COMPLEX)
        else:
            reading.spend(max(0, 8 * count - size), place)
            flat = np.frombuffer(file.read(size), stored).astype(stored.newbyteorder("="), copy=False)
            if kind == _TEXT:
                reading.count(max(rows - 1, 0), place)
                value = text_of(_codes(flat, reading, place), (rows, columns))
            else:
                value = flat.reshape((rows, columns), order="F")
        if value is not LEFT_OUT:
            variables[name] = value
    return variables


def _matrix_type(header: bytes, reading: MatReading, place: str) -> tuple[str, np.dtype[Any], int]:
    """Return the order of bytes, how numbers are stored, and whether they are numbers, text or sparse."""
    for order in ("<", ">"):
        (code,) = struct.unpack(order + "i", header[:4])
        machine, reserved, stored, kind = code // 1000, code // 100 % 10, code // 10 % 10, code % 10
        if machine == (order == ">") and not reserved and stored < len(_STORED) and kind <= _SPARSE_KIND:
            return order, np.dtype(order + _STORED[stored]), kind
    raise reading.fault(place, f"begins with {header[:4]!r}, which no MAT file does")


def _codes(flat: np.ndarray[Any, Any], reading: MatReading, place: str) -> np.ndarray[Any, Any]:
    """Return characters, which version 4 keeps as numbers of any kind, as UTF-16."""
    good = (flat >= 0) & (flat < 2**16)
    if not good.all():
        raise reading.fault(place, f"{flat[~good][0]} is no character")
    return flat.astype(np.uint16)
