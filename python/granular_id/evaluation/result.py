"""`EvaluationResult`: what an evaluation measured, as tables, JSON and CSV."""

from __future__ import annotations

import csv
import os
from dataclasses import asdict, fields
from typing import Any

from granular_id._files import TABLES, json_value, refuse_other_kind, whole_file, write_json
from granular_id._text import counted, percent
from granular_id.evaluation.outcome import Outcome, Prediction
from granular_id.evaluation.tables import details, one_screen

FORMAT = "granular_id.evaluation/1"
CSV_COLUMNS = (*(one.name for one in fields(Prediction)), "correct")


class EvaluationResult(Outcome):
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
    notes : tuple of str
        What a reader has to know, one line each.
    synthetic : bool
        True when recordings were simulated: such accuracies say nothing about real materials.
    command : str
        What to type to repeat it.
    wall_s : float
        Seconds from start to end.
    """

    def table(self) -> str:
        """Return the headline, accuracies, baselines, the worst materials and findings: one screen of text."""
        return one_screen(self)

    __str__ = table

    def details(self) -> str:
        """Return all that `table` leaves out: folds, mistakes, comparisons, what was chosen, seconds and notes."""
        return details(self)

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
