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

from granular_id.evaluation.controls import Control
from granular_id.evaluation.export import FORMAT
from granular_id.evaluation.partition import PROTOCOLS, Partition
from granular_id.evaluation.portrait import Portrait
from granular_id.evaluation.summary import SpaceSummary
from granular_id.evaluation.task import STAGES

__all__ = ["read_json"]

Codes = NDArray[np.intp]


def read_json(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read the fields of an `EvaluationResult` from a file that `write_json` wrote.

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
        saved = json.loads(Path(path).read_text(encoding="utf-8"))
    except (UnicodeDecodeError, json.JSONDecodeError, RecursionError) as error:
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
    predicted = {}
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
    portrait, wall_s = saved["portrait"], saved["wall_s"]
    return {
        "spaces": tuple(_space(one) for one in saved["spaces"]),
        "partitions": partitions,
        "predicted": predicted,
        "labels": labels,
        "truth": truth,
        "names": tuple(_texts("names", [one["name"] for one in recordings])),
        "sessions": tuple(_texts("sessions", [one["session"] for one in recordings])),
        "settings": dict(saved["settings"]),
        "data": dict(saved["data"]),
        "versions": dict(saved["versions"]),
        "notes": tuple(_texts("notes", saved["notes"])),
        "synthetic": bool(saved["synthetic"]),
        "command": str(saved["command"]),
        "controls": tuple(Control.from_dict(one) for one in saved["controls"]),
        "portrait": None if portrait is None else Portrait.from_dict(portrait),
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
