"""Which axis of an array counts recordings, which samples and which the sensor's axes; wrenches in parts."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import permutations
from typing import Any

import numpy as np

from granular_id._checks import FloatArray, all_finite
from granular_id.io.arrays.names import FORCES, TORQUES, plain_name
from granular_id.io.arrays.stated import Units
from granular_id.io.arrays.tree import Origin, has_axis, is_leaf
from granular_id.io.columns import ColumnError, axes_among, split_unit
from granular_id.recording import AXES

THREE = ("x", "y", "z")
"""Axes of a force, and of a torque."""

_CLEARLY_LONGER = 4
"""Where only length can tell, the time axis is at least this many times as long as the one of recordings.

Where the axes come last, the one of recordings is at most this many times as long as the time axis.
"""

_DIMS = "['recording', 'time', 'axis']"
_SLAB = 32
"""Samples copied at a time: 32 x 6 float64 are a few cache lines per recording."""


@dataclass(frozen=True)
class Known:
    """What the other arrays of a file say about the shape of the samples.

    `axes` are the names of the sensor's axes; `n_recordings` the lengths of what there is one of per recording
    (labels, sessions, names); `n_samples` those of time vectors; `dimensions` which one counts recordings (0), samples
    (1) and axes (2), where that is stated.
    """

    axes: tuple[str, ...] = AXES
    n_recordings: frozenset[int] = field(default_factory=frozenset)
    n_samples: frozenset[int] = field(default_factory=frozenset)
    units: Units = field(default_factory=dict)
    dimensions: tuple[int, ...] = ()


def order_of(
    shape: tuple[int, ...], known: Known, name: str, origin: Origin, *, sensor_last: bool
) -> tuple[int, ...]:
    """Find the order ([recordings,] samples, sensor axes) of a shape, for ``array.transpose(...)``.

    `sensor_last`: the last axis is known to be the sensor's. Refused where more than one order is possible.
    """
    n, n_axes = len(shape), len(known.axes)
    has_shape = f"{origin.describe} {name} has the shape {shape}"
    if len(known.dimensions) == n:
        order = tuple(known.dimensions.index(place) for place in sorted(known.dimensions))
        if shape[order[-1]] != n_axes:
            problem = f"has the shape {shape}, whose dimensions are stated otherwise"
            raise origin.fault(name, f"{problem}; wanted {n_axes} axes")
        return order
    if n not in (2, 3):
        raise origin.unclear(has_shape)
    sensor = [n - 1] if sensor_last else [i for i, length in enumerate(shape) if length == n_axes]
    orders = [order for order in permutations(range(n)) if order[-1] in sensor]
    for place, lengths in ((n - 3, known.n_recordings), (n - 2, known.n_samples)):
        if place >= 0:
            orders = [order for order in orders if shape[order[place]] in lengths] or orders
    if n == 3 and len(orders) > 1 and len(sensor) == 1:
        orders = [order for order in orders if _is_usual(shape, order)]
    if len(orders) == 1:
        return orders[0]
    if n == 2:
        raise origin.unclear(f"{has_shape}: it cannot be told which axis counts samples")
    several = len(sensor) > 1
    which = f"which of the axes of length {n_axes} is which" if several else "which axis counts recordings"
    telling = "" if several else "labels, lengths or stamps, or "
    beside = "" if origin.single else f"; save {telling}dims, such as {_DIMS}, beside it"
    raise origin.unclear(f"{has_shape}: it cannot be told {which}{beside}")


def _is_usual(shape: tuple[int, ...], order: tuple[int, ...]) -> bool:
    recordings, samples, sensor = order
    if sensor == 2:  # (recordings, samples, axes) is what everybody writes who puts the axes last
        return recordings == 0 and shape[0] <= _CLEARLY_LONGER * shape[1]
    return shape[samples] >= _CLEARLY_LONGER * shape[recordings]


def row_major(block: FloatArray) -> FloatArray:
    """Return a block (n, T, C) in row-major order, copied only where it is not.

    Column-major samples, as MATLAB keeps them, lie far apart for each recording: a few samples of all recordings at a
    time use what the cache holds, and take half as long as the whole in one go.
    """
    if block.flags.c_contiguous:
        return block
    copied = np.empty(block.shape)
    for start in range(0, block.shape[1], _SLAB):
        copied[:, start : start + _SLAB] = block[:, start : start + _SLAB]
    return copied


# -- padding and gaps


def without_padding(block: FloatArray, axes: Collection[str], name: str, origin: Origin) -> list[FloatArray]:
    """Return the recordings of a block (n, T, C), without rows of NaN at the end that pad them to one length.

    NaN or infinity elsewhere is refused.
    """
    if all_finite(block):
        return list(block)
    filled = ~np.asarray(np.isnan(block).all(axis=2))[:, ::-1]
    lengths = np.where(filled.any(axis=1), block.shape[1] - filled.argmax(axis=1), 0).tolist()
    for i, length in enumerate(lengths):
        refuse_gaps(block[i, :length], axes, name, origin, f"recording {i}, ")
    cut = sum(length < block.shape[1] for length in lengths)
    origin.note(f"{name}: NaN at the end of {cut} recordings taken as padding and left out")
    return [recording[:length] for recording, length in zip(block, lengths, strict=True)]


def refuse_gaps(
    wrench: FloatArray, axes: Collection[str], name: str, origin: Origin, where: str = ""
) -> None:
    """Raise where a recording (T, C) is empty, or has values that are no finite numbers."""
    if not len(wrench):
        raise origin.fault(name, f"{where}no samples (or only NaN); wanted at least one")
    bad = ~np.isfinite(wrench)
    if bad.any():
        row, column = (int(i) for i in np.argwhere(bad)[0])
        value = f"sample {row}, axis {list(axes)[column]} is {wrench[row, column]}"
        raise origin.fault(name, f"{where}{value}; samples must be finite")


# -- forces and torques in arrays of their own, or a vector for each axis


def halves_of(others: Mapping[str, Any], origin: Origin) -> tuple[str, str] | None:
    """Find the names of forces and torques side by side; refuse two of a kind."""
    forces, torques = _halves(others)
    if not forces or not torques:
        return None
    for what, keys in (("forces", forces), ("torques", torques)):
        if len(keys) > 1:
            raise origin.unclear(f"{' and '.join(map(repr, keys))} may both be the {what}")
    return forces[0], torques[0]


def pairs_of(halves: tuple[str, str], others: Mapping[str, Any], origin: Origin) -> list[tuple[Any, Any]]:
    """Return the pairs of two lists, or the one pair of two arrays, each of one shape."""
    both = [others[key] for key in halves]
    lists = [node if isinstance(node, list) else [node] for node in both]
    if isinstance(both[0], list) != isinstance(both[1], list) or len(lists[0]) != len(lists[1]):
        held = " and ".join(f"{key} {len(node)}" for key, node in zip(halves, lists, strict=True))
        raise origin.unclear(f"{held} recordings; wanted a force and a torque for each, both in lists")
    for i, pair in enumerate(zip(*lists, strict=True)):
        if not all(map(is_leaf, pair)) or pair[0].shape != pair[1].shape:
            called = [f"{key}[{i}]" if isinstance(both[0], list) else key for key in halves]
            each = [
                f"{name} {tuple(node.shape) if is_leaf(node) else 'is no array'}"
                for name, node in zip(called, pair, strict=True)
            ]
            problem = "differ in shape; wanted the force and the torque of each sample"
            raise origin.unclear(f"{' and '.join(each)} {problem}")
    return list(zip(*lists, strict=True))


def in_parts(items: Mapping[str, Any], axes: Sequence[str] | None) -> bool:
    """Tell whether a struct or group holds a wrench, or the axes named, in parts, going by names and shapes alone."""
    vectors = [key for key, node in items.items() if is_leaf(node)]
    if axes is not None:
        return bool(_named_so(vectors, axes)) or (set(axes) <= set(AXES) and all(_halves(items)))
    return set(AXES) <= {split_unit(key)[0] for key in items} or all(_halves(items))


def only_halves(samples: Mapping[str, Any]) -> bool:
    """Tell whether all that looks like recordings are forces and torques, of six recordings or six samples."""
    forces, torques = _halves(samples)
    return bool(forces and torques) and set(samples) <= {*forces, *torques}


def axis_arrays(others: Mapping[str, Any], origin: Origin, axes: Sequence[str] | None) -> dict[str, Any]:
    """Return the arrays called as the axes are, by default fx ... tz, in this order, also with units; else nothing."""
    if axes is not None:
        vectors = [key for key, node in others.items() if is_leaf(node)]
        return {key: others[key] for key in _named_so(vectors, axes)}
    found: dict[str | None, str] = {}
    for key, node in others.items():
        axis = split_unit(key)[0]
        if axis in AXES and is_leaf(node):
            if axis in found:
                raise origin.unclear(f"{found[axis]!r} and {key!r} both mean {axis}")
            found[axis] = key
    return {found[axis]: others[found[axis]] for axis in AXES} if len(found) == len(AXES) else {}


def _named_so(names: Sequence[str], axes: Sequence[str]) -> list[str]:
    try:
        return [names[place] for place, _ in axes_among(names, axes)]
    except ColumnError:
        return []


def _halves(others: Mapping[str, Any]) -> tuple[list[str], list[str]]:
    """Return the names of what may be forces, and of what may be torques, of three axes."""
    forces, torques = (
        [key for key, node in others.items() if plain_name(key) in words and _has_three(node)]
        for words in (FORCES, TORQUES)
    )
    return forces, torques


def _has_three(node: Any) -> bool:
    if isinstance(node, list):
        return bool(node) and _has_three(node[0])
    return has_axis(node, len(THREE))
