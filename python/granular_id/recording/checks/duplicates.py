"""Recordings that hold the samples of another one: all of them, or most, shifted, cropped, tared or rounded."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from granular_id._checks import FloatArray
from granular_id._text import counted, verb
from granular_id.recording.checks.report import Finding, found
from granular_id.recording.recording import Recording


def check_duplicates(recordings: Sequence[Recording]) -> Iterator[Finding]:
    """Find equal recordings by a hash of their bytes, then shared stretches among the rest."""
    first: dict[bytes, int] = {}
    twin_of: dict[int, int] = {}
    for i, r in enumerate(recordings):
        digest = hashlib.blake2b(r.wrench.tobytes() + repr(r.wrench.shape).encode()).digest()
        original = first.setdefault(digest, i)
        if original != i:
            twin_of[i] = original
    if twin_of:
        message = f"{counted(len(twin_of))} {verb(len(twin_of), 'holds', 'hold')} exactly the samples of another one"
        clash = [i for i, j in twin_of.items() if recordings[i].label != recordings[j].label]
        if clash:
            message += ", some under a different label"
        concerned = sorted({*twin_of, *twin_of.values()})
        yield found(
            "error", "duplicates", message, recordings, concerned, pairs=[[j, i] for i, j in twin_of.items()]
        )
    yield from _near(recordings, sorted(set(first.values())))


def _near(recordings: Sequence[Recording], distinct: Sequence[int]) -> Iterator[Finding]:
    overlaps = find_overlaps([recordings[i] for i in distinct])
    if not overlaps:
        return
    worst = max(overlaps, key=lambda overlap: overlap.share)
    places = sorted({distinct[k] for overlap in overlaps for k in (overlap.first, overlap.second)})
    message = (
        f"{counted(len(overlaps), 'pair')} of recordings {verb(len(overlaps), 'shares', 'share')} samples: "
        f"{_words(worst, [recordings[distinct[k]].name for k in (worst.first, worst.second)])}"
    )
    if any(recordings[distinct[o.first]].label != recordings[distinct[o.second]].label for o in overlaps):
        message += "; some under a different label"
    pairs = [[distinct[o.first], distinct[o.second], o.shift, round(o.share, 4)] for o in overlaps]
    yield found("error", "near-duplicates", message, recordings, places, pairs=pairs)


def _words(overlap: Overlap, names: Sequence[str]) -> str:
    share = f"{100 * overlap.share:.0f} %"
    shifted = f", {counted(abs(overlap.shift), 'sample')} later" if overlap.shift else ""
    if overlap.shift < 0:
        names = names[::-1]
    how = "" if overlap.exact else " up to rounding or an offset"
    return f"{share} of the shorter of {names[0]!r} and {names[1]!r} are the same{how}{shifted}"


# Stretches of samples that two recordings have in common, found without comparing all pairs.

LEAST_SHARE = 0.1
"""Pairs are reported when at least this part of the shorter recording's rows is in the other one."""

_MOST_BITS = 60  # of a pattern
_SPARE_BITS = 14  # besides those that number all pairs of blocks: noise agrees once in 2**14 data sets
_LEADING_AXES = 3  # patterns are made of the forces: files round torques to a few steps of their noise
_MOST_KEYS = (
    200_000  # more blocks than this are thinned out, by their own value, so that copies keep the same ones
)
_MIXED = (0.05, 0.95)  # share of rising steps in a pattern that says something
_INDEPENDENT = 0.65  # signs of steps this far apart agree by chance in half of the cases
_MIX = np.uint64(0x9E3779B97F4A7C15)  # 2^64 over the golden ratio: spreads the bits of a key
_CLOSE = 1e-3  # difference of mean and spread, of what they vary by over the set, at which to look closer
_MATCH = 0.1  # rows are the same while they differ by less than this part of the usual step
_HALF = 0.51  # ... or by half a quantisation step


@dataclass(frozen=True)
class Overlap:
    """Rows that two recordings share.

    Attributes
    ----------
    first, second : int
        Places of the recordings.
    shift : int
        Row t of the second is row t + shift of the first.
    share : float
        Rows that agree, of all rows of the shorter recording.
    exact : bool
        Whether they agree to the bit.
    """

    first: int
    second: int
    shift: int
    share: float
    exact: bool


def find_overlaps(recordings: Sequence[Recording]) -> list[Overlap]:
    """Find pairs of recordings of the same axes that share at least a tenth of their rows.

    Each block of some 20 rows becomes a pattern of up to 60 bits: at which steps which forces rise. The pattern
    survives shifting, cropping, taring and fine rounding. Sorting all patterns brings copies together; pairs that
    agree more than once at the same shift are compared row by row. Copies too coarsely rounded for that have the
    same length and nearly the same means and spreads. Time grows with the number of samples, not of pairs. Of
    copies of copies every one is found, though not every pair.
    """
    groups: dict[tuple[str, ...], list[int]] = {}
    for i, r in enumerate(recordings):
        groups.setdefault(r.axes, []).append(i)
    overlaps = []
    for group in groups.values():
        members = [recordings[i] for i in group]
        for a, b, shift in sorted(_by_pattern(members) | _by_moments(members)):
            overlap = _compared(members, a, b, shift)
            if overlap is not None:
                overlaps.append(Overlap(group[a], group[b], overlap.shift, overlap.share, overlap.exact))
    best: dict[tuple[int, int], Overlap] = {}
    for overlap in overlaps:
        pair = (overlap.first, overlap.second)
        if pair not in best or overlap.share > best[pair].share:
            best[pair] = overlap
    return list(best.values())


