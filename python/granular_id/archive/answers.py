"""Answers of a model about whole archives: which material each recording is of, in files beside the model."""

from __future__ import annotations

import hashlib
import os
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from granular_id import _core
from granular_id._checks import checked_choice, finite_number
from granular_id._files import absolute, durable_file
from granular_id._progress import ProgressCallback
from granular_id._text import Table, counted, percent, verb
from granular_id.archive.extraction import Extraction, run
from granular_id.archive.manifest import MANIFEST, Partitions
from granular_id.archive.work import INDEX_COLUMNS, one_of_each, read_samples
from granular_id.identifier import (
    Identifier,
    answers_about,
    flags_in_words,
    known_marks,
    mark_of,
    notes_of_answers,
    synthetic_words,
)
from granular_id.io.errors import need
from granular_id.io.parquet.archive import Archive, RowGroup
from granular_id.io.parquet.layout import DIGEST
from granular_id.recording import Begin, setup_mismatch

FloatArray = npt.NDArray[np.float64]

MODEL = "_model.safetensors"
"""Beside the answers: the model that gave them, which workers read."""

COLUMNS = ("answer", "margin", "probability", "candidates", "unknown", "warnings", "trained_on")

_KEPT_MODELS = 4


def identify(
    archive: Archive | str | os.PathLike[str],
    model: Identifier | str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    accept: str | Sequence[str] = (),
    begin_at: Begin = "auto",
    lead_s: float | None = None,
    on_short: Literal["raise", "skip"] = "raise",
    n_jobs: int | None = None,
    scheduler: Any = None,
    progress: bool | ProgressCallback = True,
) -> Answers:
    """Name the material of every recording of an archive, into a folder of Parquet files, each exactly once.

    Partitions, resuming and workers are those of `extract`. Answers are those that the model gives of the same
    recordings loaded, to the last bit.

    Parameters
    ----------
    archive : Archive or path
        What `granular_id.save` wrote as "parquet", or `append`.
    model : Identifier or path
        A trained model. A copy of it lies beside the answers, where workers read it.
    out : path
        Folder for the answers; made where there is none. One folder holds the answers of one model about one archive.
    accept : str or sequence of str, default ()
        What of the recordings' set-up may differ from the training though it is refused otherwise: "frame",
        "transform", "sign", "units".
    begin_at : {"auto", "first", "trigger"}, default "auto"
        Where the model's length begins in longer recordings: as in the training, at their first sample, or at their
        trigger, less the lead. Recordings of the model's length begin at their first sample.
    lead_s : float, optional
        Seconds kept ahead of the trigger; default: as in the training.
    on_short : {"raise", "skip"}, default "raise"
        Recordings that are too short, or longer and without trigger: refuse the archive, or give them no answer.
    n_jobs, scheduler, progress
        As of `extract`.

    Returns
    -------
    Answers
        ``print(answers.summary())`` shows them by material; ``answers.extraction`` says what was done.

    Raises
    ------
    ValueError
        Other axes, another rate or set-up than in the training, or recordings too short, before any work; `out`
        holds other work.
    PartitionError, RecordingFileError, OSError, ImportError
        As `extract`.

    Warns
    -----
    UserWarning
        Once, before any work: what else of the set-up is not as in the training.

    Examples
    --------
    >>> import tempfile
    >>> import granular_id as gid
    >>> from granular_id.archive import identify
    >>> data = gid.synthesize(["rice", "fine sugar"], n_per_class=6, duration_s=0.5)
    >>> fresh = gid.synthesize(["rice", "fine sugar"], n_per_class=3, duration_s=0.5, seed=1)
    >>> model = gid.Identifier.fit(data, "hfmh", estimate=False)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     archive = gid.save(fresh, folder + "/archive", "parquet")
    ...     answers = identify(archive, model, folder + "/answers", progress=False)
    ...     table = answers.table
    >>> len(answers), table["answer"].to_pylist() == model.predict(fresh).tolist()
    (6, True)
    """
    opened = archive if isinstance(archive, Archive) else Archive(archive)
    known = model if isinstance(model, Identifier) else Identifier.load(model)
    checked_choice("begin_at", begin_at, "auto", "first", "trigger")
    checked_choice("on_short", on_short, "raise", "skip")
    lead_s = None if lead_s is None else finite_number("lead_s", lead_s)
    folder = Path(out)
    content = known.core.to_bytes()
    work = AnswerWork(
        model=absolute(folder / MODEL),
        sha256=hashlib.sha256(content).hexdigest(),
        accept=(accept,) if isinstance(accept, str) else tuple(accept),
        begin_at=begin_at,
        lead_s=lead_s,
        on_short=on_short,
        loaded=known,
    )
    extraction = run(
        opened,
        work,
        out,
        n_jobs=n_jobs,
        scheduler=scheduler,
        progress=progress,
        prepare=lambda folder: _keep(folder, content),
    )
    answers = Answers(folder)
    answers.extraction = extraction
    return answers


