"""How well one attribute names the label: the label of the nearest other recording, against shuffled labels."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from granular_id.recording._values import FloatArray

N_SHUFFLES = 199

LEAST_P = 1 / (N_SHUFFLES + 1)
"""Smallest p-value that so many shuffles can give: 0.005."""


@dataclass(frozen=True)
class Neighbours:
    """Which recordings are nearest to each one.

    Attributes
    ----------
    group : ndarray of int, shape (n,)
        Recordings of the same value share a number; all the others of the group are nearest, equally.
    nearest : ndarray of int, shape (n,)
        The nearest recording of another value, for those alone in their group; -1: none.
    reverse : bool
        Ask how well the label names the group instead: two sensors cannot name eleven labels, but when each label
        was recorded with one of them, the label names the sensor.
    """

    group: NDArray[np.intp]
    nearest: NDArray[np.intp]
    reverse: bool = False

    @cached_property
    def has_ties(self) -> bool:
        """Whether any two recordings share a value."""
        return int(self.group.max()) + 1 < len(self.group)


def by_number(values: FloatArray) -> Neighbours:
    """Return the neighbours along a line; NaN (not known) is a value of its own, far from all others."""
    _, group, counts = np.unique(values, return_inverse=True, return_counts=True)
    group = group.reshape(-1)
    order = np.argsort(values, kind="stable")
    ordered = values[order]
    gap = np.concatenate([[np.inf], np.diff(ordered), [np.inf]])
    gap = np.where(np.isnan(gap), np.inf, gap)
    left, right = gap[:-1], gap[1:]
    place = np.arange(len(values))
    towards = np.where(left < right, place - 1, place + 1)
    alone = np.isinf(np.minimum(left, right))
    neighbour = order[np.clip(towards, 0, len(values) - 1)]
    nearest = np.empty(len(values), dtype=np.intp)
    nearest[order] = np.where(alone, -1, neighbour)
    nearest[counts[group] > 1] = -1
    return Neighbours(group, nearest)


def by_kind(values: Sequence[Hashable], *, reverse: bool = False) -> Neighbours:
    """Return the neighbours among values that are equal or not, with no order between them."""
    numbers: dict[Hashable, int] = {}
    group = np.array([numbers.setdefault(value, len(numbers)) for value in values], dtype=np.intp)
    return Neighbours(group, np.full(len(values), -1, dtype=np.intp), reverse)


def by_place(points: FloatArray) -> Neighbours:
    """Return the neighbours in a space of several numbers, each divided by its spread, shape (n, d)."""
    spread = points.std(axis=0)
    scaled = points / np.where(spread > 0, spread, 1.0)
    _, found = cKDTree(scaled).query(scaled, k=2)
    own = np.arange(len(points))
    nearest = np.where(found[:, 0] == own, found[:, 1], found[:, 0])
    return Neighbours(own, nearest.astype(np.intp))


@dataclass(frozen=True)
class Naming:
    """What an attribute says about the labels.

    Attributes
    ----------
    share : float
        How often the nearest other recording has the same label (the mean over ties); in reverse, how often
        another recording of the same label has the same value.
    chance : float
        What that is for shuffled labels.
    p : float
        How often the best of all attributes does as well with shuffled labels, relative to its own spread: the
        p-value, corrected for the number of attributes (P. H. Westfall and S. S. Young, "Resampling-Based
        Multiple Testing", 1993).
    agreement : ndarray, shape (n_labels,)
        For each label the harmonic mean of how many of its recordings, and how many of those nearest to them,
        are its own.
    """

    share: float
    chance: float
    p: float
    agreement: FloatArray


def naming(neighbours: Sequence[Neighbours], labels: NDArray[np.intp], seed: int = 0) -> list[Naming]:
    """Measure each attribute, correcting for their number.

    Parameters
    ----------
    neighbours : sequence of Neighbours
        One for each attribute.
    labels : ndarray of int, shape (n,)
        From 0.
    seed : int
        Of the shuffles: the same data give the same verdict.
    """
    rng = np.random.default_rng(seed)
    n_labels = int(labels.max()) + 1
    sizes = np.bincount(labels)
    hits = [_hits(each, labels, n_labels) for each in neighbours]
    shares = np.array([each.mean() for each in hits])
    shuffled = np.empty((N_SHUFFLES, len(neighbours)))
    for row in shuffled:
        mixed = rng.permutation(labels)
        row[:] = [_hits(each, mixed, n_labels).mean() for each in neighbours]
    spread = np.maximum(shuffled.std(axis=0), 1e-12)
    best = ((shuffled - shuffled.mean(axis=0)) / spread).max(axis=1)
    scores = (shares - shuffled.mean(axis=0)) / spread
    return [
        Naming(
            share=float(share),
            chance=_chance(each, labels),
            p=(1 + int((best >= score).sum())) / (N_SHUFFLES + 1),
            agreement=_agreement(each, own_hits, labels, sizes),
        )
        for share, score, each, own_hits in zip(shares, scores, neighbours, hits, strict=True)
    ]


def _chance(neighbours: Neighbours, labels: NDArray[np.intp]) -> float:
    n = len(labels)
    sizes = np.bincount(neighbours.group if neighbours.reverse else labels)
    alone = (np.bincount(neighbours.group)[neighbours.group] == 1) & (neighbours.nearest < 0)
    has_neighbour = 1.0 if neighbours.reverse else 1 - float(alone.mean())
    return has_neighbour * float((sizes * (sizes - 1)).sum()) / (n * (n - 1))


def _hits(neighbours: Neighbours, labels: NDArray[np.intp], n_labels: int) -> FloatArray:
    nearest = neighbours.nearest
    by_nearest = (nearest >= 0) & (labels[nearest] == labels)
    if not neighbours.has_ties:
        return np.asarray(by_nearest, dtype=np.float64)
    group = neighbours.group
    if neighbours.reverse:
        group, labels, n_labels = labels, group, int(group.max()) + 1
    cell = group * n_labels + labels
    alike = np.bincount(cell)[cell] - 1
    others = np.bincount(group)[group] - 1
    return np.asarray(np.where(others > 0, alike / np.maximum(others, 1), by_nearest))


def _agreement(
    neighbours: Neighbours, hits: FloatArray, labels: NDArray[np.intp], sizes: NDArray[np.intp]
) -> FloatArray:
    # within a group of ties each label is named as often as it occurs there
    tied = np.bincount(neighbours.group)[neighbours.group] > 1
    alone = ~tied & (neighbours.nearest >= 0)
    named = np.bincount(labels[tied], minlength=len(sizes)) + np.bincount(
        labels[neighbours.nearest[alone]], minlength=len(sizes)
    )
    own = np.bincount(labels, weights=hits, minlength=len(sizes))
    return np.asarray(2 * own / np.maximum(sizes + named, 1))
