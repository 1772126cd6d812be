"""Answers about recordings: one about each of many, or one about each window of a long one."""

from __future__ import annotations

import csv
import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from granular_id._checks import argument_error, finite_number
from granular_id._core import GranularIdError
from granular_id._files import TABLES, refuse_other_kind, whole_file
from granular_id._text import Table, counted, fixed, percent
from granular_id.identifier.model import (
    TrainedModel,
    known_marks,
    mark_of,
    probabilities,
    synthetic_words,
)
from granular_id.recording import Dataset, Recording, SampleFlag, refuse_tables, setup_mismatch, unit_of

FloatArray = npt.NDArray[np.float64]
Marks = npt.NDArray[np.bool_]

CSV_COLUMNS = (
    *("recording", "label", "margin", "probability", "truth", "warnings"),
    *("candidates", "unknown", "trained_on"),
)
OVER_TIME_COLUMNS = (
    *("recording", "from_s", "to_s", "label", "margin", "probability"),
    *("candidates", "unknown", "truth", "flagged", "trained_on"),
)

_BLOCK = 2**22
"""Values of the windows that are predicted at a time: 32 MB."""

_MOST_STRETCHES, _MOST_ROWS = 6, 40
"""In one sentence, and in a table."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Answers:
    """What a model of K classes says of n recordings or windows, in their order."""

    classes: tuple[str, ...]
    losses: FloatArray  # (n, K) mean loss of each class
    probabilities: FloatArray | None  # (n, K), None of a model that knows none
    candidates: tuple[tuple[str, ...], ...]
    unknown: Marks | None  # (n,) like none of the materials; None of a model that does not say
    trained_on: Marks | None = (
        None  # (n,) on these very samples; None where the model does not know its recordings
    )

    def __len__(self) -> int:
        return len(self.losses)

    @property
    def labels(self) -> npt.NDArray[np.str_]:
        """The best material of each; of tied ones the first of `classes`."""
        labels: npt.NDArray[np.str_] = np.array(self.classes)[self.losses.argmin(axis=1)]
        return labels

    @property
    def margins(self) -> FloatArray:
        """Loss of the second material minus that of the first."""
        two = np.partition(self.losses, 1, axis=1)
        margins: FloatArray = two[:, 1] - two[:, 0]
        return margins

    def each(self) -> Iterator[dict[str, Any]]:
        """Yield label, margin, probability, candidates, unknown and trained_on of each, in plain types."""
        best = self.losses.argmin(axis=1)
        shares = None if self.probabilities is None else self.probabilities[range(len(best)), best]
        columns: dict[str, npt.NDArray[Any] | None] = {
            "label": self.labels,
            "margin": self.margins,
            "probability": shares,
            "unknown": self.unknown,
            "trained_on": self.trained_on,
        }
        lists = [[None] * len(self) if column is None else column.tolist() for column in columns.values()]
        for candidates, *row in zip(self.candidates, *lists, strict=True):
            yield dict(zip(columns, row, strict=True)) | {"candidates": candidates}


def answers_about(model: TrainedModel, X: FloatArray, threads: int | None = None) -> Answers:
    """Name the material of recordings (n, T, C) of a model's length."""
    scores, novelty = model.core.scores_and_novelty(X, threads)
    losses = model.core.losses(scores)
    candidates, unknown = zip(*model.core.apply_rules(scores, novelty), strict=True)
    return Answers(
        classes=model.classes,
        losses=losses,
        probabilities=probabilities(model, losses),
        candidates=candidates,
        unknown=None if unknown[0] is None else np.array(unknown),
    )


def _write_csv(
    path: str | os.PathLike[str], columns: Sequence[str], rows: Iterable[Mapping[str, Any]]
) -> None:
    refuse_other_kind(path, TABLES)
    with whole_file(path) as draft, draft.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(columns)
        writer.writerows([_cell(row[name]) for name in columns] for row in rows)


