"""Recordings that hold the samples of another one: all of them, or most, shifted, cropped, tared or rounded."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence

from granular_id._words import counted, verb
from granular_id.recording.checking.finding import Finding, found
from granular_id.recording.checking.overlap import Overlap, find_overlaps
from granular_id.recording.one import Recording


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
