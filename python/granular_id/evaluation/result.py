"""`EvaluationResult`: what an evaluation measured, as tables, JSON, CSV and HTML."""

from __future__ import annotations

import csv
import os
from dataclasses import fields
from importlib import import_module
from typing import Any

from granular_id._files import TABLES, json_value, refuse_other_kind, whole_file, write_json
from granular_id._text import Table, counted, percent
from granular_id.evaluation.outcome import Outcome, Prediction, SpaceSummary
from granular_id.evaluation.tables import hold_out_table, plain_text
from granular_id.partitions import CONDITION

FORMAT = "granular_id.evaluation/1"
CSV_COLUMNS = (*(field.name for field in fields(Prediction)), "correct")


class EvaluationResult(Outcome):
    """Predictions of every partition, and the figures that follow from them.

    Made by `granular_id.evaluate`. The fields hold what happened; the methods compute, and store nothing.

    Parameters
    ----------
    spaces : tuple of SpaceSummary
        In the order of the table.
    partitions : mapping of str to tuple of Partition
        Protocol name to its partitions.
    predicted : mapping of (str, str) to tuple of int arrays
        (protocol, space) to the class numbers predicted for ``partition.test``, one array per partition.
    labels : tuple of str
        The K classes; class number k is ``labels[k]``.
    truth : (n,) int array
        Class number of each recording.
    names, sessions : tuple of str
        Name and session (empty when unknown) of each recording.
    settings : mapping
        Arguments of the evaluation, with the seed, the classifier and its parameters.
    data : mapping
        Summary of the recordings and the history of the steps that prepared them.
    versions : mapping of str to str
        Versions of what computed the numbers.
    report_data : ReportData
        How the recordings look, for a report.
    notes : tuple of str
        What a reader has to know, one line each.
    synthetic : bool
        True when recordings were simulated: such accuracies say nothing about real materials.
    command : str
        What to type to repeat it.
    controls : tuple of Control
        What could have been answered without the method; empty when they were not asked for.
    chosen : mapping of (str, str) to tuple of Chosen
        (protocol, space) to what the classifier of the space chose in each partition, of spaces that choose.
    wall_s : float
        Seconds that passed from start to end, controls included.
    findings : tuple of Finding
        What the checks found that spoils an evaluation. `spoiling` are those that ``evaluate(accept=...)`` did not
        name.
    adapted : mapping of str to tuple of int arrays
        Space to the class numbers after adapting to the recordings of a held-out condition, one array per value.
    """

    def table(self) -> str:
        """Return what spoils the figures, and tables of accuracies, gaps, choices and seconds, as plain text.

        Long notes are cut: `notes` and the report have all of them.
        """
        return plain_text(self)

    __str__ = table

    def hold_out_table(self, space: str | None = None) -> Table:
        """One row for each value of the condition that was held out: accuracies, and those of as many at random.

        Below them their mean with a 95 % interval, which needs three values. ``print`` shows it.

        Parameters
        ----------
        space : str, optional
            Name of a feature space; default: the best.

        Raises
        ------
        ValueError
            No condition was held out.
        """
        if self.held_out is None:
            raise ValueError("no condition was held out: pass hold_out= to evaluate")
        return hold_out_table(self, self.space(space or self.best_space(self.headline)).name)

    def __repr__(self) -> str:
        means = ", ".join(
            f"{s.name} {percent(self.mean_accuracy(s.name, self.headline))}" for s in self.spaces
        )
        mark = "SYNTHETIC, " if self.synthetic else ""
        return f"EvaluationResult({mark}{counted(len(self.names))}, {counted(len(self.labels), 'label')}, {means})"

    def to_dict(self) -> dict[str, Any]:
        """Everything, in types that JSON knows; NaN becomes None."""
        return {
            "format": FORMAT,
            "synthetic": self.synthetic,
            "command": self.command,
            "notes": list(self.notes),
            "findings": [finding.to_dict() for finding in self.findings],
            "versions": dict(self.versions),
            "settings": dict(self.settings),
            "data": dict(self.data),
            "labels": list(self.labels),
            "chance": self.chance,
            "wall_s": json_value(self.wall_s),
            "spaces": [_space(self, space) for space in self.spaces],
            "controls": json_value(self.controls),
            "partitions": {
                protocol: [
                    {
                        name: json_value(getattr(partition, name))
                        for name in ("index", "description", "train", "test")
                    }
                    for partition in partitions
                ]
                for protocol, partitions in self.partitions.items()
            },
            "recordings": [
                {"name": name, "session": session, "label": self.labels[code]}
                for name, session, code in zip(self.names, self.sessions, self.truth.tolist(), strict=True)
            ],
        }

    def to_json(self, path: str | os.PathLike[str]) -> None:
        """Write figures, settings, partitions and predictions as one JSON file; whole or not at all."""
        write_json(path, self.to_dict())

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write one line per prediction of every partition, space and protocol; whole or not at all.

        ``partition`` counts from 0, ``row`` is the place of the recording in the data set, ``correct`` is 1 or 0.
        """
        refuse_other_kind(path, TABLES)
        with whole_file(path) as draft, draft.open("w", encoding="utf-8", newline="") as stream:
            writer = csv.writer(stream)
            writer.writerow(CSV_COLUMNS)
            for one in self.predictions():
                writer.writerow((*vars(one).values(), int(one.label == one.predicted)))

    def report(self, path: str | os.PathLike[str]) -> None:
        """Write one HTML file with everything, for a browser; see `granular_id.report.report`.

        Raises
        ------
        ImportError
            matplotlib or jinja2 is missing, naming the extra to install.
        ValueError
            The path ends like another kind of file; a page that is there is replaced.
        """
        import_module("granular_id.report").report(self, path)  # by name: pages stand above results


def _space(result: Outcome, space: SpaceSummary) -> dict[str, Any]:
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


def _figures(result: Outcome, space: str, protocol: str) -> dict[str, Any]:
    chosen = [one.to_dict() for one in result.chosen.get((protocol, space), ())]
    return {
        "accuracy_mean": result.mean_accuracy(space, protocol),
        "accuracy_sd": json_value(result.sd_accuracy(space, protocol)),
        "accuracies": result.accuracies(space, protocol).tolist(),
        "macro_f1": result.macro_f1(space, protocol),
        "recall": json_value(result.recall(space, protocol)),
        "confusion": result.confusion(space, protocol).tolist(),
        "predicted": json_value(result.predicted[protocol, space]),
        **({"chosen": chosen} if chosen else {}),
        **(_of_held_out(result, space, protocol) if result.held_out else {}),
    }


def _of_held_out(result: Outcome, space: str, protocol: str) -> dict[str, Any]:
    """Return what belongs to held-out values of a condition, and to as many at random."""
    figures: dict[str, Any] = {
        "interval": json_value(result.interval(space, protocol)),
        "balanced_accuracies": result.balanced_accuracies(space, protocol).tolist(),
    }
    if protocol == CONDITION and space in result.adapted:
        figures["adapted"] = json_value(result.adapted[space])
        figures["adapted_accuracies"] = json_value(result.adapted_accuracies(space))
    return figures
