"""JSON and CSV of an evaluation.

The JSON holds figures, settings, partitions and predictions, enough to load the result back; the CSV holds one
line per prediction. Every figure in the JSON can be recomputed from the CSV alone.
"""

from __future__ import annotations

import csv
import math
import os
from typing import TYPE_CHECKING, Any

from granular_id._files import TABLES, refuse_other_kind, whole_file

if TYPE_CHECKING:
    from granular_id.evaluation.partition import Partition
    from granular_id.evaluation.result import EvaluationResult, SpaceSummary

__all__ = ["CSV_COLUMNS", "FORMAT", "as_dict", "write_csv"]

FORMAT = "granular_id.evaluation/2"
CSV_COLUMNS = (
    "protocol",
    "partition",
    "space",
    "row",
    "recording",
    "session",
    "label",
    "predicted",
    "correct",
)


def as_dict(result: EvaluationResult) -> dict[str, Any]:
    """Return figures, settings, partitions and data summary in types that JSON knows (NaN becomes None)."""
    return {
        "format": FORMAT,
        "synthetic": result.synthetic,
        "command": result.command,
        "notes": list(result.notes),
        "versions": dict(result.versions),
        "settings": dict(result.settings),
        "data": dict(result.data),
        "labels": list(result.labels),
        "chance": result.chance,
        "wall_s": _finite(result.wall_s),
        "spaces": [_space(result, space) for space in result.spaces],
        "controls": [control.to_dict() for control in result.controls],
        "partitions": {
            protocol: [_partition(partition) for partition in partitions]
            for protocol, partitions in result.partitions.items()
        },
        "recordings": [
            {"name": name, "session": session, "label": result.labels[code]}
            for name, session, code in zip(result.names, result.sessions, result.truth.tolist(), strict=True)
        ],
        "portrait": None if result.portrait is None else result.portrait.to_dict(),
    }


def write_csv(result: EvaluationResult, path: str | os.PathLike[str]) -> None:
    """Write one line per prediction with the columns `CSV_COLUMNS`; the file is whole or absent.

    ``partition`` counts from 0, ``row`` is the place of the recording in the data set, ``correct`` is 1 or 0.
    """
    refuse_other_kind(path, TABLES)
    with whole_file(path) as draft, draft.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(CSV_COLUMNS)
        for said in result.predictions():
            writer.writerow(
                (
                    said.protocol,
                    said.partition,
                    said.space,
                    said.row,
                    said.recording,
                    said.session,
                    said.label,
                    said.predicted,
                    int(said.label == said.predicted),
                )
            )


def _space(result: EvaluationResult, space: SpaceSummary) -> dict[str, Any]:
    return {
        "name": space.name,
        "accuracy_in_the_paper_on_its_own_data": space.paper_accuracy,
        "fitted_on_training_rows": space.learns,
        "n_features": space.n_features,
        "settings": dict(space.settings),
        "seconds": dict(space.seconds),
        "gap": result.gap(space.name),
        "protocols": {protocol: _figures(result, space.name, protocol) for protocol in result.protocols},
    }


def _figures(result: EvaluationResult, space: str, protocol: str) -> dict[str, Any]:
    chosen = [one.to_dict() for one in result.chosen.get((protocol, space), ())]
    return {
        "accuracy_mean": result.mean_accuracy(space, protocol),
        "accuracy_sd": _finite(result.sd_accuracy(space, protocol)),
        "accuracies": result.accuracies(space, protocol).tolist(),
        "macro_f1": result.macro_f1(space, protocol),
        "recall": [_finite(share) for share in result.recall(space, protocol).tolist()],
        "confusion": result.confusion(space, protocol).tolist(),
        "predicted": [said.tolist() for said in result.predicted[protocol, space]],
        **({"chosen": chosen} if chosen else {}),
    }


def _partition(partition: Partition) -> dict[str, Any]:
    return {
        "index": partition.index,
        "description": partition.description,
        "train": partition.train.tolist(),
        "test": partition.test.tolist(),
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
