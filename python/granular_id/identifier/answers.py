"""Answers about recordings: one about each of many, or one about each window of a long one."""

from __future__ import annotations

import csv
import os
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from granular_id import _core
from granular_id._checks import argument_error, finite_number
from granular_id._columns import samples_of
from granular_id._files import TABLES, refuse_other_kind, whole_file
from granular_id._text import Table, counted, fixed, percent
from granular_id.identifier.metadata import (
    Metadata,
    check_recordings,
    fingerprint,
    mark_of,
    marks_of,
    synthetic_words,
)
from granular_id.identifier.rules import probabilities
from granular_id.recording import Dataset, Recording, SampleFlag, setup_mismatch, unit_of

FloatArray = npt.NDArray[np.float64]

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


@dataclass(frozen=True, eq=False)
class Named:
    """What follows from the samples of n recordings or windows, of a model of K classes."""

    losses: FloatArray  # (n, K) mean loss of each class
    probabilities: FloatArray | None  # (n, K), None of a model that knows none
    verdicts: list[
        tuple[tuple[str, ...], bool | None]
    ]  # candidates; whether it is like none of the materials

    @property
    def order(self) -> npt.NDArray[np.intp]:
        """Classes (n, K) from the likeliest; of equal losses the first label, as everywhere."""
        return np.argsort(self.losses, axis=1, kind="stable")

    @property
    def margin(self) -> FloatArray:
        """Mean loss (n,) of the second class less that of the first."""
        return _margins(self.losses)

    @property
    def probability(self) -> FloatArray | None:
        """That of the likeliest class (n,)."""
        return _of_best(self.losses, self.probabilities)


def named(core: _core.Model, X: FloatArray, threads: int | None = None) -> Named:
    """Name the material of recordings (n, T, C) of a model's length."""
    scores, novelty = core.scores_and_novelty(X, threads)
    losses = core.losses(scores)
    return Named(losses, probabilities(Metadata(core).temperature, losses), core.verdicts(scores, novelty))


def _margins(losses: FloatArray) -> FloatArray:
    two: FloatArray = np.partition(losses, 1, axis=1)[:, :2]
    return two[:, 1] - two[:, 0]


def _of_best(losses: FloatArray, shares: FloatArray | None) -> FloatArray | None:
    return None if shares is None else shares[range(len(losses)), losses.argmin(axis=1)]


def _write_csv(
    path: str | os.PathLike[str], columns: Sequence[str], rows: Iterable[Iterable[object]]
) -> None:
    refuse_other_kind(path, TABLES)
    with whole_file(path) as draft, draft.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(columns)
        writer.writerows(map(_cell, row) for row in rows)