def _keep(folder: Path, content: bytes) -> None:
    """Put the model where workers find it, unless the folder holds something else."""
    path = folder / MODEL
    there = path.read_bytes() if path.is_file() else None
    if there == content:
        return
    if any(folder.glob("*.parquet")) or (folder / MANIFEST).exists():
        other = f"other work already, and no {MODEL}" if there is None else "answers of another model already"
        raise ValueError(f"{folder} holds {other}; name another folder")
    with durable_file(path) as draft:
        draft.write_bytes(content)


@dataclass(frozen=True)
class AnswerWork:
    """Answers of one model. What travels to workers is where the model lies, not the model."""

    model: str
    sha256: str
    accept: tuple[str, ...] = ()
    begin_at: Begin = "auto"
    lead_s: float | None = None
    on_short: Literal["raise", "skip"] = "raise"
    loaded: Identifier | None = field(default=None, repr=False, compare=False)

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "loaded": None}

    @property
    def identifier(self) -> Identifier:
        """The model."""
        return _model(self.model, self.sha256) if self.loaded is None else self.loaded

    def about(self) -> dict[str, Any]:
        """Return what decides about the answers."""
        begins = {"begin_at": self.begin_at, "lead_s": self.lead_s, "on_short": self.on_short}
        return {Answers.holds: {"model": self.sha256, **begins}}

    def check(self, archive: Archive) -> None:
        """Refuse other axes, rates and set-ups, and recordings that are too short; warn of what else is another."""
        model, index = self.identifier, archive.index
        differences = model.requirements.check(one_of_each(archive, model.rate_hz), self.accept)
        starts = self._starts(index)
        without = np.flatnonzero(starts < 0)
        if len(without) == len(starts) or (len(without) and self.on_short == "raise"):
            one = index.slice(int(without[0]), 1).to_pylist()[0]
            trigger = (
                "no trigger" if one["trigger_index"] is None else f"its trigger at {one['trigger_index']}"
            )
            how_many = f"{len(without)} of {counted(len(starts))} {verb(len(without), 'is', 'are')} like this"
            skip = "" if len(without) == len(starts) else ": pass on_short='skip' to give them no answer"
            raise ValueError(
                f"recording {one['name']!r} has {counted(one['n_samples'], 'sample')} and {trigger}, the model takes "
                f"{model.n_samples}; {how_many}{skip}"
            )
        if differences:
            warnings.warn(setup_mismatch(*differences), stacklevel=4)  # of `identify`, by `run`

    def fields(self) -> list[Any]:
        """Fields of the answers; null where a recording has none."""
        arrow = need("pyarrow", extra="app", why="to work on archives")
        text, number, flag = arrow.string(), arrow.float64(), arrow.bool_()
        kinds = (text, number, number, arrow.list_(text), flag, arrow.list_(text), flag)
        return [arrow.field(name, kind) for name, kind in zip(COLUMNS, kinds, strict=True)]

    def columns(self, archive: Archive, group: RowGroup) -> list[Any]:
        """Answers about one row group."""
        arrow = need("pyarrow", extra="app", why="to work on archives")
        rows = archive.index.slice(group.start, group.stop - group.start)
        n, starts = rows.num_rows, self._starts(rows)
        answered = np.flatnonzero(starts >= 0)
        if not len(answered):
            return [arrow.nulls(n, own.type) for own in self.fields()]
        X, flags = self._cropped(archive, group, rows, starts)
        each = list(answers_about(self.identifier, X, 1).each())
        values = (
            *([row[name] for row in each] for name in ("label", *COLUMNS[1:5])),
            [flags_in_words(one) for one in flags],
            self._trained_on(rows, answered, X, flags),
        )
        columns = []
        for of_answered, own in zip(values, self.fields(), strict=True):
            whole: list[Any] = [None] * n
            for place, value in zip(answered.tolist(), of_answered, strict=True):
                whole[place] = value
            columns.append(arrow.array(whole, own.type))
        return columns

    def _starts(self, rows: Any) -> npt.NDArray[np.int64]:
        """Sample at which the model's length begins, of rows of the index; -1 where a recording has no answer."""
        lengths = np.asarray(rows["n_samples"].to_numpy(), np.int64)
        triggers = np.asarray(rows["trigger_index"].fill_null(-1).to_numpy(), np.int64)
        names = _Names(rows)
        return self.identifier.requirements.starts(
            names, lengths, triggers, begin_at=self.begin_at, lead_s=self.lead_s
        )

    def _cropped(
        self, archive: Archive, group: RowGroup, rows: Any, starts: npt.NDArray[np.int64]
    ) -> tuple[FloatArray, list[npt.NDArray[np.uint8] | None]]:
        """Return samples (n, T, C) of the recordings that are answered, and their flags."""
        n, n_axes = self.identifier.n_samples, len(archive.axes)
        lengths = np.asarray(rows["n_samples"].to_numpy(), np.int64)
        answered = np.flatnonzero(starts >= 0)
        if archive.has_flags(group):
            recordings = archive.read(group).recordings
            spans = [(recordings[k], slice(starts[k], starts[k] + n)) for k in answered.tolist()]
            own = [None if one.flags is None else one.flags[span] for one, span in spans]
            return np.stack([one.wrench[span] for one, span in spans]), own
        samples = read_samples(archive, group)
        no_flags: list[npt.NDArray[np.uint8] | None] = [None] * len(answered)
        if (lengths == n).all() and len(answered) == len(lengths):
            return samples.reshape(-1, n, n_axes), no_flags
        begin = (np.cumsum(lengths) - lengths + starts)[answered]
        X = np.empty((len(answered), n, n_axes))
        for row, at in zip(X, begin.tolist(), strict=True):
            row[...] = samples[at : at + n]
        return X, no_flags

    def _trained_on(
        self,
        rows: Any,
        answered: npt.NDArray[np.intp],
        X: FloatArray,
        flags: Sequence[npt.NDArray[np.uint8] | None],
    ) -> list[bool | None]:
        """Tell which recordings the model was trained on; None where it does not know them one by one."""
        marks = known_marks(self.identifier)
        if marks is None:
            return [None] * len(answered)
        stored = rows[DIGEST].to_pylist()
        lengths = rows["n_samples"].to_pylist()
        found: list[bool | None] = []
        for place, samples, own in zip(answered.tolist(), X, flags, strict=True):
            # Of samples alone, all of them, the stored digest begins as the mark does.
            whole = own is None and lengths[place] == len(samples)
            found.append((stored[place][:8] if whole else mark_of(samples)) in marks)
        return found


