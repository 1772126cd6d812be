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
from granular_id.io.columns import split_unit
from granular_id.recording import AXES

THREE = ("x", "y", "z")
"""Axes of a force, and of a torque."""

_CLEARLY_LONGER = 4
"""Where only length can tell, the time axis is at least this many times as long as the one of recordings.

Where the axes come last, the one of recordings is at most this many times as long as the time axis.
"""

_DIMS = "['recording', 'time', 'axis']"


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
    shape: tuple[int, ...], known: Known, name: str, origin: Origin, *, sensor_last: bool = False
) -> tuple[int, ...]:
    """Find the order ([recordings,] samples, sensor axes) of a shape, for ``array.transpose(...)``.

    `sensor_last`: the last axis is known to be the sensor's. Refused where more than one order is possible.
    """
    n = len(shape)
    if len(known.dimensions) == n:
        order = tuple(known.dimensions.index(place) for place in sorted(known.dimensions))
        if shape[order[-1]] != len(known.axes):
            problem = f"has the shape {shape}, whose dimensions are stated otherwise"
            raise origin.fault(name, f"{problem}; wanted {len(known.axes)} axes")
        return order
    if n == 2:
        return (0, 1) if sensor_last or not _axes_first(shape, known, name, origin) else (1, 0)
    if n == 3:
        return _order_of_three(shape, known, name, origin, sensor_last)
    raise origin.unclear(f"{origin.describe} {name} has the shape {shape}")


def _axes_first(shape: tuple[int, ...], known: Known, name: str, origin: Origin) -> bool:
    """Tell whether a two-dimensional shape is (sensor axes, samples)."""
    n_axes = len(known.axes)
    if shape[0] != n_axes or shape[1] in known.n_samples:
        return shape[0] == n_axes
    if shape[1] == n_axes and shape[0] not in known.n_samples:
        problem = f"has the shape {shape}: it cannot be told which axis counts samples"
        raise origin.unclear(f"{origin.describe} {name} {problem}")
    return shape[1] != n_axes


def _order_of_three(
    shape: tuple[int, ...], known: Known, name: str, origin: Origin, sensor_last: bool
) -> tuple[int, ...]:
    n_axes = len(known.axes)
    sensor = [2] if sensor_last else [i for i, length in enumerate(shape) if length == n_axes]
    orders = [order for order in permutations(range(3), 3) if order[2] in sensor]
    for place, lengths in ((0, known.n_recordings), (1, known.n_samples)):
        orders = [order for order in orders if shape[order[place]] in lengths] or orders
    if len(orders) > 1 and len(sensor) == 1:
        orders = [order for order in orders if _is_usual(shape, order)]
    if len(orders) == 1:
        return orders[0]
    several = len(sensor) > 1
    which = f"which of the axes of length {n_axes} is which" if several else "which axis counts recordings"
    telling = "" if several else "labels, lengths or stamps, or "
    beside = "" if origin.single else f"; save {telling}dims, such as {_DIMS}, beside it"
    problem = f"{origin.describe} {name} has the shape {shape}: it cannot be told {which}"
    raise origin.unclear(problem + beside)


def _is_usual(shape: tuple[int, ...], order: tuple[int, ...]) -> bool:
    recordings, samples, sensor = order
    if sensor == 2:  # (recordings, samples, axes) is what everybody writes who puts the axes last
        return recordings == 0 and shape[0] <= _CLEARLY_LONGER * shape[1]
    return shape[samples] >= _CLEARLY_LONGER * shape[recordings]


# -- padding and gaps


def cut_padding(
    block: FloatArray, axes: Collection[str], name: str, origin: Origin
) -> FloatArray | list[FloatArray]:
    """Return the recordings of a block (n, T, C), without rows of NaN at the end that pad them to one length.

    The block itself where there are none; NaN or infinity elsewhere is refused.
    """
    if all_finite(block):
        return block
    filled = ~np.asarray(np.isnan(block).all(axis=2))[:, ::-1]
    lengths = np.where(filled.any(axis=1), block.shape[1] - filled.argmax(axis=1), 0).tolist()
    for i, length in enumerate(lengths):
        refuse_gaps(block[i, :length], axes, name, origin, i)
    return [recording[:length] for recording, length in zip(block, lengths, strict=True)]


def refuse_gaps(
    wrench: FloatArray, axes: Collection[str], name: str, origin: Origin, recording: int | None = None
) -> None:
    """Raise where a recording (T, C) is empty, or has values that are no finite numbers."""
    where = "" if recording is None else f"recording {recording}, "
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
    found = []
    for what, names in (("forces", FORCES), ("torques", TORQUES)):
        keys = _called(others, names)
        if not keys:
            return None
        if len(keys) > 1:
            raise origin.unclear(f"{' and '.join(map(repr, keys))} may both be the {what}")
        found.append(keys[0])
    return found[0], found[1]


def pairs_of(halves: tuple[str, str], others: Mapping[str, Any], origin: Origin) -> list[tuple[Any, Any]]:
    """Return the pairs of two lists, or the one pair of two arrays, each of one shape."""
    forces, torques = (others[key] for key in halves)
    listed = isinstance(forces, list)
    if listed != isinstance(torques, list):
        problem = "one is a list, the other an array; wanted both alike"
        raise origin.unclear(f"of {' and '.join(halves)} {problem}")
    if listed and len(forces) != len(torques):
        force, torque = halves
        raise origin.unclear(f"{force} holds {len(forces)} and {torque} {len(torques)} recordings")
    pairs = list(zip(forces, torques, strict=True)) if listed else [(forces, torques)]
    for i, pair in enumerate(pairs):
        called = [f"{key}[{i}]" if listed else key for key in halves]
        for node, name in zip(pair, called, strict=True):
            if not is_leaf(node):
                raise origin.unclear(f"{name} is no array; wanted (samples, 3)")
        each = [f"{name} {tuple(node.shape)}" for node, name in zip(pair, called, strict=True)]
        if pair[0].shape != pair[1].shape:
            problem = "differ in shape; wanted the force and the torque of each sample"
            raise origin.unclear(f"{' and '.join(each)} {problem}")
    return pairs


def in_parts(items: Mapping[str, Any]) -> bool:
    """Tell whether a struct or group holds a wrench in parts, going by names and shapes alone."""
    axes = {split_unit(key)[0] for key in items}
    return set(AXES) <= axes or all(_called(items, names) for names in (FORCES, TORQUES))


def only_halves(samples: Mapping[str, Any]) -> bool:
    """Tell whether all that looks like recordings are forces and torques, of six recordings or six samples."""
    called = [_called(samples, names) for names in (FORCES, TORQUES)]
    return all(called) and set(samples) <= {key for keys in called for key in keys}


def axis_arrays(others: Mapping[str, Any], origin: Origin) -> dict[str, Any]:
    """Return the six arrays called fx ... tz in this order, under their names, also with units; else nothing."""
    found: dict[str | None, str] = {}
    for key, node in others.items():
        axis = split_unit(key)[0]
        if axis in AXES and is_leaf(node):
            if axis in found:
                raise origin.unclear(f"{found[axis]!r} and {key!r} both mean {axis}")
            found[axis] = key
    return {found[axis]: others[found[axis]] for axis in AXES} if len(found) == len(AXES) else {}


def _called(others: Mapping[str, Any], names: frozenset[str]) -> Sequence[str]:
    return [key for key, node in others.items() if plain_name(key) in names and _has_three(node)]


def _has_three(node: Any) -> bool:
    if isinstance(node, list):
        return bool(node) and _has_three(node[0])
    return has_axis(node, len(THREE))
