"""`EvaluationResult`: what an evaluation measured, as tables, JSON, CSV and HTML, and read back from JSON."""

from __future__ import annotations

import csv
import json
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._files import TABLES, json_value, refuse_other_kind, whole_file, write_json
from granular_id._schema import EACH, check_form, from_json
from granular_id._text import Table, counted, percent
from granular_id.evaluation.controls import Control
from granular_id.evaluation.features import STAGES
from granular_id.evaluation.outcome import Outcome, Prediction, SpaceSummary
from granular_id.evaluation.report_data import ReportData
from granular_id.evaluation.tables import hold_out_table, plain_text
from granular_id.partitions import CONDITION, PROTOCOLS, Partition
from granular_id.recording import Finding
from granular_id.spaces import Chosen

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
    notes : tuple of str
        What a reader has to know, one line each.
    synthetic : bool
        True when recordings were simulated: such accuracies say nothing about real materials.
    command : str
        What to type to repeat it.
    controls : tuple of Control
        What could have been answered without the method; empty when they were not asked for.
    report_data : ReportData or None
        How the recordings look, for a report.
    chosen : mapping of (str, str) to tuple of Chosen
        (protocol, space) to what the classifier of the space chose in each partition, of spaces that choose.
    wall_s : float
        Seconds that passed from start to end, controls included; after a resumed run, those of its last part.
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
                    {name: json_value(getattr(partition, name)) for name in _PARTITION}
                    for partition in partitions
                ]
                for protocol, partitions in self.partitions.items()
            },
            "recordings": [
                {"name": name, "session": session, "label": self.labels[code]}
                for name, session, code in zip(self.names, self.sessions, self.truth.tolist(), strict=True)
            ],
            "portrait": json_value(self.report_data),
        }

    def to_json(self, path: str | os.PathLike[str]) -> None:
        """Write figures, settings, partitions and predictions as one JSON file; whole or not at all."""
        write_json(path, self.to_dict())

    @classmethod
    def from_json(cls, path: str | os.PathLike[str]) -> EvaluationResult:
        """Read what `to_json` wrote.

        Figures are computed from the predictions; those in the file are for other programs.

        Raises
        ------
        OSError
            The file cannot be read.
        ValueError
            Naming the file: it is no evaluation, is of another version, or lacks a part.
        """
        try:
            saved = json.loads(Path(path).read_text(encoding="utf-8"))
        except (ValueError, RecursionError):
            raise ValueError(
                f"{path} is no JSON of an evaluation, as granular-id evaluate --json writes it"
            ) from None
        form = saved.get("format") if isinstance(saved, dict) else None
        if form != FORMAT:
            raise ValueError(
                f"{path} has format {form!r}, wanted {FORMAT!r}, as EvaluationResult.to_json writes it"
            )
        try:
            return cls(**_fields(saved))
        except (TypeError, ValueError) as error:
            raise ValueError(f"{path} does not hold a whole evaluation: {error}") from None

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


_PARTITION = {"index": int, "description": str, "train": list, "test": list}
_FINDING = {
    "severity": {"error", "warning", "info"},
    **{"code": str, "message": str, "recordings": [str, ...], "indices": [int, ...], "values": {}},
}


def _form(protocols: Iterable[str]) -> dict[str, Any]:
    """Return the form of a file, as far as it is read: other programs may read the other entries."""
    return {
        "synthetic": bool,
        "command": str,
        "notes": [str, ...],
        "findings?": [_FINDING, ...],
        "versions": {"granular_id": str},
        "settings": {"seed": int, "hold_out?": str},
        "data": {
            **{"n_recordings": int, "n_samples": int, "n_axes": int, "rate_hz": float},
            "summary": {"rows": [{}, ...]},
            "history": [{}, ...],
        },
        "labels": [str, ...],
        "wall_s": (float, None),
        "spaces": [
            {
                "name": str,
                "accuracy_in_the_paper_on_its_own_data": (float, None),
                "fitted_on_training_rows": bool,
                "n_features": int,
                "settings": {},
                "seconds": dict.fromkeys(STAGES, float),
                "protocols": {
                    name: {"predicted": [list, ...], "chosen?": [{}, ...], "adapted?": [list, ...]}
                    for name in protocols
                },
            },
            ...,
        ],
        "controls": [{}, ...],
        "partitions": {EACH: [_PARTITION, ...]},
        "recordings": [{"name": str, "session": str, "label": str}, ...],
        "portrait": ({}, None),
    }


