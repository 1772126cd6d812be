"""LeRobot data sets, version 3.0: an episode is a recording, the wrench is a window of samples in each frame.

LeRobot has one number of frames a second (fps) for everything. Force is sampled faster, so that each frame holds the k
samples from its time stamp to the next, ``observation.wrench`` of shape (k, axes), at k times fps. What a frame cannot
say (how many samples the last one has, label, session, stamps ...) stands in columns ``granular_id/...`` of
``meta/episodes``, one value per episode, which other programs pass over.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray
from granular_id.io.arrays.stated import Columns
from granular_id.io.arrays.tree import Origin
from granular_id.io.errors import RecordingFileError, need
from granular_id.io.files import list_folder, read_bounded
from granular_id.io.flat import NO_TRIGGER, FlatRecordings, unflatten
from granular_id.io.options import LoadOptions
from granular_id.io.parquet.index import integers
from granular_id.io.parquet.layout import labels_of, open_parquet
from granular_id.io.source import FileContent, FileSource
from granular_id.io.stamped import RATE_TOLERANCE
from granular_id.recording import AXES, STATED_TOLERANCE

__all__ = ["is_lerobot", "read_lerobot"]

FEATURE = "observation.wrench"
INFO, STATS, TASKS = "meta/info.json", "meta/stats.json", "meta/tasks.parquet"
EPISODES, DATA = "meta/episodes", "data"
"""Folders of chunks of Parquet files: a row per episode, and a row per frame."""

VERSION = "v3.0"
WHY = "to read and write LeRobot data sets"

INDICES = dict.fromkeys(("frame_index", "episode_index", "index", "task_index"), "int64")
TASK, UNLABELLED = "tasks", "unlabelled"
"""Column of the texts of an episode, and what stands there for a recording without a label."""

MARK, MARK_VERSION = "granular_id", 1
OWN = {
    name: f"{MARK}/{name}"
    for name in (
        *("n_samples", "rate_hz", "start_time", "trigger_index", "label", "session", "name", "meta"),
        *("time_s", "flags"),
    )
}
"""Columns of the episodes that only this package writes and reads."""


def is_lerobot(folder: Path) -> bool:
    """Tell whether a folder is a LeRobot data set, of whatever version, or the larger part of one."""
    folders = [os.path.isdir(folder / name) for name in (DATA, EPISODES)]  # noqa: PTH112 (never raise)
    return sum((os.path.isfile(folder / INFO), *folders)) > 1  # noqa: PTH113


def read_lerobot(source: FileSource, options: LoadOptions) -> FileContent:
    """Read a LeRobot data set of version 3: an episode is a recording, its task the label.

    The wrench is the feature ``observation.wrench``, or the one that ``array=`` names, of shape (axes,) or (k, axes).
    What other features hold is not read, and a note says so.
    """
    _refuse_part(source.path)
    info = _read_info(source, options)
    feature = _Feature.of(info, source, options)
    listed = _Listed.of(source, options)
    n_stated = info.get("total_episodes")
    if n_stated is not None and n_stated != len(listed.lengths):
        problem = f"states total_episodes {n_stated!r:.40}, and {EPISODES} lists {len(listed.lengths)}"
        raise RecordingFileError(source.path / INFO, f"{problem}; {_WHOLE}")
    known = listed.own is not None and feature.name == FEATURE
    content = (_own if known else _of_others)(feature, listed, source, options)
    if feature.unread:
        content.notes.append(f"features that are not read: {', '.join(feature.unread)[:200]}")
    return content


_WHOLE = "wanted the whole data set, as it was written"


def _refuse_part(folder: Path) -> None:
    """Refuse a data set of which something is missing."""
    parts = (INFO, TASKS, EPISODES, DATA)
    missing = [part for part in parts if not (folder / part).exists()]
    if missing and (folder / EPISODES).is_dir():  # another version is told by its own refusal
        problem = f"is a part of a LeRobot data set, without {', '.join(missing)}; {_WHOLE}"
        raise RecordingFileError(folder, problem)


def _own(feature: _Feature, listed: _Listed, source: FileSource, options: LoadOptions) -> FileContent:
    """Read what this package wrote: everything is as it was."""
    assert listed.own is not None
    listed.own.refuse_changed(listed, feature)
    frames = _read_frames(feature, listed, source, options)
    frames.check_clock(feature, listed, source.path)
    flat = listed.own.flat(frames.samples, listed.lengths * feature.k, feature.names)
    for i, (task, label) in enumerate(zip(_labels(frames, listed, source, options), flat.label, strict=True)):
        if task != " ".join((label or UNLABELLED).split()):
            problem = f"names the task of episode {listed.indices[i]} {task!r:.60}, but {OWN['label']} {label!r:.60}"
            raise RecordingFileError(source.path / TASKS, f"{problem}: changed since; {_WAY_OUT}")
    return unflatten(flat, source.path, source)


def _of_others(feature: _Feature, listed: _Listed, source: FileSource, options: LoadOptions) -> FileContent:
    """Read frames as they stand."""
    columns = _columns(feature, source, options)
    frames = _read_frames(feature, listed, source, options)
    frames.check_clock(feature, listed, source.path)
    frames.check_windows(feature, listed, source.path)
    n = len(listed.lengths)
    meta = json.dumps({"units": columns.meta_units}) if columns.meta_units else None
    flat = FlatRecordings(
        axes=columns.axes,
        wrench=columns.wrench(frames.samples),
        n_samples=listed.lengths * feature.k,
        rate_hz=np.full(n, feature.rate_hz),
        start_time=np.full(n, np.nan),
        trigger_index=np.full(n, NO_TRIGGER),
        label=_labels(frames, listed, source, options),
        session=[None] * n,
        name=[None] * n,
        meta_json=[meta] * n,
    )
    content = unflatten(flat, source.path, source)
    if feature.k > 1:
        said = f"{feature.name} has {feature.k} samples in each of {feature.fps:g} frames a second"
        content.notes.append(f"{said}: {feature.rate_hz:g} Hz")
    if columns.order is not None or columns.scales is not None:
        content.notes.append(columns.said(feature.names or columns.axes))
    content.obeyed = ("axes",)
    return content


def _read_info(source: FileSource, options: LoadOptions) -> dict[str, Any]:
    """Read ``meta/info.json`` of version 3."""
    path = source.path / INFO
    data = read_bounded(path, source.root, options.max_text_bytes)
    try:
        info = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise RecordingFileError(path, f"is no JSON: {error}"[:200]) from error
    version = info.get("codebase_version") if isinstance(info, dict) else None
    if not isinstance(version, str):
        raise RecordingFileError(path, "has no codebase_version; wanted a LeRobot data set of version v3.0")
    if not re.fullmatch(r"v?3\.[0-9]+(\..*)?", version):
        way_out = (
            "LeRobot's convert_dataset_v21_to_v30 makes it of v2.1"
            if version.lstrip("v").startswith(("1.", "2."))
            else "this version of granular-id reads no other"
        )
        raise RecordingFileError(path, f"is of version {version!r:.40}; wanted v3.0, and {way_out}")
    fps, features = info.get("fps"), info.get("features")
    if isinstance(fps, bool) or not isinstance(fps, (int, float)) or not 0 < fps < math.inf:
        raise RecordingFileError(path, f"fps is {fps!r:.40}; wanted frames a second, more than 0")
    if not isinstance(features, dict) or not all(isinstance(one, dict) for one in features.values()):
        raise RecordingFileError(path, "names no features; wanted an object for each, with dtype and shape")
    return dict(info)


@dataclass(frozen=True)
class _Feature:
    """The feature that holds the wrench."""

    name: str
    shape: tuple[int, ...]
    names: tuple[str, ...]  # of its axes; empty where none are named
    fps: float
    unread: tuple[str, ...]

    @classmethod
    def of(cls, info: Mapping[str, Any], source: FileSource, options: LoadOptions) -> _Feature:
        name, path, features = options.array or FEATURE, source.path / INFO, info["features"]
        numbers = [
            key for key, one in features.items() if _is_numbers(one) and key not in (*INDICES, "timestamp")
        ]
        if name not in features:
            listed = ", ".join(numbers)[:200] or "none of numbers"
            raise RecordingFileError(
                path, f"has no feature {name!r:.60}; pass array= with the one that holds the wrench: {listed}"
            )
        said, place = features[name], f"feature {name}"
        if name not in numbers:
            raise RecordingFileError(path, f"holds {said.get('dtype')!r:.40}; wanted numbers", place=place)
        shape = said.get("shape")
        whole = isinstance(shape, list) and all(type(size) is int and size > 0 for size in shape)
        if not whole or len(shape) not in (1, 2):
            wanted = "(axes,), or (samples of a frame, axes)"
            raise RecordingFileError(path, f"has shape {shape!r:.60}; wanted {wanted}", place=place)
        try:
            names = _axis_names(said.get("names"), shape)
        except ValueError as error:
            raise RecordingFileError(path, str(error), place=place) from error
        unread = (key for key in features if key not in (name, "timestamp", *INDICES))
        return cls(name, tuple(shape), names, info["fps"], tuple(unread))

    @property
    def k(self) -> int:
        """Samples of a frame."""
        return self.shape[0] if len(self.shape) == 2 else 1

    @property
    def rate_hz(self) -> float:
        return float(self.k * self.fps)


def _is_numbers(feature: Mapping[str, Any]) -> bool:
    return re.fullmatch(r"float(16|32|64)|u?int(8|16|32|64)", str(feature.get("dtype"))) is not None


def _axis_names(said: Any, shape: Sequence[int]) -> tuple[str, ...]:
    """Return the names of the last dimension: a list, or a list in an object, or an object with their places."""
    n = shape[-1]
    if isinstance(said, dict) and all(type(place) is int for place in said.values()):
        said = sorted(said, key=said.__getitem__) if sorted(said.values()) == list(range(n)) else said
    lists = [said] if isinstance(said, list) and all(isinstance(one, str) for one in said) else []
    if not lists and isinstance(said, (dict, list)):  # a list for each dimension, or for groups
        lists = [one for one in (said.values() if isinstance(said, dict) else said) if isinstance(one, list)]
    fitting = [one for one in lists if len(one) == n and all(isinstance(name, str) for name in one)]
    if len(fitting) == 1 and len(set(fitting[0])) == n:
        return tuple(fitting[0])
    if not said or (len(lists) == 1 and len(lists[0]) == len(shape) != n):  # names of the dimensions
        return ()
    raise ValueError(
        f"has the names {said!r:.80} for shape {tuple(shape)}; wanted {n} different ones, or null"
    )


def _columns(feature: _Feature, source: FileSource, options: LoadOptions) -> Columns:
    """Tell what the columns of a feature of others are."""
    n, place = feature.shape[-1], f"feature {feature.name}"
    names = feature.names or options.axes or AXES
    if len(names) != n:
        problem = f"has {n} columns without names; pass axes= with {n} names"
        raise RecordingFileError(source.path / INFO, problem, place=place)
    return Columns.named(names, {}, place, _Origin(source.path / INFO, "feature", {}), options)


class _Origin(Origin):
    def unclear(self, problem: str) -> RecordingFileError:
        way_out = "pass array= with the feature, or axes= with the columns that hold the wrench"
        return RecordingFileError(self.path, f"{problem}; {way_out}")


@dataclass(frozen=True)
class _Listed:
    """What ``meta/episodes`` lists."""

    indices: NDArray[np.int64]
    lengths: NDArray[np.int64]  # in frames
    own: _Stored | None

    @classmethod
    def of(cls, source: FileSource, options: LoadOptions) -> _Listed:
        arrow = need("pyarrow", extra="app", why=WHY)
        tables, history, own = [], "[]", True
        for path in _files(source.path / EPISODES):
            with open_parquet(path, source.root, options.max_binary_bytes) as opened:
                names = set(opened.schema_arrow.names)
                own = own and set(OWN.values()) <= names
                if own and history == "[]":
                    history = _stored_history(labels_of(opened), path)
                wanted = ["episode_index", "length", *((TASK, *OWN.values()) if own else ())]
                tables.append(_read_columns(opened, wanted, path))
        common = ["episode_index", "length", *((TASK, *OWN.values()) if own else ())]
        table = arrow.concat_tables([one.select(common) for one in tables], promote_options="permissive")
        indices, lengths = (integers(table, name) for name in ("episode_index", "length"))
        if not len(lengths) or lengths.min() < 1:
            problem = "lists no episodes, or one without frames"
            raise RecordingFileError(source.path / EPISODES, problem)
        return cls(indices, lengths, _Stored(table, history, source.path) if own else None)


def _stored_history(labels: Mapping[str, str], path: Path) -> str:
    """Return the history in the footer of what this package wrote."""
    try:
        said = json.loads(labels.get(MARK, '{"version": 1, "history": []}'))
        version, history = said["version"], json.dumps(said["history"])
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        problem = f"the entry {MARK!r} holds no version and history"
        raise RecordingFileError(path, problem, place="footer") from error
    if version != MARK_VERSION:
        problem = f"the entry {MARK!r} is of version {version!r:.40}; wanted {MARK_VERSION}"
        raise RecordingFileError(path, problem, place="footer")
    return history


_WAY_OUT = f"without the columns {MARK}/... frames are read as they stand"


@dataclass(frozen=True)
class _Stored:
    """What this package wrote of its recordings."""

    table: Any
    history_json: str
    path: Path

    def refuse_changed(self, listed: _Listed, feature: _Feature) -> None:
        """Refuse frames that are not those of the recordings."""
        n_samples, rates = integers(self.table, OWN["n_samples"]), self._floats("rate_hz")
        with np.errstate(invalid="ignore"):
            other = np.abs(rates - feature.rate_hz) > RATE_TOLERANCE * feature.rate_hz
        wrong = np.flatnonzero((-(-n_samples // feature.k) != listed.lengths) | other)
        if len(wrong):
            i = wrong[0]
            came = f"{listed.lengths[i]} frames of {feature.k} samples, {feature.fps:g} a second"
            said = f"{OWN['n_samples']} {n_samples[i]} and {OWN['rate_hz']} {rates[i]:g}"
            problem = f"episode {listed.indices[i]} has {came}, but {said}: changed since; {_WAY_OUT}"
            raise RecordingFileError(self.path / EPISODES, problem)

        for i, (tasks, label) in enumerate(
            zip(self.table[TASK].to_pylist(), self.table[OWN["label"]].to_pylist(), strict=True)
        ):
            if tasks != [label or UNLABELLED]:
                problem = f"episode {listed.indices[i]} has the tasks {tasks!r:.60}, but {OWN['label']} {label!r:.60}"
                raise RecordingFileError(self.path / EPISODES, f"{problem}: changed since; {_WAY_OUT}")

    def flat(self, samples: FloatArray, lengths: NDArray[np.int64], axes: tuple[str, ...]) -> FlatRecordings:
        """Put everything together; of the samples (`lengths` in each episode) padding is left out."""
        n_samples = integers(self.table, OWN["n_samples"])
        if (n_samples < lengths).any():
            ends = np.cumsum(lengths)
            samples = samples[np.arange(len(samples)) < np.repeat(ends - lengths + n_samples, lengths)]
        return FlatRecordings(
            axes=axes,
            wrench=samples,
            n_samples=n_samples,
            rate_hz=self._floats("rate_hz"),
            start_time=self._floats("start_time"),
            trigger_index=integers(self.table, OWN["trigger_index"]),
            label=self._texts("label"),
            session=self._texts("session"),
            name=self._texts("name"),
            meta_json=self._texts("meta"),
            time_s=self._per_sample("time_s", n_samples, np.nan, np.float64),
            flags=self._per_sample("flags", n_samples, 0, np.uint8),
            history_json=self.history_json,
        )

    @property
    def is_even(self) -> NDArray[np.bool_]:
        """Which recordings have a rate."""
        return ~np.isnan(self._floats("rate_hz"))

    def _floats(self, name: str) -> FloatArray:
        return np.asarray(self.table[OWN[name]].to_numpy(), np.float64)

    def _texts(self, name: str) -> list[str | None]:
        return list(self.table[OWN[name]].to_pylist())

    def _per_sample(
        self, name: str, n_samples: NDArray[np.int64], nothing: float, kind: Any
    ) -> NDArray[Any] | None:
        """Return a value per sample, `nothing` in recordings without; None where none has any."""
        column = self.table[OWN[name]]
        if column.null_count == len(column):
            return None
        parts = []
        for i, (cell, n) in enumerate(zip(column, n_samples.tolist(), strict=True)):
            values = cell.values
            if values is not None and (len(values) != n or values.null_count):
                problem = f"{OWN[name]} has {len(values)} values for {n} samples in row {i}"
                raise RecordingFileError(self.path / EPISODES, problem)
            parts.append(
                np.full(n, nothing, kind) if values is None else values.to_numpy(zero_copy_only=False)
            )
        return np.concatenate(parts)


@dataclass(frozen=True)
class _FrameColumns:
    """The frames of all episodes, one behind the other."""

    samples: FloatArray  # (frames * k, axes)
    timestamp: FloatArray
    task_index: NDArray[np.int64]

    def check_clock(self, feature: _Feature, listed: _Listed, path: Path) -> None:
        """Refuse time stamps that are not those of frames at fps, but for irregular recordings of this package."""
        starts = np.cumsum(listed.lengths) - listed.lengths
        frame = np.arange(len(self.timestamp)) - np.repeat(starts, listed.lengths)
        stamps = self.timestamp
        with np.errstate(all="ignore"):
            off = np.abs(stamps - np.repeat(stamps[starts], listed.lengths) - frame / feature.fps)
            room = STATED_TOLERANCE / feature.fps + np.spacing(np.abs(stamps).astype(np.float32))
        even = np.ones(len(starts), bool) if listed.own is None else listed.own.is_even
        wrong = np.flatnonzero(~(off <= room) & np.repeat(even, listed.lengths))
        if len(wrong):
            episode = int(np.searchsorted(starts, wrong[0], side="right")) - 1
            came = (
                f"frame {frame[wrong[0]]} of episode {listed.indices[episode]} is {off[wrong[0]]:.3g} s away"
            )
            problem = f"{came} from its place at {feature.fps:g} frames a second; wanted half a frame at most"
            raise RecordingFileError(path / DATA, problem, column="timestamp")

    def check_windows(self, feature: _Feature, listed: _Listed, path: Path) -> None:
        """Refuse windows that overlap, as of the newest samples at each frame: side by side they are other signals."""
        windows = self.samples.reshape(-1, feature.k, self.samples.shape[1])
        followed = np.ones(len(windows), bool)
        followed[np.cumsum(listed.lengths) - 1] = False
        before = np.flatnonzero(followed)
        if feature.k == 1 or not before.size or (windows == windows[0, 0]).all():
            return
        last, after = windows[before, -1], windows[before + 1, :-1]
        if (after == last[:, np.newaxis]).all(axis=2).any(axis=1).all():
            problem = "its windows overlap: each holds the last sample of the one before, and not as its last"
            raise RecordingFileError(
                path / DATA,
                f"{problem}; wanted windows that follow each other",
                place=f"feature {feature.name}",
            )


def _read_frames(
    feature: _Feature, listed: _Listed, source: FileSource, options: LoadOptions
) -> _FrameColumns:
    """Read all frames; they must be those that ``meta/episodes`` lists."""
    names = ("timestamp", "episode_index", "frame_index", "task_index")
    found: dict[str, list[NDArray[Any]]] = {name: [] for name in (feature.name, *names)}
    for path in _files(source.path / DATA):
        with open_parquet(path, source.root, options.max_binary_bytes) as opened:
            table = _read_columns(opened, found, path)
        for name, parts in found.items():
            shape = feature.shape if name == feature.name else (1,)
            parts.append(_numbers(table[name], shape, path, name))
    samples, timestamp, episode, frame, task = (np.concatenate(parts) for parts in found.values())
    total = sum(listed.lengths.tolist())  # whole numbers of Python cannot overflow
    same = len(frame) == total
    if same:
        starts = np.cumsum(listed.lengths) - listed.lengths
        places = np.arange(len(frame)) - np.repeat(starts, listed.lengths)
        same = bool((episode == np.repeat(listed.indices, listed.lengths)).all() and (frame == places).all())
    if not same:
        came = f"holds {len(frame)} frames of {len(np.unique(episode))} episodes"
        problem = f"{came}, not in their order the {total} of {len(listed.lengths)} that {EPISODES} lists"
        raise RecordingFileError(source.path / DATA, f"{problem}; {_WHOLE}")
    return _FrameColumns(
        np.asarray(samples, np.float64).reshape(-1, feature.shape[-1]),
        np.asarray(timestamp, np.float64),
        task.astype(np.int64),
    )


def _numbers(column: Any, shape: Sequence[int], path: Path, name: str) -> NDArray[Any]:
    """Return the numbers of a column that has lists of this shape in it, one behind the other."""
    compute = need("pyarrow.compute", extra="app", why=WHY)
    parts = []
    for chunk in column.chunks:
        values = getattr(chunk, "storage", chunk)  # of the type that the library `datasets` registers
        sizes = list(shape)
        while "list" in str(values.type).partition("<")[0] and sizes:
            size = sizes.pop(0)
            lengths = compute.list_value_length(values).fill_null(0).to_numpy(zero_copy_only=False)
            other = next(iter(lengths[lengths != size]), None)
            if other is not None:
                problem = f"a frame has {other} values where {size} are wanted, of shape {tuple(shape)}"
                raise RecordingFileError(path, problem, column=name)
            values = values.flatten()
        numbers = values.to_numpy(zero_copy_only=False) if not values.null_count else np.empty(0, object)
        if numbers.dtype.kind not in "iuf" or sizes not in ([], [1]):
            problem = f"holds {column.type}, or empty cells; wanted numbers of shape {tuple(shape)}"
            raise RecordingFileError(path, problem, column=name)
        parts.append(numbers)
    return np.concatenate(parts) if parts else np.empty(0)


def _labels(
    frames: _FrameColumns, listed: _Listed, source: FileSource, options: LoadOptions
) -> list[str | None]:
    """Return the task of each episode."""
    path = source.path / TASKS
    with open_parquet(path, source.root, options.max_binary_bytes) as opened:
        table = opened.read()
    named = [name for name in table.column_names if str(table[name].type) in ("string", "large_string")]
    if "task_index" not in table.column_names or len(named) != 1:
        problem = f"has the columns {', '.join(table.column_names)[:100]}; wanted task_index and one of texts"
        raise RecordingFileError(path, problem)
    texts = dict(zip(integers(table, "task_index").tolist(), table[named[0]].to_pylist(), strict=True))
    starts = np.cumsum(listed.lengths) - listed.lengths
    first = frames.task_index[starts]
    several = np.flatnonzero(frames.task_index != np.repeat(first, listed.lengths))
    if len(several):
        episode = int(np.searchsorted(starts, several[0], side="right")) - 1
        both = [texts.get(int(task)) for task in (first[episode], frames.task_index[several[0]])]
        problem = f"episode {listed.indices[episode]} has the tasks {both[0]!r:.60} and {both[1]!r:.60}"
        raise RecordingFileError(source.path / DATA, f"{problem}; wanted one, the label of the recording")
    unknown = next((task for task in first.tolist() if task not in texts), None)
    if unknown is not None:
        raise RecordingFileError(path, f"has no task {unknown}, which frames have")
    return [" ".join((texts[task] or "").split()) or None for task in first.tolist()]


def _read_columns(opened: Any, names: Sequence[str] | Mapping[str, Any], path: Path) -> Any:
    """Read some columns of a file; the first that is missing is named."""
    missing = next((name for name in names if name not in opened.schema_arrow.names), None)
    if missing is not None:
        raise RecordingFileError(path, f"has no column {missing!r}; wanted {', '.join(names)}")
    try:
        table = opened.read(list(names))
        table.validate(full=True)
    except Exception as error:  # checksums, pages cut off
        raise RecordingFileError(path, f"cannot be decoded: {error}"[:300]) from error
    return table.select(list(names))


def _files(folder: Path) -> list[Path]:
    """Return the Parquet files in the chunks of a folder, in their order."""
    _, chunks = list_folder(folder)
    found = [path for chunk in chunks for path in list_folder(chunk)[0] if path.suffix == ".parquet"]
    if not found:
        raise RecordingFileError(folder, "holds no chunk-.../file-....parquet")
    return found
