"""Recordings that hold the samples of another one: all of them, or most, shifted, cropped, tared or rounded."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from granular_id._checks import FloatArray
from granular_id._text import counted, verb
from granular_id.recording.checks.measured import Measured
from granular_id.recording.checks.report import Finding
from granular_id.recording.recording import Recording, places_of
from granular_id.recording.report import subject


def check_duplicates(data: Measured) -> Iterator[Finding]:
    """Find equal recordings by a hash of their bytes, then shared stretches among the rest."""
    recordings = data.recordings
    first: dict[bytes, int] = {}
    twin_of: dict[int, int] = {}
    for i, r in enumerate(recordings):
        digest = hashlib.blake2b(r.wrench.tobytes() + repr(r.wrench.shape).encode()).digest()
        original = first.setdefault(digest, i)
        if original != i:
            twin_of[i] = original
    if twin_of:
        message = f"{subject(len(twin_of), 'holds', 'hold')} exactly the samples of another one"
        if any(recordings[i].label != recordings[j].label for i, j in twin_of.items()):
            message += ", some under a different label"
        places = sorted({*twin_of, *twin_of.values()})
        yield data.finding("error", "duplicates", message, places, pairs=[[j, i] for i, j in twin_of.items()])
    distinct = sorted(first.values())
    overlaps = find_overlaps([recordings[i] for i in distinct])
    overlaps = [o._replace(first=distinct[o.first], second=distinct[o.second]) for o in overlaps]
    if overlaps:
        message = (
            f"{counted(len(overlaps), 'pair')} of recordings {verb(len(overlaps), 'shares', 'share')} samples: "
            f"{_words(max(overlaps, key=lambda o: o.share), recordings)}"
        )
        if any(recordings[o.first].label != recordings[o.second].label for o in overlaps):
            message += "; some under a different label"
        places = sorted({place for o in overlaps for place in (o.first, o.second)})
        pairs = [[o.first, o.second, o.shift, round(o.share, 4)] for o in overlaps]
        yield data.finding("error", "near-duplicates", message, places, pairs=pairs)


class Overlap(NamedTuple):
    """Rows that two recordings share."""

    first: int
    second: int
    shift: int  # row t of the second is row t + shift of the first
    share: float  # rows that agree, of all rows of the shorter recording
    exact: bool  # to the bit


def _words(overlap: Overlap, recordings: Sequence[Recording]) -> str:
    one, other = recordings[overlap.first].name, recordings[overlap.second].name
    if overlap.shift < 0:
        one, other = other, one
    how = "" if overlap.exact else " up to rounding or an offset"
    later = f", {counted(abs(overlap.shift), 'sample')} later" if overlap.shift else ""
    return f"{100 * overlap.share:.0f} % of the shorter of {one!r} and {other!r} are the same{how}{later}"


# Stretches of samples that two recordings have in common, found without comparing all pairs.

# Pairs are reported when at least this part of the shorter recording's rows is in the other one.
LEAST_SHARE = 0.1
_MOST_BITS = 60  # of a pattern
_SPARE_BITS = 14  # besides those that number all pairs of blocks: noise agrees once in 2**14 data sets
_LEADING_AXES = 3  # patterns are made of the forces: files round torques to a few steps of their noise
_MOST_KEYS = 200_000  # of more patterns some are kept, by their value: copies keep the same ones
_MIXED = (0.05, 0.95)  # share of rising steps in a pattern that says something
_INDEPENDENT = 0.65  # signs of steps this far apart agree by chance in half of the cases
_MIX = np.uint64(0x9E3779B97F4A7C15)  # 2^64 over the golden ratio: spreads the bits of a key
_CLOSE = 1e-3  # difference of mean and spread, of what they vary by over the set, at which to look closer
_MATCH = 0.1  # rows are the same while they differ by less than this part of the usual step
_HALF = 0.51  # ... or by half a quantisation step


def find_overlaps(recordings: Sequence[Recording]) -> list[Overlap]:
    """Find pairs of recordings of the same axes that share at least a tenth of their rows.

    Each block of some 20 rows becomes a pattern: at which steps which forces rise. It survives shifting, cropping,
    taring and fine rounding, and sorting all patterns brings copies together. Copies too coarsely rounded for that have
    the same length and nearly the same means and spreads. Candidates are compared row by row. Time grows with the
    number of samples, not of pairs; of copies of copies every one is found, though not every pair.
    """
    best: dict[tuple[int, int], Overlap] = {}
    for group in places_of(r.axes for r in recordings).values():
        wrenches = [recordings[i].wrench for i in group]
        for a, b, shift in sorted(_by_pattern(wrenches) | _by_moments(wrenches)):
            share, exact = _shared(wrenches[a], wrenches[b], shift)
            pair = (group[a], group[b])
            if share >= LEAST_SHARE and (pair not in best or share > best[pair].share):
                best[pair] = Overlap(*pair, shift, share, exact)
    return list(best.values())


def _by_pattern(wrenches: Sequence[FloatArray]) -> set[tuple[int, int, int]]:
    """Return pairs that agree in several patterns at one shift: first, second, shift."""
    n_axes = wrenches[0].shape[1]
    shortest = min(map(len, wrenches))
    n_rows = sum(map(len, wrenches))
    n_bits = min(_MOST_BITS, math.ceil(2 * math.log2(n_rows)) + _SPARE_BITS)
    n_used = min(n_axes, _LEADING_AXES)
    if shortest <= 2 * n_bits // n_used:
        n_used = min(n_axes, n_bits)
    n_steps = n_bits // n_used
    rising = [np.diff(np.asfortranarray(wrench[:, :n_used]), axis=0) > 0 for wrench in wrenches]
    stride = _stride(rising, max(1, shortest // (2 * n_steps)))
    one_in = np.uint64(max(1, n_rows // _MOST_KEYS))
    patterns = [_patterns(signs, n_steps, stride, one_in) for signs in rising]
    key, place = (np.concatenate(parts) for parts in zip(*patterns, strict=True))
    owner = np.repeat(np.arange(len(wrenches)), [len(keys) for keys, _ in patterns])
    order = np.lexsort((owner, key))
    key, owner, place = key[order], owner[order], place[order]
    same = np.flatnonzero((key[1:] == key[:-1]) & (owner[1:] != owner[:-1]))
    links = np.column_stack([owner[same], owner[same + 1], place[same] - place[same + 1]])
    kinds, counts = np.unique(links, axis=0, return_counts=True)
    return {(int(a), int(b), int(shift)) for a, b, shift in kinds[counts > 1]}


def _stride(rising: Sequence[NDArray[np.bool_]], most: int) -> int:
    """Return how far apart steps are taken: smooth signals rise for many samples, which says nothing new."""
    sample = rising[:: max(1, len(rising) // 50)]
    stride = 1
    while stride < most:
        agree = [float(np.mean(s[stride:] == s[:-stride])) for s in sample if len(s) > stride]
        if not agree or np.median(agree) < _INDEPENDENT:
            break
        stride += 1 + stride // 4
    return min(stride, most)


def _patterns(
    rising: NDArray[np.bool_], n_steps: int, stride: int, one_in: np.uint64
) -> tuple[NDArray[np.uint64], NDArray[np.intp]]:
    """Return patterns that say something, and the row at which each begins."""
    n_used = rising.shape[1]
    length = max(len(rising) - (n_steps - 1) * stride, 0)
    codes = np.zeros(len(rising), np.uint64)
    for column in range(n_used):
        codes |= rising[:, column].astype(np.uint64) << np.uint64(column)
    ups = rising.sum(axis=1, dtype=np.uint8)
    key = np.zeros(length, np.uint64)
    risen = np.zeros(length, np.uint8)
    for j in range(n_steps):
        part = slice(j * stride, j * stride + length)
        key = (key << np.uint64(n_used)) | codes[part]
        risen += ups[part]
    share = risen / (n_steps * n_used)
    kept = (share > _MIXED[0]) & (share < _MIXED[1]) & ((key * _MIX >> np.uint64(32)) % one_in == 0)
    at = np.flatnonzero(kept)
    return key[at], at


def _by_moments(wrenches: Sequence[FloatArray]) -> set[tuple[int, int, int]]:
    """Return pairs of one length with nearly the same mean and spread of the forces: first, second, 0."""
    pairs: set[tuple[int, int, int]] = set()
    for group in places_of(map(len, wrenches)).values():
        leading = [np.asfortranarray(wrenches[i][:, :_LEADING_AXES]) for i in group]
        spreads = np.array([samples.std(axis=0) for samples in leading])
        means = np.array([samples.mean(axis=0) for samples in leading])
        scale = np.median(spreads, axis=0)
        scale[scale == 0] = 1.0
        tree = cKDTree(np.hstack([means / scale, spreads / scale]))
        close = tree.query_pairs(_CLOSE * np.sqrt(2 * means.shape[1]))
        pairs |= {(group[a], group[b], 0) for a, b in close}
    return pairs


def _shared(one: FloatArray, other: FloatArray, shift: int) -> tuple[float, bool]:
    """Return the share of rows that agree up to an offset, and whether they do to the bit."""
    left, right = one[max(shift, 0) :], other[max(-shift, 0) :]
    n_rows = min(len(left), len(right))
    if n_rows < 2:
        return 0.0, False
    left, right = left[:n_rows], right[:n_rows]
    tolerance = np.maximum(_tolerance(left), _tolerance(right))
    if np.isinf(tolerance).all():
        return 0.0, False
    difference = left - right
    same = (np.abs(difference - np.median(difference, axis=0)) <= tolerance).all(axis=1)
    share = float(np.count_nonzero(same)) / min(len(one), len(other))
    return share, bool((difference[same] == 0).all())


def _tolerance(samples: FloatArray) -> FloatArray:
    steps = np.abs(np.diff(samples, axis=0))
    smallest = np.where(steps > 0, steps, np.inf).min(axis=0, initial=np.inf)
    # an axis that never changes, or was rounded until it did not, says nothing: its tolerance is infinite
    return np.asarray(np.maximum(_MATCH * np.median(steps, axis=0), _HALF * smallest))
