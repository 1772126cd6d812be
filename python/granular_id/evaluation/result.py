"""`EvaluationResult`: what an evaluation measured, as figures, tables, JSON and CSV.

Terminal and page show the same tables.
"""

from __future__ import annotations

import csv
import math
import os
import textwrap
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import named
from granular_id._files import TABLES, json_value, refuse_other_kind, whole_file, write_json
from granular_id._text import Table, counted, percent, points, short, whole_percent
from granular_id.evaluation.differences import Gap, Pair, compare
from granular_id.evaluation.leakage import Baseline
from granular_id.evaluation.report_data import ReportData
from granular_id.recording import SEVERE_PREFIXES, Finding, labelled_check_note
from granular_id.score import Held
from granular_id.spaces import Choice
from granular_id.splits import NAMES, PAPER, Folds
from granular_id.statistics import MIN_PARTITIONS
from granular_id.synthetic import PAPER_MATERIALS

FORMAT = "granular_id.evaluation/1"

PAPER_NOTE = "* the paper's accuracy on the paper's own recordings (arXiv 2403.17606); not measured here"

WIDTH = 80
MOST_WORST, MOST_MISTAKES, MOST_FINDINGS, MOST_LINES = 3, 10, 2, 4


@dataclass(frozen=True)
class Prediction:
    """What was answered about one held-out recording.

    Attributes
    ----------
    space : str
        The feature space.
    fold : int
        Which fold held it out, from 0.
    row, recording, session
        Place of the recording in the data set, its name and its session ("" where it is not known).
    label, predicted : str
        The material, and what was answered.
    """

    space: str
    fold: int
    row: int
    recording: str
    session: str
    label: str
    predicted: str


CSV_COLUMNS = (*(one.name for one in fields(Prediction)), "correct")


