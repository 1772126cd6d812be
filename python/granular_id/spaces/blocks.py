"""What the columns of a feature space stand for: a block of instants, bins or frequencies, axis after axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from granular_id._core import AXES, UNITS
from granular_id.features import feature_names

__all__ = ["BlockKind", "FeatureBlock", "axis_names", "axis_units", "range_blocks", "shifted", "time_block"]

FloatArray = npt.NDArray[np.float64]
BlockKind = Literal["time", "magnitude", "frequency", "component"]


@dataclass(frozen=True, eq=False)
class FeatureBlock:
    """Columns that lie side by side and are read along one coordinate, the same one for each of their axes.

    Attributes
    ----------
    name : str
        Name of the block, for instance "raw" or "hfmh"; unique within a feature space.
    kind : {"time", "magnitude", "frequency", "component"}
        What the coordinate is.
    axes : tuple of str
        Axes of the sensor, for instance ``("fx", ..., "tz")``.
    coordinates : ndarray, shape (m,)
        Instants, centres of bins, frequencies or numbers of components.
    unit : str
        Unit of the coordinates: "s" or "sample", "Hz" or "1/sample" when the rate is not known; "N", "N m" or
        "N, N m" of magnitudes, "" when the axes are not those of a wrench.
    columns : slice
        Where the block lies in the feature vector. Axis-major: axis ``a`` occupies the ``m`` columns from
        ``columns.start + a * m``.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.spaces import RawSignal
    >>> (block,) = RawSignal(rate_hz=500).fit(np.zeros((1, 1600, 6))).feature_blocks()
    >>> block.name, block.kind, block.unit, block.coordinates[:3].tolist()
    ('raw', 'time', 's', [0.0, 0.002, 0.004])
    """

    name: str
    kind: BlockKind
    axes: tuple[str, ...]
    coordinates: FloatArray
    unit: str
    columns: slice

    def renamed(self, name: str) -> FeatureBlock:
        """Return the same block under another name."""
        return replace(self, name=name)


def axis_names(n_axes: int) -> tuple[str, ...]:
    """Names of the axes as feature names spell them: ``fx ... tz`` for six, else ``axis0 ...``."""
    return tuple(name.rpartition("_")[0] for name in feature_names(n_samples=1, n_axes=n_axes, hfmh=False))


def axis_units(n_axes: int) -> tuple[str, ...]:
    """Units of the axes: those of a wrench for six, else unknown."""
    return UNITS if n_axes == len(AXES) else ("",) * n_axes


def time_block(name: str, n_samples: int, n_axes: int, rate_hz: float | None) -> FeatureBlock:
    """Every sample of every axis."""
    step, unit = (1.0, "sample") if rate_hz is None else (1.0 / rate_hz, "s")
    instants: FloatArray = np.arange(n_samples, dtype=np.float64) * step
    return FeatureBlock(name, "time", axis_names(n_axes), instants, unit, slice(0, n_samples * n_axes))


def range_blocks(name: str, bounds: FloatArray, n_bins: int) -> tuple[FeatureBlock, ...]:
    """Histograms: one block where all axes share a range, else one an axis, named ``<name>_<axis>``."""
    axes, units = axis_names(len(bounds)), axis_units(len(bounds))
    if (bounds == bounds[0]).all():
        unit = ", ".join(dict.fromkeys(units))
        span = slice(0, n_bins * len(axes))
        return (FeatureBlock(name, "magnitude", axes, _centres(bounds[0], n_bins), unit, span),)
    return tuple(
        FeatureBlock(
            f"{name}_{axis}",
            "magnitude",
            (axis,),
            _centres(bounds[k], n_bins),
            units[k],
            slice(k * n_bins, (k + 1) * n_bins),
        )
        for k, axis in enumerate(axes)
    )


def shifted(blocks: Sequence[FeatureBlock], by: int) -> tuple[FeatureBlock, ...]:
    """Return the same blocks, further right in the feature vector."""
    return tuple(
        replace(block, columns=slice(block.columns.start + by, block.columns.stop + by)) for block in blocks
    )


def _centres(bounds: FloatArray, n_bins: int) -> FloatArray:
    edges = np.linspace(bounds[0], bounds[1], n_bins + 1)
    centres: FloatArray = edges[:-1] + np.diff(edges) / 2
    return centres
