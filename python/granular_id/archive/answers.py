"""Answers of a model about whole archives: which material each recording is of, in files beside the model."""

from __future__ import annotations

import hashlib
import os
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from granular_id import _core
from granular_id._checks import FloatArray
from granular_id._core import GranularIdError
from granular_id._files import absolute
from granular_id._progress import ProgressCallback
from granular_id._text import Table, counted, percent
from granular_id.archive.partitions import ABOUT, Extraction, Outputs, one_of_each, pa, run
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
from granular_id.io.parquet.layout import FLAGS
from granular_id.recording import setup_mismatch

MODEL = "_model.safetensors"
"""Beside the answers: the model that gave them, which workers read."""

_SCHEMA = pa.schema(
    {"answer": pa.string(), "margin": pa.float64(), "probability": pa.float64()}
    | {"candidates": pa.list_(pa.string()), "unknown": pa.bool_()}
    | {"warnings": pa.list_(pa.string()), "trained_on": pa.bool_()}
)
COLUMNS = tuple(_SCHEMA.names)
"""Columns about a recording; null where it has no answer."""


def identify(
    archive: Archive | str | os.PathLike[str],
    model: Identifier | str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    accept: str | Sequence[str] = (),
    n_jobs: int | None = None,
    scheduler: Any = None,
    progress: bool | ProgressCallback = True,
) -> Answers:
    """Name the material of every recording of an archive, into a folder of Parquet files, each exactly once.

    Partitions, resuming and workers are those of `extract`. Answers are those that the model gives of the same
    recordings loaded, to the last bit. Longer recordings begin as in the training: at their first sample, or at their
    trigger, less the lead. Those that are too short, or longer and without trigger, have no answer.

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
    n_jobs, scheduler, progress
        As of `extract`.

    Returns
    -------
    Answers
        ``print(answers.summary())`` shows them by material; ``answers.extraction`` says what was done.

    Raises
    ------
    ValueError
        Other axes, another rate or set-up than in the training, or no recording that is long enough, before any work;
        `out` holds other work.
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
    differences = known.requirements.check(one_of_each(opened, known.rate_hz), accept)
    if (_starts(known, opened.index) < 0).all():
        first = opened.index.slice(0, 1).to_pylist()[0]
        came = f"has {counted(first['n_samples'], 'sample')} and no trigger that leaves enough"
        problem = f"the model takes {known.n_samples}; all {counted(opened.n_recordings)} are like this"
        raise GranularIdError(f"recording {first['name']!r} {came}, {problem}")
    if differences:
        warnings.warn(setup_mismatch(*differences), stacklevel=2)
    content = known.core.to_bytes()
    spec = AnswersSpec(absolute(Path(out) / MODEL), hashlib.sha256(content).hexdigest())
    beside = {MODEL: content}
    extraction = run(opened, spec, out, n_jobs=n_jobs, scheduler=scheduler, progress=progress, beside=beside)
    answers = Answers(out)
    answers.extraction = extraction
    return answers


def _starts(model: Identifier, rows: Any) -> npt.NDArray[np.int64]:
    """Return the sample at which the model's length begins, of rows of the index; -1 where there is no answer."""
    lengths, triggers = integers(rows, "n_samples"), integers(rows, "trigger_index")
    return model.requirements.starts(rows["name"].to_pylist(), lengths, triggers)


@dataclass(frozen=True)
class AnswersSpec:
    """Answers of one model. What travels to workers is where the model lies, not the model."""

    model: str
    sha256: str

    def describe(self) -> dict[str, Any]:
        """Return what decides about the answers."""
        return {Answers.holds: {"model": self.sha256}}

    def table(self, archive: Archive, groups: Sequence[RowGroup]) -> Any:
        """Answers about some row groups, samples of one of them at a time in memory."""
        buffer = np.empty((max(group.n_samples for group in groups), len(archive.axes)))
        model = _model(self.model, self.sha256)
        rows = [row for group in groups for row in _rows(model, archive, group, buffer)]
        return pa.Table.from_pylist(rows, _SCHEMA)


@lru_cache(maxsize=4)
def _model(path: str, sha256: str) -> Identifier:
    """Read a model once a process."""
    content = Path(path).read_bytes()
    if (
        hashlib.sha256(content).hexdigest() != sha256
    ):  # another driver began with another model at the same time
        raise GranularIdError(f"{path} is no longer the model that answers here")
    return Identifier(_core.Model.from_bytes(content, max_file_bytes=len(content)))


