"""What goes into a reader and what comes out: ``FileSource`` and ``FileContent``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from granular_id._checks import checked_text, freeze, thaw
from granular_id.io.columns import axes_among, factor
from granular_id.io.errors import RecordingFileError
from granular_id.io.options import LoadOptions
from granular_id.recording import AXES, Recording, StepReport, same_unit, unit_of

__all__ = ["FileContent", "FileSource", "completed", "obeying"]


@dataclass(frozen=True)
class FileSource:
    """A file (or a folder that is one recording) to read, and what is known about it from outside."""

    path: Path
    root: Path  # nothing outside this folder is opened, whatever links say
    name: str  # how reports call the recording: the path within the folder, or what index.csv says
    label: str | None = None  # these five are stated by index.csv, and win over what the file says
    session: str | None = None
    start_time: float | None = None
    trigger_index: int | None = None
    meta: Mapping[str, Any] = field(default_factory=dict)
    folder_label: str | None = (
        None  # from names of folders and files; used where the file says nothing itself
    )
    folder_session: str | None = None
    rate_hz: float | None = None  # stated for this file; the one in the options otherwise
    irregular: bool = False  # keep the stamps even on an even grid, and whatever rate the options state
    axes: tuple[str, ...] | None = None  # of the file, where index.csv states them
    session_is_known: bool = False  # it is told from outside, and not looked for in the file

    @classmethod
    def alone(cls, path: Path) -> FileSource:
        """Return the source of a single file that nothing is known about."""
        return cls(path, path.resolve().parent, path.name)

    def session_column(self, options: LoadOptions) -> str | None:
        """Return the column of the file that the options take for the session."""
        return None if self.session_is_known else options.session


@dataclass
class FileContent:
    """What a reader found in a file."""

    recordings: Sequence[Recording]  # at least one
    rows: list[dict[str, Any]] = field(
        default_factory=list
    )  # remarks on single ones, the first key being "name"
    notes: list[str] = field(default_factory=list)  # on the whole: what was guessed, which topic was chosen
    history: Sequence[StepReport] = ()  # steps that were stored in the file
    obeyed: tuple[str, ...] = ()  # options that the reader itself has obeyed: "axes" (and units), "session"


def completed(content: FileContent, source: FileSource, options: LoadOptions) -> FileContent:
    """Put onto the recordings of a file what is known about it from outside."""
    stated = options.rate_hz if source.rate_hz is None else source.rate_hz
    other = next(
        (r for r in content.recordings if r.rate_hz is not None and stated not in (None, r.rate_hz)), None
    )
    if other is not None:
        problem = f"recording {other.name!r} was sampled at {other.rate_hz:g} Hz, but a rate of {stated:g} Hz is stated"
        raise RecordingFileError(source.path, f"{problem}; leave it out, then call .resample(rate_hz)")
    if len(content.recordings) > 1 and (source.start_time is not None or source.trigger_index is not None):
        problem = (
            f"start_time and trigger_index are stated for a file of {len(content.recordings)} recordings"
        )
        raise RecordingFileError(source.path, f"{problem}; wanted in the file itself")
    try:
        known = {
            name: checked_text(text, name, spaced=False)
            for name in ("label", "session", "folder_label", "folder_session")
            if (text := getattr(source, name)) is not None
        }
        meta = freeze(source.meta, "meta")
    except (TypeError, ValueError) as error:
        raise RecordingFileError(source.path, str(error)) from error
    if known or meta:
        content.recordings = [_with(recording, known, meta) for recording in content.recordings]
    return content


def obeying(content: FileContent, source: FileSource, options: LoadOptions) -> FileContent:
    """Choose axes, state units and take sessions as the options say, where the reader of a format does not."""
    try:
        if (options.axes or options.units) and "axes" not in content.obeyed:
            content.recordings = [_chosen(recording, options) for recording in content.recordings]
        column = source.session_column(options)
        if column is not None and "session" not in content.obeyed:
            content.recordings = [
                replace(recording, session=_from_meta(recording, column)) for recording in content.recordings
            ]
    except (TypeError, ValueError) as error:
        raise RecordingFileError(source.path, str(error)) from error
    return content


def _chosen(recording: Recording, options: LoadOptions) -> Recording:
    axes = options.axes or recording.axes
    columns = [i for i, _ in axes_among(recording.axes, axes)]
    old = thaw(recording.meta.get("units", {}))
    stated = old if isinstance(old, dict) else {}
    units = {
        axis: stated[recording.axes[i]]
        for axis, i in zip(axes, columns, strict=True)
        if recording.axes[i] in stated
    }
    for axis, unit in options.units_of(axes).items():
        known = unit_of(axis) if axis in AXES else units.get(axis, "")
        same = factor(unit, known) == 1 if axis in AXES else not known or same_unit(unit, known)
        if not same:
            raise ValueError(
                f"the unit of {axis} is {known!r:.40}, and units= states {unit!r:.40}; leave it out"
            )
        if axis not in AXES:
            units[axis] = unit
    meta = {**thaw(recording.meta), "units": units} if units or stated else recording.meta
    return replace(recording, wrench=recording.wrench[:, columns], axes=axes, meta=meta)


def _from_meta(recording: Recording, column: str) -> str:
    value = recording.meta.get(column)
    if isinstance(value, (str, int, float)):
        return str(value)
    kept = ", ".join(map(str, recording.meta)) or "none"
    raise ValueError(f"session={column!r} is no column of it, nor among what is known of it (meta: {kept})")


def _with(recording: Recording, known: Mapping[str, str], meta: Mapping[str, Any]) -> Recording:
    changed: dict[str, Any] = {
        name: known.get(name) or getattr(recording, name) or known.get(f"folder_{name}")
        for name in ("label", "session")
    }
    if meta:
        changed["meta"] = freeze({**thaw(recording.meta), **thaw(meta)}, "meta")
    return Recording._trusted(**{**vars(recording), **changed})
