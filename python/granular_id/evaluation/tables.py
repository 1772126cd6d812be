"""Tables of an evaluation; a `Table` holds strings, so that all who show it show the same figures."""

from __future__ import annotations

import math
import textwrap
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from granular_id._text import Table, counted, listed, percent, short, whole_percent
from granular_id.evaluation.features import STAGES
from granular_id.evaluation.outcome import Outcome
from granular_id.partitions import CONDITION
from granular_id.recording import labelled_check_note
from granular_id.spaces import Chosen
from granular_id.statistics import MIN_PARTITIONS, mean_interval
from granular_id.synthetic import PAPER_MATERIALS

PAPER_NOTE = "* the paper's accuracy on the paper's own recordings (arXiv 2403.17606); not measured here"


LONGEST_NOTE = 120
"""Characters of a note below a table; `EvaluationResult.notes` and the report have all of it."""

MOST_MISTAKES = 10
"""Rows of the table of the most frequent mistakes."""


def finding_lines(result: Outcome) -> tuple[str, ...]:
    """Say what spoils the figures, for above them, and how to state that it is known; then what is known already."""
    spoiling = result.spoiling
    known = tuple(finding for finding in result.findings if finding not in spoiling)
    return (
        *(f"SPOILED by {finding.code}: {finding.message}" for finding in spoiling),
        *(f"accepted: {finding.code}: {finding.message}" for finding in known),
    )


def headline(result: Outcome) -> str:
    """Say what the best space names rightly under the strictest protocol, and at random where as many were drawn."""
    space = result.best_space(result.headline)
    strict = percent(result.mean_accuracy(space, result.headline))
    text = f"{space} names {strict} of recordings rightly with {result.protocol_name(result.headline)}"
    if result.exceptions:
        text += f" (but for {listed(list(result.exceptions))}: one session only)"
    if result.random is not None and result.gap(space) is not None:
        text += f", {percent(result.mean_accuracy(space, result.random))} with {result.protocol_name(result.random)}"
    return text


def plain_text(result: Outcome) -> str:
    """Return what spoils the figures, accuracies with gaps, controls, comparisons, choices, then seconds."""
    tables = (
        accuracy_table(result),
        *hold_out_tables(result),
        *((controls_table(result),) if result.controls else ()),
        *comparison_tables(result),
        *choice_tables(result),
        seconds_table(result),
    )
    return "\n\n".join((*finding_lines(result), *map(str, tables)))


def accuracy_table(result: Outcome) -> Table:
    """Accuracy per space for each protocol, the strictest first, then the gap where equals were compared.

    The paper's accuracies stand beside them where the labels are the paper's eleven materials.
    """
    papers = shows_paper(result)
    columns = [("space", [space.name for space in result.spaces])]
    if papers:
        columns.append(("paper*", [percent(space.paper_accuracy, 2) for space in result.spaces]))
    for protocol in _strictest_first(result):
        columns += _columns(result, protocol)
    gaps = [result.gap(space.name) for space in result.spaces]
    if any(gap is not None for gap in gaps):
        columns.append(("gap", [_points(gap or 0.0) for gap in gaps]))
    header, cells = zip(*columns, strict=True)
    kind = (
        "SYNTHETIC recordings: says nothing about real materials" if result.synthetic else "these recordings"
    )
    counts = f"{len(result.names)} recordings, {len(result.labels)} classes, chance {percent(result.chance)}"
    return Table(
        f"Accuracy on {kind} ({counts})",
        header,
        tuple(zip(*cells, strict=True)),
        (*((PAPER_NOTE,) if papers else ()), headline(result), *map(_brief_note, result.notes)),
    )


def _brief_note(note: str) -> str:
    """Cut a note of a result to `LONGEST_NOTE`, and say whose it is."""
    return textwrap.shorten(labelled_check_note(note), LONGEST_NOTE, placeholder=" ...")


def _strictest_first(result: Outcome) -> list[str]:
    return sorted(result.protocols, key=lambda protocol: protocol != result.headline)


def shows_paper(result: Outcome) -> bool:
    """Whether the paper's accuracies may stand beside these: same materials, so the same task by name."""
    same = set(result.labels) == {material.name for material in PAPER_MATERIALS}
    return same and any(space.paper_accuracy is not None for space in result.spaces)


