"""What goes into a reader and what comes out: ``FileSource`` and ``FileContent``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from granular_id.io.options import LoadOptions
from granular_id.recording import Recording, Stated, StepReport, Table

__all__ = ["FileContent", "FileSource"]


@dataclass(frozen=True)
class FileSource:
    """A file (or a folder that is one recording) to read, and what is known about it from outside.

    Attributes
    ----------
    path, root : Path
        Nothing outside of the folder `root` is opened, whatever links say.
    name : str
        How reports call the recording: the path within the folder, or what index.csv says.
    label, session : str or None
        What an option or index.csv states; it wins over what the file says.
    label_else, session_else : str or None
        What its folder or name says, where nothing else does.
    label_place, session_place : str
        Where these come from, for the report.
    two_meanings : str or None
        Why a file that states no label itself is refused: its folders may mean two things.
    start_time, trigger_index, meta, rate_hz, irregular, axes
        What index.csv states.
    """

    path: Path
    root: Path
    name: str
    label: str | None = None
    session: str | None = None
    label_else: str | None = None
    session_else: str | None = None
    label_place: str = ""
    session_place: str = ""
    two_meanings: str | None = None
    start_time: float | None = None
    trigger_index: int | None = None
    meta: Mapping[str, Any] = field(default_factory=dict)
    rate_hz: float | None = None
    irregular: bool = False
    axes: tuple[str, ...] | None = None

    @classmethod
    def alone(cls, path: Path) -> FileSource:
        """Return the source of a single file that nothing is known about."""
        return cls(path, path.resolve().parent, path.name)

    def stated(self, options: LoadOptions) -> Stated:
        """Join what the options and what index.csv say of it."""
        of_all = options.stated()
        meta = dict(self.meta) if options.read_as is None else {**self.meta, "read_as": options.read_as}
        return replace(
            of_all,
            rate_hz=None if self.irregular else of_all.rate_hz if self.rate_hz is None else self.rate_hz,
            axes=self.axes if of_all.axes is None else of_all.axes,
            label=self.label,
            session=self.session,
            label_else=self.label_else,
            session_else=self.session_else,
            start_time=self.start_time,
            trigger_index=self.trigger_index,
            meta=meta,
            irregular=self.irregular,
        )


@dataclass
class FileContent:
    """What a reader found in a file: tables, or recordings that are complete already.

    `place` leads from a table (its number) and a row to what an error names: ``line=``, ``place=``.
    """

    tables: Sequence[Table] = ()
    recordings: Sequence[Recording] = ()
    rows: list[dict[str, Any]] = field(default_factory=list)  # remarks on single recordings, "name" first
    notes: list[str] = field(default_factory=list)
    history: Sequence[StepReport] = ()
    place: Callable[[int, int | None], dict[str, Any]] = lambda table, row: {}  # noqa: ARG005
