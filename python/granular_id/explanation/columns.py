"""What the columns of a feature space stand for: block, band, axes and time of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from sklearn.pipeline import Pipeline

from granular_id._core import GranularIdError
from granular_id.spaces import (
    BandColumns,
    FeatureBlock,
    band_columns,
    feature_blocks,
    joined_units,
    renamed,
)

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Columns:
    """What each of D columns of a feature space stands for.

    Attributes
    ----------
    axes : tuple of C str
    names : tuple of D str
        Of multi-band features as `MultiBand` has them, such as "b2_q98_fz"; of others block, axis and coordinate,
        such as "raw_fz_0.502".
    blocks : ndarray of str, shape (D,)
        Block of each column, such as "raw" or "quantiles".
    bands : ndarray of str, shape (D,)
        Its band by its edges, such as "61-122 Hz"; of a column without a band its block.
    axis_shares : ndarray, shape (D, C)
        How much of a column each axis has: 1, or a half for each of two that are coupled.
    spans : ndarray, shape (D, 2)
        First and last instant, in `time_unit`; NaN where a column is about no time.
    time_unit : str
        "s", or "sample" where the rate is not known.
    along : tuple of FeatureBlock
        Blocks that are read along time, frequency or bins.
    """

    axes: tuple[str, ...]
    names: tuple[str, ...]
    blocks: npt.NDArray[np.str_]
    bands: npt.NDArray[np.str_]
    axis_shares: FloatArray
    spans: FloatArray
    time_unit: str
    along: tuple[FeatureBlock, ...]


def columns_of(space: Pipeline, axes: Sequence[str] | None, units: Sequence[str] | None) -> Columns:
    """Describe the columns of a fitted feature space, with other names of the axes where they are given."""
    bands = band_columns(space)
    try:
        blocks = () if bands is not None else feature_blocks(space)
    except TypeError as reason:
        raise TypeError(f"model cannot be followed back to the recording: {reason}") from None
    own = _axes_of(blocks) if bands is None else bands.axes
    if axes is not None and units is not None:
        are_names = not isinstance(axes, str) and all(isinstance(axis, str) for axis in axes)
        if not are_names or len(axes) != len(own) or len(set(axes)) < len(axes):
            raise GranularIdError(
                f"axes must be {len(own)} different names, one for each axis of X, got {axes!r:.80}"
            )
        if bands is None:
            of = {old: (new, unit) for old, new, unit in zip(own, axes, units, strict=True)}
            blocks = tuple(_renamed_block(block, of) for block in blocks)
        else:
            names = tuple(renamed(space[-1].extractor_.names, axes))
            bands = replace(bands, axes=tuple(axes), units=tuple(units), names=names)
    return _of_blocks(blocks) if bands is None else _of_bands(bands)


def _axes_of(blocks: Sequence[FeatureBlock]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(axis for block in blocks for axis in block.axes))


def _renamed_block(block: FeatureBlock, of: Mapping[str, tuple[str, str]]) -> FeatureBlock:
    """Return a block with other names and units of its axes."""
    axes, units = zip(*(of[axis] for axis in block.axes), strict=True)
    # A histogram with a range of its own is named after its axis.
    name = block.name if group_of(block) == block.name else f"{group_of(block)}_{axes[0]}"
    block = replace(block, name=name, axes=axes)
    return replace(block, units=units, unit=joined_units(units)) if block.kind == "magnitude" else block


def _of_blocks(blocks: Sequence[FeatureBlock]) -> Columns:
    """Describe the columns of blocks that lie one behind the other."""
    axes = _axes_of(blocks)
    time_unit = next((block.unit for block in blocks if block.kind == "time"), "s")
    names, groups, numbers, spans = list[str](), list[str](), list[int](), list[FloatArray]()
    for block in blocks:
        n = len(block.coordinates)
        names += [
            f"{group_of(block)}_{axis}_{at:.6g}" for axis in block.axes for at in block.coordinates.tolist()
        ]
        groups += [group_of(block)] * (n * len(block.axes))
        numbers += [axes.index(axis) for axis in block.axes for _ in range(n)]
        of_axis = np.full((n, 2), np.nan)
        if block.kind == "time" and block.unit == time_unit:  # no common scale of seconds and samples
            step = float(block.coordinates[1] - block.coordinates[0]) if n > 1 else 1.0
            of_axis = block.coordinates[:, np.newaxis] + np.array([0.0, step])
        spans += [of_axis] * len(block.axes)
    group = np.array(groups)
    shares = np.eye(len(axes))[numbers]
    return Columns(
        axes=axes,
        names=tuple(names),
        blocks=group,
        bands=group,
        axis_shares=shares,
        spans=np.concatenate(spans),
        time_unit=time_unit,
        along=tuple(blocks),
    )


def _of_bands(bands: BandColumns) -> Columns:
    """Describe the columns of the multi-band space."""
    stretches = {
        key: bands.stretch_s(*key)
        for key in dict.fromkeys((column.block, column.detail) for column in bands.columns)
        if key[0] in ("envelope", "level")
    }
    nowhere = (np.nan, np.nan)
    return Columns(
        axes=bands.axes,
        names=bands.names,
        blocks=np.array([column.block for column in bands.columns]),
        bands=np.array(
            [
                column.block if column.band is None else str(bands.bands[column.band]).removeprefix("the ")
                for column in bands.columns
            ]
        ),
        axis_shares=bands.over_axes(np.ones(len(bands.columns))),
        spans=np.array([stretches.get((column.block, column.detail), nowhere) for column in bands.columns]),
        time_unit="s",
        along=bands.read_along(),
    )


def group_of(block: FeatureBlock) -> str:
    """Return the name of the space a block is from: histograms with a range per axis are a block per axis."""
    (*_, axis) = block.axes
    return block.name.removesuffix(f"_{axis}") if len(block.axes) == 1 else block.name