def _columns(result: Outcome, protocol: str) -> list[tuple[str, list[str]]]:
    """Headers and cells of one protocol: the mean over its partitions, of the headline also macro-F1."""
    names = [space.name for space in result.spaces]
    cells = []
    for name in names:
        sd = result.sd_accuracy(name, protocol)
        spread = "" if math.isnan(sd) else f" ± {100 * sd:.2f}"
        cells.append(f"{100 * result.mean_accuracy(name, protocol):.2f}{spread} %")
    mark = "†" if result.exceptions and protocol == "session" else ""
    header = f"{result.protocol_name(protocol)}{mark} ({len(result.partitions[protocol])})"
    columns = [(header, cells)]
    if protocol == result.headline:
        columns.append(("macro-F1", [f"{result.macro_f1(name, protocol):.3f}" for name in names]))
    return columns


def hold_out_tables(result: Outcome) -> tuple[Table, ...]:
    """One table a space with a row for each held-out value of a condition; none where no condition was held out."""
    return tuple(hold_out_table(result, space.name) for space in result.spaces if result.held_out)


def hold_out_table(result: Outcome, space: str) -> Table:
    """Compare what a space names rightly of each held-out value of a condition with as many at random."""
    drawn, beside = result.partitions[CONDITION], result.random
    columns = {"accuracy": result.accuracies(space, CONDITION)}
    columns["balanced"] = balanced = result.balanced_accuracies(space, CONDITION)
    if (shares := result.adapted_accuracies(space)) is not None:
        columns["adapted"] = shares
    columns["at random"] = at_random = result.balanced_accuracies(space, beside)
    names = [partition.description.removeprefix(f"{result.held_out}: ") for partition in drawn]
    rows = [
        (
            short(name, 40),
            str(part.train.size),
            str(part.test.size),
            *(percent(float(shares[k])) for shares in columns.values()),
            _points(at_random[k] - balanced[k]),
        )
        for k, (name, part) in enumerate(zip(names, drawn, strict=True))
    ]
    sizes = [part.train.size for part in drawn], [part.test.size for part in drawn]
    means = tuple(percent(float(shares.mean())) for shares in columns.values())
    rows.append(("mean", "", "", *means, _points(float((at_random - balanced).mean()))))
    ranges = [mean_interval(shares, *sizes) for shares in columns.values()]
    told = tuple("-" if math.isnan(low) else f"{100 * low:.0f} to {100 * high:.0f}" for low, high in ranges)
    rows.append(("95 % interval", "", "", *told, ""))
    notes = [
        "all but accuracy are balanced: the mean over materials; gap: points lost against as many at random"
    ]
    if len(drawn) < MIN_PARTITIONS:
        notes.append(
            f"no interval: {counted(len(drawn), 'value')} tell nothing of how far another one may be off"
        )
    else:
        notes.append(
            f"the interval is that of the mean, not of one more {result.held_out}; it allows for the training that "
            "folds share" + ("; -: no spread to tell it from" if "-" in told else "")
        )
    if "adapted" in columns:
        notes.append("adapted: to the held-out recordings, declared to hold all materials about equally")
    title = f"{space} with one {result.held_out} after the other held out{_mark(result)}"
    header = (str(result.held_out), "train", "tested", *columns, "gap")
    return Table(title, header, tuple(rows), tuple(notes))


def _points(share: float) -> str:
    return f"{round(100 * share, 1) + 0.0:.1f}"  # never -0.0


def controls_table(result: Outcome, space: str | None = None) -> Table:
    """Accuracy of each control below that of the method, under the headline's protocol; verdicts in the notes.

    The method is `space`, by default the best under that protocol.
    """
    method = space or result.best_space(result.headline)
    first = (method, percent(result.mean_accuracy(method, result.headline)))
    return Table(
        f"Controls beside the method, {method} (chance {percent(result.chance)}){_mark(result)}",
        ("control", result.protocol_name(result.headline)),
        (first, *((control.name, percent(control.accuracy)) for control in result.controls)),
        tuple(f"{control.name}: {control.what}; {control.verdict}" for control in result.controls),
    )


def comparison_tables(result: Outcome, space: str | None = None) -> tuple[Table, ...]:
    """One space against each other, under the strictest protocol and under random draws.

    None where there is one space only. Default: the space that is best in each protocol.
    """
    if len(result.spaces) < 2:
        return ()
    return tuple(
        result.comparison(protocol).table(of=space or result.best_space(protocol))
        for protocol in dict.fromkeys((result.headline, result.random))
        if protocol is not None
    )


