"""Why no recordings were recognised among named arrays, and how to save them so that they are."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from granular_id.io.arrays.names import is_other_thing, role_of
from granular_id.io.arrays.parts import THREE, is_half
from granular_id.io.arrays.stated import names_of
from granular_id.io.arrays.tree import MAX_DEPTH, as_tree, is_numbers
from granular_id.recording import AXES

_N = len(AXES)


def nothing_found(tree: Mapping[str, Any]) -> str:
    """Say what the first array that comes near a recording lacks.

    Examples
    --------
    >>> import numpy as np
    >>> nothing_found({"X": np.zeros((0, 6))})
    'X (0, 6) is empty: it holds no samples'
    """
    arrays = list(_arrays(tree, "", MAX_DEPTH))
    named = {key: len(names_of(node)) for key, node in tree.items() if role_of(key) == "axes"}
    for key, n_names in named.items():
        six = next((f"{name} {shape}" for name, shape in arrays if _N in shape), None)
        if six is not None and n_names != _N:
            return f"{six} has {_N} columns, {key} names {n_names}; wanted a name for each"
    for hint in _HINTS:
        for name, shape in arrays:
            said = hint(name, shape)
            if said is not None:
                return said
    return f"wanted an array with an axis of length {_N}, or axes, the names of the axes that there are, beside it"


def _arrays(node: Any, name: str, depth: int) -> Iterator[tuple[str, tuple[int, ...]]]:
    """Yield names and shapes of arrays of numbers that are no vectors."""
    node = as_tree(node)
    if isinstance(node, Mapping) and depth:
        for key, item in node.items():
            yield from _arrays(item, f"{name}/{key}" if name else key, depth - 1)
    elif isinstance(node, list) and depth:
        for i, item in enumerate(node[:1]):
            yield from _arrays(item, f"{name}[{i}]", depth - 1)
    elif is_numbers(node) and len(node.shape) in (2, 3):
        yield name[:200], tuple(node.shape)


def _other_thing(name: str, shape: tuple[int, ...]) -> str | None:
    if 0 in shape or _N not in shape or not is_other_thing(name.rpartition("/")[2]):
        return None
    return f"{name} {shape} is no wrench by its name; if it is one, pass array={name!r}, or save it under another name"


def _empty(name: str, shape: tuple[int, ...]) -> str | None:
    if 0 not in shape or _N not in shape:
        return None
    return f"{name} {shape} is empty: it holds no samples"


def _with_time(name: str, shape: tuple[int, ...]) -> str | None:
    if shape[-1] != _N + 1 or 0 in shape:
        return None
    time = f"{name}[:, 0]" if len(shape) == 2 else f"{name}[0, :, 0]"
    return (
        f"{name} {shape} has {_N + 1} columns; if the first is time, save {name}[..., 1:] as X "
        f"and {time} as t (s)"
    )


def _one_side(name: str, shape: tuple[int, ...]) -> str | None:
    if len(THREE) not in shape or 0 in shape or not is_half(name.rpartition("/")[2]):
        return None
    return (
        f"{name} {shape} has {len(THREE)} axes, a wrench {_N}; save force and torque as arrays of one shape "
        "under these names, or beside the samples axes, the names of those that there are"
    )


def _flattened(name: str, shape: tuple[int, ...]) -> str | None:
    if len(shape) != 2 or shape[1] % _N or 0 in shape:
        return None
    n, n_samples = shape[0], shape[1] // _N
    return (
        f"{name} {shape} may hold one flattened recording in each row; whether all of fx or all axes of the first "
        f"sample come first cannot be told. Save it as {name}.reshape({n}, {_N}, {n_samples}).transpose(0, 2, 1) in "
        f"the first case, as {name}.reshape({n}, {n_samples}, {_N}) in the second"
    )


_HINTS: tuple[Callable[[str, tuple[int, ...]], str | None], ...] = (
    _other_thing,
    _empty,
    _one_side,
    _with_time,
    _flattened,
)
"""In the order in which they are tried."""
