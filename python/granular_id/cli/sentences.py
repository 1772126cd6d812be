"""What was read and left out, in words."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING

from granular_id._words import counted, verb

if TYPE_CHECKING:
    from granular_id.recording import Dataset, StepReport

__all__ = ["excluded_text", "loaded_text", "skipped_text"]

MOST_LINES = 10


def loaded_text(data: Dataset) -> str:
    """Say what was read: numbers, length and rate, and else only what deserves mention.

    Parameters
    ----------
    data : Dataset
        As loaded: the last step of its history is the reading.

    Returns
    -------
    str
        One line, and one more for each remark.
    """
    report = data.history[-1]
    lengths = [recording.n_samples for recording in data]
    lines = [", ".join((_size(data), f"{_span(lengths)} {_times(data, max(lengths))}"))]
    skipped = skipped_text(report)
    lines += [skipped] if skipped else []
    repaired = [row["name"] for row in report.rows if row.get("moved") or row.get("merged")]
    if repaired:
        moved, merged = (report.totals.get(name, 0) for name in ("moved_samples", "merged_samples"))
        did = [f"{counted(moved, 'sample')} moved"] * bool(moved) + [f"{merged} merged"] * bool(merged)
        lines.append(f"time repaired in {_named(repaired, ' (' + ', '.join(did) + ')')}")
    remarks: dict[str, list[str]] = {}
    for row in report.rows:
        if row.get("remark"):
            remarks.setdefault(row["remark"], []).append(row["name"])
    lines += [f"{remark}, in {_named(names)}" for remark, names in remarks.items()]
    return "\n".join((*lines, *(f"note: {note}" for note in report.notes)))


def skipped_text(report: StepReport) -> str:
    """Name what a step left out because it could not be used; empty when nothing was."""
    reading = report.step == "load"
    rows = [row for row in report.rows if "skipped" in row]
    if not rows:
        return ""
    lines = [f"{counted(len(rows), 'file' if reading else 'recording')} skipped:"]
    # The problem of a file names it, with its folder.
    lines += [f"  {'' if reading else row['name'] + ': '}{row['skipped']}" for row in rows[:MOST_LINES]]
    if len(rows) > MOST_LINES:
        lines.append(f"  ... and {len(rows) - MOST_LINES} more")
    return "\n".join(lines)


def excluded_text(before: Dataset, after: Dataset) -> str:
    """Say which materials ``--exclude`` left out, and what remains."""
    counts = Counter(recording.label for recording in before if recording.label not in after.labels)
    out = ", ".join(f"{label or 'no label'} ({counted(n, 'recording')})" for label, n in counts.items())
    return f"--exclude left out {out}; {_size(after)} remain"


def _named(names: Sequence[str], remark: str = "") -> str:
    shown = ", ".join(names[:MOST_LINES]) + (" ..." if len(names) > MOST_LINES else "")
    return f"{counted(len(names), 'recording')}{remark}: {shown}"


def _size(data: Dataset) -> str:
    return f"{counted(len(data), 'recording')}, {counted(len(data.labels), 'material')}"


def _span(values: Sequence[float]) -> str:
    low, high = min(values), max(values)
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"


def _times(data: Dataset, longest: int) -> str:
    rates = [recording.rate_hz for recording in data if recording.rate_hz is not None]
    irregular = len(data) - len(rates)
    samples = verb(longest, "sample", "samples")
    if not rates:
        return f"{samples}, irregular in time"
    remark = f", {irregular} of them irregular in time" if irregular else ""
    return f"{samples} at {_span(rates)} Hz{remark}"
