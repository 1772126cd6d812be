"""Files and folders to identify, whether or not anything says what they are."""

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
        Of any format. Unlike `granular_id.load`, a folder of files whose names give no label is read too.
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

    parts = [_load(path, settings, quiet=quiet) for path in paths]
    if len(parts) == 1:
        return parts[0]
    named = [
        Dataset([replace(r, name=_place(path, r.name, alone=len(part) == 1)) for r in part], part.history)
        for path, part in zip(paths, parts, strict=True)
    ]
    return Dataset.concatenate(named)


def _load(path: Path, settings: Mapping[str, Any], *, quiet: bool) -> Dataset:
    unlabelled = _unlabelled(path, settings)
    if not unlabelled:
        return loaded(path, settings, quiet=quiet)

    from granular_id.recording import Dataset, StepReport  # noqa: PLC0415

    rows: list[dict[str, str]] = []
    read = [_read(file, settings, rows) for file in unlabelled]
    parts = [part for part in read if part is not None]
    if not parts:
        raise ValueError(f"{path}: none of {len(rows)} files could be read; the first: {rows[0]['skipped']}")
    report = StepReport("load", {"format": "files without labels"}, {"recordings": len(parts)}, rows)
    return Dataset([recording for part in parts for recording in part], [report])


def _read(file: Path, settings: Mapping[str, Any], rows: list[dict[str, str]]) -> Dataset | None:
    """Read one file; when those that cannot be read are skipped, add it to `rows` and return None."""
    try:
        return loaded(file, settings, quiet=True)
    except ValueError as error:
        if settings["on_error"] != "skip":
            raise
        rows.append({"name": file.name, "skipped": str(error)})
        return None


def _unlabelled(path: Path, settings: Mapping[str, Any]) -> list[Path]:
    """Return the files of a flat folder in which the names of some give no label; nothing for any other path."""
    from granular_id.io.files import list_folder  # noqa: PLC0415
    from granular_id.io.folder import find_files  # noqa: PLC0415
    from granular_id.io.formats import format_of  # noqa: PLC0415
    from granular_id.io.options import LoadOptions  # noqa: PLC0415

    if not path.is_dir() or format_of(path) is not None:
        return []
    options = LoadOptions(**settings)
    try:
        found = find_files(path, options)
    except ValueError:
        return []  # reading it says what is wrong
    if found.layout != "label_*" or not found.problems:
        return []
    named = {source.path.name for source in found.sources} | {Path(p.path).name for p in found.problems}
    files, folders = list_folder(path)
    return [entry for entry in (*files, *folders) if entry.name in named]


def _place(path: Path, name: str, *, alone: bool) -> str:
    if path.is_dir():
        return str(path / name)
    return str(path) if alone else f"{path}: {name}"