def _lists(row: dict[str, Any]) -> dict[str, Any]:
    return {name: list(value) if isinstance(value, tuple) else value for name, value in row.items()}


def _cell(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return "; ".join(value)
    return "" if value is None else repr(value) if isinstance(value, float) else str(value)


# One answer about each recording.


@dataclass(frozen=True, eq=False, kw_only=True)
class Batch(Answers):
    """Answers about recordings."""

    names: tuple[str, ...]
    truth: tuple[str | None, ...]  # their labels
    warnings: tuple[tuple[str, ...], ...]  # what is wrong with their samples
    synthetic: str  # what is simulated, in words
    differences: tuple[str, ...]  # what of their set-up is not as in the training

    def each(self) -> Iterator[dict[str, Any]]:
        """Yield the answer about each recording as `Answers.each`, with what is known of the recording."""
        about = zip(self.names, self.truth, self.warnings, strict=True)
        for (name, truth, warnings), row in zip(about, super().each(), strict=True):
            yield {"name": name, **row, "truth": truth, "warnings": warnings}

    def table(self) -> Table:
        """Return answers, margins and truth as a table with notes."""
        each = list(self.each())
        n_trained_on = 0 if self.trained_on is None else int(self.trained_on.sum())
        # A rule has its column wherever the model has it: that it has nothing to say is an answer.
        columns: tuple[tuple[str, bool, Callable[[dict[str, Any]], str]], ...] = (
            ("recording", True, lambda row: row["name"]),
            ("answer", True, lambda row: row["label"]),
            ("margin", True, lambda row: fixed(row["margin"], 3)),
            ("probability", self.probabilities is not None, lambda row: percent(row["probability"])),
            ("may be", any(self.candidates), lambda row: ", ".join(row["candidates"])),
            ("unknown", self.unknown is not None, lambda row: "yes" if row["unknown"] else ""),
            (
                "truth",
                any(self.truth),
                lambda row: (row["truth"] or "") + " (!)" * self._is_wrong(row),
            ),
            ("trained on", 0 < n_trained_on < len(self), lambda row: "yes" if row["trained_on"] else ""),
            ("samples", any(self.warnings), lambda row: ", ".join(row["warnings"])),
        )
        shown = [(title, text) for title, is_there, text in columns if is_there]
        rows = tuple(tuple(text(row) for _, text in shown) for row in each)
        notes = [f"warning: {setup_mismatch(*self.differences)}"] if self.differences else []
        counts = Counter((row["truth"], row["label"], row["trained_on"]) for row in each)
        notes += notes_of_answers(counts, self.classes)
        title = f"Materials named{', ' + self.synthetic if self.synthetic else ''}"
        return Table(title, tuple(title for title, _ in shown), rows, tuple(notes))

    def _is_wrong(self, row: Mapping[str, Any]) -> bool:
        """Whether another material is named; one that the model does not know may be refused instead."""
        truth = row["truth"]
        return truth not in (None, row["label"]) and not (row["unknown"] and truth not in self.classes)

    def to_dict(self) -> dict[str, Any]:
        """Return everything in types that JSON knows."""
        judged = [
            name == truth
            for name, truth in zip(self.labels, self.truth, strict=True)
            if truth in self.classes
        ]
        order = np.argsort(self.losses, axis=1, kind="stable")
        rankings = zip(order.tolist(), self.losses.tolist(), strict=True)
        return {
            "synthetic": self.synthetic,
            "n_trained_on": None if self.trained_on is None else int(self.trained_on.sum()),
            "differences": list(self.differences),
            "accuracy": sum(judged) / len(judged) if judged else None,
            "n_judged": len(judged),
            "recordings": [
                _lists(row)
                | {"ranking": [{"label": self.classes[k], "mean_loss": losses[k]} for k in ranked]}
                for row, (ranked, losses) in zip(self.each(), rankings, strict=True)
            ],
        }

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write one line for each recording, whole or not at all."""
        _write_csv(path, CSV_COLUMNS, ({"recording": row["name"], **row} for row in self.each()))


def identify_all(model: TrainedModel, data: Dataset, differences: tuple[str, ...] = ()) -> Batch:
    """Name the material of every recording of a model's length; `differences` are those of their set-up."""
    marks = known_marks(model)
    seen = None if marks is None else np.array([mark_of(samples) in marks for samples in data.X])
    return Batch(
        **vars(answers_about(model, data.X)) | {"trained_on": seen},
        names=data.names,
        truth=tuple(recording.label for recording in data),
        warnings=tuple(flags_in_words(recording.flags) for recording in data),
        synthetic=synthetic_words(recordings=data.is_synthetic, model=model.synthetic),
        differences=differences,
    )


def notes_of_answers(
    counts: Mapping[tuple[str | None, str, bool | None], int], classes: Sequence[str]
) -> Iterator[str]:
    """Say how many answers are right, and about which recordings they say nothing new.

    `counts`: of recordings by truth, answer, and whether the model was trained on them.
    """
    judged, fresh, others = Counter[bool](), Counter[bool](), Counter[str]()
    mistakes = Counter[tuple[str | None, str]]()
    for (truth, label, trained_on), count in counts.items():
        if truth in classes:
            judged[truth == label] += count
            if truth != label:
                mistakes[truth, label] += count
            if not trained_on:
                fresh[truth == label] += count
        elif truth is not None:
            others[truth] += count
    n, n_judged, n_fresh = sum(counts.values()), judged.total(), fresh.total()
    if n_judged:
        share = percent(judged[True] / n_judged)
        yield f"{judged[True]} of {counted(n_judged)} with a known material named rightly: {share}"
        if mistakes:
            most = (f"{truth} for {label} ({count})" for (truth, label), count in mistakes.most_common(5))
            yield f"mistakes (true for named): {', '.join(most)}"
    if others:
        named_others = ", ".join(f"{label} ({count})" for label, count in others.most_common(5))
        yield f"labels that the model does not know, not counted: {named_others}"
    n_trained_on = sum(count for (_, _, trained_on), count in counts.items() if trained_on)
    if n_trained_on == n:
        yield "the model was trained on each of these recordings: this says nothing about new ones"
    elif n_trained_on:
        rest = f"; of the others {fresh[True]} of {n_fresh} named rightly" if n_fresh else ""
        yield (
            f"the model was trained on {n_trained_on} of these {counted(n)}, whose answers say nothing about new "
            f"ones{rest}"
        )


def flags_in_words(flags: npt.NDArray[np.uint8] | None) -> tuple[str, ...]:
    """Count the samples with each flag, in words."""
    if flags is None:
        return ()
    counts = {flag.name or "": int(np.count_nonzero(flags & flag)) for flag in SampleFlag}
    return tuple(f"{count} {name.lower().replace('_', ' ')}" for name, count in counts.items() if count)


# One answer about each window.


class Stretch(NamedTuple):
    """Answers in a row that say the same: the seconds that they stand for, and how many they are.

    Of a stretch like no known material `label` is the nearest one of most answers.
    """

    from_s: float
    to_s: float
    label: str
    unknown: bool
    n_answers: int
    margin: float

    def sentence(self, digits: int = 1) -> str:
        """Say from when to when it was what."""
        what = f"unknown, nearest {self.label}" if self.unknown else self.label
        return f"{fixed(self.from_s, digits)} to {fixed(self.to_s, digits)} s {what}"


@dataclass(frozen=True, eq=False, kw_only=True)
class Timeline(Answers):
    """Answers over one recording, by `Identifier.predict_over`; ``print`` it for its stretches in a sentence.

    Answer `i` is about the window that ends `times_s[i]` seconds after the beginning of the recording. It stands for
    the time since the answer before; the first one for all of its window. Where the material changes, answers follow
    while the window passes the change: up to `window_s` later.

    Attributes
    ----------
    name : str
        Of the recording.
    classes : tuple of str
        The K materials that the model knows.
    times_s : ndarray, shape (n,)
        End of each window, seconds from the first sample.
    labels : ndarray of str, shape (n,)
        The best material of each window.
    losses : ndarray, shape (n, K)
        Mean loss of each of `classes`: the smallest wins.
    margins : ndarray, shape (n,)
        Loss of the second material minus that of the first.
    probabilities : ndarray, shape (n, K), or None
        Share of each of `classes`, of a model that knows probabilities.
    candidates : tuple of tuple of str
        What each window may be, as in `Decision`; empty tuples without such a rule.
    unknown : ndarray of bool, shape (n,), or None
        Which windows are like none of the materials; None without such a rule.
    flagged : ndarray of bool, shape (n,)
        Which windows hold samples with a flag: filled gaps, saturation.
    trained_on : ndarray of bool, shape (n,), or None
        Which windows, sample for sample, the model was trained on; None where it does not know.
    window_s, hop_s : float
        Length of a window, and the time from one answer to the next.
    duration_s : float
        Length of the recording.
    truth : str or None
        Label of the recording.
    synthetic : str
        What is simulated, in words; empty where nothing is.
    differences : tuple of str
        What of the set-up is not as in the training.
    units : tuple of str
        Unit of each axis: as the recording states it, else that of the training.

    Examples
    --------
    >>> import numpy as np
    >>> import granular_id as gid
    >>> data = gid.synthesize(["rice", "fine sugar"], n_per_class=6, duration_s=0.5)
    >>> model = gid.Identifier.fit(data, "hfmh", estimate=False)
    >>> both = gid.Recording(np.concatenate([data.X[0], data.X[-1]]), rate_hz=500, name="drive")
    >>> answers = model.predict_over(both, hop_s=0.5)
    >>> print(answers)
    SYNTHETIC: drive: 0.0 to 0.5 s rice, then 0.5 to 1.0 s fine sugar
    >>> answers.times_s.tolist(), answers.labels.tolist()
    ([0.5, 1.0], ['rice', 'fine sugar'])
    """

    name: str
    times_s: FloatArray
    flagged: Marks
    window_s: float
    hop_s: float
    duration_s: float
    truth: str | None = None
    synthetic: str = ""
    differences: tuple[str, ...] = ()
    units: tuple[str, ...] = ()

    @property
    def n_right(self) -> int:
        """How many answers name the label of the recording."""
        known = True if self.unknown is None else ~self.unknown
        return int(((self.labels == self.truth) & known).sum())

    @property
    def stretches(self) -> tuple[Stretch, ...]:
        """Answers in a row that say the same, in order; those like no known material are one stretch."""
        labels, margins = self.labels, self.margins
        unknown = np.zeros(len(self), np.bool_) if self.unknown is None else self.unknown
        same = np.where(unknown, "", labels)
        ends = [*(np.flatnonzero(same[1:] != same[:-1]) + 1).tolist(), len(self)]
        made, begin, from_s = [], 0, float(self.times_s[0]) - self.window_s
        for end in ends:
            nearest = Counter(labels[begin:end].tolist()).most_common(1)[0][0]
            to_s = float(self.times_s[end - 1])
            margin = float(margins[begin:end].mean())
            made.append(Stretch(from_s, to_s, nearest, bool(unknown[begin]), end - begin, margin))
            begin, from_s = end, to_s
        return tuple(made)

    def sentence(self) -> str:
        """Return the stretches in a sentence: the first ones where they are many."""
        every = self.stretches
        few = every if len(every) <= _MOST_STRETCHES else every[: _MOST_STRETCHES - 1]
        rest = f", and {len(every) - len(few)} more" if len(few) < len(every) else ""
        digits = 1 if all(abs(10 * s - round(10 * s)) < 1e-6 for s in (self.window_s, self.hop_s)) else 2
        return ", then ".join(one.sentence(digits) for one in few) + rest

    def __str__(self) -> str:
        mark = "SYNTHETIC: " if self.synthetic else ""
        return f"{mark}{self.name}: {self.sentence()}" if self.name else f"{mark}{self.sentence()}"

    def table(self) -> Table:
        """Return the stretches as a table with notes."""
        every = self.stretches
        shown = every[:_MOST_ROWS]
        columns = {
            "seconds": [f"{one.from_s:.2f} to {one.to_s:.2f}" for one in shown],
            "answer": ["unknown" if one.unknown else one.label for one in shown],
            "answers": [str(one.n_answers) for one in shown],
            "mean margin": [fixed(one.margin, 3) for one in shown],
        }
        if any(one.unknown for one in shown):
            columns["nearest"] = [one.label if one.unknown else "" for one in shown]
        title = ", ".join(filter(None, (f"Answers over {self.name or 'the recording'}", self.synthetic)))
        rows = tuple(zip(*columns.values(), strict=True))
        left = len(every) - len(shown)
        more = [f"and {left} more: to_csv, or --csv, has every answer"]
        return Table(title, tuple(columns), rows, (*more[: left > 0], *self._notes()))

    def _notes(self) -> list[str]:
        notes = [f"warning: {setup_mismatch(*self.differences)}"] if self.differences else []
        names = self.labels if self.unknown is None else np.where(self.unknown, "", self.labels)
        counts = Counter(names.tolist()).most_common()
        shares = ", ".join(f"{name or 'unknown'} {percent(n / len(self), 0)}" for name, n in counts)
        step = f"one each {self.hop_s:g} s about the last {self.window_s:g} s"
        notes.append(f"{counted(len(self), 'answer')}, {step}: {shares}")
        if self.truth in self.classes:
            notes.append(f"the recording is labelled {self.truth}: {self.n_right} of {len(self)} name it")
        elif self.truth is not None:
            notes.append(f"the recording is labelled {self.truth}, which the model does not know")
        left_s = self.duration_s - float(self.times_s[-1])
        if left_s > 0.005:
            notes.append(f"the last {fixed(left_s, 2)} s are less than a hop: no answer is about them")
        if self.flagged.any():
            notes.append(
                f"{counted(int(self.flagged.sum()), 'answer')} about samples with a flag (gaps that were filled, "
                "saturation)"
            )
        return [*notes, *trained_on_note([self])]

    def each(self) -> Iterator[dict[str, Any]]:
        """Yield each answer as `Answers.each`, with the seconds that it is about."""
        ends = [round(end_s, 9) for end_s in self.times_s.tolist()]
        for end_s, flagged, row in zip(ends, self.flagged.tolist(), super().each(), strict=True):
            times = {"from_s": round(end_s - self.window_s, 9), "to_s": end_s}
            yield {**times, **row, "truth": self.truth, "flagged": flagged}

    def to_dict(self) -> dict[str, Any]:
        """Return everything in types that JSON knows."""
        return {
            "recording": self.name,
            "synthetic": self.synthetic,
            "differences": list(self.differences),
            "classes": list(self.classes),
            "truth": self.truth,
            "window_s": self.window_s,
            "hop_s": self.hop_s,
            "duration_s": self.duration_s,
            "stretches": [one._asdict() for one in self.stretches],
            "answers": [
                _lists(row) | {"losses": losses}
                for row, losses in zip(self.each(), self.losses.tolist(), strict=True)
            ],
        }

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write one line for each answer, whole or not at all."""
        write_csv(path, [self])


def notes_of_all(timelines: Sequence[Timeline]) -> list[str]:
    """Say what the answers over several recordings are worth."""
    judged = [one for one in timelines if one.truth in one.classes]
    n_right, n = sum(one.n_right for one in judged), sum(map(len, judged))
    of_labels = f"{n_right} of {counted(n, 'answer')} about recordings with a known label name it: "
    return [*([of_labels + percent(n_right / n)] if n else []), *trained_on_note(timelines)]


def trained_on_note(timelines: Sequence[Timeline]) -> list[str]:
    """Say how many windows the model was trained on, where it was on any."""
    n_trained_on = sum(int(one.trained_on.sum()) for one in timelines if one.trained_on is not None)
    if not n_trained_on:
        return []
    n = sum(map(len, timelines))
    others = ", and may know parts of the others" if n_trained_on < n else ""
    return [
        f"the model was trained on {n_trained_on} of these {counted(n, 'window')}{others}: answers about such "
        "recordings say nothing about new ones"
    ]


def write_csv(path: str | os.PathLike[str], timelines: Sequence[Timeline]) -> None:
    """Write one line for each answer over some recordings, whole or not at all."""
    rows = ({"recording": one.name, **row} for one in timelines for row in one.each())
    _write_csv(path, OVER_TIME_COLUMNS, rows)


def timeline_of(
    model: TrainedModel,
    recording: Recording | npt.ArrayLike,
    hop_s: float | None,
    accept: str | Sequence[str],
) -> Timeline:
    """Answer for each window of a recording; see `Identifier.predict_over`."""
    rate_hz, n = model.rate_hz, model.n_samples
    n_hop = n if hop_s is None else round(finite_number("hop_s", hop_s, positive=True) * rate_hz)
    if n_hop < 1:
        problem = f"={hop_s:g} is less than a sample: at {rate_hz:g} Hz at least {1 / rate_hz:g}"
        raise argument_error(GranularIdError, "hop_s", problem)
    if not isinstance(recording, Recording):
        if isinstance(recording, Dataset):
            raise TypeError(
                "recording must be one Recording or an array, got a Dataset: pass them one by one"
            )
        refuse_tables(recording, "recording")
        recording = Recording(np.asarray(recording), rate_hz=rate_hz, axes=model.axes)
    differences = model.requirements.check(Dataset([recording]), accept)
    if recording.n_samples < n:
        raise GranularIdError(
            f"recording {recording.name!r} has {recording.n_samples} samples ({recording.duration_s:g} s), the model "
            f"takes windows of {n} ({n / rate_hz:g} s): record for longer, or train on shorter windows"
        )
    n_hop = min(n_hop, recording.n_samples)
    windows = np.lib.stride_tricks.sliding_window_view(recording.wrench, n, axis=0)[::n_hop]
    marks = known_marks(model)
    blocks: list[Answers] = []
    seen: list[bool] = []
    step = max(1, _BLOCK // (n * recording.wrench.shape[1]))
    for begin in range(0, len(windows), step):
        # As each window alone: contiguous, axes last.
        block = np.ascontiguousarray(windows[begin : begin + step].transpose(0, 2, 1))
        blocks.append(answers_about(model, block))
        if marks is not None:
            seen += [mark_of(window) in marks for window in block]
    losses = np.concatenate([block.losses for block in blocks])
    unknown = [block.unknown for block in blocks if block.unknown is not None]
    flags = np.zeros(recording.n_samples, np.bool_) if recording.flags is None else recording.flags != 0
    return Timeline(
        name=recording.name,
        classes=model.classes,
        times_s=(n + n_hop * np.arange(len(windows))) / rate_hz,
        losses=losses,
        probabilities=probabilities(model, losses),
        candidates=tuple(few for block in blocks for few in block.candidates),
        unknown=np.concatenate(unknown) if unknown else None,
        flagged=np.asarray(np.lib.stride_tricks.sliding_window_view(flags, n)[::n_hop].any(axis=1)),
        trained_on=None if marks is None else np.array(seen),
        window_s=n / rate_hz,
        hop_s=n_hop / rate_hz,
        duration_s=recording.n_samples / rate_hz,
        truth=recording.label,
        synthetic=synthetic_words(recordings=recording.is_synthetic, model=model.synthetic),
        differences=differences,
        units=tuple(
            unit_of(axis, recording.meta) or unit for axis, unit in zip(model.axes, model.units, strict=True)
        ),
    )
