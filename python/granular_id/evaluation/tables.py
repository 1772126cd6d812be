"""Tables of an evaluation as data, and their plain-text form.

A `Table` holds strings only, so that plain text here and the coloured terminal in the command line show the
same figures.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from granular_id._text import Table, counted, percent, whole_percent
from granular_id.evaluation.scoring import STAGES
from granular_id.recording import of_check
from granular_id.spaces import Chosen
from granular_id.splits import are_blocks, protocol_name
from granular_id.synthetic import PAPER_MATERIALS

if TYPE_CHECKING:
    from granular_id.evaluation.compare import Comparison
    from granular_id.evaluation.result import EvaluationResult
PAPER_NOTE = "* the paper's accuracy on the paper's own recordings (arXiv 2403.17606); not measured here"
SMALL_GAP = 0.01
"""A gap below one point is called none."""

_GAPS_IN_WORDS = 3


def accuracy_table(result: EvaluationResult) -> Table:
    """Accuracy per space for each protocol, then the gap between random draws and the strictest.

    The paper's accuracies stand beside them where the labels are the paper's eleven materials.
    """
    papers = shows_paper(result)
    counts = f"{len(result.names)} recordings, {len(result.labels)} classes, chance {percent(result.chance)}"
    kind = (
        "on SYNTHETIC recordings: says nothing about real materials"
        if result.synthetic
        else "on these recordings"
    )
    header = ["space", "paper*"] if papers else ["space"]
    for protocol in result.protocols:
        header += _columns(result, protocol)
    with_gap = result.random is not None and result.strictest is not None
    if with_gap:
        header.append("gap")
    rows = []
    for space in result.spaces:
        row = [space.name, percent(space.paper_accuracy, 2)] if papers else [space.name]
        for protocol in result.protocols:
            row += _accuracy_cells(result, space.name, protocol)
        if with_gap:
            gap = result.gap(space.name) or 0.0
            row.append(f"{round(100 * gap, 1) + 0.0:.1f}")  # never -0.0
        rows.append(tuple(row))
    notes = [PAPER_NOTE] if papers else []
    title = f"Accuracy {kind} ({counts})"
    return Table(
        title, tuple(header), tuple(rows), (*notes, *gap_lines(result), *map(of_check, result.notes))
    )


def gap_lines(result: EvaluationResult) -> tuple[str, ...]:
    """Say how far the strictest protocol falls below random draws, and what else differs.

    One line a space; of more than three spaces only the best of either protocol, the table has them all.
    """
    random, strictest = result.random, result.strictest
    if random is None or strictest is None:
        return ()
    names = [space.name for space in result.spaces]
    if len(names) > _GAPS_IN_WORDS:
        names = list(dict.fromkeys((result.best_space(random), result.best_space(strictest))))
    lines = [_gap_line(result, name, random, strictest) for name in names]
    sizes = {name: _train_per_class(result, name) for name in (random, strictest)}
    if sizes[random] != sizes[strictest]:
        lines.append(
            f"({protocol_name(random, result.partitions[random])} train on {sizes[random]} recordings of each "
            f"class, {protocol_name(strictest, result.partitions[strictest])} on {sizes[strictest]}: part of a "
            "gap may be that)"
        )
    return tuple(lines)


def _gap_line(result: EvaluationResult, space: str, random: str, strictest: str) -> str:
    gap = result.gap(space) or 0.0
    start = f"{space}: {percent(result.mean_accuracy(space, random))} random, "
    if strictest == "chronological":
        forward, backward = result.accuracies(space, strictest).tolist()
        start += f"{percent(forward)} first half to second half, {percent(backward)} the reverse: "
        what = "training and test from different halves"
    else:
        name = protocol_name(strictest, result.partitions[strictest])
        start += f"{percent(result.mean_accuracy(space, strictest))} on {name}: "
        what = f"{name.removeprefix('held-out ')} held out"
    if gap >= SMALL_GAP:
        return f"{start}{100 * gap:.1f} points less with {what}"
    return f"{start}less than a point is lost"


def controls_table(result: EvaluationResult, space: str | None = None) -> Table:
    """Accuracy of each control under each protocol below that of the method; verdicts in the notes.

    The method is `space`, by default the best under random draws.
    """
    method = space or result.best_space(result.random)
    header = ("control", *(protocol_name(name, drawn) for name, drawn in result.partitions.items()))
    first = (method, *(percent(result.mean_accuracy(method, protocol)) for protocol in result.protocols))
    rows = tuple(
        (control.name, *(percent(control.accuracies.get(protocol)) for protocol in result.protocols))
        for control in result.controls
    )
    notes = tuple(f"{control.name}: {control.what}. {control.verdict}" for control in result.controls)
    title = f"Controls beside the method, {method} (chance {percent(result.chance)}){marked(result)}"
    return Table(title, header, (first, *rows), notes)


def seconds_table(result: EvaluationResult) -> Table:
    """Seconds per stage and space."""
    rows = []
    for space in result.spaces:
        spent = [space.seconds[stage] for stage in STAGES]
        rows.append(
            (space.name, *(f"{value:.2f}" for value in spent), f"{sum(spent):.2f}", str(space.n_features))
        )
    return Table("Seconds, added up over threads", ("space", *STAGES, "sum", "dimension"), tuple(rows))


def confusion_table(result: EvaluationResult, space: str, protocol: str) -> Table:
    """Percent of each true class (row) given each name (column); empty where zero.

    Columns carry the number of a class, rows its number and name, so that many classes fit a line.
    """
    counts = result.confusion(space, protocol)
    tested = counts.sum(axis=1, keepdims=True)
    shares = np.divide(100.0 * counts, tested, out=np.zeros(counts.shape), where=tested > 0)
    width = len(str(len(result.labels)))
    header = ("true \\ named", *(str(k + 1) for k in range(len(result.labels))))
    rows = tuple(
        (f"{k + 1:>{width}} {label}", *(_cell(share, count) for share, count in zip(row, hits, strict=True)))
        for k, (label, row, hits) in enumerate(
            zip(result.labels, shares.tolist(), counts.tolist(), strict=True)
        )
    )
    title = f"Confusion of {space}, {protocol} protocol, in percent of the true class{marked(result)}"
    return Table(title, header, rows)


def recall_table(result: EvaluationResult, space: str) -> Table:
    """Share of each class named rightly under each protocol, the worst under the strictest first."""
    names = [protocol_name(name, drawn) for name, drawn in result.partitions.items()]
    recalls = {protocol: result.recall(space, protocol) for protocol in result.protocols}
    order = np.argsort(recalls[result.strictest or result.protocols[-1]], kind="stable")
    rows = tuple(
        (result.labels[k], *(percent(float(recall[k])) for recall in recalls.values()))
        for k in order.tolist()
    )
    return Table(f"Recall of {space}{marked(result)}", ("class", *names), rows)


def mistakes_table(result: EvaluationResult, space: str, protocol: str, limit: int = 10) -> Table:
    """List the most frequent mistakes, for when the whole matrix would not fit."""
    counts = result.confusion(space, protocol)
    tested = counts.sum(axis=1)
    wrong = counts - np.diag(np.diag(counts))
    order = np.argsort(-wrong, axis=None, kind="stable")[:limit]
    rows = []
    for k, m in zip(*np.unravel_index(order, wrong.shape), strict=True):
        if wrong[k, m] == 0:
            break
        share = f"{wrong[k, m]} of {tested[k]}"
        rows.append((result.labels[k], result.labels[m], share, percent(float(wrong[k, m] / tested[k]))))
    title = f"Most frequent mistakes of {space}, {protocol} protocol{marked(result)}"
    notes = () if rows else ("none: every tested recording was named rightly",)
    return Table(title, ("true", "named", "recordings", "of the class"), tuple(rows), notes)


def comparison_tables(result: EvaluationResult, space: str | None = None) -> tuple[Table, ...]:
    """One space against each other, under random draws and under the strictest protocol.

    None where there is one space only. Default: the space that is best in each protocol.
    """
    if len(result.spaces) < 2:
        return ()
    shown = [name for name in (result.random, result.strictest) if name is not None]
    return tuple(
        result.comparison(protocol).table(of=space or result.best_space(protocol)) for protocol in shown
    )


def _columns(result: EvaluationResult, protocol: str) -> list[str]:
    """Column names of one protocol: the two halves by name, of others a mean, of the first also macro-F1."""
    partitions = result.partitions[protocol]
    if protocol == "chronological":
        return [partition.description for partition in partitions]
    kinds = {
        "paper": "random",
        "kfold": "folds",
        "session": "blocks" if are_blocks(partitions) else "session folds",
    }
    names = [f"{len(partitions)} {kinds[protocol]}"]
    return [*names, "macro-F1"] if protocol == result.protocols[0] else names


def _accuracy_cells(result: EvaluationResult, space: str, protocol: str) -> list[str]:
    values = result.accuracies(space, protocol)
    if protocol == "chronological":
        return [percent(value) for value in values.tolist()]
    sd = result.sd_accuracy(space, protocol)
    spread = "" if math.isnan(sd) else f" ± {100 * sd:.2f}"
    cells = [f"{100 * values.mean():.2f}{spread} %"]
    return [*cells, f"{result.macro_f1(space, protocol):.3f}"] if protocol == result.protocols[0] else cells


def _cell(share: float, count: int) -> str:
    return whole_percent(share) if count else ""


def shows_paper(result: EvaluationResult) -> bool:
    """Whether the paper's accuracies may stand beside these: same materials, so the same task by name."""
    same = set(result.labels) == {material.name for material in PAPER_MATERIALS}
    return same and any(space.paper_accuracy is not None for space in result.spaces)