@dataclass(frozen=True, eq=False, repr=False)
class EvaluationResult:
    """What was answered about held-out recordings, and the figures that follow.

    Made by `granular_id.evaluate`. The fields hold what happened; the methods compute, and store nothing. Accuracies
    are balanced: the mean over materials of the share named right, in [0, 1].

    Parameters
    ----------
    held : mapping of str to Held
        Feature space to the answers about held-out recordings. The first is the headline's.
    folds : Folds
        What was held out, the same for all.
    at_random : mapping of str to tuple of float
        Feature space to its accuracy in each draw of as many recordings at random; empty where none was drawn.
    gap : Gap or None
        What the strict folds cost, tested; None where it could not be measured: `why_no_gap` says why.
    why_no_gap : str
    baselines : tuple of Baseline
        What could be known without touching the material.
    adapted : mapping of str to float array
        Feature space to its accuracy in each fold after adapting to half of the held-out recordings, declared to hold
        all materials, judged on the other half; only where a condition was held out.
    paper_accuracies : mapping of str to float
        What the paper reports for a space on its own recordings. Never measured here.
    findings : tuple of Finding
        What the checks found that spoils an evaluation, accepted or not.
    names : tuple of str
        Name of each recording.
    settings, data, versions : mapping
        Arguments, with the seed; summary and history of the recordings; versions of what computed the numbers.
    report_data : ReportData
        How the recordings look, for a report.
    chosen : mapping of str to tuple of Choice
        Feature space to what its model of each fold chose, where it had a choice.
    notes : tuple of str
        What a reader has to know, one line each.
    synthetic : bool
        True when recordings were simulated: such accuracies say nothing about real materials.
    command : str
        What to type to repeat it.
    wall_s : float
        Seconds from start to end.
    """

    held: Mapping[str, Held]
    folds: Folds
    at_random: Mapping[str, tuple[float, ...]]
    gap: Gap | None
    why_no_gap: str
    baselines: tuple[Baseline, ...]
    adapted: Mapping[str, NDArray[np.float64]]
    paper_accuracies: Mapping[str, float]
    findings: tuple[Finding, ...]
    names: tuple[str, ...]
    settings: Mapping[str, Any]
    data: Mapping[str, Any]
    versions: Mapping[str, str]
    report_data: ReportData
    chosen: Mapping[str, tuple[Choice, ...]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    synthetic: bool = False
    command: str = ""
    wall_s: float = math.nan

    @property
    def spaces(self) -> tuple[str, ...]:
        """Feature spaces, the headline's first."""
        return tuple(self.held)

    @property
    def headline(self) -> Held:
        """The answers of the space that was named first: those that count."""
        return self.held[self.spaces[0]]

    @property
    def labels(self) -> tuple[str, ...]:
        """The K materials; class number k is ``labels[k]``."""
        return self.headline.classes

    @property
    def chance(self) -> float:
        """Accuracy of guessing: one over the number of materials that were tested."""
        return self.headline.chance

    @property
    def spoiling(self) -> tuple[Finding, ...]:
        """Those of `findings` that nobody accepted: the figures mislead."""
        accepted = self.settings.get("accept", ())
        return tuple(finding for finding in self.findings if finding.code not in accepted)

    def of(self, space: str | None = None) -> Held:
        """Return the answers of a feature space, by default the headline's.

        Raises
        ------
        ValueError
            A space that was not evaluated.
        """
        held: Held = self.headline if space is None else named(self.held, "space", space)
        return held

    def accuracy(self, space: str | None = None) -> float:
        """Balanced accuracy of a feature space on held-out recordings, by default the headline's."""
        return self.of(space).accuracy

    def interval(self, space: str | None = None) -> tuple[float, float]:
        """95 % interval of `accuracy` over new sessions, or values of the condition: Student's t over those held out.

        NaN where neither was held out, with fewer than three, and where all answers are right or all are wrong.
        """
        return self.of(space).interval

    def recall(self, space: str | None = None) -> NDArray[np.float64]:
        """Share of each material named right, (K,) in the order of `labels`; NaN for one that was not tested."""
        return self.of(space).recall

    def confusion(self, space: str | None = None) -> NDArray[np.int64]:
        """Return counts (K, K): row true, column named material, in the order of `labels`."""
        return self.of(space).confusion

    def comparison(self) -> tuple[Pair, ...]:
        """Each feature space against every later one on the same folds."""
        return compare(self.held)

    def predictions(self) -> Iterator[Prediction]:
        """Every answer: by space and fold, then row."""
        for space, held in self.held.items():
            for k, row in enumerate(held.rows.tolist()):
                yield Prediction(
                    space=space,
                    fold=int(held.fold[k]),
                    row=row,
                    recording=self.names[row],
                    session=held.sessions[k] or "",
                    label=self.labels[held.truth[k]],
                    predicted=self.labels[held.predicted[k]],
                )

    def table(self) -> str:
        """Return the headline, accuracies, baselines, the worst materials and findings: one screen of text."""
        first = (*spoiled_lines(self), headline(self), *gap_lines(self))
        lines = [textwrap.fill(line, WIDTH) for line in first]
        return "\n".join((*lines, "", str(accuracy_table(self)), *remarks(self)))

    __str__ = table

    def details(self) -> str:
        """Return all that `table` leaves out: folds, mistakes, comparisons, what was chosen, seconds and notes."""
        tables = [fold_table(self), mistakes_table(self), *comparison_tables(self), *choice_tables(self)]
        notes = "\n".join(map(labelled_check_note, self.notes))
        return "\n\n".join(map(str, [*tables, seconds_table(self), *([notes] if notes else [])]))

    def __repr__(self) -> str:
        accuracies = ", ".join(f"{name} {percent(one.accuracy)}" for name, one in self.held.items())
        mark = "SYNTHETIC, " if self.synthetic else ""
        materials = counted(len(self.labels), "material")
        return f"EvaluationResult({mark}{counted(len(self.names))}, {materials}, {self.folds.name}: {accuracies})"

    def to_dict(self) -> dict[str, Any]:
        """Everything, in types that JSON knows; NaN becomes None."""
        return {
            "format": FORMAT,
            "synthetic": self.synthetic,
            "command": self.command,
            "headline": {
                "space": self.spaces[0],
                "held_out": self.folds.name,
                "accuracy": self.accuracy(),
                "interval_95": json_value(self.interval()),
                "chance": self.chance,
                "untested": dict(self.folds.untested),
            },
            "gap": None if self.gap is None else json_value(asdict(self.gap)),
            "why_no_gap": self.why_no_gap,
            "spaces": {name: self._figures(name) for name in self.spaces},
            "baselines": [
                {
                    "name": one.name,
                    "what": one.what,
                    "accuracy": None if one.held is None else one.held.accuracy,
                    "at_random": json_value(one.at_random),
                    "p": json_value(one.p),
                    "why_not": one.why_not,
                }
                for one in self.baselines
            ],
            "comparison": json_value([asdict(pair) for pair in self.comparison()]),
            "findings": [finding.to_dict() for finding in self.findings],
            "notes": list(self.notes),
            "labels": list(self.labels),
            "folds": [json_value(fold._asdict()) for fold in self.folds],
            "recordings": list(self.names),
            "settings": dict(self.settings),
            "data": dict(self.data),
            "versions": dict(self.versions),
            "wall_s": json_value(self.wall_s),
        }

    def _figures(self, space: str) -> dict[str, Any]:
        held = self.held[space]
        return {
            "accuracy": held.accuracy,
            "plain_accuracy": float(held.right.mean()),
            "interval_95": json_value(held.interval),
            "fold_accuracies": held.fold_accuracies().tolist(),
            "at_random": list(self.at_random.get(space, ())),
            "adapted": json_value(self.adapted.get(space)),
            "accuracy_in_the_paper_on_its_own_data": self.paper_accuracies.get(space),
            "recall": json_value(held.recall),
            "confusion": held.confusion.tolist(),
            "rows": held.rows.tolist(),
            "predicted": held.predicted.tolist(),
            "n_features": held.n_features,
            "seconds": dict(held.seconds),
            "chosen": [one.to_dict() for one in self.chosen.get(space, ())],
        }

    def to_json(self, path: str | os.PathLike[str]) -> None:
        """Write figures, settings, folds and predictions as one JSON file; whole or not at all."""
        write_json(path, self.to_dict())

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write one line for each answer of every space; whole or not at all.

        ``fold`` counts from 0, ``row`` is the place of the recording in the data set, ``correct`` is 1 or 0.
        """
        refuse_other_kind(path, TABLES)
        with whole_file(path) as draft, draft.open("w", encoding="utf-8", newline="") as stream:
            writer = csv.writer(stream)
            writer.writerow(CSV_COLUMNS)
            for one in self.predictions():
                writer.writerow((*vars(one).values(), int(one.label == one.predicted)))


# What is printed.


def remarks(result: EvaluationResult) -> list[str]:
    """Name the worst materials, what was not tested, baselines that come near, what is open, warnings of the checks."""
    lines = worst_lines(result)
    untested = list(result.folds.untested.items())
    lines += [f"not tested: {label}, {why}" for label, why in untested[:MOST_WORST]]
    spoiled = {finding.code for finding in result.findings}
    lines += [
        f"the {one.name} alone comes near, in too few sessions to tell it from chance"
        for one in result.baselines
        if one.comes_near(result.headline) and not spoiled & {f"baseline-{one.name}", f"leak-{one.name}"}
    ]
    if result.folds.by not in NAMES:
        more = result.folds.notes[1 : MOST_FINDINGS + 1]
        lines += [textwrap.shorten(note, WIDTH, placeholder=" ...") for note in more]
    lines += [f"accepted: {finding.code}" for finding in result.findings if finding not in result.spoiling]
    lines += [note for note in result.notes if note.startswith("accept: ")]
    warnings = [note for note in result.notes if note.startswith(SEVERE_PREFIXES)]
    left = MOST_LINES
    for note in warnings[:MOST_FINDINGS]:
        together = note.replace(" %", "\N{NO-BREAK SPACE}%")
        wrapped = textwrap.wrap(
            together, WIDTH, subsequent_indent="  ", max_lines=min(left, 3), placeholder=" ... (data check)"
        )
        lines += [line.replace("\N{NO-BREAK SPACE}", " ") for line in wrapped]
        left -= len(wrapped)
    return lines


def spoiled_lines(result: EvaluationResult) -> list[str]:
    """Say what spoils the figures, one line each, the worst first."""
    return [f"SPOILED by {finding.code}: {finding.message}" for finding in result.spoiling]


def headline(result: EvaluationResult) -> str:
    """Say what the space that was named first names right of held-out recordings."""
    low, high = result.interval()
    interval = "" if math.isnan(low) else f"95 % interval {100 * low:.0f} to {100 * high:.0f}, "
    mark = " of SYNTHETIC recordings" if result.synthetic else ""
    return (
        f"{result.spaces[0]} names {percent(result.accuracy())}{mark} right with {result.folds.name} "
        f"({interval}chance {percent(result.chance)})"
    )


def gap_lines(result: EvaluationResult) -> list[str]:
    """Say what the strict folds cost, or why that is not known."""
    if result.gap is None:
        return [f"gap not measured: {result.why_no_gap}"] if result.why_no_gap else []
    of = "" if result.gap.space == result.spaces[0] else f"{result.gap.space}: "
    return [f"{of}{result.gap}"]


def accuracy_table(result: EvaluationResult) -> Table:
    """Balanced accuracy of spaces and baselines: strict, at random, and the gap between them."""
    if result.folds.by == PAPER:
        return _paper_table(result)
    drawn = bool(result.at_random)
    rows = []
    for name, held in result.held.items():
        draws = result.at_random.get(name, ())
        rows.append((name, *_cells(held.accuracy, float(np.mean(draws)) if draws else math.nan, drawn)))
    rows += [
        (f"({one.name})", *_cells(one.held.accuracy, one.at_random, drawn))
        for one in result.baselines
        if one.held is not None
    ]
    header = ("space", result.folds.name, *(("at random", "gap") if drawn else ()))
    materials = counted(len(result.labels), "material")
    title = f"Balanced accuracy: {counted(len(result.names))} of {materials}, {counted(len(result.folds), 'fold')}"
    without = [f"({one.name}) left out: {one.why_not}" for one in result.baselines if one.held is None]
    return Table(title, header, tuple(rows), tuple(without))


def _cells(strict: float, at_random: float, drawn: bool) -> tuple[str, ...]:
    if not drawn:
        return (percent(strict),)
    gap = "-" if math.isnan(at_random) else points(at_random - strict)
    return percent(strict), percent(at_random), gap


def shows_paper(result: EvaluationResult) -> bool:
    """Whether the paper's accuracies may stand beside these: same materials, so the same task by name."""
    return set(result.labels) == {material.name for material in PAPER_MATERIALS} and bool(
        result.paper_accuracies
    )


def _paper_table(result: EvaluationResult) -> Table:
    """Return the paper's table: mean and sample standard deviation over partitions, and its Mann-Whitney test."""
    against = {pair.second: pair for pair in result.comparison() if pair.first == result.spaces[0]}
    rows, papers = [], shows_paper(result)
    for name, held in result.held.items():
        shares = held.fold_accuracies()
        spread = f" ± {100 * float(shares.std(ddof=1)):.2f}" if shares.size > 1 else ""
        p = _p_value(against[name].mann_whitney_p) if name in against else ""
        paper = percent(result.paper_accuracies.get(name), 2) if papers else "-"
        rows.append((name, paper, f"{100 * float(shares.mean()):.2f}{spread} %", p))
    notes = (
        PAPER_NOTE,
        f"p: Mann-Whitney against {result.spaces[0]}, as in the paper; far too small, as partitions share recordings",
    )
    title = (
        f"{counted(len(result.folds), 'random partition')}, {result.folds.notes[0].removeprefix('random: ')}"
    )
    return Table(title, ("space", "paper*", "accuracy", "p"), tuple(rows), notes)


def worst_lines(result: EvaluationResult) -> list[str]:
    """Name the three worst materials, with what each is most often taken for."""
    confusion, recall = result.confusion(), result.recall()
    lines = []
    for k in np.argsort(np.where(np.isnan(recall), np.inf, recall), kind="stable")[:MOST_WORST].tolist():
        wrong = confusion[k].copy()
        wrong[k] = 0
        if wrong.any():
            share = whole_percent(100 * float(wrong.max() / confusion[k].sum()))
            other = short(result.labels[int(wrong.argmax())])
            right = whole_percent(100 * float(recall[k]))
            lines.append(f"worst: {short(result.labels[k])} {right} %, taken for {other} {share} %")
    return lines


def fold_table(result: EvaluationResult) -> Table:
    """Accuracy of the headline's space in each fold; after adapting, too, where a condition was held out."""
    adapted = result.adapted.get(result.spaces[0])
    rows = []
    for k, (fold, share) in enumerate(zip(result.folds, result.headline.fold_accuracies(), strict=True)):
        more = () if adapted is None else (percent(float(adapted[k])),)
        sizes = str(fold.train.size), str(fold.test.size)
        rows.append((short(fold.held_out, 40), *sizes, percent(float(share)), *more))
    header = ("held out", "train", "tested", "accuracy", *(() if adapted is None else ("adapted",)))
    notes = list(result.folds.notes)
    if adapted is not None:
        notes.append(
            "adapted: to half of the held-out recordings, declared to hold all materials; judged on the rest"
        )
    return Table(f"{result.spaces[0]} with {result.folds.name}", header, tuple(rows), tuple(notes))


def comparison_tables(result: EvaluationResult) -> tuple[Table, ...]:
    """Spaces against each other on the same folds; none where there is one space."""
    pairs = result.comparison()
    if not pairs:
        return ()
    tested = len(result.folds) >= MIN_PARTITIONS
    rows = tuple(
        (pair.first, pair.second, f"{100 * pair.difference:+.1f}")
        + ((_p_value(pair.corrected_p), _p_value(pair.holm_p)) if tested else ())
        for pair in pairs
    )
    note = "p: corrected resampled t-test (Nadeau and Bengio 2003); Holm: adjusted for all pairs"
    if not tested:
        note = f"{counted(len(result.folds), 'fold')}: too few for p-values"
    header = ("first", "second", "points", *(("p", "Holm") if tested else ()))
    return (Table(f"Differences with {result.folds.name}", header, rows, (note,)),)


def _p_value(value: float) -> str:
    if math.isnan(value):
        return "-"
    return "<0.001" if value < 0.001 else f"{value:.3f}"


def confusion_table(result: EvaluationResult, space: str | None = None) -> Table:
    """Percent of each true material (row) given each name (column); empty where zero.

    Columns carry the number of a material, rows its number and name, so that many fit a line.
    """
    counts = result.confusion(space)
    tested = counts.sum(axis=1, keepdims=True)
    shares = np.divide(100.0 * counts, tested, out=np.zeros(counts.shape), where=tested > 0)
    numbers = [str(k + 1) for k in range(len(result.labels))]
    rows = (
        (f"{number:>{len(numbers[-1])}} {label}", *(whole_percent(share) if share else "" for share in row))
        for number, label, row in zip(numbers, result.labels, shares.tolist(), strict=True)
    )
    title = f"Confusion of {space or result.spaces[0]}, in percent of the true material"
    return Table(title, ("true \\ named", *numbers), tuple(rows))


def mistakes_table(result: EvaluationResult) -> Table:
    """List the most frequent mistakes of the headline's space."""
    counts = result.confusion()
    tested = counts.sum(axis=1)
    wrong = counts - np.diag(np.diag(counts))
    order = np.argsort(-wrong, axis=None, kind="stable")[:MOST_MISTAKES]
    rows = tuple(
        (
            result.labels[k],
            result.labels[m],
            f"{wrong[k, m]} of {tested[k]}",
            percent(float(wrong[k, m] / tested[k])),
        )
        for k, m in zip(*np.unravel_index(order, wrong.shape), strict=True)
        if wrong[k, m]
    )
    notes = () if rows else ("none: every tested recording was named right",)
    title = f"Most frequent mistakes of {result.spaces[0]}"
    return Table(title, ("true", "named", "recordings", "of the material"), rows, notes)


def recall_table(result: EvaluationResult) -> Table:
    """Share of each material that is named right, the worst first; why some are not tested."""
    recall = result.recall()
    order = np.argsort(np.where(np.isnan(recall), np.inf, recall), kind="stable").tolist()
    rows = tuple((result.labels[k], percent(float(recall[k]))) for k in order)
    notes = tuple(
        f"{label}: {why}; it trains and is not tested" for label, why in result.folds.untested.items()
    )
    return Table(f"Recall of {result.spaces[0]}", ("material", result.folds.name), rows, notes)


def choice_tables(result: EvaluationResult) -> tuple[Table, ...]:
    """How often each candidate model was taken, for each space that chooses one."""
    found = []
    for space, chosen in result.chosen.items():
        taken = Counter(k for one in chosen for k in one.chosen)
        rows = []
        # Without sessions to hold out, candidates with optional blocks, which come last, are not tried.
        most = max(chosen, key=lambda one: len(one.machines))
        for k, machine in enumerate(most.machines):
            tried = [one for one in chosen if len(one.accuracies) and k < len(one.machines)]
            mean = percent(float(np.mean([one.accuracies[:, k].mean() for one in tried])) if tried else None)
            rows.append((f"{k + 1} {machine.name}", f"{taken[k]} of {len(chosen)}", mean))
        notes = tuple(f"chosen on {note}" for note in dict.fromkeys(one.note for one in chosen))
        header = ("candidate", "taken in folds", "held-out accuracy")
        found.append(Table(f"What {space} chose", header, tuple(rows), notes))
    return tuple(found)


def seconds_table(result: EvaluationResult) -> Table:
    """Seconds per stage and space."""

    def row(name: str, held: Held) -> tuple[str, ...]:
        return (name, *(f"{value:.2f}" for value in held.seconds.values()), str(held.n_features))

    stages = tuple(result.headline.seconds)
    rows = tuple(row(name, held) for name, held in result.held.items())
    title = f"Seconds, added up over threads ({result.wall_s:.0f} s in all)"
    return Table(title, ("space", *stages, "dimension"), rows)
