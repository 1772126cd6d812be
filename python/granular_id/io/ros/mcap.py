"""What this library writes into an MCAP file beside the messages, and what it makes of that when it reads it.

Messages hold samples exactly and stamps to the nanosecond. The rest stands in a metadata record ``granular_id``
(label, session, rate, start time, ..., all as text) and two attachments: ``granular_id/time_s``, the stamps of an
irregular recording as little-endian float64, and ``granular_id/flags``, a byte per sample.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from granular_id import _core
from granular_id._checks import FloatArray, thaw
from granular_id._files import new_file
from granular_id._progress import ProgressCallback
from granular_id.io.errors import RecordingFileError, need
from granular_id.io.flat import NO_TRIGGER, FlatRecordings, unflatten
from granular_id.io.folder_save import checked_dataset, history_json, indexed_folder, refuse_other_axes
from granular_id.io.ros.messages import DEFINITION, LONGEST_FRAME, Wrenches, encode_wrenches
from granular_id.io.source import FileContent, FileSource
from granular_id.recording import AXES, Dataset, Recording

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
    attachments: dict[str, bytes] = field(default_factory=dict)


def wire_stamps(times: FloatArray, start_time: float | None) -> NDArray[np.int64]:
    """Return the stamps that messages carry, ns; ValueError where they are more than ROS stamps can count (68 years).

    They count from 1970 where the start (s, NaN as None) is known and fits, and from the first sample otherwise.
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
    return OwnRecords(texts, attachments)


def restored(own: OwnRecords, wrenches: Wrenches, source: FileSource) -> FileContent | None:
    """Make the recording that was written, bit for bit; None where the messages are no longer the same."""
    texts, n_samples = own.metadata, len(wrenches.wrench)
    if texts.get("n_samples") != str(n_samples) or wrenches.stamps_ns is None:
        return None
    place = f"metadata {OWN_NAME}"
    if texts.get("version") != _VERSION:
        problem = f"version is {texts.get('version', 'missing')!r:.40}; wanted {_VERSION!r}"
        raise RecordingFileError(source.path, problem, place=place)
    try:
        rate_hz, start_time = (float(texts.get(name, "nan")) for name in ("rate_hz", "start_time"))
        trigger = int(texts.get("trigger_index", NO_TRIGGER))
        times = np.frombuffer(own.attachments.get(_TIME_S, b""), "<f8") if math.isnan(rate_hz) else None
    except ValueError as error:
        raise RecordingFileError(source.path, str(error), place=place) from error
    flags = own.attachments.get(_FLAGS)
    said_elsewhere = not source.path.as_posix().endswith(source.name)  # in index.csv
    flat = FlatRecordings(
        axes=AXES,
        wrench=wrenches.wrench,
        n_samples=np.array([n_samples]),
        rate_hz=np.array([rate_hz]),
        start_time=np.array([start_time]),
        trigger_index=np.array([trigger]),
        label=[texts.get("label")],
        session=[texts.get("session")],
        name=[None if said_elsewhere else texts.get("name")],
        meta_json=[texts.get("meta")],
        time_s=times,
        flags=None if flags is None else np.frombuffer(flags, np.uint8),
        history_json=texts.get("history", "[]"),
    )
    content = unflatten(flat, source.path, source, finite=True)
    stamps_ns = wire_stamps(content.recordings[0].times(), start_time)
    return content if np.array_equal(stamps_ns, wrenches.stamps_ns) else None


TOPIC = "/wrench"
"""Topic of the messages that are written."""

_TYPE = "geometry_msgs/msg/WrenchStamped"


def save_mcap(
    dataset: Dataset, path: str | os.PathLike[str], *, progress: ProgressCallback | None = None
) -> Path:
    """Write a data set as MCAP: one recording as a file, several as a folder with a file each.

    The files have the ROS 2 profile, zstd chunks, and a summary with statistics and indexes. Stamps count from
    1970 where `start_time` is known, and from the first sample otherwise. What messages cannot hold stands beside them
    in a metadata record and attachments called ``granular_id``, so that ``load(path) == dataset`` to the last bit.

    Parameters
    ----------
    dataset : Dataset
        Of 6-axis recordings.
    path : str or path
        A file ending in ``.mcap`` for one recording, a new or empty folder for several.
    progress : callable, optional
        Called as ``progress(files_done, files_in_all, file)``.

    Returns
    -------
    Path
        The file or folder.

    Raises
    ------
    FileExistsError
        There is something at `path` already.
    FileNotFoundError
        The folder to put it in does not exist.
    ValueError
        A recording has other axes or lasts longer than 68 years; a file name for several recordings, or another
        ending than ``.mcap`` for one.
    ImportError
        The extra ``ros`` is not installed.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> from granular_id import load
    >>> from granular_id.io.ros.mcap import save_mcap
    >>> from granular_id import Dataset, Recording
    >>> data = Dataset([Recording(np.ones((3, 6)) / 3, rate_hz=500, label="oat flakes")])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     load(save_mcap(data, folder + "/oats.mcap")) == data
    True

    Notes
    -----
    The format is described at https://mcap.dev/spec, the ROS 2 profile in its registry.
    """
    refuse_other_axes(checked_dataset(dataset), "MCAP")
    target = Path(path)
    is_file = target.suffix.lower() == ".mcap"
    if is_file and len(dataset) > 1:
        raise ValueError(
            f"an .mcap file holds one recording, and there are {len(dataset)}; name a folder, format='mcap'"
        )
    if not is_file:
        return indexed_folder(dataset, target, ".mcap", partial(_write, history="[]"), progress)
    with new_file(target) as draft:
        _write(dataset[0], draft, history=history_json(dataset))
    if progress is not None:
        progress(1, 1, target.name)
    return target


def _write(recording: Recording, path: Path, *, history: str) -> None:
    mcap = need("mcap.writer", extra="ros", why="to write .mcap files")
    try:
        stamps_ns = wire_stamps(recording.times(), recording.start_time)
    except ValueError as error:
        raise ValueError(f"recording {recording.name!r}: {error}") from error
    messages = encode_wrenches(recording.wrench, stamps_ns, _frame(recording))
    own = own_records(recording, history)
    first_ns = int(stamps_ns[0])
    with path.open("wb") as file:
        writer = mcap.Writer(file, compression=mcap.CompressionType.ZSTD, enable_data_crcs=True)
        writer.start(profile="ros2", library=f"granular-id {_core.__version__}")
        schema = writer.register_schema(_TYPE, "ros2msg", DEFINITION.encode())
        channel = writer.register_channel(TOPIC, "cdr", schema)
        for number, (stamp_ns, message) in enumerate(zip(stamps_ns.tolist(), messages, strict=True)):
            writer.add_message(
                channel, log_time=stamp_ns, publish_time=stamp_ns, sequence=number, data=message
            )
        writer.add_metadata(OWN_NAME, own.metadata)
        for name, data in own.attachments.items():
            writer.add_attachment(first_ns, first_ns, name, "application/octet-stream", data)
        writer.finish()


def _frame(recording: Recording) -> str:
    """Return what the metadata call the frame, where that can be a ``frame_id``."""
    frame = recording.meta.get("frame")
    if isinstance(frame, str) and frame.isprintable() and len(frame.encode()) < LONGEST_FRAME:
        return frame
    return ""