def _by_pattern(recordings: Sequence[Recording]) -> set[tuple[int, int, int]]:
    n_axes = recordings[0].wrench.shape[1]
    shortest = min(r.n_samples for r in recordings)
    n_used = min(n_axes, _LEADING_AXES)
    n_rows = sum(r.n_samples for r in recordings)
    n_bits = min(_MOST_BITS, math.ceil(2 * math.log2(n_rows)) + _SPARE_BITS)
    if shortest <= 2 * n_bits // n_used:
        n_used = min(n_axes, n_bits)
    n_steps = n_bits // n_used
    rising = [np.diff(np.asfortranarray(r.wrench[:, :n_used]), axis=0) > 0 for r in recordings]
    stride = _stride(rising, max(1, shortest // (2 * n_steps)))
    thin = np.uint64(max(1, n_rows // _MOST_KEYS))
    keys, owners, places = [], [], []
    for i, signs in enumerate(rising):
        own, at = _patterns(signs, n_steps, stride, thin)
        keys.append(own)
        places.append(at)
        owners.append(np.full(len(own), i))
    key, owner, place = np.concatenate(keys), np.concatenate(owners), np.concatenate(places)
    order = np.lexsort((owner, key))
    key, owner, place = key[order], owner[order], place[order]
    same = np.flatnonzero((key[1:] == key[:-1]) & (owner[1:] != owner[:-1]))
    if not len(same):
        return set()
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
    rising: NDArray[np.bool_], n_steps: int, stride: int, thin: np.uint64
) -> tuple[NDArray[np.uint64], NDArray[np.int64]]:
    n_used = rising.shape[1]
    length = len(rising) - (n_steps - 1) * stride
    if length < 1:
        return np.empty(0, np.uint64), np.empty(0, np.int64)
    codes = np.zeros(len(rising), np.uint64)
    ups = np.zeros(len(rising), np.uint8)
    for column in range(n_used):
        codes |= rising[:, column].astype(np.uint64) << np.uint64(column)
        ups += rising[:, column]
    key = np.zeros(length, np.uint64)
    risen = np.zeros(length, np.uint8)
    for j in range(n_steps):
        part = slice(j * stride, j * stride + length)
        key = (key << np.uint64(n_used)) | codes[part]
        risen += ups[part]
    share = risen / (n_steps * n_used)
    kept = (share > _MIXED[0]) & (share < _MIXED[1]) & ((key * _MIX >> np.uint64(32)) % thin == 0)
    at = np.flatnonzero(kept)
    return key[at], at


def _by_moments(recordings: Sequence[Recording]) -> set[tuple[int, int, int]]:
    pairs: set[tuple[int, int, int]] = set()
    lengths: dict[int, list[int]] = {}
    for i, r in enumerate(recordings):
        lengths.setdefault(r.n_samples, []).append(i)
    for group in lengths.values():
        if len(group) < 2:
            continue
        leading = [np.asfortranarray(recordings[i].wrench[:, :_LEADING_AXES]) for i in group]
        spreads = np.array([samples.std(axis=0) for samples in leading])
        table = np.hstack([np.array([samples.mean(axis=0) for samples in leading]), spreads])
        scale = np.median(spreads, axis=0)
        scale[scale == 0] = 1.0
        tree = cKDTree(table / np.hstack([scale, scale]))
        pairs |= {(group[a], group[b], 0) for a, b in tree.query_pairs(_CLOSE * np.sqrt(table.shape[1]))}
    return pairs


def _compared(recordings: Sequence[Recording], a: int, b: int, shift: int) -> Overlap | None:
    one, two = recordings[a].wrench, recordings[b].wrench
    left, right = one[max(shift, 0) :], two[max(-shift, 0) :]
    n_rows = min(len(left), len(right))
    if n_rows < 2:
        return None
    left, right = left[:n_rows], right[:n_rows]
    difference = left - right
    offset = np.median(difference, axis=0)
    tolerance = np.maximum(_tolerance(left), _tolerance(right))
    if np.isinf(tolerance).all():
        return None
    same = (np.abs(difference - offset) <= tolerance).all(axis=1)
    share = float(np.count_nonzero(same)) / min(len(one), len(two))
    if share < LEAST_SHARE:
        return None
    return Overlap(a, b, shift, share, bool((difference[same] == 0).all()))


def _tolerance(samples: FloatArray) -> FloatArray:
    steps = np.abs(np.diff(samples, axis=0))
    smallest = np.where(steps > 0, steps, np.inf).min(axis=0, initial=np.inf)
    # an axis that never changes, or was rounded until it did not, says nothing: its tolerance is infinite
    return np.asarray(np.maximum(_MATCH * np.median(steps, axis=0), _HALF * smallest))
