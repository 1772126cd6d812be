"""Which axis of an array counts recordings, which samples and which the axes of the sensor."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray
from granular_id.io.arrays.tree import Origin
from granular_id.io.bulk import all_finite
from granular_id.recording import AXES

_CLEARLY_LONGER = 4
"""Where only length can tell, the time axis is at least this many times as long as the one of recordings.

Where the axes come last, the one of recordings is at most this many times as long as the time axis.
"""

_DIMS = "['recording', 'time', 'axis']"


@dataclass(frozen=True)
class Known:
    """What the other arrays of a file say about the shape of the samples.

    Attributes
    ----------
    axes : tuple of str
        Names of the sensor's axes.
    n_recordings : frozenset of int
        Lengths of what there is one of per recording: labels, sessions, names.
    n_samples : frozenset of int
        Lengths of time vectors.
    units : mapping
        See ``stated.Units``.
    dimensions : tuple of int
        Which dimension counts recordings (0), samples (1) and axes (2), where that is stated.
    """

    axes: tuple[str, ...] = AXES
    n_recordings: frozenset[int] = field(default_factory=frozenset)
    n_samples: frozenset[int] = field(default_factory=frozenset)
    units: Mapping[str, tuple[str, tuple[str, ...]]] = field(default_factory=dict)
    dimensions: tuple[int, ...] = ()

    def order(self, n_dimensions: int) -> tuple[int, ...] | None:
        """Return the stated order of an array's dimensions, for ``array.transpose(...)``."""
        if len(self.dimensions) != n_dimensions:
            return None
        return tuple(self.dimensions.index(place) for place in sorted(self.dimensions))


def recordings_samples_axes(
    shape: tuple[int, ...], known: Known, name: str, origin: Origin, *, sensor_last: bool = False
) -> tuple[int, int, int]:
    """Find the order (recordings, samples, sensor axes) of a three-dimensional shape.

    `sensor_last`: the last axis is known to be the sensor's.

    Returns
    -------
    tuple of int
        The place of each, for ``array.transpose(...)``.

    Raises
    ------
    RecordingFileError
        When more than one order is possible.
    """
    n_axes = len(known.axes)
    sensor = [2] if sensor_last else [i for i, length in enumerate(shape) if length == n_axes]
    orders = [order for order in permutations(range(3), 3) if order[2] in sensor]
    for place, lengths in ((0, known.n_recordings), (1, known.n_samples)):
        fitting = [order for order in orders if shape[order[place]] in lengths]
        orders = fitting or orders
    if len(orders) > 1 and len(sensor) == 1:
        orders = _by_convention(shape, orders, sensor[0])
    if len(orders) != 1:
        several = len(sensor) > 1
        which = (
            f"which of the axes of length {n_axes} is which" if several else "which axis counts recordings"
        )
        problem = f"{origin.describe} {name} has the shape {shape}: it cannot be told {which}"
        telling = "" if several else "labels, lengths or stamps, or "
        beside = "" if origin.single else f"; save {telling}dims, such as {_DIMS}, beside it"
        raise origin.unclear(problem + beside)
    return orders[0]


def _by_convention(
    shape: tuple[int, ...], orders: list[tuple[int, int, int]], sensor: int
) -> list[tuple[int, int, int]]:
    if sensor == 2:  # (recordings, samples, axes) is what everybody writes who puts the axes last
        few = shape[0] <= _CLEARLY_LONGER * shape[1]
        return [order for order in orders if order == (0, 1, 2)] if few else orders
    return [order for order in orders if shape[order[1]] >= _CLEARLY_LONGER * shape[order[0]]]


def samples_axes(shape: tuple[int, ...], known: Known, name: str, origin: Origin) -> bool:
    """Tell whether a two-dimensional shape is (sensor axes, samples), to be transposed.

    Raises
    ------
    RecordingFileError
        When both orders are possible.
    """
    n_axes = len(known.axes)
    if shape[0] != n_axes or shape[1] in known.n_samples:
        return shape[0] == n_axes
    if shape[1] == n_axes and shape[0] not in known.n_samples:
        problem = (
            f"{origin.describe} {name} has the shape {shape}: it cannot be told which axis counts samples"
        )
        raise origin.unclear(problem)
    return shape[1] != n_axes


def cut_padding(
    block: FloatArray, axes: Collection[str], name: str, origin: Origin
) -> FloatArray | list[FloatArray]:
    """Return the recordings of a block (n, T, C), without rows of NaN at the end that pad them to one length.

    The block itself where there are none.

    Raises
    ------
    RecordingFileError
        NaN or infinity elsewhere, or a recording of nothing else; names recording, sample and axis.
    """
    if all_finite(block):
        return block
    lengths = _padded_lengths(np.asarray(np.isnan(block).all(axis=2)))
    for i, length in enumerate(lengths.tolist()):
        refuse_gaps(block[i, :length], axes, name, origin, i)
    return [recording[:length] for recording, length in zip(block, lengths.tolist(), strict=True)]


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
        axis = list(axes)[column]
        problem = f"{where}sample {row}, axis {axis} is {wrench[row, column]}; samples must be finite"
        raise origin.fault(name, problem)


def _padded_lengths(empty: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return, per recording, how many samples there are before those at the end that are all NaN."""
    filled = ~empty[:, ::-1]
    after = np.where(filled.any(axis=1), filled.argmax(axis=1), empty.shape[1])
    return np.asarray(empty.shape[1] - after, np.int64)