def marked(result: EvaluationResult) -> str:
    """Return what ends a title where recordings are synthetic, else nothing."""
    return " (SYNTHETIC recordings)" if result.synthetic else ""


def _train_per_class(result: EvaluationResult, protocol: str) -> str:
    sizes = [
        np.bincount(result.truth[partition.train], minlength=len(result.labels))
        for partition in result.partitions[protocol]
    ]
    low, high = int(np.min(sizes)), int(np.max(sizes))
    return str(low) if low == high else f"{low} to {high}"


# Tables of what the spaces that choose took: over all partitions, and in each of them.

_MOST_ROWS = 40
"""Partitions that the second table lists; more are in the JSON file."""


def choice_tables(result: EvaluationResult) -> tuple[Table, ...]:
    """Say what each space that chooses took: over all partitions, then in each of them; none without such a space.

    Parameters
    ----------
    result : EvaluationResult

    Returns
    -------
    tuple of Table
        Two a space.
    """
    found: list[Table] = []
    for space in result.spaces:
        of_protocol = {
            protocol: result.chosen[protocol, space.name]
            for protocol in result.protocols
            if (protocol, space.name) in result.chosen
        }
        if of_protocol:
            found += [_over_all(result, space.name, of_protocol), _of_each(result, space.name, of_protocol)]
    return tuple(found)


