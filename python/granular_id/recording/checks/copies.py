"""Copies: recordings that hold the samples of another one, all of them or a stretch."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray
from granular_id._text import counted, verb
from granular_id.recording.checks.measured import Measured
from granular_id.recording.checks.report import Finding
from granular_id.recording.recording import Recording, places_of
from granular_id.recording.report import subject
from granular_id.recording.steps import recordings_cut

LEAST_SHARE = 0.1
"""Pairs are reported where at least this part of the shorter recording's rows is in the other one."""

_RUN = 8
"""Rows that agree one behind the other count as shared; fewer of a coarse sensor agree by chance."""

_MOST_RUNS = 500_000
"""Of more runs some are compared, chosen by their values: recordings that share samples have the same ones."""

_MIX = np.uint64(0x9E3779B97F4A7C15)  # 2^64 over the golden ratio: spreads the bits of a key


def check_duplicates(data: Measured) -> Iterator[Finding]:
    """Find equal recordings by a hash of their bytes, then shared stretches among the rest."""
    recordings = data.recordings
    equal = places_of(
        hashlib.blake2b(r.wrench.tobytes() + repr(r.wrench.shape).encode()).digest() for r in recordings
    ).values()
    pairs: list[list[Any]] = [[first, i] for first, *others in equal for i in others]
    pairs.sort(key=lambda pair: pair[1])
    if pairs:
        message = f"{subject(len(pairs), 'holds', 'hold')} exactly the samples of another one"
        yield _copies(data, "duplicates", message, pairs)
    distinct = [first for first, *_ in equal]
    whole = recordings_cut(recordings)  # windows of one recording may overlap
    shared: list[list[Any]] = [
        [i, j, overlap.shift, round(overlap.share, 4)]
        for overlap in find_overlaps([recordings[i] for i in distinct])
        if whole[i := distinct[overlap.first]] != whole[j := distinct[overlap.second]]
    ]
    if shared:
        first, second, _, share = max(shared, key=lambda overlap: overlap[3])
        names = f"{recordings[first].name!r} and {recordings[second].name!r}"
        message = (
            f"{counted(len(shared), 'pair')} of recordings {verb(len(shared), 'shares', 'share')} samples: "
            f"{100 * share:.0f} % of the shorter of {names} are the same"
        )
        yield _copies(data, "near-duplicates", message, shared)


def _copies(data: Measured, code: str, message: str, pairs: Sequence[Sequence[Any]]) -> Finding:
    if any(data.recordings[i].label != data.recordings[j].label for i, j, *_ in pairs):
        message += ", some under a different label"
    return data.finding("error", code, message, sorted({i for pair in pairs for i in pair[:2]}), pairs=pairs)


class Overlap(NamedTuple):
    """Rows that two recordings share, to the bit."""

    first: int
    second: int
    shift: int  # row t of the second is row t + shift of the first
    share: float  # shared rows, of all rows of the shorter recording


def find_overlaps(recordings: Sequence[Recording]) -> list[Overlap]:
    """Find pairs of recordings of the same axes that share at least a tenth of their rows, in runs of 8 or more.

    All runs are sorted by their values, not compared in pairs: of copies of copies every one is found, not every pair.
    """
    best: dict[tuple[int, int], Overlap] = {}
    for group in places_of(r.axes for r in recordings).values():
        wrenches = [recordings[i].wrench for i in group]
        for a, b, shift in _same_runs(wrenches):
            share = _shared(wrenches[a], wrenches[b], shift)
            pair = (group[a], group[b])
            if share >= LEAST_SHARE and (pair not in best or share > best[pair].share):
                best[pair] = Overlap(*pair, shift, share)
    return list(best.values())


def _same_runs(wrenches: Sequence[FloatArray]) -> list[tuple[int, int, int]]:
    """Return pairs that agree in several runs at one shift: first, second, shift."""
    one_in = np.uint64(max(1, sum(map(len, wrenches)) // _MOST_RUNS))
    runs = [_runs(wrench, one_in) for wrench in wrenches]
    key, place = (np.concatenate(parts) for parts in zip(*runs, strict=True))
    owner = np.repeat(np.arange(len(wrenches)), [len(keys) for keys, _ in runs])
    order = np.lexsort((owner, key))
    key, owner, place = key[order], owner[order], place[order]
    same = np.flatnonzero((key[1:] == key[:-1]) & (owner[1:] != owner[:-1]))
    links = np.column_stack([owner[same], owner[same + 1], place[same] - place[same + 1]])
    kinds, counts = np.unique(links, axis=0, return_counts=True)
    return [(int(a), int(b), int(shift)) for a, b, shift in kinds[counts > 1]]


def _runs(wrench: FloatArray, one_in: np.uint64) -> tuple[NDArray[np.uint64], NDArray[np.intp]]:
    """Return a key of the values of each run in which they change, and the row at which it begins."""
    n_runs = max(len(wrench) - _RUN + 1, 0)
    bits = np.ascontiguousarray(wrench + 0.0).view(np.uint64)  # + 0.0: -0.0 is 0.0
    row = np.zeros(len(wrench), np.uint64)
    for column in bits.T:
        row = (row ^ column) * _MIX
        row ^= row >> np.uint64(32)
    key = np.zeros(n_runs, np.uint64)
    changes = np.zeros(n_runs, np.uint8)
    for j in range(_RUN):
        key = key * _MIX + row[j : j + n_runs]
        if j:
            changes += row[j : j + n_runs] != row[j - 1 : j - 1 + n_runs]
    at = np.flatnonzero((changes > 1) & ((key * _MIX >> np.uint64(32)) % one_in == 0))
    return key[at], at


def _shared(one: FloatArray, other: FloatArray, shift: int) -> float:
    """Return how many rows agree at a shift in runs, as a share of the shorter recording."""
    left, right = one[max(shift, 0) :], other[max(-shift, 0) :]
    n_rows = min(len(left), len(right))
    same = (left[:n_rows] == right[:n_rows]).all(axis=1)
    ends = np.flatnonzero(np.diff(same, prepend=False, append=False))
    lengths = ends[1::2] - ends[::2]
    return float(lengths[lengths >= _RUN].sum()) / min(len(one), len(other))
