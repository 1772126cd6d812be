"""``Summary``: figures over a data set; what it and a single recording hold, in words."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np

from granular_id._text import counted, verb
from granular_id.recording.recording import Recording, SampleFlag, places_of, unit_of
from granular_id.recording.report import span, text_table, text_totals
from granular_id.recording.resampling import step_s


@dataclass(frozen=True)
class Summary:
    """Figures over a data set, printable as a table; what is zero everywhere is not printed.

    Attributes
    ----------
    totals : mapping
        Recordings, labels, sessions, irregular recordings, rates (Hz) and flagged samples over everything.
    rows : tuple of mappings
        The same per label: recordings, sessions (None: not known), samples and seconds (shortest and
        longest), rate, largest gap in seconds, samples that carry a flag.
    """

    totals: Mapping[str, Any]
    rows: tuple[Mapping[str, Any], ...]

    def to_dict(self) -> dict[str, Any]:
        """Return plain dicts and lists, ready for ``json.dumps``."""
        return {"totals": dict(self.totals), "rows": [dict(row) for row in self.rows]}

    def __str__(self) -> str:
        return "\n".join([*text_totals(self.totals), *text_table(self.rows)])


def summarise(recordings: Sequence[Recording]) -> Summary:
    """Count and measure recordings per label; see :meth:`Dataset.summary`, which calls this."""
    groups = {
        label: [recordings[i] for i in places]
        for label, places in places_of(r.label for r in recordings).items()
    }
    flags: Counter[str] = Counter()
    for recording in recordings:
        if recording.flags is not None:
            flags.update({bit.name or "": int((recording.flags & bit > 0).sum()) for bit in SampleFlag})
    totals = {
        "recordings": len(recordings),
        "labels": sum(label is not None for label in groups),
        "sessions": _sessions(recordings),
        "irregular": sum(r.rate_hz is None for r in recordings),
        "rates_hz": sorted({r.rate_hz for r in recordings if r.rate_hz is not None}),
        "samples": sum(r.n_samples for r in recordings),
        "flags": {name: count for name, count in flags.items() if count},
    }
    order = sorted(groups, key=lambda label: (label is None, label or ""))
    return Summary(totals, tuple(_row(label, groups[label]) for label in order))


def _row(label: str | None, group: Sequence[Recording]) -> dict[str, Any]:
    lengths = [r.n_samples for r in group]
    seconds = [r.duration_s for r in group]
    irregular = [r for r in group if r.rate_hz is None]
    uniform = sorted({f"{r.rate_hz:g}" for r in group if r.rate_hz is not None}, key=float)
    steps = sum(r.n_samples - 1 for r in irregular)
    mean = [f"~{steps / sum(r.duration_s for r in irregular):.3g} irregular"] if steps else []
    return {
        "label": label,
        "recordings": len(group),
        "sessions": _sessions(group),
        "samples": span(min(lengths), max(lengths)),
        "seconds": span(round(min(seconds), 3), round(max(seconds), 3)),
        "rate_hz": ", ".join(uniform + mean),
        "largest_gap_s": round(max((step_s(r, np.max) for r in irregular), default=0.0), 6),
        "flagged_samples": sum(int((r.flags > 0).sum()) for r in group if r.flags is not None),
    }


def _sessions(group: Sequence[Recording]) -> int | None:
    known = {r.session for r in group} - {None}
    return len(known) or None


def headline(recordings: Sequence[Recording]) -> str:
    """Say in one line how many recordings there are, of how many materials, how long and at which rate."""
    labels = {r.label for r in recordings} - {None}
    lengths = [r.n_samples for r in recordings]
    rates = [r.rate_hz for r in recordings if r.rate_hz is not None]
    size = f"{counted(len(recordings))}, {counted(len(labels), 'material')}, "
    size += f"{span(min(lengths), max(lengths))} {verb(max(lengths), 'sample', 'samples')}"
    if not rates:
        return f"{size}, irregular in time"
    irregular = len(recordings) - len(rates)
    remark = f", {irregular} of them irregular in time" if irregular else ""
    return f"{size} at {span(min(rates), max(rates))} Hz{remark}"


def axes_in_words(recording: Recording) -> str:
    """Name the axes of a recording, each run of one unit followed by it: ``wx wy wz (rad/s), ax ay az (m/s2)``."""
    runs = groupby(recording.axes, key=lambda axis: unit_of(axis, recording.meta))
    return ", ".join(" ".join(axes) + (f" ({unit})" if unit else "") for unit, axes in runs)