def _over_all(result: EvaluationResult, space: str, of_protocol: Mapping[str, Sequence[Chosen]]) -> Table:
    """How often each machine was taken, and its mean accuracy on the folds that chose."""
    every = [one for each in of_protocol.values() for one in each]
    taken = {
        protocol: Counter(k for one in each for k in one.chosen) for protocol, each in of_protocol.items()
    }
    rows = []
    for k, name in enumerate(every[0].machines):
        inside = [one.accuracies[k] for one in every if one.accuracies]
        counts = (f"{taken[protocol][k]} of {len(each)}" for protocol, each in of_protocol.items())
        rows.append((f"{k + 1} {name}", *counts, percent(float(np.mean(inside)) if inside else None)))
    names = [protocol_name(protocol, result.partitions[protocol]) for protocol in of_protocol]
    notes = [
        f"{name}: chosen on {note}"
        for name, each in zip(names, of_protocol.values(), strict=True)
        for note in dict.fromkeys(one.note for one in each)
    ]
    seed = result.space(space).settings.get("own_classifier", {}).get("random_state")
    if seed is not None:
        notes.append(f"seed of random folds: {seed}; the model is the mean of the machines that were taken")
    title = f"What {space} chose: machines taken, of the partitions that trained{marked(result)}"
    return Table(title, ("machine", *names, "held-out accuracy"), tuple(rows), tuple(notes))


