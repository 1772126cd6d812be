"""A table of what a data set holds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from granular_id.recording.flags import SampleFlag
from granular_id.recording.one import Recording
from granular_id.recording.report import text_table, text_totals
from granular_id.recording.timing import largest_gap_s


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
    groups: dict[str | None, list[Recording]] = {}
    for recording in recordings:
        groups.setdefault(recording.label, []).append(recording)
    flags: Counter[str] = Counter()
    for recording in recordings:
        if recording.flags is not None:
            flags.update({bit.name or "": int((recording.flags & bit > 0).sum()) for bit in SampleFlag})
    totals = {
        "recordings": len(recordings),
        "labels": sum(label is not None for label in groups),
        "sessions": _sessions(recordings),
        "irregular": sum(not r.is_uniform for r in recordings),
        "rates_hz": sorted({r.rate_hz for r in recordings if r.rate_hz is not None}),
        "samples": sum(r.n_samples for r in recordings),
        "flags": {name: count for name, count in flags.items() if count},
    }
    order = sorted(groups, key=lambda label: (label is None, label or ""))
    return Summary(totals, tuple(_row(label, groups[label]) for label in order))


def _row(label: str | None, group: Sequence[Recording]) -> dict[str, Any]:
    lengths = [r.n_samples for r in group]
    seconds = [r.duration_s for r in group]
    irregular = [r for r in group if not r.is_uniform]
    uniform = sorted({f"{r.rate_hz:g}" for r in group if r.rate_hz is not None}, key=float)
    steps = sum(r.n_samples - 1 for r in irregular)
    mean = [f"~{steps / sum(r.duration_s for r in irregular):.3g} irregular"] if steps else []
    return {
        "label": label,
        "recordings": len(group),
        "sessions": _sessions(group),
        "samples": _span(min(lengths), max(lengths)),
        "seconds": _span(round(min(seconds), 3), round(max(seconds), 3)),
        "rate_hz": ", ".join(uniform + mean),
        "largest_gap_s": round(max((largest_gap_s(r) for r in irregular), default=0.0), 6),
        "flagged_samples": sum(int((r.flags > 0).sum()) for r in group if r.flags is not None),
    }


def _sessions(group: Sequence[Recording]) -> int | None:
    known = {r.session for r in group} - {None}
    return len(known) or None


def _span(low: float, high: float) -> str:
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"
