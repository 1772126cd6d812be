"""Wrenches in parts: forces and torques in arrays of their own, or a vector for each axis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from granular_id.io.arrays.names import plain_name
from granular_id.io.arrays.tree import Origin, has_axis, is_leaf
from granular_id.io.columns import split_unit
from granular_id.recording import AXES

__all__ = [
    "FORCES",
    "THREE",
    "TORQUES",
    "Halves",
    "axis_arrays",
    "halves_of",
    "in_parts",
    "is_half",
    "only_halves",
]

THREE = ("x", "y", "z")
"""Axes of a force, and of a torque."""

FORCES = frozenset(f"{word}{unit}" for word in ("f", "force", "forces", "eeforce") for unit in ("", "n"))
TORQUES = frozenset(
    f"{word}{unit}"
    for word in ("t", "m", "tau", "torque", "torques", "moment", "moments", "eetorque")
    for unit in ("", "nm")
)
"""As ``plain_name`` gives them; other units in names (``force_mN``) are not known here."""


@dataclass(frozen=True)
class Halves:
    """Forces and torques that stand side by side, each an array with three axes or a list of such arrays.

    Attributes
    ----------
    force, torque : str
        Their names.
    pair : tuple
        The two nodes.
    """

    force: str
    torque: str
    pair: tuple[Any, Any]

    @property
    def name(self) -> str:
        """How places and notes call the two."""
        return f"{self.force} and {self.torque}"

    def items(self, origin: Origin) -> list[tuple[Any, Any]]:
        """Return the pairs of two lists, or the one pair of two arrays: of one shape each.

        Raises
        ------
        RecordingFileError
            They differ in shape or number.
        """
        forces, torques = self.pair
        if not isinstance(forces, list) and not isinstance(torques, list):
            return [self._matching(forces, torques, "", origin)]
        if not isinstance(forces, list) or not isinstance(torques, list):
            raise origin.unclear(f"of {self.name} one is a list, the other an array; wanted both alike")
        if len(forces) != len(torques):
            raise origin.unclear(
                f"{self.force} holds {len(forces)} and {self.torque} {len(torques)} recordings"
            )
        return [
            self._matching(*pair, f"[{i}]", origin)
            for i, pair in enumerate(zip(forces, torques, strict=True))
        ]

    def _matching(self, force: Any, torque: Any, index: str, origin: Origin) -> tuple[Any, Any]:
        for node, name in ((force, self.force), (torque, self.torque)):
            if not is_leaf(node):
                raise origin.unclear(f"{name}{index} is no array; wanted (samples, 3)")
        shapes = [tuple(node.shape) for node in (force, torque)]
        if shapes[0] != shapes[1]:
            both = f"{self.force}{index} {shapes[0]} and {self.torque}{index} {shapes[1]}"
            raise origin.unclear(f"{both} differ in shape; wanted the force and the torque of each sample")
        return force, torque


def is_half(name: str) -> bool:
    """Tell whether an array is called like forces or torques."""
    return plain_name(name) in FORCES | TORQUES


def halves_of(others: Mapping[str, Any], origin: Origin) -> Halves | None:
    """Find forces and torques side by side.

    Raises
    ------
    RecordingFileError
        There are two of a kind.
    """
    found = []
    for what, names in (("forces", FORCES), ("torques", TORQUES)):
        keys = _called(others, names)
        if not keys:
            return None
        if len(keys) > 1:
            raise origin.unclear(f"{' and '.join(map(repr, keys))} may both be the {what}")
        found.append(keys[0])
    force, torque = found
    return Halves(force, torque, (others[force], others[torque]))


def in_parts(items: Mapping[str, Any]) -> bool:
    """Tell whether a struct or group holds a wrench in parts, going by names and shapes alone."""
    axes = {split_unit(key)[0] for key in items}
    return set(AXES) <= axes or all(_called(items, names) for names in (FORCES, TORQUES))


def only_halves(samples: Mapping[str, Any]) -> bool:
    """Tell whether all that looks like recordings are forces and torques, of six recordings or six samples."""
    called = [_called(samples, names) for names in (FORCES, TORQUES)]
    return all(called) and set(samples) <= {key for keys in called for key in keys}


def axis_arrays(others: Mapping[str, Any], origin: Origin) -> dict[str, Any]:
    """Return the six arrays called fx ... tz in this order, under their names, also with units; else nothing.

    Raises
    ------
    RecordingFileError
        Two of them mean the same.
    """
    found: dict[str, str] = {}
    for key, node in others.items():
        axis = split_unit(key)[0]
        if axis in AXES and is_leaf(node) and axis is not None:
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