def _of_each(result: EvaluationResult, space: str, of_protocol: Mapping[str, Sequence[Chosen]]) -> Table:
    """Machines by number, their accuracy on the folds that chose, and what the partition measured."""
    rows = [
        (
            f"{protocol_name(protocol, result.partitions[protocol])}, {partition.description}",
            " ".join(str(k + 1) for k in one.chosen),
            percent(one.together),
            percent(float(tested)),
        )
        for protocol, each in of_protocol.items()
        for partition, one, tested in zip(
            result.partitions[protocol], each, result.accuracies(space, protocol), strict=True
        )
    ]
    notes = [
        "held out: the machines together, on the recordings of the training that chose them, so too good; "
        "tested: on the recordings of the partition"
    ]
    if len(rows) > _MOST_ROWS:
        notes.append(f"and {len(rows) - _MOST_ROWS} more partitions: the JSON file has all")
    title = f"What {space} chose in each partition{marked(result)}"
    return Table(
        title, ("partition", "machines", "held out", "tested"), tuple(rows[:_MOST_ROWS]), tuple(notes)
    )


# A whole evaluation as plain text.


def plain_text(result: EvaluationResult) -> str:
    """Accuracies with gaps and notes, controls, comparisons, what was chosen, then seconds."""
    controls = (controls_table(result),) if result.controls else ()
    parts = (
        accuracy_table(result),
        *controls,
        *comparison_tables(result),
        *choice_tables(result),
        seconds_table(result),
    )
    return "\n\n".join(map(str, parts))


# The pairs of a comparison as a table, with a note on each column that needs one.

MANN_WHITNEY_MARK = (
    "† Mann-Whitney, as the paper reports it, but far too small: it takes partitions that share recordings for "
    "independent. With 20 random partitions it calls one of two equally good methods better in about 4 of 10 data "
    "sets, not in 1 of 20."
)


def comparison_table(comparison: Comparison, of: str | None = None) -> Table:
    """Return all pairs, or those of one method against each other one; see `Comparison.table`."""
    if of is None:
        pairs = comparison.pairs
    elif of in comparison.names:
        pairs = tuple(comparison.pair(of, other) for other in comparison.names if other != of)
    else:
        raise ValueError(f"of must be one of {', '.join(map(repr, comparison.names))}, got {of!r}")
    count = comparison.n_partitions
    where = f", {comparison.protocol} protocol" if comparison.protocol else ""
    title = f"Differences in accuracy on the same {counted(count, 'partition')}{where}"
    why_not = (comparison.why_not,) if comparison.why_not else ()
    if not comparison.testable:
        plain = tuple((pair.first, pair.second, _points(pair.difference)) for pair in pairs)
        return Table(title, ("first", "second", "points"), plain, why_not)
    header = ("first", "second", "points", "U test†", "p", "Holm", "worse", "equal", "better")
    rows = tuple(
        (
            pair.first,
            pair.second,
            _points(pair.difference),
            *map(_p, (pair.mann_whitney_p, pair.corrected_p, pair.holm_p)),
            *map(probability, (pair.worse, pair.equivalent, pair.better)),
        )
        for pair in pairs
    )
    tests = sum(not math.isnan(pair.corrected_p) for pair in comparison.pairs)
    notes = (
        MANN_WHITNEY_MARK,
        "p: corrected resampled t-test (Nadeau & Bengio 2003); "
        f"Holm: the same, adjusted for {counted(tests, 'pair')}",
        "worse, equal, better: probability that the first is so, equal meaning within "
        f"{100 * comparison.rope:g} % (Bayesian correlated t-test, Corani & Benavoli 2015)",
    )
    return Table(title, header, rows, (*notes, *why_not))


def _points(difference: float) -> str:
    return f"{100 * difference:+.2f}"


def _p(value: float) -> str:
    if math.isnan(value):
        return "-"
    return "<0.001" if value < 0.001 else f"{value:.3f}"


def probability(value: float) -> str:
    """Format a probability so that almost sure and almost impossible keep their rest; ``-`` for NaN."""
    if math.isnan(value):
        return "-"
    return f"{whole_percent(100 * value) if value > 0 else '0'} %"
