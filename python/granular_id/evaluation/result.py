"""What an evaluation found, with everything needed to recompute each figure."""

from __future__ import annotations

import csv
import json
import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from granular_id._core import AXES
from granular_id._files import TABLES, refuse_other_kind, whole_file, write_json
from granular_id._text import counted, percent
from granular_id.evaluation.compare import Comparison, compare
from granular_id.evaluation.controls import Control
from granular_id.evaluation.report_data import Portrait
from granular_id.evaluation.scoring import STAGES
from granular_id.evaluation.tables import plain_text
from granular_id.recording import StepReport
from granular_id.spaces import Chosen
from granular_id.splits import PROTOCOLS, Partition, are_blocks
from granular_id.statistics import (
    MIN_PARTITIONS,
    confusion_counts,
    corrected_interval,
    macro_f1,
    recall_per_class,
    sample_sd,
)

if TYPE_CHECKING:
    from granular_id.splits import Partition


@dataclass(frozen=True, eq=False, repr=False)
class EvaluationResult:
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
    portrait : Portrait or None
        How the recordings look, for a report.
    chosen : mapping of (str, str) to tuple of Chosen
        (protocol, space) to what the classifier of the space chose in each partition, of spaces that choose.
    wall_s : float
        Seconds that passed from start to end, controls included; after a resumed run, those of its last part.
    """

    spaces: tuple[SpaceSummary, ...]
    partitions: Mapping[str, tuple[Partition, ...]]
    predicted: Mapping[tuple[str, str], tuple[NDArray[np.intp], ...]]
    labels: tuple[str, ...]
    truth: NDArray[np.intp]
    names: tuple[str, ...]
    sessions: tuple[str, ...]
    settings: Mapping[str, Any]
    data: Mapping[str, Any]
    versions: Mapping[str, str]
    notes: tuple[str, ...] = ()
    synthetic: bool = False
    command: str = ""
    controls: tuple[Control, ...] = ()
    portrait: Portrait | None = None
    chosen: Mapping[tuple[str, str], tuple[Chosen, ...]] = field(default_factory=dict)
    wall_s: float = math.nan

    @property
    def protocols(self) -> tuple[str, ...]:
        """Protocols that ran, in order."""
        return tuple(self.partitions)

    @property
    def strictest(self) -> str | None:
        """The strictest protocol that ran and held out a time or session of its own; None where none did.

        Whole sessions, then halves in time order, then blocks in time that stood in for sessions.
        """
        order = ["session", "chronological"]
        if "session" in self.partitions and are_blocks(self.partitions["session"]):
            order.reverse()
        return next((name for name in order if name in self.partitions), None)

    @property
    def random(self) -> str | None:
        """The protocol with random draws that ran, against which the strictest is held; None where none did."""
        return next((name for name in ("paper", "kfold") if name in self.partitions), None)

    @property
    def chance(self) -> float:
        """Accuracy of guessing when every class is equally frequent: 1 / K."""
        return 1 / len(self.labels)

    def space(self, name: str) -> SpaceSummary:
        """Return one space by name, or raise a ValueError that lists the names."""
        named = {space.name: space for space in self.spaces}
        if name not in named:
            raise ValueError(f"space must be one of {', '.join(map(repr, named))}, got {name!r}")
        return named[name]

    def best_space(self, protocol: str | None = None) -> str:
        """Name of the space with the highest mean accuracy; of equals that which the strictest protocol prefers.

        The choice uses the tested recordings: good for picking what to look at, not for claiming its accuracy.
        """
        protocols = (protocol, self.strictest)
        return max(self.spaces, key=lambda s: [self.mean_accuracy(s.name, p) for p in protocols]).name

    def accuracies(self, space: str, protocol: str | None = None) -> NDArray[np.float64]:
        """Share of tested recordings named rightly, one value per partition.

        Parameters
        ----------
        space : str
            Name of a feature space.
        protocol : str, optional
            Default: the first protocol that ran.

        Returns
        -------
        (n_partitions,) float array
            In [0, 1].
        """
        partitions, predicted = self._runs(space, protocol)
        return np.array(
            [np.mean(self.truth[p.test] == said) for p, said in zip(partitions, predicted, strict=True)]
        )

    def mean_accuracy(self, space: str, protocol: str | None = None) -> float:
        """Mean of `accuracies`, in [0, 1]."""
        return float(self.accuracies(space, protocol).mean())

    def sd_accuracy(self, space: str, protocol: str | None = None) -> float:
        """Sample standard deviation of `accuracies` (divisor J - 1); NaN for one partition."""
        return sample_sd(self.accuracies(space, protocol))

    def interval(self, space: str, protocol: str | None = None) -> tuple[float, float]:
        """95 % interval of `mean_accuracy`, corrected for the recordings that partitions share.

        NaN with fewer than three partitions and where all agree: see
        `granular_id.statistics.corrected_interval`.
        """
        partitions, _ = self._runs(space, protocol)
        if len(partitions) < MIN_PARTITIONS:
            return math.nan, math.nan
        n_train, n_test = (float(np.mean(sizes)) for sizes in _sizes(partitions))
        return corrected_interval(self.accuracies(space, protocol), n_train, n_test)

    def comparison(self, protocol: str | None = None) -> Comparison:
        """Compare every space with every other on the same partitions; ``print`` it for a table.

        Parameters
        ----------
        protocol : str, optional
            Default: the first protocol that ran.

        Raises
        ------
        ValueError
            A protocol that did not run, or a single space.
        """
        names = [space.name for space in self.spaces]
        partitions, _ = self._runs(names[0], protocol)
        accuracies = {name: self.accuracies(name, protocol) for name in names}
        return compare(names, accuracies, *_sizes(partitions), protocol=partitions[0].protocol)

    def confusion(self, space: str | None = None, protocol: str | None = None) -> NDArray[np.int64]:
        """Confusion matrix summed over the partitions of a protocol.

        Parameters
        ----------
        space : str, optional
            Default: `best_space`.
        protocol : str, optional
            Default: the first protocol that ran.

        Returns
        -------
        (K, K) int array
            Row: true class, column: predicted class, in the order of `labels`.
        """
        partitions, predicted = self._runs(space or self.best_space(protocol), protocol)
        truth = np.concatenate([self.truth[partition.test] for partition in partitions])
        return confusion_counts(truth, np.concatenate(predicted), len(self.labels))

    def recall(self, space: str | None = None, protocol: str | None = None) -> NDArray[np.float64]:
        """Share of each class named rightly, over all partitions: (K,) in the order of `labels`."""
        return recall_per_class(self.confusion(space, protocol))

    def macro_f1(self, space: str | None = None, protocol: str | None = None) -> float:
        """Mean F1 over classes, from the confusion matrix summed over partitions."""
        return macro_f1(self.confusion(space, protocol))

    def gap(self, space: str) -> float | None:
        """Accuracy lost between random draws and the strictest protocol; None unless both ran.

        Mean accuracy of `random` minus that of `strictest`, each over its partitions.
        """
        if self.random is None or self.strictest is None:
            return None
        return self.mean_accuracy(space, self.random) - self.mean_accuracy(space, self.strictest)

    def predictions(self) -> Iterator[Prediction]:
        """Every prediction: by protocol, space and partition, then row."""
        for protocol, partitions in self.partitions.items():
            for space in self.spaces:
                for partition, said in zip(partitions, self.predicted[protocol, space.name], strict=True):
                    for row, code in zip(partition.test.tolist(), said.tolist(), strict=True):
                        yield Prediction(
                            protocol=protocol,
                            partition=partition.index,
                            space=space.name,
                            row=row,
                            recording=self.names[row],
                            session=self.sessions[row],
                            label=self.labels[self.truth[row]],
                            predicted=self.labels[code],
                        )

    def table(self) -> str:
        """Tables of accuracies, gaps, choices and seconds as plain text."""
        return plain_text(self)

    __str__ = table

    def __repr__(self) -> str:
        means = ", ".join(f"{s.name} {percent(self.mean_accuracy(s.name))}" for s in self.spaces)
        mark = "SYNTHETIC, " if self.synthetic else ""
        return f"EvaluationResult({mark}{counted(len(self.names))}, {counted(len(self.labels), 'label')}, {means})"

    def to_dict(self) -> dict[str, Any]:
        """Everything, in types that JSON knows; see `to_json`."""
        return as_dict(self)

    def to_json(self, path: str | os.PathLike[str]) -> None:
        """Write figures, settings, partitions and predictions as one JSON file; whole or not at all."""
        write_json(path, self.to_dict())

    @classmethod
    def from_json(cls, path: str | os.PathLike[str]) -> EvaluationResult:
        """Read what `to_json` wrote; a ValueError names a file that is anything else, and what is wrong.

        Figures are computed from the predictions; those in the file are for other programs.
        """
        return cls(**read_json(path))

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write one line per prediction of every partition, space and protocol; whole or not at all."""
        write_csv(self, path)

    def report(self, path: str | os.PathLike[str]) -> None:
        """Write one HTML file with everything, for a browser; see `granular_id.report`.

        Raises
        ------
        ImportError
            matplotlib or jinja2 is missing, naming the extra to install.
        ValueError
            The path ends like another kind of file; a page that is there is replaced.
        """
        import_module("granular_id.report").report(self, path)  # by name: pages stand above results

    def _runs(
        self, space: str, protocol: str | None
    ) -> tuple[tuple[Partition, ...], tuple[NDArray[np.intp], ...]]:
        name = self.space(space).name
        chosen = self.protocols[0] if protocol is None else protocol
        if chosen not in self.partitions:
            known = ", ".join(map(repr, self.partitions))
            raise ValueError(f"protocol must be one of those that ran ({known}), got {protocol!r}")
        return self.partitions[chosen], self.predicted[chosen, name]


