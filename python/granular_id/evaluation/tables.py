"""What an evaluation prints: one screen, and details on demand. Terminal and page show the same tables."""

from __future__ import annotations

import math
import textwrap
from collections import Counter

import numpy as np

from granular_id._text import Table, counted, percent, short, whole_percent
from granular_id.evaluation.outcome import Outcome
from granular_id.recording import SEVERE_PREFIXES, labelled_check_note
from granular_id.score import Held
from granular_id.splits import NAMES, PAPER
from granular_id.statistics import MIN_PARTITIONS, sample_sd
from granular_id.synthetic import PAPER_MATERIALS

PAPER_NOTE = "* the paper's accuracy on the paper's own recordings (arXiv 2403.17606); not measured here"

WIDTH = 80
MOST_WORST, MOST_MISTAKES, MOST_FINDINGS = 3, 10, 2


def one_screen(result: Outcome) -> str:
    """Return what spoils the figures, the headline, accuracies and baselines, then remarks."""
    first = (*spoiled_lines(result), headline(result), *gap_lines(result))
    lines = [textwrap.fill(line, WIDTH) for line in first]
    return "\n".join((*lines, "", str(accuracy_table(result)), *remarks(result)))


def remarks(result: Outcome) -> list[str]:
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
    for note in warnings[:MOST_FINDINGS]:
        shown = textwrap.shorten(note, 2 * WIDTH - 10, placeholder=" ... (data check)")
        lines += textwrap.wrap(shown, WIDTH, subsequent_indent="  ")
    return lines


def spoiled_lines(result: Outcome) -> list[str]:
    """Say what spoils the figures, one line each, the worst first."""
    return [f"SPOILED by {finding.code}: {finding.message}" for finding in result.spoiling]


def headline(result: Outcome) -> str:
    """Say what the space that was named first names right of held-out recordings."""
    low, high = result.interval()
    interval = "" if math.isnan(low) else f"95 % interval {100 * low:.0f} to {100 * high:.0f}, "
    mark = " of SYNTHETIC recordings" if result.synthetic else ""
    return (
        f"{result.spaces[0]} names {percent(result.accuracy())}{mark} right with {result.folds.name} "
        f"({interval}chance {percent(result.chance)})"
    )


def gap_lines(result: Outcome) -> list[str]:
    """Say what the strict folds cost, or why that is not known."""
    if result.gap is None:
        return [f"gap not measured: {result.why_no_gap}"] if result.why_no_gap else []
    of = "" if result.gap.space == result.spaces[0] else f"{result.gap.space}: "
    return [f"{of}{result.gap}"]


def accuracy_table(result: Outcome) -> Table:
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
    gap = "-" if math.isnan(at_random) else f"{100 * (at_random - strict) + 0.0:.1f}"
    return percent(strict), percent(at_random), gap


def shows_paper(result: Outcome) -> bool:
    """Whether the paper's accuracies may stand beside these: same materials, so the same task by name."""
    return set(result.labels) == {material.name for material in PAPER_MATERIALS} and bool(
        result.paper_accuracies
    )


def _paper_table(result: Outcome) -> Table:
    """Return the paper's table: mean and sample standard deviation over partitions, and its Mann-Whitney test."""
    against = {pair.second: pair for pair in result.comparison() if pair.first == result.spaces[0]}
    rows, papers = [], shows_paper(result)
    for name, held in result.held.items():
        shares = held.fold_accuracies()
        sd = sample_sd(shares)
        spread = "" if math.isnan(sd) else f" ± {100 * sd:.2f}"
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


def worst_lines(result: Outcome) -> list[str]:
    """Name the three worst materials, with what each is most often taken for."""
    confusion, recall = result.confusion(), result.recall()
    lines = []
    for k in np.argsort(np.where(np.isnan(recall), np.inf, recall), kind="stable")[:MOST_WORST].tolist():
        wrong = confusion[k].copy()
        wrong[k] = 0
        if wrong.any():
            share = percent(float(wrong.max() / confusion[k].sum()), 0)
            other = short(result.labels[int(wrong.argmax())])
            lines.append(
                f"worst: {short(result.labels[k])} {percent(float(recall[k]), 0)}, taken for {other} {share}"
            )
    return lines


def details(result: Outcome) -> str:
    """Return folds, mistakes, comparisons, choices and seconds as tables, then all notes."""
    tables = [fold_table(result), mistakes_table(result), *comparison_tables(result), *choice_tables(result)]
    notes = [labelled_check_note(note) for note in result.notes]
    return "\n\n".join(map(str, [*tables, seconds_table(result), *(["\n".join(notes)] if notes else [])]))


def fold_table(result: Outcome) -> Table:
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


def comparison_tables(result: Outcome) -> tuple[Table, ...]:
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


def confusion_table(result: Outcome, space: str | None = None) -> Table:
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


def mistakes_table(result: Outcome) -> Table:
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


def recall_table(result: Outcome) -> Table:
    """Share of each material that is named right, the worst first; why some are not tested."""
    recall = result.recall()
    order = np.argsort(np.where(np.isnan(recall), np.inf, recall), kind="stable").tolist()
    rows = tuple((result.labels[k], percent(float(recall[k]))) for k in order)
    notes = tuple(
        f"{label}: {why}; it trains and is not tested" for label, why in result.folds.untested.items()
    )
    return Table(f"Recall of {result.spaces[0]}", ("material", result.folds.name), rows, notes)


def choice_tables(result: Outcome) -> tuple[Table, ...]:
    """How often each candidate model was taken, for each space that chooses one."""
    found = []
    for space, chosen in result.chosen.items():
        taken = Counter(k for one in chosen for k in one.chosen)
        rows = []
        for k, machine in enumerate(chosen[0].machines):
            shares = [one.accuracies[:, k].mean() for one in chosen if len(one.accuracies)]
            mean = percent(float(np.mean(shares)) if shares else None)
            rows.append((f"{k + 1} {machine.name}", f"{taken[k]} of {len(chosen)}", mean))
        notes = tuple(f"chosen on {note}" for note in dict.fromkeys(one.note for one in chosen))
        header = ("candidate", "taken in folds", "held-out accuracy")
        found.append(Table(f"What {space} chose", header, tuple(rows), notes))
    return tuple(found)


def seconds_table(result: Outcome) -> Table:
    """Seconds per stage and space."""

    def row(name: str, held: Held) -> tuple[str, ...]:
        return (name, *(f"{value:.2f}" for value in held.seconds.values()), str(held.n_features))

    stages = tuple(result.headline.seconds)
    rows = tuple(row(name, held) for name, held in result.held.items())
    title = f"Seconds, added up over threads ({result.wall_s:.0f} s in all)"
    return Table(title, ("space", *stages, "dimension"), rows)
