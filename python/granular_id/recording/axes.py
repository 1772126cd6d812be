"""Names and units of the columns of a recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from granular_id._core import AXES, UNITS
from granular_id.recording._values import checked_text

if TYPE_CHECKING:
    from granular_id.recording.one import Recording

__all__ = ["KNOWN_UNITS", "checked_axes", "common_axes", "unit_of"]

KNOWN_UNITS = dict(zip(AXES, UNITS, strict=True))


def checked_axes(names: object, shape: tuple[int, ...]) -> tuple[str, ...]:
    """Return one name per column: those given, or fx fy fz tx ty tz where none are and six are wanted.

    Parameters
    ----------
    names : sequence of str, or None
        Empty or None: nothing is said.
    shape : tuple of int
        (T, C) of the samples.

    Raises
    ------
    TypeError, ValueError
        Not a sequence of different printable names, not as many as columns, or none given and C is not 6.
    """
    if names is None or (isinstance(names, tuple) and not names):
        if shape[1] != len(AXES):
            raise ValueError(
                f"wrench has shape {shape}; six columns are {' '.join(AXES)}, for any other number give axes="
            )
        return AXES
    if names is AXES:
        return AXES
    if isinstance(names, str) or not isinstance(names, Sequence):
        raise TypeError(f"axes must be a sequence of names, got {type(names).__name__}")
    axes = tuple(checked_text(name, f"axes[{i}]", spaced=False) for i, name in enumerate(names))
    if len(axes) != shape[1]:
        raise ValueError(f"axes has {len(axes)} names, but wrench has {shape[1]} columns")
    if len(set(axes)) < len(axes):
        raise ValueError(f"axes {axes!r} names an axis twice")
    return axes


def common_axes(recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Return the axes that all recordings share, or raise ValueError naming the method that helps."""
    first = recordings[0]
    other = next((r for r in recordings if r.axes != first.axes), None)
    if other is not None:
        raise ValueError(
            f"recordings differ in their axes: {first.name!r} has {' '.join(first.axes)}, {other.name!r} has "
            f"{' '.join(other.axes)}; call .select(axes=...) to keep those that all have"
        )
    return first.axes


def unit_of(axis: str, meta: Mapping[str, object] | None = None) -> str:
    """Return the unit of an axis: N or N m for the six of a wrench, else what ``meta["units"]`` says, else N.

    Examples
    --------
    >>> from granular_id.recording.axes import unit_of
    >>> unit_of("tz"), unit_of("force"), unit_of("depth", {"units": {"depth": "mm"}})
    ('N m', 'N', 'mm')
    """
    units = (meta or {}).get("units")
    stated = units.get(axis) if isinstance(units, Mapping) else None
    return stated if isinstance(stated, str) else KNOWN_UNITS.get(axis, "N")
