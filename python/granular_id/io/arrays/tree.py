"""A tree of named arrays, wherever it came from: NPZ archives, MATLAB variables, HDF5 groups.

Nodes are mappings (structs, groups), lists (cells), ``str``, and leaves: numpy arrays, or anything with ``shape``,
``dtype`` and ``read()`` that gives one, so that only what is needed is read.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id.io.errors import RecordingFileError
from granular_id.io.flat import plain_texts

MAX_DEPTH = 16
"""Structs and groups within each other; deeper ones are damage."""

_LISTED = 8
"""How many arrays an error or a note lists."""


@dataclass(frozen=True)
class Origin:
    """The file that a tree came from, for errors, and what was guessed of it.

    `describe` is what its format calls an entry: ``"array"``, ``"variable"``, ``"data set"``; `single` says that such
    a file can hold one array only, so that nothing can stand beside it.
    """

    path: Path
    describe: str
    tree: Mapping[str, Any]
    single: bool = False
    notes: list[str] = field(default_factory=list)

    def note(self, text: str) -> None:
        """Say once what was guessed."""
        if text not in self.notes:
            self.notes.append(text)

    def fault(self, name: str, problem: str) -> RecordingFileError:
        """Return the error about one entry."""
        return RecordingFileError(self.path, problem, place=f"{self.describe} {name}")

    def unclear(self, problem: str) -> RecordingFileError:
        """Return the error about what cannot be told, with what is in the file and how to say what is meant."""
        wanted = "X of shape (recordings, samples, 6), labels (a text per recording) and fs (Hz)"
        means = f"Say what is meant by saving what belongs together and nothing else: {wanted}"
        if self.single:
            means = f"A file like this holds one array: save an .npz file with {wanted}"
        return RecordingFileError(self.path, f"{problem}. It holds {contents(self.tree)}. {means}")


def is_leaf(node: Any) -> bool:
    """Tell whether a node is an array, read or not."""
    return hasattr(node, "shape") and hasattr(node, "dtype")


def is_numbers(node: Any) -> bool:
    """Tell whether a node is an array of real numbers."""
    return is_leaf(node) and np.dtype(node.dtype).kind in "iuf"


def has_axis(node: Any, length: int) -> bool:
    """Tell whether a node is an array of numbers (also complex) of two or three dimensions, one of them so long."""
    if not is_leaf(node) or np.dtype(node.dtype).kind not in "iufc" or n_values(node) is not None:
        return False
    return len(node.shape) in (2, 3) and length in node.shape and 0 not in node.shape


def values(node: Any) -> NDArray[Any]:
    """Return the array of a leaf, reading it if need be."""
    return np.asarray(node.read() if hasattr(node, "read") else node)


def n_values(node: Any) -> int | None:
    """Return the length of what can be taken as a list of values, None for everything else.

    MATLAB has matrices only: (1, n) and (n, 1) are lists of n, and (1, 1) is a single value.
    """
    if isinstance(node, str):
        return 1
    if isinstance(node, list):
        return len(node)
    if not is_leaf(node) or sum(n != 1 for n in node.shape) > 1:
        return None
    return int(math.prod(node.shape))


def numbers(node: Any) -> NDArray[Any] | None:
    """Return a list of real numbers as an array of shape (n,), None where a node is no such list."""
    if isinstance(node, list):
        each = _one_each(node, numbers)
        return np.concatenate(each) if each else None
    return values(node).reshape(-1) if is_numbers(node) and n_values(node) is not None else None


def texts(node: Any) -> list[str] | None:
    """Return a list of texts, without the spaces that pad them to one width; None where a node is no such list."""
    if isinstance(node, str):
        return [node.rstrip(" ")]
    if isinstance(node, list):
        each = _one_each(node, texts)
        return [text for (text,) in each] if each else None
    if not is_leaf(node) or np.dtype(node.dtype).kind not in "US" or n_values(node) is None:
        return None
    plain = plain_texts(values(node).reshape(-1))
    return None if plain is None else [text.rstrip(" ") for text in plain]


def _one_each(cells: list[Any], read: Callable[[Any], Any]) -> list[Any] | None:
    """Return what is read of each cell where each holds one value, None otherwise."""
    each = [None if isinstance(cell, list) else read(cell) for cell in cells]
    return each if all(found is not None and len(found) == 1 for found in each) else None


def as_tree(node: Any) -> Any:
    """Return a mapping of the fields where a node is a structured array, the node itself otherwise."""
    if isinstance(node, tuple):
        return list(node)
    if is_leaf(node) and np.dtype(node.dtype).names:
        array = values(node)
        return {name: array[name] for name in array.dtype.names or ()}
    return node


def contents(tree: Mapping[str, Any]) -> str:
    """List what a tree holds, with shapes and types."""
    found = list(_described(tree, "", MAX_DEPTH))
    more = f" and {len(found) - _LISTED} more" if len(found) > _LISTED else ""
    return ", ".join(found[:_LISTED]) + more if found else "nothing"


def _described(node: Any, name: str, depth: int) -> Iterator[str]:
    node = as_tree(node)
    if isinstance(node, Mapping) and depth:
        for key, item in node.items():
            yield from _described(item, f"{name}/{key[:60]}" if name else key[:60], depth - 1)
    elif isinstance(node, list):
        first = next(_described(node[0], "", depth - 1), "") if node and depth else ""
        yield f"{name} (list of {len(node)}{', the first:' if first else ''}{first})"
    elif is_leaf(node):
        yield f"{name} {tuple(node.shape)} {np.dtype(node.dtype)}"
    elif isinstance(node, str):
        yield f"{name} {node[:40]!r}"
    else:
        yield f"{name} ({type(node).__name__})"
