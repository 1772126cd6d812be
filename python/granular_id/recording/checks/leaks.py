"""Leaks: sessions or a clock that give the label away without a look at the forces."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray
from granular_id.recording.checks.measured import FALSE_ALARM_RATE, Measured
from granular_id.recording.checks.report import Finding

FEWEST = 10  # fewer recordings say nothing: a leak of two labels would not stand out from chance
STRONG = 0.2  # a leak warns when it names this part of the labels that chance leaves open
N_SHUFFLES = 999
_WHY = {
    "session": "no session holds several of them; keep sessions whole when you evaluate",
    "clock": "what was recorded one after the other is like one session per label, and no evaluation can tell a "
    "label from its time; record the labels in turn",
}


def check_leaks(data: Measured) -> Iterator[Finding]:
    """Find out if session or clock name the label: of the recording that is nearest in it, against shuffled labels."""
    places = sorted(i for group in data.witnesses.values() for i in group)
    if len(data.labels) > 1 and len(places) < FEWEST:
        few = f"fewer than {FEWEST} recordings whose label has others"
        yield data.finding("info", "few", f"{few}: whether clock or session give labels away is not judged")
    recordings = [data.recordings[i] for i in places]
    labels = np.unique([str(r.label) for r in recordings], return_inverse=True)[1]
    # Whoever knows the session knows the clock; a session each is a finding of its own.
    if len(places) < FEWEST or labels.max() < 1 or data.labels_of_one_session:
        return
    rng = np.random.default_rng(0)  # the same data give the same findings
    sessions = np.unique([repr(r.session) for r in recordings], return_inverse=True)[1]
    clock = np.array([np.nan if r.start_time is None else r.start_time for r in recordings])
    for what, values in (("session", sessions.astype(np.float64)), ("clock", clock)):
        nearest = nearest_on_a_line(values, rng)
        if what == "session":
            nearest = np.where(values[nearest] == values, nearest, -1)
        shuffled = np.array([_share(nearest, rng.permutation(labels)) for _ in range(N_SHUFFLES)])
        share, chance = _share(nearest, labels), float(shuffled.mean())
        p = (1 + int((shuffled >= share).sum())) / (N_SHUFFLES + 1)
        lift = (share - chance) / max(1 - chance, 1e-12)
        if lift >= STRONG and p <= max(FALSE_ALARM_RATE / 2, 1 / (N_SHUFFLES + 1)):
            named = f"the {what} alone names {100 * share:.0f} % of the labels (chance {100 * chance:.0f} %)"
            message = f"{named}: {_WHY[what]}"
            yield data.finding("warning", f"leak-{what}", message, share=share, chance=chance, p=p)
            return


def _share(nearest: NDArray[np.intp], labels: NDArray[np.intp]) -> float:
    """Return how often the nearest recording has the same label."""
    return float(((labels[nearest] == labels) & (nearest >= 0)).mean())


def nearest_on_a_line(values: FloatArray, rng: np.random.Generator) -> NDArray[np.intp]:
    """Return the place of the nearest other value, ties drawn; -1 where it is not known (NaN), or no other is."""
    nearest = np.full(len(values), -1)
    known = np.flatnonzero(~np.isnan(values))
    if len(known) < 2:
        return nearest
    order = known[np.lexsort((rng.random(len(known)), values[known]))]
    gaps = np.concatenate([[np.inf], np.diff(values[order]), [np.inf]])
    left, right = gaps[:-1], gaps[1:]
    before = np.where(left == right, rng.random(len(order)) < 0.5, left < right)
    nearest[order] = order[np.arange(len(order)) + np.where(before, -1, 1)]
    return nearest
