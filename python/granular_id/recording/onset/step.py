"""Onsets of a whole data set: found, kept or overruled, each said in the report."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from difflib import get_close_matches
from typing import Any

import numpy as np

from granular_id._words import counted, verb
from granular_id.recording._values import checked_number
from granular_id.recording.flags import SampleFlag
from granular_id.recording.one import Recording
from granular_id.recording.onset.find import (
    checked_false_alarm_rate,
    find_onsets_in_block,
    rest_samples,
)
from granular_id.recording.onset.result import Onset
from granular_id.recording.report import StepReport

__all__ = ["STEP", "find_all_onsets", "onsets_of"]

STEP = "find_onsets"
"""Name of this step in ``Dataset.history``."""

_ORDER = ("not found", "overruled", "found", "kept")  # as rows of a report: what needs a look comes first


def find_all_onsets(
    recordings: Sequence[Recording],
    *,
    rest_s: float,
    false_alarm_rate: float,
    overrule: Mapping[str, float | None] | None,
    replace_recorded: bool,
) -> tuple[list[Recording], StepReport]:
    """Set the trigger of each recording; see :meth:`Dataset.find_onsets`, which calls this."""
    if not isinstance(replace_recorded, bool):
        raise TypeError(f"replace must be True or False, got {replace_recorded!r}")
    stated = _stated_indices(recordings, overrule)
    open_ = [
        i
        for i, r in enumerate(recordings)
        if i not in stated and (replace_recorded or r.trigger_index is None)
    ]
    found = dict(
        zip(
            open_,
            onsets_of([recordings[i] for i in open_], rest_s=rest_s, false_alarm_rate=false_alarm_rate),
            strict=True,
        )
    )
    results: list[Recording] = []
    rows: list[dict[str, Any]] = []
    for i, recording in enumerate(recordings):
        if i in stated:
            result, row = _with_trigger(recording, stated[i]), {"how": "overruled"}
        elif i in found:
            result, row = _with_trigger(recording, found[i].index), _what_was_found(found[i])
        else:
            result, row = recording, {"how": "kept"}
        index = result.trigger_index
        onset_s = None if index is None else float(result.times()[index])
        rows.append({"name": recording.name, "onset_s": onset_s, **row})
        results.append(result)
    rows.sort(key=lambda row: _ORDER.index(row["how"]))
    how = Counter(row["how"] for row in rows)
    onsets = [row["onset_s"] for row in rows if row["onset_s"] is not None]
    totals = {
        "recordings": len(rows),
        "stored_triggers_replaced": sum(recordings[i].trigger_index is not None for i in open_),
        **{word.replace(" ", "_"): how[word] for word in ("found", "not found", "overruled", "kept")},
        "earliest_onset_s": min(onsets, default=None),
        "median_onset_s": float(np.median(onsets)) if onsets else None,
        "latest_onset_s": max(onsets, default=None),
    }
    parameters = {
        "rest_s": float(rest_s),
        "false_alarm_rate": float(false_alarm_rate),
        "overrule": dict(overrule) if overrule else None,
        "replace": replace_recorded,
    }
    return results, StepReport(STEP, parameters, totals, rows, _notes(recordings, found))


def onsets_of(recordings: Sequence[Recording], *, rest_s: float, false_alarm_rate: float) -> list[Onset]:
    """Find the onset of each recording, those of equal length and rate together.

    Raises
    ------
    TypeError, ValueError
        Bad settings, or an irregular recording: it must be resampled first.
    """
    rate = checked_false_alarm_rate(false_alarm_rate)
    if checked_number(rest_s, "rest_s") <= 0:
        raise ValueError(f"rest_s must be positive, got {rest_s:g}")
    irregular = [r.name for r in recordings if r.rate_hz is None]
    if irregular:
        raise ValueError(
            f"{len(irregular)} of {counted(len(recordings))} "
            f"{verb(len(irregular), 'is', 'are')} irregularly sampled (the first is "
            f"{irregular[0]!r}), and windows of a varying number of samples cannot be compared; call "
            ".resample(rate_hz) first, or overrule these"
        )
    alike: defaultdict[Any, list[int]] = defaultdict(list)
    for i, recording in enumerate(recordings):
        alike[recording.n_samples, recording.rate_hz, recording.axes].append(i)
    onsets: dict[int, Onset] = {}
    for (_, rate_hz, axes), places in alike.items():
        wrenches = [recordings[i].wrench for i in places]
        block = find_onsets_in_block(wrenches, rate_hz, rest_samples(rest_s, rate_hz), rate, axes)
        onsets.update(zip(places, block, strict=True))
    return [onsets[i] for i in range(len(recordings))]


def _with_trigger(recording: Recording, index: int | None) -> Recording:
    return recording if recording.trigger_index == index else replace(recording, trigger_index=index)


def _what_was_found(onset: Onset) -> dict[str, Any]:
    if onset.index is None:
        return {"how": "not found", "why": onset.why}
    return {
        "how": "found",
        "detected_s": onset.detected_s,
        "strength": round(onset.strength, 2),
        "axes": " ".join(onset.axes),
    }


def _stated_indices(
    recordings: Sequence[Recording], overrule: Mapping[str, float | None] | None
) -> dict[int, int | None]:
    """Turn names and seconds into places and samples, or say what is wrong with them."""
    if overrule is None:
        return {}
    if not isinstance(overrule, Mapping):
        raise TypeError(
            f"overrule must map names of recordings to seconds, got {type(overrule).__name__}; for example "
            "{'rice_01': 0.25}"
        )
    places: defaultdict[str, list[int]] = defaultdict(list)
    for i, recording in enumerate(recordings):
        places[recording.name].append(i)
    stated: dict[int, int | None] = {}
    for name, seconds in overrule.items():
        if name not in places:
            near = get_close_matches(str(name), [key for key in places if key], n=3, cutoff=0.5)
            hint = f"; did you mean {' or '.join(map(repr, near))}?" if near else ""
            raise ValueError(f"overrule: no recording is called {name!r}{hint}")
        if len(places[name]) > 1:
            raise ValueError(f"overrule: {len(places[name])} recordings are called {name!r}; which is meant?")
        place = places[name][0]
        stated[place] = None if seconds is None else _index_at(recordings[place], seconds)
    return stated


def _index_at(recording: Recording, seconds: float) -> int:
    time_s = checked_number(seconds, f"overrule[{recording.name!r}]")
    if not 0 <= time_s <= recording.duration_s:
        raise ValueError(
            f"overrule[{recording.name!r}] is {time_s:g} s; the recording lasts from 0 to "
            f"{recording.duration_s:g} s"
        )
    return int(np.abs(recording.times() - time_s).argmin())


def _notes(recordings: Sequence[Recording], found: Mapping[int, Onset]) -> list[str]:
    filled = [
        recordings[i].name
        for i, onset in found.items()
        if (flags := recordings[i].flags) is not None
        and (flags[: onset.rest_samples] & SampleFlag.GAP_FILLED).any()
    ]
    if not filled:
        return []
    return [
        f"{counted(len(filled))} {verb(len(filled), 'has', 'have')} "
        f"filled gaps in what is taken for rest (the first is {filled[0]!r}): "
        "straight lines hide the noise there, and the false-alarm rate does not hold for them"
    ]
