"""Tables of what the spaces that choose took: over all partitions, and in each of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from granular_id.evaluation.chosen import Chosen
from granular_id.evaluation.protocol_names import protocol_name
from granular_id.evaluation.tables import Table, marked, percent

if TYPE_CHECKING:
    from granular_id.evaluation.result import EvaluationResult

__all__ = ["choice_tables"]

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
