"""LeRobot data sets written: frames, episodes, tasks, statistics."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray, argument_error, positive_number, thaw
from granular_id._progress import ProgressCallback
from granular_id.io.errors import need
from granular_id.io.folder_save import checked_dataset, history_json, new_folder
from granular_id.io.lerobot.reading import (
    DATA,
    EPISODES,
    FEATURE,
    INDICES,
    INFO,
    MARK,
    MARK_VERSION,
    OWN,
    STATS,
    TASK,
    TASKS,
    UNLABELLED,
    VERSION,
    WHY,
)
from granular_id.recording import Dataset, Recording

_FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_FILES_PER_CHUNK, _FILE_MB = 1000, 100

_MOST_FPS, _LEAST_FPS = 50, 25
"""Frames a second by default: those of cameras and policies, so that data sets can be put together."""

_QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}


def save_lerobot(
    dataset: Dataset,
    folder: str | os.PathLike[str],
    *,
    fps: float | None = None,
    progress: ProgressCallback | None = None,
) -> Path:
    """Write a data set as a LeRobot data set of version 3.0.

    An episode is a recording, its task is the label. Each frame holds the k samples from its time stamp to that of
    the next, as the feature ``observation.wrench`` of shape (k, axes), or (axes,) where k is 1: float64, N and N m.
    The last frame of an episode is filled up with its last sample. How many samples there are, and all that LeRobot
    has no place for, stands in columns ``granular_id/...`` of ``meta/episodes``: `load` gives back every bit. There
    are no pictures and no ``action``.

    Parameters
    ----------
    dataset : Dataset
        Uniform recordings of one rate. An irregular one is written, too: its frames have the time stamps of their first
        samples, and are not 1 / fps apart.
    folder : str or path
        New or empty folder. It is written under a temporary name and renamed at the end.
    fps : float, optional
        Frames a second, which must divide the rate: ``fps=rate`` writes a frame a sample. By default the largest whole
        number from 25 to 50 that does (500 Hz: 50 frames of 10 samples), as cameras and policies have them; for a rate
        without one, the rate divided by the smallest k that gives 50 or less.
    progress : callable, optional
        Called as ``progress(recordings_done, recordings_in_all, file)`` after each recording.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    FileExistsError
        `folder` is a file, a link or a folder with something in it.
    FileNotFoundError
        The folder to put it in does not exist.
    ImportError
        pyarrow is missing.
    TypeError, ValueError
        `dataset` is no Dataset; its recordings differ in their axes or rates; `fps` does not divide the rate.

    References
    ----------
    LeRobotDataset v3.0, https://huggingface.co/docs/lerobot/lerobot-dataset-v3

    Examples
    --------
    >>> import json, numpy as np, pathlib, tempfile
    >>> from granular_id import load
    >>> from granular_id.io.lerobot.writing import save_lerobot
    >>> from granular_id import Dataset, Recording
    >>> data = Dataset([Recording(np.ones((1601, 6)) / 3, rate_hz=500, label="oat flakes")])
    >>> with tempfile.TemporaryDirectory() as place:
    ...     folder = save_lerobot(data, place + "/oats")
    ...     info = json.loads(pathlib.Path(folder, "meta/info.json").read_text())
    ...     load(folder) == data
    True
    >>> info["fps"], info["total_frames"], info["features"]["observation.wrench"]["shape"]
    (50, 161, [10, 6])
    """
    recordings = checked_dataset(dataset).recordings
    library = need("pyarrow.parquet", extra="app", why=WHY)
    frames = _Frames.of(dataset, fps)
    with new_folder(folder) as partial:
        episodes = _write_data(library, partial, recordings, frames, progress)
        labels = {MARK: json.dumps({"version": MARK_VERSION, "history": json.loads(history_json(dataset))})}
        table = episodes.table(recordings).replace_schema_metadata(labels)
        path = partial / EPISODES / _FILE.format(chunk_index=0, file_index=0)
        path.parent.mkdir(parents=True)
        library.write_table(table, path, write_page_checksum=True)
        library.write_table(_tasks_table(episodes.tasks), partial / TASKS)
        _write_json(partial / STATS, episodes.whole_stats())
        _write_json(partial / INFO, _info(episodes, frames))
    return Path(folder)


@dataclass(frozen=True)
class _Frames:
    """How samples become frames: `k` of them in each, `fps` frames a second."""

    axes: tuple[str, ...]
    k: int
    fps: float

    @classmethod
    def of(cls, dataset: Dataset, fps: float | None) -> _Frames:
        rates = sorted({r.rate_hz for r in dataset if r.rate_hz is not None})
        if len(rates) > 1:
            came = ", ".join(f"{rate:g}" for rate in rates[:4])
            problem = f"recordings were sampled at {came} Hz, and a LeRobot data set has one rate"
            raise ValueError(f"{problem}: call .resample(rate_hz) first, or save them apart")
        rate = rates[0] if rates else _typical_rate(dataset.recordings)
        if fps is None:
            k = _default_k(rate)
            return cls(dataset.axes, k, _whole(rate / k))
        fps = positive_number("fps", fps, "frames a second")
        k = max(1, round(rate / fps))
        if rates and abs(rate / fps - k) > 1e-9 * k:
            wanted = f"wanted one that divides the rate, like {rate / _default_k(rate):g} or {rate:g}"
            raise argument_error(ValueError, "fps", f"={fps:g} does not divide {rate:g} Hz; {wanted}")
        return cls(dataset.axes, k, _whole(fps))

    @property
    def shape(self) -> tuple[int, ...]:
        return (len(self.axes),) if self.k == 1 else (self.k, len(self.axes))

    @property
    def features(self) -> dict[str, dict[str, Any]]:
        wrench = {"dtype": "float64", "shape": list(self.shape), "names": list(self.axes)}
        others = {"timestamp": "float32", **INDICES}
        return {
            FEATURE: wrench,
            **{name: {"dtype": kind, "shape": [1], "names": None} for name, kind in others.items()},
        }

    def count(self, recording: Recording) -> int:
        """Frames of a recording."""
        return -(-recording.n_samples // self.k)

    def padded(self, recording: Recording) -> FloatArray:
        """Return the samples, as many as its frames hold: the last one again and again at the end."""
        missing = self.count(recording) * self.k - recording.n_samples
        return np.concatenate([recording.wrench, np.repeat(recording.wrench[-1:], missing, axis=0)])

    def stamps(self, recording: Recording) -> NDArray[np.float32]:
        """Return when the frames begin, seconds from the first sample."""
        times = (
            np.arange(self.count(recording)) / self.fps
            if recording.time_s is None
            else recording.time_s[:: self.k]
        )
        return times.astype(np.float32)


def _default_k(rate: float) -> int:
    """Return how many samples a frame has where nobody says it."""
    whole = [n for n in range(_MOST_FPS, _LEAST_FPS - 1, -1) if rate >= n and rate % n == 0]
    return round(rate / whole[0]) if whole else math.ceil(rate / _MOST_FPS)


def _typical_rate(recordings: Sequence[Recording]) -> float:
    """Return a whole rate near that of irregular recordings; 1 Hz where they have one sample each."""
    steps = [np.diff(r.time_s) for r in recordings if r.time_s is not None and r.n_samples > 1]
    rate = 1 / float(np.median(np.concatenate(steps))) if steps else 1.0
    return float(max(1, round(min(rate, 1e6))))


def _whole(number: float) -> float:
    """Return an int where it is one: LeRobot's fps are."""
    return int(number) if number == int(number) else number


