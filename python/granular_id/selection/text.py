"""A selection in words: the verdict, and the table of candidates."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from granular_id.evaluation.comparison import MIN_PARTITIONS
from granular_id.evaluation.comparison_table import probability
from granular_id.evaluation.describe import of_check
from granular_id.evaluation.folds import HALVES, RANDOM, SESSIONS
from granular_id.evaluation.metrics import sample_sd
from granular_id.evaluation.statistics import ROPE
from granular_id.evaluation.tables import Table, percent

if TYPE_CHECKING:
    from granular_id.selection.result import Selection

__all__ = ["candidates_table", "verdict"]

SURE = 0.95

EXPECTED_OF = {
    SESSIONS: "in a session that did not train",
    HALVES: "in a stretch of time beside the one that trained; a new session may do worse",
    RANDOM: "of recordings made among those that trained; a new session may do worse",
}


def verdict(selection: Selection) -> str:
    """Say what was chosen, what to expect of it, and how sure that is."""
    lines = (
        ["SYNTHETIC recordings: this choice says nothing about real materials"] if selection.synthetic else []
    )
    best, relative = selection.best, selection.relative_costs[selection.final.cost]
    lines.append(
        f"Take {best.name} with C = {selection.C:.3g} ({relative:g} relative to the spread of the features)"
    )
    low, high = selection.interval
    folds = len(selection.outer)
    if math.isnan(low):
        reach = f" (no interval: {'too few folds' if folds < MIN_PARTITIONS else 'no two folds differ'})"
    else:
        reach = f" (95 % interval {100 * low:.1f} to {100 * high:.1f} %)"
    lines += [
        f"Expect {percent(selection.accuracy)}{reach} {EXPECTED_OF[selection.held_out]}; chance is "
        f"{percent(1 / selection.n_classes)}",
        f"That is the mean over {folds} outer folds of {selection.held_out}, of what was chosen without them",
    ]
    others = ", ".join(f"{name} {n}" for name, n in selection.votes.most_common() if name != best.name)
    same_cost = sum(fold.choice.same_as(selection.final) for fold in selection.outer)
    lines.append(
        f"Agreement: {selection.votes[best.name]} of {folds} outer folds chose the same space and weights, "
        f"{same_cost} the same C too{f'; others chose {others}' if others else ''}"
    )
    lines.append(_how_sure(selection))
    return "\n".join(lines)


def candidates_table(selection: Selection) -> Table:
    """List every candidate at its best C on the outer folds, best first."""
    rows = []
    for k, candidate in enumerate(selection.candidates):
        shares = candidate.accuracies[:, candidate.best_cost]
        rows.append(
            (
                float(shares.mean()),
                (
                    f"{'> ' if k == selection.final.candidate else '  '}{candidate.name}",
                    f"{selection.relative_costs[candidate.best_cost]:g}",
                    percent(float(shares.mean())),
                    f"{100 * sample_sd(shares):.1f}",
                    str(selection.votes[candidate.name]),
                    str(candidate.n_features),
                ),
            )
        )
    rows.sort(key=lambda row: -row[0])
    synthetic = " (SYNTHETIC recordings)" if selection.synthetic else ""
    notes = (
        "accuracy: mean over the outer folds at the candidate's best C; these figures made the choice, so the "
        "highest of them is too good",
        f"> chosen: the simplest of those within one standard error and {100 * ROPE:g} point of the best",
        "chosen by: outer folds whose inner folds chose it; relative C: C times the mean squared distance of the "
        "features from their mean",
    )
    return Table(
        f"Candidates{synthetic}",
        ("candidate", "relative C", "accuracy", "SD", "chosen by", "dimension"),
        tuple(row for _, row in rows),
        (*notes, *map(of_check, selection.notes)),
    )


def _how_sure(selection: Selection) -> str:
    pair = selection.runner_up
    if pair is None:
        return "There was no other candidate to compare with"
    if math.isnan(pair.better):
        why = selection.comparison.why_not if selection.comparison is not None else ""
        return f"Against the best other, {pair.second}: {100 * pair.difference:+.1f} points; {why}"
    shares = (
        f"{probability(pair.better)} better, {probability(pair.equivalent)} equal within "
        f"{100 * ROPE:g} point, {probability(pair.worse)} worse"
    )
    if pair.better > SURE:
        words = "it is better"
    elif pair.equivalent > SURE:
        words = "the two are equal, and this one is taken as the simpler or the first"
    elif pair.better + pair.equivalent > SURE:
        words = "it is not worse"
    elif pair.worse + pair.equivalent > SURE:
        words = "it is not better, and taken as the simpler one"
    else:
        words = "these recordings do not tell which is better"
    return f"Against the best other, {pair.second}: {words} ({shares})"