def _sizes(partitions: tuple[Partition, ...]) -> tuple[list[int], list[int]]:
    """Count recordings that train and that are tested, per partition."""
    return [p.train.size for p in partitions], [p.test.size for p in partitions]


# What a result says of one feature space, and of one recording in one partition.


@dataclass(frozen=True)
class SpaceSummary:
    """One feature space as it was evaluated.

    Parameters
    ----------
    name : str
        ``"raw"``, ``"hfmh"``, ``"raw+hfmh"`` or the caller's own name.
    paper_accuracy : float or None
        Accuracy that the paper reports for this space on its own recordings, in [0, 1]. Never measured here.
    learns : bool
        True when the features were fitted on the training rows of each partition.
    n_features : int
        Length of a feature vector.
    seconds : mapping of str to float
        Time spent in the stages ``features``, ``gram``, ``training`` and ``prediction``, controls left out. What
        several spaces share is counted for each, as it would take alone, and with several threads the stages of
        different partitions overlap: the sum exceeds the time that passed, which is `EvaluationResult.wall_s`.
    settings : mapping
        Parameters of the transformer.
    """

    name: str
    paper_accuracy: float | None
    learns: bool
    n_features: int
    seconds: Mapping[str, float]
    settings: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Prediction:
    """What one partition said about one recording."""

    protocol: str
    partition: int
    space: str
    row: int
    recording: str
    session: str
    label: str
    predicted: str


