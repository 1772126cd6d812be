"""Answers of a model about whole archives: which material each recording is of, in files beside the model."""

from __future__ import annotations

import hashlib
import os
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from granular_id import _core
from granular_id._checks import checked_choice, finite_number
from granular_id._core import GranularIdError
from granular_id._files import absolute
from granular_id._progress import ProgressCallback
from granular_id._text import Table, counted, percent, verb
from granular_id.archive.partitions import ABOUT, Extraction, Outputs, one_of_each, run
from granular_id.identifier import (
    Identifier,
    answers_about,
    flags_in_words,
    known_marks,
    mark_of,
    notes_of_answers,
    synthetic_words,
)
from granular_id.io.files import need
from granular_id.io.parquet.archive import Archive, RowGroup, integers
from granular_id.recording import Begin, setup_mismatch

MODEL = "_model.safetensors"
"""Beside the answers: the model that gave them, which workers read."""

COLUMNS = ("answer", "margin", "probability", "candidates", "unknown", "warnings", "trained_on")
"""What is said of a recording; null where it has no answer."""


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
    content = known.core.to_bytes()
    spec = AnswersSpec(
        model=absolute(Path(out) / MODEL),
        sha256=hashlib.sha256(content).hexdigest(),
        accept=(accept,) if isinstance(accept, str) else tuple(accept),
        begin_at=begin_at,
        lead_s=None if lead_s is None else finite_number("lead_s", lead_s),
        on_short=on_short,
        loaded=known,
    )
    extraction = run(
        opened, spec, out, n_jobs=n_jobs, scheduler=scheduler, progress=progress, beside={MODEL: content}
    )
    answers = Answers(out)
    answers.extraction = extraction
    return answers


@dataclass(frozen=True)
class AnswersSpec:
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

    def describe(self) -> dict[str, Any]:
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
            at = one["trigger_index"]
            came = f"{counted(one['n_samples'], 'sample')} and {'no trigger' if at is None else f'its trigger at {at}'}"
            how_many = f"{len(without)} of {counted(len(starts))} {verb(len(without), 'is', 'are')} like this"
            skip = "" if len(without) == len(starts) else ": pass on_short='skip' to give them no answer"
            problem = f"recording {one['name']!r} has {came}, the model takes {model.n_samples}"
            raise GranularIdError(f"{problem}; {how_many}{skip}")
        if differences:
            warnings.warn(setup_mismatch(*differences), stacklevel=4)  # of `identify`, by `run`

    def table(self, archive: Archive, groups: Sequence[RowGroup]) -> Any:
        """Answers about some row groups, samples of one of them at a time in memory."""
        arrow = need("pyarrow", extra="app", why="to work on archives")
        texts, number, flag = arrow.list_(arrow.string()), arrow.float64(), arrow.bool_()
        kinds = (arrow.string(), number, number, texts, flag, texts, flag)
        buffer = np.empty((max(group.n_samples for group in groups), len(archive.axes)))
        columns = zip(*(row for group in groups for row in self._rows(archive, group, buffer)), strict=True)
        schema = arrow.schema([*zip(COLUMNS, kinds, strict=True)])
        return arrow.table([*map(arrow.array, columns, kinds)], schema)

    def _rows(
        self, archive: Archive, group: RowGroup, buffer: npt.NDArray[np.float64]
    ) -> list[tuple[Any, ...]]:
        """Return a row of `COLUMNS` for each recording of a row group."""
        model, marks = self.identifier, known_marks(self.identifier)
        index = archive.index.slice(group.start, group.stop - group.start)
        answers: list[tuple[Any, ...]] = [(None,) * len(COLUMNS)] * index.num_rows
        starts, lengths, n = self._starts(index), integers(index, "n_samples"), model.n_samples
        answered = np.flatnonzero(starts >= 0)
        if not len(answered):
            return answers
        flags = np.zeros(group.n_samples, np.uint8)
        samples = archive.samples(group, buffer, flags)
        first = (np.cumsum(lengths) - lengths + starts)[answered].tolist()
        if (lengths == n).all():
            X = samples.reshape(-1, n, len(archive.axes))
        else:
            X = np.stack([samples[at : at + n] for at in first])
        digests, any_flags = index["digest"].to_pylist(), flags.any()
        said = answers_about(model, X, 1).each()
        for place, at, X_one, one in zip(answered.tolist(), first, X, said, strict=True):
            own = flags[at : at + n] if any_flags and flags[at : at + n].any() else None
            known = None
            if marks is not None:  # of samples alone, all of them, the stored digest begins as the mark does
                whole = lengths[place] == n and own is None
                known = (digests[place][:8] if whole else mark_of(X_one)) in marks
            about = (one[name] for name in ("label", *COLUMNS[1:5]))
            answers[place] = (*about, flags_in_words(own), known)
        return answers

    def _starts(self, rows: Any) -> npt.NDArray[np.int64]:
        """Sample at which the model's length begins, of rows of the index; -1 where a recording has no answer."""
        lengths, triggers = integers(rows, "n_samples"), integers(rows, "trigger_index")
        names = rows["name"].to_pylist()
        begins: Any = {"begin_at": self.begin_at, "lead_s": self.lead_s}
        return self.identifier.requirements.starts(names, lengths, triggers, **begins)


