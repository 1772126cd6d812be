"""Single samples that jump away and come back: bits lost on the way, no load."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from granular_id._words import counted, verb
from granular_id.recording.checking.finding import Finding, found
from granular_id.recording.checking.layout import by_axis
from granular_id.recording.one import Recording

SHORTEST = 30
"""Shorter recordings are not judged: there is no telling what is usual for them."""

UNUSUAL = 50.0
"""A spike is this many times the median distance of a sample from the mean of its neighbours, twice what slips of
grains reach (at 500 Hz 25, in 1000 recordings of a finger sliding at 90 Hz 32)."""

LONE = 0.2
"""Its neighbours differ from each other by less than this part of it: a step or a slip is no spike."""

_ROUNDING = 1e-12  # of the largest reading: what float64 leaves between equal readings
_LOOKED_AT = 400  # samples that tell what is usual


def check_spikes(recordings: Sequence[Recording]) -> Iterator[Finding]:
    """Find samples far from both neighbours, which agree with each other."""
    places: dict[int, int] = {}
    touched: set[str] = set()
    for i, r in enumerate(recordings):
        if r.n_samples < SHORTEST:
            continue
        wrench = by_axis(r)
        before, here, after = wrench[:-2], wrench[1:-1], wrench[2:]
        away = np.abs(here - 0.5 * (before + after))
        usual = np.median(away[:: max(1, len(away) // _LOOKED_AT)], axis=0)
        usual = np.where(usual > _ROUNDING * np.abs(here).max(axis=0), usual, np.inf)  # too coarse to judge
        if (away.max(axis=0) <= UNUSUAL * usual).all():
            continue
        hit: NDArray[np.bool_] = (away > UNUSUAL * usual) & (np.abs(after - before) < LONE * away)
        spiky = np.flatnonzero(hit.any(axis=0))
        number = int(np.count_nonzero(hit.any(axis=1)))
        if number:
            places[i] = number
            touched |= {r.axes[column] for column in spiky}
    if places:
        samples = sum(places.values())
        message = (
            f"{counted(len(places))} {verb(len(places), 'has', 'have')} single samples that jump away and come back "
            f"({counted(samples, 'spike')} on {', '.join(sorted(touched))})"
        )
        yield found("warning", "spikes", message, recordings, places, spikes=samples, axes=sorted(touched))
