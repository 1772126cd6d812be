"""An array of a file: where it lies, what stands beside it, and how people open it in Python."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

MOST_DEEP = 12
"""Groups in groups that are looked into."""

BESIDE = {
    "y": ("y",),
    "rate_hz": ("fs", "rate_hz"),
    "session": ("session",),
    "name": ("name",),
    "lengths": ("lengths",),
    "axes": ("axes",),
    "units": ("units",),
    "t": ("t", "time"),
}
"""What stands beside samples, and its names, in small or large letters."""

PLACE = re.compile(r"\[\d+\]")
"""The number of a cell or struct in a path."""

Chain = tuple[Mapping[str, Any], ...]
"""The groups around an array, the innermost first."""


@dataclass
class Leaf:
    """An array of a file: `values[()]` gives all of it; `about` is what its attributes say."""

    values: Any
    about: dict[str, Any] = field(default_factory=dict)
    is_attribute: bool = False
    texts: str = ""  # as in `Opening`, where it is not that of the file

    @property
    def shape(self) -> tuple[int, ...]:
        """Lengths of its dimensions."""
        return tuple(self.values.shape)

    @property
    def is_numbers(self) -> bool:
        """Whether it holds real numbers."""
        return bool(self.values.dtype.kind in "iuf")

    @property
    def is_text(self) -> bool:
        """Whether it holds texts."""
        return bool(self.values.dtype.kind in "US")

    def read(self) -> NDArray[Any]:
        """Return its values."""
        return np.asarray(self.values[()])


@dataclass
class Found:
    """An array of a file, its name, and the groups around it; `label` is what its name says."""

    path: str
    leaf: Leaf
    chain: Chain
    label: str | None = None

    @property
    def name(self) -> str:
        """Its name without those of the groups."""
        return self.path.rpartition("/")[2]

    @property
    def parent(self) -> str:
        """The group that it lies in."""
        return self.path.rpartition("/")[0]


@dataclass(frozen=True)
class Opening:
    """How people open a kind of file: `kind` is what an array is called, `line` is formatted with the path."""

    kind: str
    line: str
    ending: str = ""  # behind the name of an array: [()] reads an HDF5 data set
    texts: str = "numpy.ravel({})"  # labels, of the expression without the ending
    is_flat: bool = False  # whether names hold those of their groups: f['a/b'], not f['a']['b']
    by_reference: bool = False  # whether cells and structs hold references, which no line follows

    def item(self, one: Found, within: str = "") -> str:
        """Return the expression for an array; `within`: of one called r, which lies in such a group."""
        if self.is_flat:
            return f"f[{one.path!r}]"
        *groups, last = one.path.removeprefix(within).strip("/").split("/")
        text = ("r" if within else "f") + "".join(map(indexed, groups))
        return f"{text}.attrs[{last!r}]" if one.leaf.is_attribute else text + indexed(last) + self.ending

    def label(self, one: Found, within: str = "") -> str:
        """Return the expression for texts, or numbers, as labels."""
        item, is_plain = self.item(one, within), one.leaf.is_numbers or one.leaf.is_attribute
        text = (
            f"numpy.ravel({item})"
            if is_plain
            else (one.leaf.texts or self.texts).format(item.removesuffix(self.ending))
        )
        if self.by_reference and one.leaf.is_text and not one.leaf.shape:  # a text is its characters' codes
            text = f"[''.join(map(chr, {item.removesuffix(self.ending)}[()].ravel()))]"
        return f"{text}[0]" if within else text


def indexed(part: str) -> str:
    """Return how a part of a path is taken: ``['rec'][3]`` of ``rec[3]``."""
    name, bracket, places = part.partition("[")
    return (f"[{name!r}]" if name else "") + bracket + places