@lru_cache(maxsize=4)
def _model(path: str, sha256: str) -> Identifier:
    """Read a model once a process."""
    content = Path(path).read_bytes()
    if hashlib.sha256(content).hexdigest() != sha256:
        raise GranularIdError(f"{path} is no longer the model that answers here")
    return Identifier(_core.Model.from_bytes(content, max_file_bytes=len(content)))


class Answers(Outputs):
    """Answers that `identify` wrote about an archive.

    Parameters
    ----------
    folder : path
        The `out` of `identify`.
    partial : bool, default False
        Take what there is of answers that were stopped, or of which partitions failed; refused unless asked for.

    Attributes
    ----------
    spec : dict
        What was asked: the digest of the model, where recordings begin, and the version of this package.
    n_recordings, n_synthetic : int
        Recordings, and how many of them were simulated.
    extraction : Extraction or None
        What `identify` did; None where they are read later.

    Raises
    ------
    FileNotFoundError
        The work is not finished.
    ValueError
        The folder holds something else, or a partition is damaged.

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
    extraction: Extraction | None = None

    def __iter__(self) -> Iterator[Any]:
        """Yield a pyarrow.Table of each partition, so that no more is in memory."""
        return self._tables([*ABOUT, *COLUMNS])

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
        there are, and how many of these were named rightly.
        """
        by_truth = Counter[tuple[str | None, str, bool | None]]()
        n_without, n_flagged, unknown, candidates = 0, 0, Counter[bool | None](), Counter[int]()
        for table in self._tables(["label", "answer", "trained_on", "unknown", "candidates", "warnings"]):
            for *kind, strange, several, flags in zip(*table.to_pydict().values(), strict=True):
                if kind[1] is None:
                    n_without += 1
                    continue
                by_truth[tuple(kind)] += 1
                unknown[strange] += 1
                candidates[len(several)] += 1
                n_flagged += bool(flags)
        n, classes = by_truth.total(), self.model.classes
        answers, true, right = Counter[str](), Counter[str | None](), Counter[str | None]()
        for (truth, answer, _), count in by_truth.items():
            answers[answer] += count
            true[truth] += count
            right[truth] += count * (truth == answer)
        columns = {
            "material": [*classes],
            "answers": [str(answers[name]) for name in classes],
            "share": [percent(answers[name] / n) if n else "" for name in classes],
        }
        if set(true) & set(classes):
            columns["recordings of it"] = [str(true[name]) for name in classes]
            shares = {name: percent(right[name] / true[name]) for name in classes if true[name]}
            columns["named rightly"] = [shares.get(name, "") for name in classes]
        notes = [*notes_of_answers(by_truth, classes)] if n else []
        several = sum(count for size, count in candidates.items() if size > 1)
        for is_ruled, count, words in (
            (set(unknown) - {None}, unknown[True], "like no known material"),
            (set(candidates) - {0}, several, "with several candidates"),
        ):
            if is_ruled:
                notes.append(f"{count} of {counted(n, 'answer')} {words}: {percent(count / n)}")
        if n_flagged:
            notes.append(f"{counted(n_flagged)} with flagged samples: see the column warnings")
        if n_without:
            notes.append(f"{counted(n_without)} without an answer: too short, or no trigger")
        if self.unfinished:
            notes.append("not finished: these are the answers that there are")
        simulated = synthetic_words(recordings=bool(self.n_synthetic), model=self.model.synthetic)
        title = f"Materials named in {counted(n)}{', ' + simulated if simulated else ''}"
        return Table(title, tuple(columns), tuple(zip(*columns.values(), strict=True)), tuple(notes))