def _write_data(
    library: Any,
    folder: Path,
    recordings: Sequence[Recording],
    frames: _Frames,
    progress: ProgressCallback | None,
) -> _Episodes:
    """Write the frames of all recordings, a row group each."""
    episodes = _Episodes(frames)
    for number, part in enumerate(_parts(recordings)):
        chunk, file = divmod(number, _FILES_PER_CHUNK)
        name = f"{DATA}/{_FILE.format(chunk_index=chunk, file_index=file)}"
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        with library.ParquetWriter(folder / name, episodes.schema, write_page_checksum=True) as writer:
            for recording in part:
                table = episodes.add(recording, number)
                writer.write_table(table, row_group_size=table.num_rows)
                if progress is not None:
                    progress(len(episodes), len(recordings), name)
    return episodes


def _parts(recordings: Sequence[Recording]) -> Iterator[list[Recording]]:
    """Part recordings into files of at most 100 MB, or of one recording."""
    part: list[Recording] = []
    n_bytes = 0
    for recording in recordings:
        if part and n_bytes + recording.wrench.nbytes > _FILE_MB << 20:
            yield part
            part, n_bytes = [], 0
        part.append(recording)
        n_bytes += recording.wrench.nbytes
    yield part


class _Episodes:
    """The episodes as they are written: where each lies, its task, its statistics."""

    def __init__(self, frames: _Frames) -> None:
        self._frames = frames
        self._arrow = need("pyarrow", extra="app", why=WHY)
        self.n_frames = 0
        self.tasks: dict[str, int] = {}
        self._files: list[int] = []
        self._lengths: list[int] = []
        self._stats: dict[str, list[FloatArray]] = {}

    def __len__(self) -> int:
        return len(self._lengths)

    @property
    def schema(self) -> Any:
        """The columns of frames."""
        kind = self._arrow.float64()
        for _ in self._sizes:
            kind = self._arrow.list_(kind)
        indices = dict.fromkeys(INDICES, self._arrow.int64())
        return self._arrow.schema({FEATURE: kind, "timestamp": self._arrow.float32(), **indices})

    @property
    def _sizes(self) -> tuple[int, ...]:
        """Lengths of the lists within each other that a frame holds: none where it is a number."""
        return () if self._frames.shape == (1,) else self._frames.shape

    def add(self, recording: Recording, file: int) -> Any:
        """Return the table of frames of the next episode."""
        n, episode, first = self._frames.count(recording), len(self), self.n_frames
        task = self.tasks.setdefault(recording.label or UNLABELLED, len(self.tasks))
        frame = np.arange(n, dtype=np.int64)
        indices = (frame, np.full_like(frame, episode), first + frame, np.full_like(frame, task))
        with np.errstate(all="ignore"):  # numbers may be as large as float64 holds
            columns: dict[str, NDArray[Any]] = {"timestamp": self._frames.stamps(recording)}
            columns |= dict(zip(INDICES, indices, strict=True))
            for name, values in {FEATURE: recording.wrench, **columns}.items():
                self._describe(name, values.reshape(len(values), -1), n)
        self._files.append(file)
        self._lengths.append(n)
        self.n_frames += n
        wrench = self._nested(self._frames.padded(recording))
        return self._arrow.table({FEATURE: wrench, **columns})

    def _nested(self, samples: FloatArray) -> Any:
        """Make lists, or lists of lists, of samples (T, C): one a frame."""
        array = self._arrow.array(samples.reshape(-1))
        for size in reversed(self._sizes):
            offsets = self._arrow.array(np.arange(0, len(array) + 1, size), self._arrow.int32())
            array = self._arrow.ListArray.from_arrays(offsets, array)
        return array

    def _describe(self, name: str, values: NDArray[Any], n_frames: int) -> None:
        """Keep the statistics that LeRobot wants of a feature (n, width) in an episode."""
        quantiles = np.quantile(values, list(_QUANTILES.values()), axis=0)
        found = {
            "min": values.min(axis=0),
            "max": values.max(axis=0),
            "mean": values.mean(axis=0, dtype=np.float64),
            "std": values.std(axis=0, dtype=np.float64),
            "count": np.array([n_frames]),
            **dict(zip(_QUANTILES, quantiles, strict=True)),
        }
        for what, value in found.items():
            self._stats.setdefault(f"{name}/{what}", []).append(np.asarray(value, np.float64))

    def whole_stats(self) -> dict[str, dict[str, list[float]]]:
        """Return the statistics of the data set, put together as LeRobot does it: quantiles by their mean."""
        whole: dict[str, dict[str, list[float]]] = {}
        for name in self._frames.features:
            of = {
                what: np.stack(self._stats[f"{name}/{what}"])
                for what in ("min", "max", "mean", "std", "count", *_QUANTILES)
            }
            with np.errstate(all="ignore"):
                share = of["count"] / of["count"].sum()
                mean = (share * of["mean"]).sum(axis=0)
                variance = (share * (of["std"] ** 2 + (of["mean"] - mean) ** 2)).sum(axis=0)
                found = {"min": of["min"].min(axis=0), "max": of["max"].max(axis=0), "mean": mean}
                found |= {"std": np.sqrt(variance)}
                found |= {what: (share * of[what]).sum(axis=0) for what in _QUANTILES}
            listed = {what: value.tolist() for what, value in found.items()}
            whole[name] = {**listed, "count": [self.n_frames]}
        return whole

    def table(self, recordings: Sequence[Recording]) -> Any:
        """Return what ``meta/episodes`` lists, a row per recording."""
        arrow = self._arrow
        ends = np.cumsum(self._lengths)
        chunks, files = np.divmod(self._files, _FILES_PER_CHUNK)
        columns: dict[str, Any] = {
            "episode_index": np.arange(len(self)),
            TASK: arrow.array([[r.label or UNLABELLED] for r in recordings], arrow.list_(arrow.string())),
            "length": np.array(self._lengths),
            "data/chunk_index": chunks,
            "data/file_index": files,
            "dataset_from_index": ends - self._lengths,
            "dataset_to_index": ends,
            "meta/episodes/chunk_index": np.zeros(len(self), np.int64),
            "meta/episodes/file_index": np.zeros(len(self), np.int64),
        }
        number, text = arrow.float64(), arrow.string()
        kinds = {"n_samples": arrow.int64(), "trigger_index": arrow.int64()}
        kinds |= {"rate_hz": number, "start_time": number}
        kinds |= {"time_s": arrow.list_(number), "flags": arrow.list_(arrow.uint8())}
        for name, column in OWN.items():
            values = [_own_value(recording, name) for recording in recordings]
            columns[column] = arrow.array(values, kinds.get(name, text))
        for name, stats in self._stats.items():
            whole = name.endswith("/count")
            kind = arrow.list_(arrow.int64() if whole else number)
            columns[f"stats/{name}"] = arrow.array([s.astype(np.int64) if whole else s for s in stats], kind)
        return arrow.table(columns)