class _Names(Sequence[str]):
    """Names of recordings, looked up when an error names one."""

    def __init__(self, rows: Any) -> None:
        self._rows = rows

    def __len__(self) -> int:
        return int(self._rows.num_rows)

    def __getitem__(self, place: Any) -> Any:
        return self._rows["name"][place].as_py()


@lru_cache(maxsize=_KEPT_MODELS)
def _model(path: str, sha256: str) -> Identifier:
    """Read a model once a process."""
    content = Path(path).read_bytes()
    if hashlib.sha256(content).hexdigest() != sha256:
        raise ValueError(f"{path} is no longer the model that answers here")
    return Identifier(_core.Model.from_bytes(content, max_file_bytes=len(content)))


class Answers(Partitions):
    """Answers that `identify` wrote about an archive.

    Parameters
    ----------
    folder : path
        The `out` of `identify`.
    partial : bool, default False
        Take what there is where partitions failed; refused unless asked for.

    Attributes
    ----------
    spec : dict
        What was asked: the digest of the model, where recordings begin, and the version of this package.
    n_recordings : int
    sha256 : str
        Over all partitions, as `Extraction.sha256`.
    extraction : Extraction or None
        What `identify` did; None where they are read later.

    Raises
    ------
    FileNotFoundError
        There is no manifest: the work is not finished.
    ValueError
        Partitions failed, are gone or are cut off; the folder holds something else.

    Examples
    --------
    Answers come partition by partition as pyarrow tables, or in one:

    >>> import tempfile
    >>> import granular_id as gid
    >>> from granular_id.archive import Answers, identify
    >>> data = gid.synthesize(["rice", "fine sugar"], n_per_class=6, duration_s=0.5)
    >>> model = gid.Identifier.fit(data, "hfmh", estimate=False)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = identify(gid.save(data, folder + "/a", "parquet"), model, folder + "/out", progress=False)
    ...     answers = Answers(folder + "/out")
    ...     names = answers.table.column_names
    >>> names[:4], names[5:]
    (['name', 'label', 'session', 'start_time'], ['answer', 'margin', 'probability', 'candidates', 'unknown', \
'warnings', 'trained_on'])
    """

    holds = "answers"
    again = "identify again, which answers what is missing"

    extraction: Extraction | None = None

    def __iter__(self) -> Iterator[Any]:
        """Yield a pyarrow.Table of each partition, so that no more is in memory."""
        return map(self._read, self._files)

    def __repr__(self) -> str:
        return f"Answers({os.fspath(self.folder)!r}: {counted(len(self))})"

    @cached_property
    def model(self) -> Identifier:
        """The model that gave them."""
        return Identifier.load(self.folder / MODEL)

    @property
    def table(self) -> Any:
        """All answers, a pyarrow.Table, in the order of the archive.

        Name, label (the truth, null where it is not known), session, start_time and digest of each recording; then
        ``answer``, ``margin``, ``probability`` (null where the model knows none), ``candidates``, ``unknown`` (null
        where the model has no such rule), ``warnings`` (flagged samples) and ``trained_on`` (null where the model
        does not know its recordings one by one).
        """
        arrow = need("pyarrow", extra="app", why="to work on archives")
        return arrow.concat_tables(list(self))

    def summary(self) -> Table:
        """Count the answers by material, with notes on how many are right.

        Materials are those of the model. Beside each: answers, their share, how many recordings of it (as far as known)
        were named rightly, and how many answers are of no known material, or have several candidates.
        """
        found, classes = _Counts.of(self), self.model.classes
        n, true, right = found.answers.total(), Counter[str | None](), Counter[str | None]()
        for (truth, answer, _), count in found.by_truth.items():
            true[truth] += count
            right[truth] += count * (truth == answer)

        def shares(part: Mapping[Any, int], whole: Mapping[Any, int]) -> list[str]:
            return [percent(part[name] / whole[name]) if whole[name] else "" for name in classes]

        columns = {
            "material": list(classes),
            "answers": [str(found.answers[name]) for name in classes],
            "share": [percent(found.answers[name] / n) if n else "" for name in classes],
        }
        if set(true) & set(classes):
            columns["recordings of it"] = [str(true[name]) for name in classes]
            columns["named rightly"] = shares(right, true)
        notes = list(notes_of_answers(found.by_truth, classes)) if n else []
        of_rules = (
            (found.knows_unknown, "unknown", found.unknown, "like no known material"),
            (found.knows_candidates, "several candidates", found.several, "with several candidates"),
        )
        for is_there, title, own, words in of_rules:
            if is_there:
                columns[title] = shares(own, found.answers)
                notes.append(f"{own.total()} of {counted(n, 'answer')} {words}: {percent(own.total() / n)}")
        if found.n_flagged:
            notes.append(f"{counted(found.n_flagged)} with flagged samples: see the column warnings")
        if found.n_without:
            notes.append(f"{counted(found.n_without)} without an answer: too short, or no trigger")
        if self._n_failed:
            failed = counted(self._n_failed, "partition")
            notes.append(f"{failed} failed and {verb(self._n_failed, 'is', 'are')} left out")
        simulated = synthetic_words(recordings=self._synthetic, model=self.model.synthetic)
        title = f"Materials named in {counted(n)}{', ' + simulated if simulated else ''}"
        return Table(title, tuple(columns), tuple(zip(*columns.values(), strict=True)), tuple(notes))

    def _read(self, file: str) -> Any:
        with self._opened(file) as opened:
            return opened.read([*INDEX_COLUMNS, *COLUMNS])


