"""Data folders for `accuracy.py`: what is read, how it is brought to one shape, and how it is split."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from sklearn.model_selection import StratifiedShuffleSplit

import granular_id as gid
from granular_id.partitions import Partition, chronological_partitions, kfold_partitions, session_partitions
from granular_id.recording import Dataset, Recording
from granular_id.splits import describe_order, strictest

SPLITS = ("auto", "sessions", "halves", "kfold", "random")
TEST_SHARE = 0.2
"""Of random partitions, as one fold of five."""


class FolderError(ValueError):
    """A folder that cannot be used; the message names it and says why."""


@dataclass(frozen=True)
class Preparation:
    """How recordings become one array; None leaves it to the folder.

    Attributes
    ----------
    rate_hz : float or None
        Resample to this rate.
    recorded_hz : float or None
        Rate of files that carry no clock.
    max_gap_s : float or None
        Longest gap that resampling may fill.
    window_s : float or None
        Cut recordings into windows of this length, one after the other.
    """

    rate_hz: float | None = None
    recorded_hz: float | None = None
    max_gap_s: float | None = None
    window_s: float | None = None


KNOWN = {"sliding_wrench": Preparation(rate_hz=100.0, max_gap_s=1.0)}
"""Preparation of folders by name, where the command line says nothing."""

FAILURE_SAMPLES = 15
FAILURE_RATE_HZ = FAILURE_SAMPLES / 0.315


@dataclass(frozen=True)
class BenchSet:
    """One data set: recordings of one shape.

    Attributes
    ----------
    name : str
        ``"sliding_wrench"``, ``"robot_failures/lp1"``.
    group : str
        Folder that it came from; accuracies are averaged over its sets.
    data : Dataset
    notes : tuple of str
        What was done to the recordings.
    split : str
        What ``--partitions auto`` means here, a member of `SPLITS`.
    """

    name: str
    group: str
    data: Dataset
    notes: tuple[str, ...] = ()
    split: str = "auto"


def read_folder(path: Path, asked: Preparation) -> list[BenchSet]:
    """Read a folder: one data set, or five where it holds the robot-failure sets.

    Raises
    ------
    FolderError
        It does not exist, cannot be read, or its recordings cannot be brought to one shape.
    """
    name = path.resolve().name
    failures = sorted(path.glob("lp[1-5].data"))
    if failures:
        return [_failure_set(file, name) for file in failures]
    known = KNOWN.get(name, Preparation())
    rate_hz = known.rate_hz if asked.rate_hz is None else asked.rate_hz
    max_gap_s = known.max_gap_s if asked.max_gap_s is None else asked.max_gap_s
    asked = replace(asked, rate_hz=rate_hz, max_gap_s=max_gap_s)
    try:
        data, notes = _prepared(gid.load(path, rate_hz=asked.recorded_hz), asked)
        _ = data.X, data.y
    except (ValueError, TypeError, OSError, ImportError) as error:
        message = str(error)
        raise FolderError(message if str(path) in message else f"{path}: {message}") from error
    return [BenchSet(name, name, data, tuple(notes))]


def _prepared(data: Dataset, asked: Preparation) -> tuple[Dataset, list[str]]:
    notes = []
    if asked.rate_hz is not None:
        limit = {} if asked.max_gap_s is None else {"max_gap_s": asked.max_gap_s}
        data = data.resample(asked.rate_hz, **limit)
        notes.append(f"resampled to {asked.rate_hz:g} Hz")
    if any(not recording.is_uniform for recording in data):
        raise ValueError("sampled irregularly: say --rate-hz, and --max-gap-s where there are gaps")
    if len({recording.rate_hz for recording in data}) > 1:
        raise ValueError("recordings differ in rate: say --rate-hz")
    if asked.window_s is not None:
        data = windows(data, asked.window_s)
        notes.append(f"cut into {len(data)} windows of {asked.window_s:g} s")
    lengths = {recording.n_samples for recording in data}
    if len(lengths) > 1:
        data = data.align("shortest")
        notes.append(f"cut to the shortest: {min(lengths)} of up to {max(lengths)} samples")
    return data, notes


def windows(data: Dataset, window_s: float) -> Dataset:
    """Cut recordings of one rate into windows, one after the other; each knows the file that it is from.

    A window's session is that of its recording, or else the recording itself: windows of one file, which share
    everything but the moment, are never on both sides of a partition that holds sessions out.
    """
    length = round(window_s * data.rate_hz)
    if length < 1:
        raise ValueError(f"--window-s {window_s:g} holds no sample at {data.rate_hz:g} Hz")
    cut: list[Recording] = []
    for recording in data:
        for k in range(recording.n_samples // length):
            rows = slice(k * length, (k + 1) * length)
            began = recording.start_time
            cut.append(
                replace(
                    recording,
                    wrench=recording.wrench[rows],
                    flags=None if recording.flags is None else recording.flags[rows],
                    trigger_index=None,
                    start_time=None if began is None else began + k * length / data.rate_hz,
                    session=recording.session or recording.name,
                    name=f"{recording.name} window {k + 1}",
                )
            )
    if not cut:
        longest = max(recording.duration_s for recording in data)
        raise ValueError(
            f"--window-s {window_s:g} is longer than every recording; the longest has {longest:.3g} s"
        )
    return Dataset(cut, data.history)


def _failure_set(file: Path, group: str) -> BenchSet:
    """Read one robot-failure set: a label line, then 15 rows of six integers; instances between blank lines."""
    recordings = []
    for number, block in enumerate(file.read_text(encoding="ascii").split("\n\n"), start=1):
        if not block.strip():
            continue
        label, *rows = block.strip().splitlines()
        try:
            wrench = np.array([row.split() for row in rows], dtype=np.float64)
        except ValueError as error:
            raise FolderError(f"{file}: instance {number} is no table of numbers: {error}") from error
        if wrench.shape != (FAILURE_SAMPLES, 6):
            raise FolderError(
                f"{file}: instance {number} has shape {wrench.shape}, wanted ({FAILURE_SAMPLES}, 6)"
            )
        name = f"{file.stem}_{len(recordings) + 1:03d}"
        recordings.append(Recording(wrench, rate_hz=FAILURE_RATE_HZ, label=label.strip(), name=name))
    if not recordings:
        raise FolderError(f"{file}: holds no instance")
    return BenchSet(f"{group}/{file.stem}", group, Dataset(recordings), split="kfold")


def split(
    bench_set: BenchSet, how: str, *, n_folds: int = 5, seeds: int = 2, draws: int = 10, seed: int = 0
) -> tuple[list[Partition], str]:
    """Draw the partitions of a data set, with a line on how.

    Parameters
    ----------
    bench_set : BenchSet
    how : str
        A member of `SPLITS`. ``"auto"``: what the set asks for; else whole sessions where every class has two or
        more, else halves in time order both ways, else stratified folds.
    n_folds, seeds : int
        Of ``"kfold"``: folds, and how often they are drawn anew.
    draws : int
        Of ``"random"``: stratified partitions that test a fifth.
    seed : int
        First seed.

    Raises
    ------
    ValueError
        The set cannot be split this way; the message says why.
    """
    data, why = bench_set.data, ""
    if how == "auto" and bench_set.split != "auto":
        how = bench_set.split
    elif how == "auto":
        found, why = strictest(data)
        how = {"session": "sessions", "chronological": "halves", None: "kfold"}[found]
    why = f" ({why})" if why else ""
    if how == "sessions":
        drawn = session_partitions(data.y, data.sessions, names=data.names)
        n_sessions = len(set(data.sessions.tolist()))
        return drawn, f"sessions: {n_sessions} held out whole, in {len(drawn)} folds"
    if how == "halves":
        basis = describe_order(data.start_times, data.y, data.names)
        order, _ = data.chronological_order()
        return chronological_partitions(data.y, order), f"halves of each class, both ways, {basis}{why}"
    if how == "kfold":
        repeats = range(seed, seed + seeds)
        drawn = [fold for s in repeats for fold in kfold_partitions(data.y, n_folds=n_folds, seed=s)]
        return drawn, f"{n_folds} stratified folds, {seeds} seed{'s' * (seeds > 1)} from {seed}{why}"
    shuffle = StratifiedShuffleSplit(draws, test_size=TEST_SHARE, random_state=seed)
    drawn = [
        Partition("paper", j, f"partition {j + 1}", np.sort(train), np.sort(test))
        for j, (train, test) in enumerate(shuffle.split(data.y, data.y))
    ]
    return drawn, f"{draws} random stratified partitions, a fifth tested, seed {seed}"
