"""What this library writes into an MCAP file beside the messages, and what it makes of that when it reads it.

Messages hold samples exactly and stamps to the nanosecond. The rest stands in a metadata record ``granular_id``
(label, session, rate, start time, ..., all as text) and two attachments: ``granular_id/time_s``, the stamps of an
irregular recording as little-endian float64, and ``granular_id/flags``, a byte per sample.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray, finite_number, thaw
from granular_id.io.errors import RecordingFileError
from granular_id.io.flat_checks import checked_history
from granular_id.io.options import LoadOptions
from granular_id.io.ros.wrench import Wrenches
from granular_id.io.source import FileContent, FileSource
from granular_id.io.stamped import stamped_recording
from granular_id.recording import Recording, StepReport

__all__ = ["CHANGED_NOTE", "OWN_NAME", "OwnRecords", "own_records", "restored", "wire_stamps"]

OWN_NAME = "granular_id"
"""Name of the metadata record, and beginning of the names of attachments."""

CHANGED_NOTE = (
    "the messages are not those that granular-id wrote (cut or merged since?): stamps are taken from them, and label, "
    "session, flags and trigger are left out"
)

_VERSION = "1"
_TIME_S, _FLAGS = f"{OWN_NAME}/time_s", f"{OWN_NAME}/flags"
_LAST_S = 2**31
"""Seconds that fit ``builtin_interfaces/Time``: until 2038 where they count from 1970."""


@dataclass
class OwnRecords:
    """What this library writes beside the messages."""

    metadata: dict[str, str] = field(default_factory=dict)
    n_metadata: int = 0
    attachments: dict[str, bytes] = field(default_factory=dict)


def wire_stamps(times: FloatArray, start_time: float | None) -> NDArray[np.int64]:
    """Return the stamps that messages carry.

    They count from 1970 where the start is known and fits, and from the first sample otherwise.

    Parameters
    ----------
    times : ndarray, shape (T,)
        Seconds from the first sample.
    start_time : float or None
        Of the first sample, seconds since 1970.

    Returns
    -------
    ndarray of int64, shape (T,)
        Nanoseconds.

    Raises
    ------
    ValueError
        The recording lasts longer than ROS stamps can count (68 years).
    """
    room = _LAST_S - 1 - float(times[-1])
    if not room > 0:
        raise ValueError(f"the recording lasts {times[-1]:.3g} s; stamps of ROS count to {_LAST_S} s")
    first_ns = 0
    if start_time is not None and 0 <= start_time < room:
        first_ns = round(Fraction(start_time) * 10**9)  # in float64 it would be off by up to 128 ns
    offsets_ns: NDArray[np.int64] = np.rint(times * 1e9).astype(np.int64)
    return offsets_ns + first_ns


def own_records(recording: Recording, history_json: str) -> OwnRecords:
    """Make the metadata and attachments of a recording."""
    known: Mapping[str, object] = {
        "version": _VERSION,
        "n_samples": recording.n_samples,
        "name": recording.name,
        "label": recording.label,
        "session": recording.session,
        "axes": " ".join(recording.axes),
        "rate_hz": recording.rate_hz,
        "start_time": recording.start_time,
        "trigger_index": recording.trigger_index,
        # plain ASCII: text with halves of characters, which JSON can hold, has no place in UTF-8
        "meta": json.dumps(thaw(recording.meta)),
        "history": history_json,
    }
    texts = {
        key: value if isinstance(value, str) else repr(value)
        for key, value in known.items()
        if value is not None
    }
    attachments = {}
    if recording.time_s is not None:
        attachments[_TIME_S] = recording.time_s.astype("<f8").tobytes()
    if recording.flags is not None:
        attachments[_FLAGS] = recording.flags.tobytes()
    return OwnRecords(texts, 1, attachments)


@dataclass(frozen=True)
class _Known:
    """The metadata record, parsed."""

    rate_hz: float | None
    start_time: float | None
    trigger_index: int | None
    meta: Mapping[str, Any]
    history: tuple[StepReport, ...]
    time_s: FloatArray
    flags: NDArray[np.uint8] | None


def restored(
    own: OwnRecords, wrenches: Wrenches, source: FileSource, options: LoadOptions
) -> FileContent | None:
    """Make the recording that was written, bit for bit; None where the messages are no longer the same.

    Raises
    ------
    RecordingFileError
        Metadata or attachments that this library did not write.
    """
    n_samples = len(wrenches.wrench)
    texts = own.metadata
    if own.n_metadata != 1 or texts.get("n_samples") != str(n_samples) or wrenches.stamps_ns is None:
        return None
    try:
        known = _parsed(own, n_samples)
        if not np.array_equal(wire_stamps(known.time_s, known.start_time), wrenches.stamps_ns):
            return None
        name = texts.get("name", source.name)
        if not source.path.as_posix().endswith(source.name):
            name = source.name  # index.csv says so
        source = replace(
            source,
            name=name,
            irregular=source.irregular or (known.rate_hz is None and options.rate_hz is None),
            rate_hz=known.rate_hz if source.rate_hz is None and options.rate_hz is None else source.rate_hz,
        )
        recording, remarks = stamped_recording(
            wrenches.wrench,
            source,
            options,
            stamps=known.time_s,
            start_time=known.start_time,
            flags=known.flags,
            trigger=known.trigger_index,
            meta=known.meta,
            time_unit="s",
        )
        recording = replace(recording, label=texts.get("label"), session=texts.get("session"))
    except RecordingFileError:
        raise
    except (TypeError, ValueError, OverflowError, RecursionError, KeyError) as error:
        raise RecordingFileError(source.path, str(error), place=f"metadata {OWN_NAME}") from error
    rows = [{"name": recording.name, **remarks}] if remarks else []
    return FileContent([recording], rows, history=known.history)


def _parsed(own: OwnRecords, n_samples: int) -> _Known:
    texts = own.metadata
    if texts.get("version") != _VERSION:
        raise ValueError(f"version is {texts.get('version', 'missing')[:40]!r}; wanted {_VERSION!r}")
    rate_hz = _number(texts, "rate_hz")
    if rate_hz is not None:
        time_s = np.arange(n_samples) / finite_number("rate_hz", rate_hz, positive=True)
    else:
        time_s = _attached(own, _TIME_S, n_samples, np.dtype("<f8")).astype(np.float64)
        if not (
            time_s[0] == 0 and (time_s[1:] > time_s[:-1]).all()
        ):  # what is not even a number is not greater
            raise ValueError(f"attachment {_TIME_S} does not ascend from 0")
    flags = _attached(own, _FLAGS, n_samples, np.dtype(np.uint8)) if _FLAGS in own.attachments else None
    trigger = texts.get("trigger_index")
    return _Known(
        rate_hz=rate_hz,
        start_time=_number(texts, "start_time"),
        trigger_index=None if trigger is None else int(trigger),
        meta=json.loads(texts.get("meta", "{}")),
        history=checked_history(texts.get("history", "[]"), 1),
        time_s=time_s,
        flags=flags,
    )


def _number(texts: Mapping[str, str], key: str) -> float | None:
    return finite_number(key, float(texts[key])) if key in texts else None


def _attached(own: OwnRecords, name: str, n_samples: int, dtype: np.dtype[Any]) -> NDArray[Any]:
    data = own.attachments.get(name, b"")
    if len(data) != n_samples * dtype.itemsize:
        raise ValueError(f"attachment {name} has {len(data)} bytes; wanted {n_samples * dtype.itemsize}")
    return np.frombuffer(data, dtype)