# JSON and CSV of an evaluation.
#
# The JSON holds figures, settings, partitions and predictions, enough to load the result back; the CSV holds one
# line per prediction. Every figure in the JSON can be recomputed from the CSV alone.

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


# An evaluation read back from JSON: everything is checked, since anybody may have edited the file.

Codes = NDArray[np.intp]


def read_json(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read the fields of an `EvaluationResult` from a file that `EvaluationResult.to_json` wrote.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    dict
        Arguments of `EvaluationResult`.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        Naming the file and what is wrong with it.
    """
    try:
        saved = json.loads(Path(path).read_text(encoding="utf-8"), parse_constant=_no_number)
    except UnicodeDecodeError:  # no text: where it stops being one says nothing
        raise ValueError(
            f"{path} is no JSON of an evaluation, as granular-id evaluate --json writes it"
        ) from None
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} is no JSON: {error}") from None
    form = saved.get("format") if isinstance(saved, dict) else None
    if form != FORMAT:
        raise ValueError(
            f"{path} has format {form!r}, wanted {FORMAT!r}, as EvaluationResult.to_json writes it"
        )
    try:
        return _fields(saved)
    except KeyError as error:
        raise ValueError(f"{path} lacks the field {error.args[0]!r}") from None
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        raise ValueError(f"{path} does not hold a whole evaluation: {error}") from None


def _fields(saved: Mapping[str, Any]) -> dict[str, Any]:
    labels = tuple(_once("labels", saved["labels"]))
    _once("spaces", [space["name"] for space in saved["spaces"]])
    recordings = saved["recordings"]
    truth = np.array([_number_of(one["label"], labels) for one in recordings], dtype=np.intp)
    partitions = {
        protocol: tuple(_partition_restore(protocol, j, one, truth.size) for j, one in enumerate(drawn))
        for protocol, drawn in saved["partitions"].items()
    }
    if not (partitions and all(partitions.values()) and saved["spaces"]):
        raise ValueError("no space or no partition")
    predicted, chosen = {}, {}
    for space in saved["spaces"]:
        for protocol, drawn in partitions.items():
            where = f"predictions of {space['name']!r}, {protocol}"
            said = space["protocols"][protocol]["predicted"]
            if len(said) != len(drawn):
                raise ValueError(f"{where}: {len(said)} partitions, wanted {len(drawn)}")
            predicted[protocol, space["name"]] = tuple(
                _codes(where, codes, partition.test.size, len(labels))
                for codes, partition in zip(said, drawn, strict=True)
            )
            choices = space["protocols"][protocol].get("chosen", [])
            if len(choices) not in (0, len(drawn)):
                raise ValueError(f"{where}: {len(choices)} choices, wanted {len(drawn)}")
            if choices:
                chosen[protocol, space["name"]] = tuple(map(Chosen.from_dict, choices))
    wall_s = saved["wall_s"]
    return {
        "spaces": tuple(_space_restore(one) for one in saved["spaces"]),
        "partitions": partitions,
        "predicted": predicted,
        "labels": labels,
        "truth": truth,
        "names": tuple(_texts("names", [one["name"] for one in recordings])),
        "sessions": tuple(_texts("sessions", [one["session"] for one in recordings])),
        "settings": _with("settings", saved["settings"], "seed"),
        "data": _data(saved["data"]),
        "versions": _with("versions", saved["versions"], "granular_id"),
        "notes": tuple(_texts("notes", saved["notes"])),
        "synthetic": bool(saved["synthetic"]),
        "command": str(saved["command"]),
        "controls": tuple(Control.from_dict(one) for one in saved["controls"]),
        "portrait": None if saved["portrait"] is None else _portrait(saved["portrait"]),
        "chosen": chosen,
        "wall_s": math.nan if wall_s is None else float(wall_s),
    }


def _space_restore(saved: Mapping[str, Any]) -> SpaceSummary:
    paper = saved["accuracy_in_the_paper_on_its_own_data"]
    return SpaceSummary(
        name=saved["name"],
        paper_accuracy=None if paper is None else float(paper),
        learns=bool(saved["fitted_on_training_rows"]),
        n_features=int(saved["n_features"]),
        seconds={stage: float(saved["seconds"][stage]) for stage in STAGES},
        settings=dict(saved["settings"]),
    )


def _partition_restore(protocol: str, index: int, saved: Mapping[str, Any], n_rows: int) -> Partition:
    if protocol not in PROTOCOLS:
        raise ValueError(f"there is no protocol {protocol!r}")
    where = f"{protocol} partition {index}"
    if saved["index"] != index:
        raise ValueError(f"{where} has index {saved['index']!r}")
    train, test = (_codes(f"{where}, {part}", saved[part], None, n_rows) for part in ("train", "test"))
    if np.unique(np.concatenate([train, test])).size != train.size + test.size:
        raise ValueError(f"{where} has a recording twice")
    return Partition(protocol, index, str(saved["description"]), train, test)


def _codes(where: str, values: Any, size: int | None, below: int) -> Codes:
    """Return whole numbers in ``range(below)``, at least one; `size` of them unless that is None."""
    codes = np.array(values)
    if codes.ndim != 1 or codes.dtype.kind != "i" or (size is not None and codes.size != size):
        wanted = "whole numbers" if size is None else f"{size} whole numbers"
        raise ValueError(f"{where}: wanted {wanted}, got {codes.size} values of shape {codes.shape}")
    if codes.min() < 0 or codes.max() >= below:
        raise ValueError(f"{where}: numbers from {codes.min()} to {codes.max()}, wanted 0 to {below - 1}")
    return codes.astype(np.intp)


def _number_of(label: Any, labels: tuple[str, ...]) -> int:
    if label not in labels:
        raise ValueError(f"label {label!r} of a recording is not among the labels")
    return labels.index(label)


def _data(saved: Mapping[str, Any]) -> dict[str, Any]:
    """Return the summary of the recordings with all that a report says of it."""
    for name in ("n_recordings", "n_samples", "n_axes", "rate_hz"):
        _number(f"data: {name}", saved[name])
    rows = saved["summary"]["rows"]
    if not rows or any(row.keys() != rows[0].keys() for row in rows):
        raise ValueError("data: wanted rows of the same figures in the summary")
    for step in saved["history"]:
        str(StepReport(**step))
    return dict(saved)


def _portrait(saved: Mapping[str, Any]) -> Portrait:
    """Return a portrait whose arrays fit together."""
    seen = Portrait.from_dict(saved)
    labels, axes = len(_texts("portrait: labels", list(seen.labels))), _axes(seen.axes)
    points = seen.time_s.size
    shapes: list[tuple[str, Any, tuple[int, ...]]] = [
        ("time_s", seen.time_s, (points,)),
        ("mean", seen.mean, (labels, axes, points)),
        ("sd", seen.sd, (labels, axes, points)),
    ]
    if seen.high_pass is not None:
        high, windows = seen.high_pass, seen.high_pass.time_s.size
        _number("portrait: cutoff_hz", high.settings["cutoff_hz"])
        _with("portrait: settings", high.settings, "initial")
        n_bins = int(high.settings["n_bins"])
        shapes += [
            ("time_s of the high-passed signal", high.time_s, (windows,)),
            ("residual", high.residual, (labels, axes, windows)),
            ("bin_range", high.bin_range, (axes, 2)),
            ("hfmh", high.hfmh, (labels, axes, n_bins)),
        ]
    for block in seen.weights:
        _texts("portrait: weights", [block.name, block.kind, block.unit])
        rows, columns = _axes(block.axes), block.coordinates.size
        shapes += [
            (f"coordinates of {block.name}", block.coordinates, (columns,)),
            (f"weights of {block.name}", block.weights, (rows, columns)),
            (f"influence of {block.name}", block.influence, (rows, columns)),
            (f"shares of {block.name}", block.shares, (rows,)),
        ]
    for name, values, shape in shapes:
        if values.shape != shape or not values.size or not np.isfinite(values).all():
            raise ValueError(
                f"portrait: {name} must hold finite numbers of shape {shape}, got {values.shape}"
            )
    return seen


def _axes(names: tuple[str, ...]) -> int:
    if not names or any(name not in AXES for name in names):
        raise ValueError(f"portrait: axes must be among {', '.join(AXES)}, got {names!r}")
    return len(names)


def _with(name: str, saved: Mapping[str, Any], key: str) -> dict[str, Any]:
    if key not in saved:
        raise ValueError(f"{name} lacks {key!r}")
    return dict(saved)


def _number(name: str, value: Any) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{name} must be a number, got {value!r}")


def _no_number(constant: str) -> None:
    raise ValueError(f"{constant} is no number of JSON")


def _texts(name: str, values: Any) -> list[str]:
    if not isinstance(values, list) or not all(isinstance(value, str) for value in values):
        raise ValueError(f"{name}: wanted a list of texts")
    return values


def _once(name: str, values: Any) -> list[str]:
    """Return texts that all differ."""
    texts = _texts(name, values)
    for k, text in enumerate(texts):
        if text in texts[:k]:
            raise ValueError(f"{name}: {text!r} stands there twice")
    return texts
