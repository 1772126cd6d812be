"""Crop recordings to one length, from their start or around a trigger, saying what was dropped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from granular_id._words import counted, fixed, verb
from granular_id.recording._values import checked_index, checked_number
from granular_id.recording.axes import common_axes
from granular_id.recording.one import Recording
from granular_id.recording.report import StepReport


def align_recordings(
    recordings: Sequence[Recording],
    rate_hz: float,
    *,
    n_samples: int | Literal["shortest"] | None = None,
    duration_s: float | None = None,
    trigger: Literal["recorded"] | Sequence[int] | None = None,
    lead_s: float = 0.0,
    on_short: Literal["raise", "skip"] = "raise",
    on_missing: Literal["raise", "skip"] = "raise",
) -> tuple[list[Recording], StepReport]:
    """Crop recordings of one rate to one length; see :meth:`Dataset.align`, which calls this."""
    if on_short not in ("raise", "skip"):
        raise ValueError(f"on_short={on_short!r}; wanted 'raise' or 'skip'")
    if on_missing not in ("raise", "skip"):
        raise ValueError(f"on_missing={on_missing!r}; wanted 'raise' or 'skip'")
    without: list[Recording] = []
    if isinstance(trigger, str) and on_missing == "skip":
        without = [r for r in recordings if r.trigger_index is None]
        recordings = [r for r in recordings if r.trigger_index is not None]
        if not recordings:
            raise ValueError(
                f"none of the {counted(len(without))} has a trigger_index; call .find_onsets(), or see in its "
                "report why it found none"
            )
    starts = _starts(recordings, rate_hz, trigger, lead_s)
    n = _length(recordings, starts, rate_hz, n_samples, duration_s)
    kept: list[tuple[Recording, int]] = []
    rows: list[dict[str, Any]] = [
        {"name": r.name, "samples_before": r.n_samples, "skipped": "has no trigger"} for r in without
    ]
    for recording, start in zip(recordings, starts, strict=True):
        if start < 0 or start + n > recording.n_samples:
            missing = _missing(recording, start, n)
            if on_short == "raise":
                raise ValueError(
                    f"recording {recording.name!r} {missing}; {_way_out(recordings, starts, n, rate_hz)}"
                )
            rows.append({"name": recording.name, "samples_before": recording.n_samples, "skipped": missing})
            continue
        kept.append((recording, start))
        end = recording.n_samples - start - n
        if start or end:
            before = recording.n_samples
            rows.append(
                {"name": recording.name, "samples_before": before, "dropped_start": start, "dropped_end": end}
            )
    if not kept:
        wanted = f"{n} samples from its start or trigger on"
        if all(start < 0 for start in starts):
            wanted = f"the lead before its trigger (lead_s={lead_s:g})"
        raise ValueError(
            f"none of the {counted(len(recordings))} has {wanted}; the longest has "
            f"{counted(max(r.n_samples for r in recordings), 'sample')} in all"
        )
    rows.sort(key=lambda row: "skipped" not in row)
    cropped = _crop(kept, n)
    changed = [row for row in rows if "skipped" not in row]
    totals = {
        "recordings": len(cropped),
        "recordings_cropped": len(changed),
        "recordings_skipped": len(rows) - len(changed),
        "dropped_samples": sum(row["dropped_start"] + row["dropped_end"] for row in changed),
    }
    parameters = {
        "n_samples": n,
        "duration_s": duration_s,
        "trigger": trigger if trigger is None or isinstance(trigger, str) else "given",
        "lead_s": lead_s,
        "on_short": on_short,
        "on_missing": on_missing if isinstance(trigger, str) else None,
    }
    return cropped, StepReport("align", parameters, totals, rows)


def _starts(
    recordings: Sequence[Recording],
    rate: float,
    trigger: Literal["recorded"] | Sequence[int] | None,
    lead_s: float,
) -> list[int]:
    lead = round(checked_number(checked_number(lead_s, "lead_s") * rate, "lead_s times the rate"))
    if trigger is None:
        if lead:
            raise ValueError(f"lead_s={lead_s:g} is time kept before the trigger: give trigger= too")
        return [0] * len(recordings)
    if isinstance(trigger, str):
        if trigger != "recorded":
            raise ValueError(
                f"trigger={trigger!r}; wanted None, 'recorded' or one sample index per recording"
            )
        without = [r.name for r in recordings if r.trigger_index is None]
        if without:
            names = ", ".join(map(repr, without[:3])) + (", ..." if len(without) > 3 else "")
            n = len(without)
            raise ValueError(
                f"{counted(n)} {verb(n, 'has', 'have')} no trigger_index: {names}; call .find_onsets(), state it with "
                ".find_onsets(overrule={name: seconds}), or pass on_missing='skip' to leave such recordings out"
            )
        return [(r.trigger_index or 0) - lead for r in recordings]
    indices = [checked_index(i, "trigger") for i in np.asarray(trigger).ravel()]
    if len(indices) != len(recordings):
        raise ValueError(f"trigger has {len(indices)} indices for {len(recordings)} recordings")
    for recording, index in zip(recordings, indices, strict=True):
        if not 0 <= index < recording.n_samples:
            raise ValueError(
                f"trigger {index} is outside recording {recording.name!r} ({recording.n_samples} samples)"
            )
    return [i - lead for i in indices]


def _length(
    recordings: Sequence[Recording],
    starts: Sequence[int],
    rate: float,
    n_samples: int | Literal["shortest"] | None,
    duration_s: float | None,
) -> int:
    if (n_samples is None) == (duration_s is None):
        raise ValueError("give exactly one of n_samples (a number, or 'shortest') and duration_s")
    if duration_s is not None:
        seconds = checked_number(duration_s, "duration_s")
        n = round(checked_number(seconds * rate, "duration_s times the rate"))
        what = f"duration_s={seconds:g} at {rate:g} Hz"
    elif isinstance(n_samples, str):
        if n_samples != "shortest":
            raise ValueError(f"n_samples={n_samples!r}; wanted a number or 'shortest'")
        # those without the lead are refused or left out, and do not shorten the others
        n = min(
            (r.n_samples - start for r, start in zip(recordings, starts, strict=True) if start >= 0),
            default=1,
        )
        what = "n_samples='shortest'"
    else:
        n = checked_index(n_samples, "n_samples")
        what = f"n_samples={fixed(n)}"
    if n < 1:
        raise ValueError(f"{what} gives {fixed(n)} samples; at least one is wanted")
    return n


def _missing(recording: Recording, start: int, n: int) -> str:
    if start < 0:
        return f"begins {fixed(-start)} samples too late for the lead before its trigger"
    after = f" after sample {fixed(start)}" if start else ""
    return f"is too short: {fixed(recording.n_samples - start)} samples{after}, {fixed(n)} wanted"


def _way_out(recordings: Sequence[Recording], starts: Sequence[int], n: int, rate_hz: float) -> str:
    """Say how many recordings are in the way, and what would fit all."""
    room = [r.n_samples - start if start >= 0 else 0 for r, start in zip(recordings, starts, strict=True)]
    skip = "pass on_short='skip' to leave such recordings out"
    said = f"{sum(samples < n for samples in room)} of {len(room)} recordings have no room"
    if min(room) <= 0:
        return f"{said}; ask for less lead, or {skip}"
    return f"{said}, n_samples={min(room)} ({min(room) / rate_hz:g} s) fits all; ask for that, or {skip}"


def _crop(kept: Sequence[tuple[Recording, int]], n: int) -> list[Recording]:
    # one block that all results look into, so that Dataset.X needs no second copy
    block = np.empty((len(kept), n, len(common_axes([recording for recording, _ in kept]))))
    for row, (recording, start) in zip(block, kept, strict=True):
        row[:] = recording.wrench[start : start + n]
    block.flags.writeable = False
    return [_cropped(recording, start, row) for (recording, start), row in zip(kept, block, strict=True)]


def _cropped(recording: Recording, start: int, wrench: np.ndarray[Any, np.dtype[np.float64]]) -> Recording:
    n = len(wrench)
    trigger = None if recording.trigger_index is None else recording.trigger_index - start
    rate = recording.rate_hz or 1.0
    return replace(
        recording,
        wrench=wrench,
        start_time=None if recording.start_time is None else recording.start_time + start / rate,
        trigger_index=trigger if trigger is not None and 0 <= trigger < n else None,
        flags=None if recording.flags is None else recording.flags[start : start + n],
    )
