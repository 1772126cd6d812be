"""HDF5 files by h5py; what would make the library read other files is refused before."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id.io.errors import RecordingFileError, naming, need
from granular_id.io.files import Expansion

_HARD_LINK = 0

__all__ = ["attribute", "has", "is_group", "is_text", "member", "opened", "values"]


@contextmanager
def opened(expansion: Expansion, why: str) -> Iterator[Any]:
    """Open a file; `why` ends the sentence about a missing h5py."""
    h5py = need("h5py", extra="hdf5", why=why)
    # a lock would make files on read-only and network drives unreadable; nothing is written
    with naming(expansion.path, "reading it by h5py"), h5py.File(expansion.path, "r", locking=False) as file:
        yield file


def is_group(item: Any) -> bool:
    """Tell a group from a data set."""
    return hasattr(item, "keys")


def is_text(dtype: np.dtype[Any]) -> bool:
    """Tell whether values are texts of changing length."""
    about: Any = dtype.metadata or {}
    return about.get("vlen") in (str, bytes)


def has(group: Any, name: str) -> bool:
    """Tell whether there is a member of that name, without following a link."""
    return is_group(group) and bool(group.id.links.exists(name.encode()))


def member(group: Any, name: str | bytes, place: str, expansion: Expansion) -> Any:
    """Return a group or data set that is itself in the group, with values in this file."""
    with naming(expansion.path, f"looking at {place}"):
        key = name if isinstance(name, bytes) else name.encode()
        if group.id.links.get_info(key).type != _HARD_LINK:  # ``in`` and ``get`` would open what it leads to
            raise expansion.fault(place, "is a link, which is not followed; wanted the data set itself")
        item = group[name]
        _refuse_elsewhere(item, place, expansion)
    return item


def _refuse_elsewhere(item: Any, place: str, expansion: Expansion) -> None:
    if getattr(item, "external", None) or getattr(item, "is_virtual", False):
        raise expansion.fault(place, "keeps its values in other files, which are not opened")


def attribute(item: Any, name: str, place: str, expansion: Expansion) -> Any:
    """Return an attribute, texts as str or an array of them; None where there is none."""
    with naming(expansion.path, f"reading the attribute {name} of {place}"):
        value = item.attrs.get(name)
        if isinstance(value, bytes):
            return value.decode("utf-8", "backslashreplace")
        if isinstance(value, np.ndarray) and is_text(item.attrs.get_id(name).dtype):
            return value.astype(np.str_)
    is_number = getattr(value, "dtype", np.dtype("O")).kind in "iufbSU" and value.shape is not None
    if value is None or isinstance(value, str) or is_number:
        return value
    raise RecordingFileError(expansion.path, f"the attribute {name} is no number or text", place=place)


def values(item: Any, place: str, expansion: Expansion) -> NDArray[Any]:
    """Return all values of a data set; texts of changing length as texts of one width."""
    with naming(expansion.path, f"reading {place}"):
        _refuse_elsewhere(item, place, expansion)
        expansion.spend(item.size * max(item.dtype.itemsize, 8), place)  # numbers become float64
        if is_text(item.dtype):
            return np.asarray(item.asstr(errors="backslashreplace")[()], np.str_)
        return np.asarray(item[()])
