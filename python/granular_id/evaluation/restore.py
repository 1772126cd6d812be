"""An evaluation read back from JSON: everything is checked, since anybody may have edited the file."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._core import AXES
from granular_id.evaluation.chosen import Chosen
from granular_id.evaluation.controls import Control
from granular_id.evaluation.export import FORMAT
from granular_id.evaluation.partition import PROTOCOLS, Partition
from granular_id.evaluation.portrait import Portrait
from granular_id.evaluation.summary import SpaceSummary
from granular_id.evaluation.task import STAGES
from granular_id.recording import StepReport

__all__ = ["read_json"]

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
        protocol: tuple(_partition(protocol, j, one, truth.size) for j, one in enumerate(drawn))
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
        "spaces": tuple(_space(one) for one in saved["spaces"]),
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


def _space(saved: Mapping[str, Any]) -> SpaceSummary:
    paper = saved["accuracy_in_the_paper_on_its_own_data"]
    return SpaceSummary(
        name=saved["name"],
        paper_accuracy=None if paper is None else float(paper),
        learns=bool(saved["fitted_on_training_rows"]),
        n_features=int(saved["n_features"]),
        seconds={stage: float(saved["seconds"][stage]) for stage in STAGES},
        settings=dict(saved["settings"]),
    )


def _partition(protocol: str, index: int, saved: Mapping[str, Any], n_rows: int) -> Partition:
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