def seconds_table(result: Outcome) -> Table:
    """Seconds per stage and space."""
    rows = []
    for space in result.spaces:
        spent = [space.seconds[stage] for stage in STAGES]
        rows.append((space.name, *(f"{value:.2f}" for value in (*spent, sum(spent))), str(space.n_features)))
    return Table("Seconds, added up over threads", ("space", *STAGES, "sum", "dimension"), tuple(rows))


def confusion_table(result: Outcome, space: str, protocol: str) -> Table:
    """Percent of each true class (row) given each name (column); empty where zero.

    Columns carry the number of a class, rows its number and name, so that many classes fit a line.
    """
    counts = result.confusion(space, protocol)
    tested = counts.sum(axis=1, keepdims=True)
    shares = np.divide(100.0 * counts, tested, out=np.zeros(counts.shape), where=tested > 0)
    numbers = [str(k + 1) for k in range(len(result.labels))]
    rows = (
        (f"{number:>{len(numbers[-1])}} {label}", *(whole_percent(share) if share else "" for share in row))
        for number, label, row in zip(numbers, result.labels, shares.tolist(), strict=True)
    )
    title = (
        f"Confusion of {space}, {result.protocol_name(protocol)}, in percent of the true class{_mark(result)}"
    )
    return Table(title, ("true \\ named", *numbers), tuple(rows))


def recall_table(result: Outcome, space: str) -> Table:
    """Share of each class named rightly under each protocol, the worst under the strictest first."""
    recalls = {protocol: result.recall(space, protocol) for protocol in _strictest_first(result)}
    order = np.argsort(recalls[result.headline], kind="stable")
    exceptions = result.exceptions
    rows = (
        (
            result.labels[k] + "†" * (result.labels[k] in exceptions),
            *(percent(float(recall[k])) for recall in recalls.values()),
        )
        for k in order.tolist()
    )
    names = (result.protocol_name(protocol) for protocol in recalls)
    notes = tuple(f"† {label}: {what}" for label, what in exceptions.items())
    return Table(f"Recall of {space}{_mark(result)}", ("class", *names), tuple(rows), notes)


def mistakes_table(result: Outcome, space: str, protocol: str) -> Table:
    """List the most frequent mistakes, for when the whole matrix would not fit."""
    counts = result.confusion(space, protocol)
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
    title = f"Most frequent mistakes of {space}, {result.protocol_name(protocol)}{_mark(result)}"
    notes = () if rows else ("none: every tested recording was named rightly",)
    return Table(title, ("true", "named", "recordings", "of the class"), rows, notes)


def choice_tables(result: Outcome) -> tuple[Table, ...]:
    """How often each candidate model was taken, for each space that chooses one."""
    found = []
    for space in result.spaces:
        chosen = {
            protocol: result.chosen[protocol, space.name]
            for protocol in result.protocols
            if (protocol, space.name) in result.chosen
        }
        if chosen:
            found.append(_choices(result, space.name, chosen))
    return tuple(found)


def _choices(result: Outcome, space: str, chosen: Mapping[str, Sequence[Chosen]]) -> Table:
    """How often each candidate was taken, and its mean accuracy on the folds that chose."""
    every = [one for each in chosen.values() for one in each]
    taken = [(Counter(k for one in each for k in one.chosen), len(each)) for each in chosen.values()]
    rows = []
    for k, name in enumerate(every[0].machines):
        held_out = [one.accuracies[k] for one in every if one.accuracies]
        counts = (f"{times[k]} of {total}" for times, total in taken)
        rows.append((f"{k + 1} {name}", *counts, percent(float(np.mean(held_out)) if held_out else None)))
    names = [result.protocol_name(protocol) for protocol in chosen]
    notes = [
        f"{name}: chosen on {note}"
        for name, each in zip(names, chosen.values(), strict=True)
        for note in dict.fromkeys(one.note for one in each)
    ]
    seed = result.space(space).settings.get("own_classifier", {}).get("random_state")
    if seed is not None:
        notes.append(f"seed of random folds: {seed}; the model is the mean of the candidates that were taken")
    title = f"What {space} chose: candidate models taken, of the partitions that trained{_mark(result)}"
    return Table(title, ("candidate", *names, "held-out accuracy"), tuple(rows), tuple(notes))


def _mark(result: Outcome) -> str:
    """Return what ends a title where recordings are synthetic, else nothing."""
    return " (SYNTHETIC recordings)" if result.synthetic else ""
