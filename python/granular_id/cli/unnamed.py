"""Files and folders to identify, as one data set."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from granular_id.cli.reading import loaded

if TYPE_CHECKING:
    from granular_id.recording import Dataset

__all__ = ["load_all"]


def load_all(paths: Sequence[Path], settings: Mapping[str, Any], *, quiet: bool) -> Dataset:
    """Read several files and folders into one data set.

    Parameters
    ----------
    paths : sequence of Path
        Of any format.
    settings : mapping
        See `granular_id.cli.reading.load_settings`.
    quiet : bool
        No progress.

    Returns
    -------
    Dataset
        Of several paths, recordings are named after the path they came from.
    """
    from granular_id.recording import Dataset  # noqa: PLC0415 (--help must not wait for numpy)

    parts = [loaded(path, settings, quiet=quiet) for path in paths]
    if len(parts) == 1:
        return parts[0]
    named = [
        Dataset([replace(r, name=_place(path, r.name, alone=len(part) == 1)) for r in part], part.history)
        for path, part in zip(paths, parts, strict=True)
    ]
    return Dataset.concatenate(named)


def _place(path: Path, name: str, *, alone: bool) -> str:
    if path.is_dir():
        return str(path / name)
    return str(path) if alone else f"{path}: {name}"