def _own_value(recording: Recording, name: str) -> Any:
    if name == "meta":
        return json.dumps(thaw(recording.meta)) if recording.meta else None
    return getattr(recording, name)


def _info(episodes: _Episodes, frames: _Frames) -> dict[str, Any]:
    return {
        "codebase_version": VERSION,
        "robot_type": None,
        "total_episodes": len(episodes),
        "total_frames": episodes.n_frames,
        "total_tasks": len(episodes.tasks),
        "chunks_size": _FILES_PER_CHUNK,
        "data_files_size_in_mb": _FILE_MB,
        "video_files_size_in_mb": 200,
        "fps": frames.fps,
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": f"{DATA}/{_FILE}",
        "video_path": None,
        "features": frames.features,
    }


def _tasks_table(tasks: Mapping[str, int]) -> Any:
    """Return the tasks as pandas writes them: the texts are its index."""
    arrow = need("pyarrow", extra="app", why=WHY)
    about = {"name": "task_index", "pandas_type": "int64", "numpy_type": "int64"}
    index = {"name": "task", "pandas_type": "unicode", "numpy_type": "object"}
    pandas = {
        "index_columns": ["task"],
        "column_indexes": [
            {"name": None, "field_name": None, "pandas_type": "unicode", "numpy_type": "object"}
        ],
        "columns": [{**column, "field_name": column["name"], "metadata": None} for column in (about, index)],
        "pandas_version": "2.0.0",
    }
    table = arrow.table(
        {"task_index": np.arange(len(tasks)), "task": arrow.array(list(tasks), arrow.string())}
    )
    return table.replace_schema_metadata({"pandas": json.dumps(pandas)})


def _write_json(path: Path, content: object) -> None:
    path.write_text(json.dumps(content, indent=4, ensure_ascii=False), encoding="utf-8")
