"""What is known of recordings besides their forces: anything that could give the label away."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any

import numpy as np

from granular_id.recording._values import FloatArray
from granular_id.recording.checking.nearest import Neighbours, by_kind, by_number, by_place
from granular_id.recording.checking.rest import Rest
from granular_id.recording.checking.timing import Pace, is_number
from granular_id.recording.flags import SampleFlag
from granular_id.recording.one import Recording

DESCRIBES_MATERIAL = "material"
"""Entries of ``meta`` under this key describe the material, and may well name it."""

MOST_KINDS = 20
"""Attributes of more values than this are not asked whether the label names them."""

_REPAIRS = SampleFlag.GAP_FILLED | SampleFlag.BAD_STATUS | SampleFlag.TIME_REPAIRED


@dataclass(frozen=True)
class Attribute:
    """One thing that is known of every recording.

    Attributes
    ----------
    code : str
        Code of the finding.
    name : str
        In words.
    neighbours : Neighbours
        Which recordings are alike in it.
    shown : ndarray or None
        Numbers to show where a single label stands apart, shape (n,), in `unit`.
    unit : str
    """

    code: str
    name: str
    neighbours: Neighbours
    shown: FloatArray | None = None
    unit: str = ""


def attributes_of(
    recordings: Sequence[Recording],
    paces: Sequence[Pace],
    rests: Sequence[Rest | None],
    resolutions: Sequence[tuple[float | None, ...]],
) -> list[Attribute]:
    """Collect what varies between recordings, apart from their samples and labels.

    Attributes of few values come twice: as what may name the label, and (``neighbours.reverse``) as what the
    label may name.
    """
    starts = np.array([np.nan if r.start_time is None else r.start_time for r in recordings])
    kinds: list[tuple[str, str, Sequence[Any]]] = [
        ("leak-session", "the session", [r.session for r in recordings]),
        ("leak-format", "the file's ending", [PurePosixPath(r.name).suffix.lower() for r in recordings]),
        ("leak-resolution", "the resolution", resolutions),
        ("leak-hour", "the hour of the day (UTC)", [None if np.isnan(s) else s // 3600 % 24 for s in starts]),
        ("leak-flags", "what was repaired (flags)", [_repairs(r) for r in recordings]),
    ]
    numbers: list[tuple[str, str, FloatArray, str]] = [
        ("leak-clock", "the clock", starts, "s"),
        ("leak-length", "the duration", np.array([r.duration_s for r in recordings]), "s"),
        (
            "leak-length",
            "the number of samples",
            np.array([float(r.n_samples) for r in recordings]),
            "samples",
        ),
        ("leak-rate", "the median step", np.array([1e3 * p.median_s for p in paces]), "ms"),
        ("leak-jitter", "the jitter of the steps", np.array([p.spread for p in paces]), "of the median step"),
        ("leak-trigger", "the time of the trigger", np.array([_trigger_s(r) for r in recordings]), "s"),
    ]
    for key, entries in scalar_meta(recordings).items():
        if all(v is None or is_number(v) for v in entries):
            column = np.array([np.nan if v is None else float(v) for v in entries])
            numbers.append(("leak-meta", f"meta {key!r}", column, ""))
        else:
            kinds.append(("leak-meta", f"meta {key!r}", entries))
    found = []
    for code, name, values in kinds:
        if len(set(values)) > 1:
            found.append(Attribute(code, name, by_kind(values)))
            found += _named_by_label(code, name, values)
    for code, name, column, unit in numbers:
        if len(np.unique(column)) > 1:
            found.append(Attribute(code, name, by_number(column), column, unit))
            found += _named_by_label(code, name, np.nan_to_num(column, nan=np.inf).tolist())
    return found + _rest_levels(recordings, rests)


def _rest_levels(recordings: Sequence[Recording], rests: Sequence[Rest | None]) -> list[Attribute]:
    levels = [rest.level for rest in rests if rest is not None]
    if len(levels) < len(recordings) or len({r.axes for r in recordings}) > 1:
        return []
    table = np.array(levels)
    each = [
        Attribute("leak-rest", f"the rest level of {axis}", by_number(column), column)
        for axis, column in zip(recordings[0].axes, table.T, strict=True)
        if len(np.unique(column)) > 1
    ]
    return [Attribute("leak-rest", "the rest level of all axes", by_place(table)), *each]


def _named_by_label(code: str, name: str, values: Sequence[Any]) -> list[Attribute]:
    if len(set(values)) > min(MOST_KINDS, len(values) // 2):
        return []
    return [Attribute(code, name, by_kind(values, reverse=True))]


def scalar_meta(recordings: Sequence[Recording]) -> dict[str, list[Any]]:
    """Return the entries of ``meta`` that are a text, number or bool, nested keys joined by dots.

    Left out are entries that describe the material (`DESCRIBES_MATERIAL`, at any depth), or in which every recording
    repeats its name or mentions its label.
    """
    flat = [_flat(r.meta) for r in recordings]
    keys = dict.fromkeys(key for entries in flat for key in entries)
    columns = {key: [entries.get(key) for entries in flat] for key in keys}
    return {
        key: values
        for key, values in columns.items()
        if DESCRIBES_MATERIAL not in key.split(".")
        and not all(_names(value, r) for value, r in zip(values, recordings, strict=True))
    }


def _names(value: Any, recording: Recording) -> bool:
    label = recording.label
    return value == recording.name or (label is not None and isinstance(value, str) and label in value)


def _flat(meta: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    entries: dict[str, Any] = {}
    for key, value in meta.items():
        if isinstance(value, Mapping):
            entries.update(_flat(value, f"{prefix}{key}."))
        elif isinstance(value, (str, int, float)):
            entries[prefix + key] = value
    return entries


def _repairs(recording: Recording) -> int:
    return 0 if recording.flags is None else int(np.bitwise_or.reduce(recording.flags) & _REPAIRS)


def _trigger_s(recording: Recording) -> float:
    if recording.trigger_index is None:
        return float("nan")
    return float(recording.times()[recording.trigger_index])