@dataclass
class _Counts:
    """Answers, counted partition by partition."""

    answers: Counter[str] = field(default_factory=Counter)
    unknown: Counter[str] = field(default_factory=Counter)
    several: Counter[str] = field(default_factory=Counter)
    by_truth: Counter[tuple[str | None, str, bool | None]] = field(default_factory=Counter)
    n_without: int = 0
    n_flagged: int = 0
    knows_unknown: bool = False
    knows_candidates: bool = False

    @classmethod
    def of(cls, tables: Iterable[Any]) -> _Counts:
        """Count the answers of several tables."""
        counts = cls()
        for table in tables:
            counts.add(table)
        return counts

    def add(self, table: Any) -> None:
        """Count those of one more table."""
        compute = need("pyarrow.compute", extra="app", why="to work on archives")
        self.n_without += table["answer"].null_count
        table = table.filter(compute.is_valid(table["answer"]))
        sizes = compute.list_value_length(table["candidates"])
        self.n_flagged += (
            compute.sum(compute.greater(compute.list_value_length(table["warnings"]), 0)).as_py() or 0
        )
        self.knows_unknown |= table["unknown"].null_count < table.num_rows
        self.knows_candidates |= (compute.max(sizes).as_py() or 0) > 0
        table = table.append_column("several", compute.greater(sizes, 1))
        keys = ["label", "answer", "trained_on", "unknown", "several"]
        grouped = table.group_by(keys, use_threads=False).aggregate([([], "count_all")])
        for row in grouped.to_pylist():
            answer, count = row["answer"], row["count_all"]
            self.by_truth[row["label"], answer, row["trained_on"]] += count
            self.answers[answer] += count
            self.unknown[answer] += count * bool(row["unknown"])
            self.several[answer] += count * bool(row["several"])