def _rows(model: Identifier, archive: Archive, group: RowGroup, buffer: FloatArray) -> list[dict[str, Any]]:
    """Return the columns of each recording of a row group; nothing where it has no answer."""
    index = archive.index.slice(group.start, group.stop - group.start)
    starts, lengths, n = _starts(model, index), integers(index, "n_samples"), model.n_samples
    rows: list[dict[str, Any]] = [{} for _ in starts]
    answered = np.flatnonzero(starts >= 0).tolist()
    if not answered:
        return rows
    flags = np.zeros(group.n_samples, np.uint8)
    samples = buffer[: group.n_samples]
    archive.decode(group, samples, {FLAGS: flags})
    begins = (np.cumsum(lengths) - lengths + starts).tolist()
    if (lengths == n).all():
        X = samples.reshape(-1, n, len(archive.axes))
    else:
        X = np.stack([samples[begins[place] : begins[place] + n] for place in answered])
    marks, digests, is_flagged = known_marks(model), index["digest"].to_pylist(), flags.any()
    for place, X_one, one in zip(answered, X, answers_about(model, X, 1).each(), strict=True):
        own = flags[begins[place] : begins[place] + n] if is_flagged else None
        if marks is not None:  # of samples alone, all of them, the stored digest begins as the mark does
            is_whole = lengths[place] == n and not is_flagged
            one["trained_on"] = (digests[place][:8] if is_whole else mark_of(X_one)) in marks
        rows[place] = {**one, "answer": one["label"], "warnings": flags_in_words(own)}
    return rows


class Answers(Outputs):
    """Answers that `identify` wrote about an archive.

    Parameters
    ----------
    folder : path
        The `out` of `identify`.
    partial : bool, default False
        Take what there is of answers that were stopped, or of which partitions failed; refused by default.

    Attributes
    ----------
    spec : dict
        What decides the answers: the digest of the model, where recordings begin, and the version of this package.
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
        return self.tables(*ABOUT.names, *COLUMNS)

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
        return self.joined(*ABOUT.names, *COLUMNS)

    def summary(self) -> Table:
        """Count the answers by material, with notes on how many are right.

        Materials are those of the model. Beside each: answers, their share, how many recordings of it (as far as known)
        there are, and how many of these were named rightly.
        """
        every = self.joined("label", "answer", "trained_on", "unknown", "candidates", "warnings")
        table = every.filter(every["answer"].is_valid())
        groups = table.group_by(["label", "answer", "trained_on"], use_threads=False)
        counts = {
            (row["label"], row["answer"], row["trained_on"]): row["count_all"]
            for row in groups.aggregate([([], "count_all")]).to_pylist()
        }
        n, classes, rows = len(table), self.model.classes, list[tuple[str, ...]]()
        for name in classes:
            answers = sum(count for (_, answer, _), count in counts.items() if answer == name)
            true = sum(count for (truth, _, _), count in counts.items() if truth == name)
            right = sum(count for (truth, answer, _), count in counts.items() if truth == answer == name)
            share, rightly = (
                percent(part / all_) if all_ else "" for part, all_ in ((answers, n), (right, true))
            )
            rows.append((name, str(answers), share, str(true), rightly))
        header = ("material", "answers", "share", "recordings of it", "named rightly")
        n_columns = 5 if any(truth in classes for truth, _, _ in counts) else 3
        notes = [*notes_of_answers(counts, classes)] if n else []
        unknown = table["unknown"].drop_null().to_numpy()
        compute = need("pyarrow.compute", extra="app", why="to work on archives")
        n_candidates, n_warnings = (
            compute.list_value_length(table[name]).to_numpy() for name in ("candidates", "warnings")
        )
        for is_ruled, marks, words in (
            (unknown.size, unknown, "like no known material"),
            (n_candidates.any(), n_candidates > 1, "with several candidates"),
        ):
            if is_ruled:
                notes.append(f"{marks.sum()} of {counted(n, 'answer')} {words}: {percent(marks.sum() / n)}")
        if n_warnings.any():
            notes.append(
                f"{counted(int((n_warnings > 0).sum()))} with flagged samples: see the column warnings"
            )
        if n < len(every):
            notes.append(f"{counted(len(every) - n)} without an answer: too short, or no trigger")
        if self.unfinished:
            notes.append("not finished: these are the answers that there are")
        simulated = synthetic_words(recordings=bool(self.n_synthetic), model=self.model.synthetic)
        title = f"Materials named in {counted(n)}{', ' + simulated if simulated else ''}"
        return Table(title, header[:n_columns], tuple(row[:n_columns] for row in rows), tuple(notes))
