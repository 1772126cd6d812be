"""What the readers of every MAT version share: limits, the list of what was left out, MATLAB shapes as lists."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from granular_id.io.expansion import Expansion

MAX_DEPTH = 32
"""Cells and structs within each other; data sets nest three or four deep."""

MAX_PARTS = 50_000
"""Cells, fields and variables in one file: 1,000 recordings with 50 fields each, read within a second."""

VARIABLE_PARTS = 5
"""A variable takes the time of five cells."""

MAX_DIMENSIONS = 32
"""As numpy 1.26 has it."""

MAX_NAME = 256
"""Bytes of the name of a variable or field; MATLAB's own are at most 63."""


class _LeftOut:
    """Stands for a value that cannot be read, until whatever holds it has been left out."""

    def __repr__(self) -> str:
        return "LEFT_OUT"


LEFT_OUT: Final = _LeftOut()


@dataclass
class MatReading(Expansion):
    """The file being read, what it has cost so far, and what of it could not be read.

    Attributes
    ----------
    parts : int
        Cells, fields and variables met so far.
    left_out, may_be_labels : list of str
        What could not be read, where, and how to save it instead; the second lists those that may name materials.
    """

    parts: int = 0
    left_out: list[str] = field(default_factory=list)
    may_be_labels: list[str] = field(default_factory=list)

    def count(self, n_parts: int, place: str) -> None:
        """Refuse a file of more cells and fields than can be read in good time."""
        self.parts += n_parts
        if self.parts > MAX_PARTS:
            problem = f"the file has more than {MAX_PARTS} cells, fields and variables"
            raise self.fault(place, f"{problem}; save recordings as one array (n, T, 6), or in several files")

    def deeper(self, depth: int, place: str) -> int:
        """Return the next depth, or refuse it."""
        if depth >= MAX_DEPTH:
            raise self.fault(place, f"cells and structs lie more than {MAX_DEPTH} deep in each other")
        return depth + 1

    def checked_dims(self, dims: Sequence[int], place: str) -> int:
        """Return how many elements an array has, or refuse its size."""
        if len(dims) == 2 and 0 <= dims[0] < 1 << 20 and 0 <= dims[1] < 1 << 20:
            return dims[0] * dims[1]
        if len(dims) > MAX_DIMENSIONS or any(n < 0 for n in dims):
            shown = " x ".join(map(str, dims[:8]))
            raise self.fault(place, f"has the size {shown}, {len(dims)} dimensions; that is damage")
        count = extent = 1
        for n in dims:
            count *= n
            extent *= max(n, 1)
        if extent >= 2**40:  # numpy multiplies the extents of an empty array too
            raise self.fault(
                place, f"has the size {' x '.join(map(str, dims[:8]))}, which is damage or a trap"
            )
        return count

    def leave_out(self, place: str, what: str, remedy: str, *, may_be_labels: bool = False) -> _LeftOut:
        """Note that a value cannot be read, and how to save it so that it can."""
        self.left_out.append(f"{place} is {what} and was left out; {remedy}")
        if may_be_labels:
            self.may_be_labels.append(self.left_out[-1])
        return LEFT_OUT

    def leave_out_object(self, place: str, class_name: str) -> _LeftOut:
        """Leave out an object of a MATLAB class, which only MATLAB itself can read."""
        what = f"a MATLAB {class_name}"
        remedy, may_be_labels = _REMEDIES.get(class_name, ("save its values as plain arrays", False))
        return self.leave_out(place, what, remedy, may_be_labels=may_be_labels)


_REMEDIES = {
    "string": ("save cellstr(...) of it", True),
    "categorical": ("save cellstr(...) of it", True),
    "table": ("save table2struct(..., 'ToScalar', true), with cellstr(...) of text columns", True),
    "timetable": (
        "save table2struct(timetable2table(...), 'ToScalar', true), with seconds(...) of its times",
        True,
    ),
    "datetime": ("save posixtime(...) of it", False),
    "duration": ("save seconds(...) of it", False),
    "containers.Map": ("save its keys and values as cells", True),
}
SPARSE = ("a sparse matrix", "save full(...) of it")
COMPLEX = ("an array of complex numbers", "a wrench is real: save real(...) of it")
FUNCTION = ("a function handle", "it holds no samples")


def nested(items: list[Any], dims: Sequence[int]) -> list[Any]:
    """Arrange what a file lists column by column: vectors as a list, matrices as lists of their rows.

    Examples
    --------
    >>> nested([1, 2, 3, 4, 5, 6], (2, 3))
    [[1, 3, 5], [2, 4, 6]]
    >>> nested([1, 2], (1, 2))
    [1, 2]
    """
    long = [n for n in dims if n != 1]
    if not items or len(long) <= 1:  # none at all may be 2^24 rows of nothing
        return items
    rows = long[0]
    return [nested(items[i::rows], long[1:]) for i in range(rows)]


def holds(dtype: np.dtype[Any], stored: np.dtype[Any]) -> bool:
    """Tell whether numbers of a class can be stored so: MATLAB stores them in fewer bytes, never in more."""
    if dtype.kind == "f" and stored.kind in "iu":
        return True
    return dtype.kind == "b" or np.can_cast(stored, dtype, "safe")


def in_class(values: NDArray[Any], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Convert stored numbers to the class that they are of."""
    with np.errstate(invalid="ignore"):  # a signalling NaN becomes a quiet one
        return values.astype(dtype, copy=False)


def text_of(codes: NDArray[Any], dims: Sequence[int]) -> str | list[str]:
    """Turn character codes, column by column, into a str; several rows into a list without trailing spaces.

    Parameters
    ----------
    codes : array of uint8 (UTF-8 or Latin-1), uint16 (UTF-16) or uint32 (UTF-32), shape (n,)
    dims : sequence of int
        Size in MATLAB; its product is n.
    """
    if not len(codes):
        return ""
    rows = np.ascontiguousarray(codes.reshape(dims[0], -1, order="F"))
    texts = [decoded(row.tobytes(), codes.dtype) for row in rows]
    if len(texts) == 1:
        return texts[0]
    return [text.rstrip(" \0") for text in texts]  # char matrices are padded to one width


def decoded(data: bytes, stored: np.dtype[Any]) -> str:
    """Turn the bytes of character codes of one, two or four bytes into text."""
    if stored.itemsize > 1:
        order = "be" if stored.str.startswith(">") else "le"
        return data.decode(f"utf-{8 * stored.itemsize}-{order}", "replace")
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:  # before Unicode, char arrays held Latin-1
        return data.decode("latin-1")


def name_of(data: bytes) -> str:
    """Return the name of a variable or field; bytes that are no text are shown as escapes."""
    return data.split(b"\0", 1)[0].decode("utf-8", "backslashreplace")


def empty_matrix() -> NDArray[np.float64]:
    """Return what MATLAB writes as ``[]``."""
    return np.empty((0, 0))
