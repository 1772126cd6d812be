"""The recordings that were found in a file, as columns: a value per recording of everything that is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from granular_id._checks import FloatArray


@dataclass
class Found:
    """Some recordings, in order.

    Attributes
    ----------
    wrench : sequence of n ndarrays, shape (T, C)
        Finite samples; an array (n, T, C) where they lie so.
    axes : list of n tuples of str
        Names of their columns.
    places : list of n str
        Names of the arrays that they are from.
    n_padded : list of n int
        Samples with those that were left out as padding.
    sizes : list of int
        How many of them stood in each array, cell or struct; they add up to n.
    about : dict
        Columns of what is known, None where it is not: label, session, name, rate, start, trigger, stamps, time_unit,
        flags, meta, group (a label that the name of a group gave).

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.io.arrays.found import Found
    >>> both = Found.joined([Found.block(np.zeros((2, 5, 6)), tuple("abcdef"), name) for name in ("rice", "peas")])
    >>> both.fill("label", ["rice", "rice", None, None])
    >>> both.fill("label", ["x"] * 4)  # only where nothing is known
    >>> len(both), both.places, both.about["label"], both.sizes
    (4, ['rice', 'rice', 'peas', 'peas'], ['rice', 'rice', 'x', 'x'], [2, 2])
    """

    wrench: Sequence[FloatArray] | FloatArray
    axes: list[tuple[str, ...]]
    places: list[str]
    n_padded: list[int]
    sizes: list[int]
    about: dict[str, list[Any]] = field(default_factory=dict)

    @classmethod
    def block(
        cls,
        wrench: Sequence[FloatArray] | FloatArray,
        axes: tuple[str, ...],
        place: str,
        n_padded: int | None = None,
    ) -> Found:
        """Return the recordings of one array; `n_padded`: its samples, where some recordings are shorter."""
        n = len(wrench)
        padded = [len(recording) for recording in wrench] if n_padded is None else [n_padded] * n
        return cls(wrench, [axes] * n, [place] * n, padded, [n])

    @classmethod
    def joined(cls, parts: Sequence[Found]) -> Found:
        """Put some behind others."""
        if len(parts) == 1:
            return parts[0]
        about = dict.fromkeys(name for part in parts for name in part.about)
        return cls(
            wrench=[wrench for part in parts for wrench in part.wrench],
            axes=[axes for part in parts for axes in part.axes],
            places=[place for part in parts for place in part.places],
            n_padded=[n for part in parts for n in part.n_padded],
            sizes=[size for part in parts for size in part.sizes],
            about={name: [value for part in parts for value in part.get(name)] for name in about},
        )

    def as_one(self) -> Found:
        """Return them as if all had stood in one array."""
        return replace(self, sizes=[len(self)])

    def __len__(self) -> int:
        return len(self.wrench)

    @property
    def lengths(self) -> list[int]:
        """Samples of each."""
        if isinstance(self.wrench, np.ndarray):
            return [self.wrench.shape[1]] * len(self)
        return [len(wrench) for wrench in self.wrench]

    def cut(self, lengths: Sequence[int]) -> None:
        """Keep the first samples of each."""
        self.wrench = [wrench[:n] for wrench, n in zip(self.wrench, lengths, strict=True)]
        for name in ("stamps", "flags"):
            if name in self.about:
                rows = zip(self.about[name], lengths, strict=True)
                self.about[name] = [None if row is None else row[:n] for row, n in rows]

    def split(self, lengths: Sequence[int]) -> None:
        """Make several recordings of one, in which they lie one behind the other."""
        ends = np.cumsum(lengths)[:-1]
        each = {name: [column[0]] * len(lengths) for name, column in self.about.items()}
        for name in ("stamps", "flags"):
            if self.about.get(name, [None])[0] is not None:
                each[name] = np.split(self.about[name][0], ends)
        self.wrench, self.n_padded, self.about = np.split(self.wrench[0], ends), list(lengths), each
        self.axes, self.places, self.sizes = (
            self.axes * len(lengths),
            self.places * len(lengths),
            [len(lengths)],
        )

    def fill(self, attribute: str, column: Sequence[Any]) -> None:
        """Put down what is now known, where nothing was known before."""
        known = self.get(attribute)
        self.about[attribute] = [new if old is None else old for old, new in zip(known, column, strict=True)]

    def get(self, attribute: str) -> list[Any]:
        """Return what is known, None per recording where it is not."""
        return self.about.get(attribute, [None] * len(self))

    def one(self, i: int) -> dict[str, Any]:
        """Return what is known of one recording."""
        return {name: column[i] for name, column in self.about.items() if column[i] is not None}