def _cell(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return "" if value is None else repr(value) if isinstance(value, float) else str(value)


# One answer about each recording.


@dataclass(frozen=True)
class Answer:
    """What a model says of one recording, as a final `granular_id.Decision`, and what is known of the recording."""

    name: str
    label: str
    margin: float
    probability: float | None
    truth: str | None  # its label
    warnings: tuple[str, ...]  # what is wrong with its samples
    candidates: tuple[str, ...]
    unknown: bool | None
    trained_on: bool | None  # on these very samples; None where the model does not know its recordings
    ranking: tuple[tuple[str, float], ...]


@dataclass(frozen=True, eq=False)
class Batch:
    """Answers about recordings, in their order; iterate over them."""

    each: tuple[Answer, ...]
    classes: tuple[str, ...]  # that the model knows
    synthetic: str  # what is simulated, in words
    trained_on_these: bool  # exactly
    differences: tuple[str, ...] = ()  # what of their set-up is not as in the training

    def __iter__(self) -> Iterator[Answer]:
        return iter(self.each)

    def __len__(self) -> int:
        return len(self.each)

    @property
    def judged(self) -> tuple[Answer, ...]:
        """Answers about recordings with a label that the model knows."""
        return tuple(answer for answer in self.each if answer.truth in self.classes)

    @property
    def accuracy(self) -> float | None:
        """Share of right answers among `judged`; None where there are none."""
        judged = self.judged
        return sum(n.label == n.truth for n in judged) / len(judged) if judged else None

    @property
    def n_trained_on(self) -> int | None:
        """Recordings that the model was trained on; None where it does not know."""
        known = [answer.trained_on for answer in self.each if answer.trained_on is not None]
        return sum(known) if known else None

    def table(self) -> Table:
        """Return answers, margins and truth as a table with notes."""
        title = f"Materials named{', ' + self.synthetic if self.synthetic else ''}"
        columns = {"recording": [n.name for n in self.each], "answer": [n.label for n in self.each]}
        columns["margin"] = [fixed(n.margin, 3) for n in self.each]
        if any(n.probability is not None for n in self.each):
            columns["probability"] = [percent(n.probability) for n in self.each]
        # There wherever the model has the rule: that it has nothing to say is an answer.
        if any(n.candidates for n in self.each):
            columns["may be"] = [", ".join(n.candidates) for n in self.each]
        if any(n.unknown is not None for n in self.each):
            columns["unknown"] = ["yes" if n.unknown else "" for n in self.each]
        if any(n.truth is not None for n in self.each):
            wrong = [" (!)" if n.truth not in (None, n.label) else "" for n in self.each]
            columns["truth"] = [f"{n.truth or ''}{mark}" for n, mark in zip(self.each, wrong, strict=True)]
        if 0 < (self.n_trained_on or 0) < len(self):
            columns["trained on"] = ["yes" if n.trained_on else "" for n in self.each]
        if any(n.warnings for n in self.each):
            columns["samples"] = [", ".join(n.warnings) for n in self.each]
        rows = tuple(zip(*columns.values(), strict=True))
        return Table(title, tuple(columns), rows, tuple(self._notes()))

    def to_dict(self) -> dict[str, Any]:
        """Return everything in types that JSON knows."""
        return {
            "synthetic": self.synthetic,
            "trained_on_these": self.trained_on_these,
            "n_trained_on": self.n_trained_on,
            "differences": list(self.differences),
            "accuracy": self.accuracy,
            "n_judged": len(self.judged),
            "recordings": [
                vars(n)
                | {
                    "warnings": list(n.warnings),
                    "candidates": list(n.candidates),
                    "ranking": [{"label": label, "mean_loss": loss} for label, loss in n.ranking],
                }
                for n in self.each
            ],
        }

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write one line for each recording, whole or not at all."""
        rows = (
            [
                *(n.name, n.label, n.margin, n.probability, n.truth, "; ".join(n.warnings)),
                *("; ".join(n.candidates), n.unknown, n.trained_on),
            ]
            for n in self.each
        )
        _write_csv(path, CSV_COLUMNS, rows)

    def _notes(self) -> Iterator[str]:
        if self.differences:
            yield f"warning: {setup_mismatch(*self.differences)}"
        counts = Counter((n.truth, n.label, n.trained_on) for n in self.each)
        yield from notes_of_answers(counts, self.classes, trained_on_these=self.trained_on_these)


def notes_of_answers(
    counts: Mapping[tuple[str | None, str, bool | None], int],
    classes: Sequence[str],
    *,
    trained_on_these: bool = False,
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
    if trained_on_these:
        yield "the model was trained on exactly these recordings: this says nothing about new ones"
    elif n_trained_on == n:
        yield "the model was trained on each of these recordings: this says nothing about new ones"
    elif n_trained_on:
        rest = f"; of the others {fresh[True]} of {n_fresh} named rightly" if n_fresh else ""
        yield (
            f"the model was trained on {n_trained_on} of these {counted(n)}, whose answers say nothing about new "
            f"ones{rest}"
        )


def identify_all(core: _core.Model, data: Dataset, differences: tuple[str, ...] = ()) -> Batch:
    """Name the material of every recording of a model's length; `differences` are those of `check_recordings`."""
    answers = named(core, data.X)
    order, margins, probability = answers.order.tolist(), answers.margin.tolist(), answers.probability
    shares = [None] * len(data) if probability is None else probability.tolist()
    known = Metadata(core)
    marks, settings = known.marks, known.trained.get("settings")
    seen = [None] * len(data) if marks is None else [mark in marks for mark in marks_of(data)]
    each = []
    for i, recording in enumerate(data):
        candidates, unknown = answers.verdicts[i]
        ranking = tuple((core.classes[k], float(answers.losses[i, k])) for k in order[i])
        each.append(
            Answer(
                name=recording.name,
                label=ranking[0][0],
                margin=margins[i],
                probability=shares[i],
                truth=recording.label,
                warnings=flags_in_words(recording.flags),
                candidates=candidates,
                unknown=unknown,
                trained_on=seen[i],
                ranking=ranking,
            )
        )
    simulated = synthetic_words(recordings=data.is_synthetic, model=known.trained.get("synthetic", False))
    trained_on_these = False
    if settings is not None and None not in {recording.label for recording in data}:
        trained_on_these = fingerprint(data, settings) == core.metadata["training_sha256"]
    return Batch(tuple(each), core.classes, simulated, trained_on_these, differences)


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


@dataclass(frozen=True, eq=False)
class Timeline:
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
    classes: tuple[str, ...]
    times_s: FloatArray
    losses: FloatArray
    probabilities: FloatArray | None
    candidates: tuple[tuple[str, ...], ...]
    unknown: npt.NDArray[np.bool_] | None
    flagged: npt.NDArray[np.bool_]
    trained_on: npt.NDArray[np.bool_] | None
    window_s: float
    hop_s: float
    duration_s: float
    truth: str | None = None
    synthetic: str = ""
    differences: tuple[str, ...] = ()
    units: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.times_s)

    @property
    def labels(self) -> npt.NDArray[np.str_]:
        """The best material of each window; of tied ones the first of `classes`."""
        labels: npt.NDArray[np.str_] = np.array(self.classes)[self.losses.argmin(axis=1)]
        return labels

    @property
    def margins(self) -> FloatArray:
        """Loss of the second material minus that of the first."""
        return _margins(self.losses)

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

    def shares(self) -> dict[str, float]:
        """Return the share of all answers that each material has, the largest first; of none known as "unknown"."""
        labels = self.labels if self.unknown is None else np.where(self.unknown, "", self.labels)
        return {label or "unknown": n / len(self) for label, n in Counter(labels.tolist()).most_common()}

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
        step = f"one each {self.hop_s:g} s about the last {self.window_s:g} s"
        shares = ", ".join(f"{name} {percent(share, 0)}" for name, share in self.shares().items())
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
                row | {"losses": losses, "candidates": list(candidates)}
                for row, losses, candidates in zip(
                    self._rows(), self.losses.tolist(), self.candidates, strict=True
                )
            ],
        }

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write one line for each answer, whole or not at all."""
        write_csv(path, [self])

    def _rows(self) -> list[dict[str, Any]]:
        n, labels, margins = len(self), self.labels.tolist(), self.margins.tolist()
        probability = _of_best(self.losses, self.probabilities)
        shares = [None] * n if probability is None else probability.tolist()
        unknown = [None] * n if self.unknown is None else self.unknown.tolist()
        trained_on = [None] * n if self.trained_on is None else self.trained_on.tolist()
        ends = [round(end_s, 9) for end_s in self.times_s.tolist()]
        return [
            {
                "from_s": round(ends[i] - self.window_s, 9),
                "to_s": ends[i],
                "label": labels[i],
                "margin": margins[i],
                "probability": shares[i],
                "candidates": "; ".join(self.candidates[i]),
                "unknown": unknown[i],
                "truth": self.truth,
                "flagged": bool(self.flagged[i]),
                "trained_on": trained_on[i],
            }
            for i in range(n)
        ]


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
    every = counted(sum(map(len, timelines)), "window")
    return [
        f"the model was trained on {n_trained_on} of these {every}, and may know parts of the others: answers "
        "about such recordings say nothing about new ones"
    ]


def write_csv(path: str | os.PathLike[str], timelines: Sequence[Timeline]) -> None:
    """Write one line for each answer over some recordings, whole or not at all."""
    rows = ((one.name, *row.values()) for one in timelines for row in one._rows())
    _write_csv(path, OVER_TIME_COLUMNS, rows)


def predict_over(
    core: _core.Model,
    recording: Recording | npt.ArrayLike,
    hop_s: float | None,
    accept: str | Sequence[str],
    threads: int | None,
) -> Timeline:
    """Answer for each window of a recording; see `Identifier.predict_over`."""
    rate_hz, n, known = core.rate_hz, core.n_samples, Metadata(core)
    n_hop = n if hop_s is None else round(finite_number("hop_s", hop_s, positive=True) * rate_hz)
    if n_hop < 1:
        problem = f"={hop_s:g} is less than a sample: at {rate_hz:g} Hz at least {1 / rate_hz:g}"
        raise argument_error(ValueError, "hop_s", problem)
    if not isinstance(recording, Recording):
        if isinstance(recording, Dataset):
            raise TypeError(
                "recording must be one Recording or an array, got a Dataset: pass them one by one"
            )
        samples, _ = samples_of(recording, "recording", known.axes)
        recording = Recording(samples, rate_hz=rate_hz, axes=known.axes)
    differences = check_recordings(Dataset([recording]), core, accept)
    if recording.n_samples < n:
        raise ValueError(
            f"recording {recording.name!r} has {recording.n_samples} samples ({recording.duration_s:g} s), the model "
            f"takes windows of {n} ({n / rate_hz:g} s): record for longer, or train on shorter windows"
        )
    n_hop = min(n_hop, recording.n_samples)
    windows = np.lib.stride_tricks.sliding_window_view(recording.wrench, n, axis=0)[::n_hop]
    marks = known.marks
    blocks = []
    seen: list[bool] = []
    step = max(1, _BLOCK // (n * recording.wrench.shape[1]))
    for begin in range(0, len(windows), step):
        # As each window alone: contiguous, axes last.
        block = np.ascontiguousarray(windows[begin : begin + step].transpose(0, 2, 1))
        blocks.append(named(core, block, threads))
        if marks is not None:
            seen += [mark_of(window) in marks for window in block]
    losses = np.concatenate([block.losses for block in blocks])
    candidates, unknown = zip(*(one for block in blocks for one in block.verdicts), strict=True)
    flags = np.zeros(recording.n_samples, np.bool_) if recording.flags is None else recording.flags != 0
    of_model = known.trained.get("synthetic", False)
    return Timeline(
        name=recording.name,
        classes=core.classes,
        times_s=(n + n_hop * np.arange(len(windows))) / rate_hz,
        losses=losses,
        probabilities=probabilities(known.temperature, losses),
        candidates=candidates,
        unknown=None if unknown[0] is None else np.array(unknown),
        flagged=np.asarray(np.lib.stride_tricks.sliding_window_view(flags, n)[::n_hop].any(axis=1)),
        trained_on=None if marks is None else np.array(seen),
        window_s=n / rate_hz,
        hop_s=n_hop / rate_hz,
        duration_s=recording.n_samples / rate_hz,
        truth=recording.label,
        synthetic=synthetic_words(recordings=recording.is_synthetic, model=of_model),
        differences=differences,
        units=tuple(
            unit_of(axis, recording.meta) or unit for axis, unit in zip(known.axes, known.units, strict=True)
        ),
    )
