"""The names that recordings give their axes, in the place of those that feature spaces give by position."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from granular_id.explanation.steps import Chain
from granular_id.spaces.blocks import axis_names

__all__ = ["named"]


def named(chain: Chain, axes: Any, n_axes: int) -> Chain:
    """Return a chain whose columns are told by the names of the axes.

    A space calls the first of six axes fx and the first of three axis0, whatever it measures.

    Parameters
    ----------
    chain : Chain
    axes : sequence of str
        Name of each axis of the recordings.
    n_axes : int
        Of the recordings.

    Raises
    ------
    TypeError, ValueError
        Something else than one name for each axis, or one name twice.
    """
    if isinstance(axes, str) or not isinstance(axes, Sequence) or not all(isinstance(a, str) for a in axes):
        raise TypeError(f"axes must be a sequence of names of axes, got {axes!r}")
    if len(axes) != n_axes or len(set(axes)) < n_axes:
        raise ValueError(f"axes must be {n_axes} different names, one for each axis of X, got {tuple(axes)}")
    own = dict(zip(axis_names(n_axes), axes, strict=True))

    def told(name: str) -> str:
        return "_".join(own.get(part, part) for part in name.split("_"))

    blocks = tuple(
        replace(block, name=told(block.name), axes=tuple(own[axis] for axis in block.axes))
        for block in chain.blocks
    )
    bands = chain.bands
    if bands is not None:
        bands = replace(bands, axes=tuple(axes), names=tuple(map(told, bands.names)))
    return replace(chain, blocks=blocks, bands=bands)
