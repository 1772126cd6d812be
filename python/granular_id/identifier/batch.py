"""Answers about many whole recordings at once, beside the truth where it is known."""

from __future__ import annotations

import csv
import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from granular_id import _core
from granular_id._files import TABLES, refuse_other_kind, whole_file
from granular_id._text import Table, counted, fixed, percent
from granular_id.identifier.identifier import Identifier
from granular_id.identifier.metadata import (
    Metadata,
    fingerprint,
    marks_of,
    synthetic_words,
)
from granular_id.identifier.rules import probabilities
from granular_id.recording import Dataset, SampleFlag, setup_mismatch

CSV_COLUMNS = (
    *("recording", "label", "margin", "probability", "truth", "warnings"),
    *("candidates", "unknown", "trained_on"),
)


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
    trained_on: (
        bool | None
    )  # on these very samples; None where the model does not know each of its recordings
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
        return _rightly(judged) / len(judged) if judged else None

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
        refuse_other_kind(path, TABLES)
        with whole_file(path) as draft, draft.open("w", encoding="utf-8", newline="") as stream:
            writer = csv.writer(stream)
            writer.writerow(CSV_COLUMNS)
            for n in self.each:
                probability = "" if n.probability is None else repr(n.probability)
                flags = ["" if flag is None else str(flag).lower() for flag in (n.unknown, n.trained_on)]
                texts = ("; ".join(n.warnings), "; ".join(n.candidates))
                writer.writerow((n.name, n.label, repr(n.margin), probability, n.truth or "", *texts, *flags))

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
            said = (f"{truth} for {label} ({count})" for (truth, label), count in mistakes.most_common(5))
            yield f"mistakes (true for said): {', '.join(said)}"
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


@dataclass(frozen=True, eq=False)
class Named:
    """What a model says of n recordings of K classes: everything that follows from their samples."""

    order: npt.NDArray[
        np.intp
    ]  # (n, K) classes from the likeliest; of equal losses the first label, as everywhere
    losses: npt.NDArray[np.float64]  # (n, K) their mean losses, in this order
    probability: npt.NDArray[np.float64] | None  # (n,) of the first; None of a model that knows none
    verdicts: list[
        tuple[tuple[str, ...], bool | None]
    ]  # candidates, and whether it is like none of the materials

    @property
    def margin(self) -> npt.NDArray[np.float64]:
        """Mean loss (n,) of the second class less that of the first."""
        return self.losses[:, 1] - self.losses[:, 0]


def named(core: _core.Model, X: npt.NDArray[np.float64], threads: int | None = None) -> Named:
    """Name the material of recordings (n, T, C) of a model's length."""
    scores = core.scores(X, threads)
    losses = core.losses(scores)
    order = np.argsort(losses, axis=1, kind="stable")
    probability = None
    if core.sigmoid is not None:
        probability = np.take_along_axis(probabilities(core, scores), order[:, :1], axis=1)[:, 0]
    return Named(order, np.take_along_axis(losses, order, axis=1), probability, core.verdicts(scores))


def identify_all(model: Identifier, data: Dataset, differences: tuple[str, ...] = ()) -> Batch:
    """Name the material of every recording of the model's length; `differences` are those of `check_recordings`."""
    said = named(model.core, data.X)
    margins = said.margin.tolist()
    marks = Metadata(model.core).marks
    seen = [None] * len(data) if marks is None else [mark in marks for mark in marks_of(data)]
    each = []
    for i, recording in enumerate(data):
        candidates, unknown = said.verdicts[i]
        places = zip(said.order[i].tolist(), said.losses[i].tolist(), strict=True)
        ranking = tuple((model.classes[k], loss) for k, loss in places)
        each.append(
            Answer(
                name=recording.name,
                label=ranking[0][0],
                margin=margins[i],
                probability=None if said.probability is None else float(said.probability[i]),
                truth=recording.label,
                warnings=flags_in_words(recording.flags),
                candidates=candidates,
                unknown=unknown,
                trained_on=seen[i],
                ranking=ranking,
            )
        )
    simulated = synthetic_words(recordings=data.is_synthetic, model=model.synthetic)
    trained_on_these = False
    settings = model.trained.get("settings")
    if settings is not None and None not in {recording.label for recording in data}:
        trained_on_these = fingerprint(data, settings) == model.core.metadata["training_sha256"]
    return Batch(tuple(each), model.classes, simulated, trained_on_these, differences)


def _rightly(judged: Sequence[Answer]) -> int:
    return sum(answer.label == answer.truth for answer in judged)


def flags_in_words(flags: npt.NDArray[np.uint8] | None) -> tuple[str, ...]:
    """Count the samples with each flag, in words."""
    if flags is None:
        return ()
    counts = {flag.name or "": int(np.count_nonzero(flags & flag)) for flag in SampleFlag}
    return tuple(f"{count} {name.lower().replace('_', ' ')}" for name, count in counts.items() if count)