def _fields(saved: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of `EvaluationResult`."""
    check_form(saved, {"partitions": {}})
    if unknown := set(saved["partitions"]) - set(PROTOCOLS):
        raise ValueError(f"there is no protocol {min(unknown)!r}")
    check_form(saved, _form(saved["partitions"]))
    labels, recordings = tuple(saved["labels"]), saved["recordings"]
    condition = saved["settings"].get("hold_out", "")
    partitions = {
        protocol: tuple(
            _partition(protocol, index, one, len(recordings), condition if protocol == CONDITION else "")
            for index, one in enumerate(drawn)
        )
        for protocol, drawn in saved["partitions"].items()
    }
    if not (saved["spaces"] and partitions and all(partitions.values())):
        raise ValueError("no space or no partition")
    predicted, chosen, adapted = {}, {}, {}
    for space in saved["spaces"]:
        for protocol, drawn in partitions.items():
            key, figures = (protocol, space["name"]), space["protocols"][protocol]
            place = f"predictions of {space['name']!r}, {protocol}"
            predicted[key] = _named(place, figures["predicted"], drawn, len(labels))
            if "adapted" in figures:
                adapted[space["name"]] = _named(f"{place}, adapted", figures["adapted"], drawn, len(labels))
            if figures.get("chosen"):
                chosen[key] = tuple(map(Chosen.from_dict, figures["chosen"]))
                if len(chosen[key]) != len(drawn):
                    raise ValueError(f"choices of {space['name']!r}, {protocol}, do not fit the partitions")
    for one in recordings:
        if one["label"] not in labels:
            raise ValueError(f"label {one['label']!r} of a recording is not among the labels")
    return {
        "spaces": tuple(
            SpaceSummary(
                name=space["name"],
                paper_accuracy=space["accuracy_in_the_paper_on_its_own_data"],
                learns=space["fitted_on_training_rows"],
                n_features=space["n_features"],
                seconds={stage: space["seconds"][stage] for stage in STAGES},
                settings=space["settings"],
            )
            for space in saved["spaces"]
        ),
        "partitions": partitions,
        "predicted": predicted,
        "labels": labels,
        "truth": np.array([labels.index(one["label"]) for one in recordings], dtype=np.intp),
        "names": tuple(one["name"] for one in recordings),
        "sessions": tuple(one["session"] for one in recordings),
        **{name: saved[name] for name in ("settings", "data", "versions", "synthetic", "command")},
        "notes": tuple(saved["notes"]),
        "findings": tuple(map(_finding, saved.get("findings", ()))),
        "controls": tuple(map(Control.from_dict, saved["controls"])),
        "report_data": None
        if saved["portrait"] is None
        else from_json(ReportData, saved["portrait"], what="portrait"),
        "chosen": chosen,
        "adapted": adapted,
        "wall_s": math.nan if saved["wall_s"] is None else saved["wall_s"],
    }


def _finding(saved: Mapping[str, Any]) -> Finding:
    given = {name: saved[name] for name in _FINDING}
    return Finding(**given | {name: tuple(saved[name]) for name in ("recordings", "indices")})


def _partition(protocol: str, index: int, saved: Mapping[str, Any], n_rows: int, condition: str) -> Partition:
    place = f"{protocol} partition {index}"
    if saved["index"] != index:
        raise ValueError(f"{place} has index {saved['index']!r}")
    train, test = (_codes(f"{place}, {part}", saved[part], n_rows) for part in ("train", "test"))
    if np.unique(np.concatenate([train, test])).size < train.size + test.size:
        raise ValueError(f"{place} has a recording twice")
    return Partition(protocol, index, saved["description"], train, test, condition)


def _named(
    place: str, saved: Sequence[Any], drawn: Sequence[Partition], n_classes: int
) -> tuple[NDArray[np.intp], ...]:
    """Read class numbers of the tested rows of each partition."""
    named = tuple(_codes(place, codes, n_classes) for codes in saved)
    if [codes.size for codes in named] != [partition.test.size for partition in drawn]:
        raise ValueError(f"{place}, do not fit the partitions")
    return named


def _codes(place: str, values: Any, below: int) -> NDArray[np.intp]:
    codes = np.array(values)
    if (
        codes.ndim != 1
        or codes.dtype.kind != "i"
        or codes.min(initial=0) < 0
        or codes.max(initial=0) >= below
    ):
        raise ValueError(f"{place}: wanted whole numbers from 0 to {below - 1}")
    return codes.astype(np.intp)
