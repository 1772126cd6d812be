"""The argument PATH, and the options that say how its recordings are read and prepared."""

from __future__ import annotations

import csv
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from granular_id._core import GranularIdError
from granular_id._text import counted, known_label, verb
from granular_id.cli.errors import words_of
from granular_id.cli.options import at_least, names_in, numbers_in, option, positive
from granular_id.cli.outputs import show

if TYPE_CHECKING:
    from granular_id._checks import FloatArray
    from granular_id._progress import ProgressCallback
    from granular_id.recording import Dataset

PANEL, SETUP = "Recordings", "Another set-up"

MAX_GAP_S = 0.25
"""Default of ``--max-gap-s``."""


class Difference(str, Enum):
    """Choices of ``--accept``."""

    frame = "frame"
    transform = "transform"
    sign = "sign"
    units = "units"


ACCEPT = "Goes on though this is not as in the training, with a warning. Repeatable."
"""Help of ``--accept``."""


Handling = Literal["raise", "skip"]


class UnreadableError(GranularIdError):
    """A file or folder that cannot be read, in the words of the command line."""


@dataclass(kw_only=True)
class ReadingOptions:
    """How files are read."""

    on_error: Handling = option(PANEL, "An unreadable file: refuse, or leave it out.", default="raise")
    on_time_error: Literal["raise", "repair"] = option(
        PANEL, "Time running backwards or repeated: refuse, or sort and merge.", default="raise"
    )
    recorded_hz: float | None = option(
        PANEL, "Rate of files without a clock, or whose rows share stamps (--rate-hz resamples)."
    )
    topic: str | None = option(
        PANEL, "Topic of a bag, where several hold a wrench; with .field after it one inside its messages."
    )
    time_unit: Literal["s", "ms", "us", "ns", "sample"] | None = option(
        PANEL, "What stamps count, where a file does not state it. Default: seconds."
    )
    array: str | None = option(PANEL, "Array or group of a file that holds the samples, where several may.")
    label: str | None = option(
        PANEL, "Where labels stand: folder, parent (above that), file (its name), column:NAME, meta:PATH."
    )
    axes: str | None = option(
        PANEL, "Columns that are the axes, in this order: wx,wy,wz. Default: fx,fy,fz,tx,ty,tz."
    )
    units: str | None = option(
        PANEL,
        "Units of the axes, where files do not state them: one, one per axis, or one per run: rad/s,m/s2.",
    )
    session: str | None = option(
        PANEL, "Where sessions stand, what was recorded in one go: as --label. Default: as the files say."
    )

    def __post_init__(self) -> None:
        positive("--recorded-hz", self.recorded_hz)

    def load_path(self, path: Path, *, axes: Sequence[str] | None = None, quiet: bool) -> Dataset:
        """Read one file or folder; `axes` are those it has unless an option names others."""
        from granular_id.io import load

        with self._said_in_options():
            return load(path, progress=not quiet, **self._of_load(axes))

    def load_parts(self, path: Path, progress: ProgressCallback | None) -> Iterator[Dataset]:
        """Read one file or folder piece by piece; no more than a piece is in memory."""
        from granular_id.io import load_parts

        with self._said_in_options():
            yield from load_parts(path, progress=progress or False, **self._of_load())

    def _of_load(self, axes: Sequence[str] | None = None) -> dict[str, Any]:
        return {
            "rate_hz": self.recorded_hz,
            "on_error": self.on_error,
            "on_time_error": self.on_time_error,
            "topic": self.topic,
            "time_unit": self.time_unit,
            "array": self.array,
            "label": self.label,
            "axes": self.axes or axes,
            "units": self.units,
            "session": self.session,
        }

    @contextmanager
    def _said_in_options(self) -> Iterator[None]:
        from granular_id.io import RecordingFileError

        try:
            yield
        except ValueError as error:
            skippable = isinstance(error, RecordingFileError) and error.skippable
            hint = "; add --on-error skip to leave such files out" if skippable else ""
            kind = UnreadableError if isinstance(error, RecordingFileError) else ValueError
            raise kind(words_of(error, rate_option="--recorded-hz") + hint) from None


@dataclass(kw_only=True)
class Reading(ReadingOptions):
    """Recordings to read, all in one file or folder."""

    path: Path = typer.Argument(
        metavar="PATH", help="Folder or file of recordings, of any format; see granular-id evaluate."
    )

    def refuse_absent(self) -> None:
        """Refuse a path with nothing there, before an import that takes longer than a look."""
        from granular_id._files import check_source

        check_source(self.path)

    def load(self, *, quiet: bool = False) -> Dataset:
        """Read the recordings and say what was read; when quiet, only what was skipped."""
        data = self.load_path(self.path, quiet=quiet)
        say_loaded(data, quiet=quiet)
        return data


@dataclass(kw_only=True)
class StepOptions:
    """How recordings come to one rate, and which of them are left out."""

    rate_hz: float | None = option(
        PANEL, "Resample, to a lower rate through a low-pass. For files without a clock: --recorded-hz."
    )
    max_gap_s: float = option(PANEL, "Longest gap to fill when resampling; inf: any.", default=MAX_GAP_S)
    on_gap: Handling = option(PANEL, "A longer gap: refuse, or leave the recording out.", default="raise")
    on_short: Handling = option(
        PANEL, "A recording too short, or without trigger or onset: refuse, or leave it out.", default="raise"
    )
    rest_s: float = option(PANEL, "Rest at the start from which the onset is judged.", default=0.1)
    onset_at: list[str] | None = option(PANEL, "Overrule an onset: NAME=SECONDS, or NAME=none. Repeatable.")
    onsets: dict[str, float | None] = field(init=False)

    def __post_init__(self) -> None:
        positive("--rate-hz", self.rate_hz)
        positive("--max-gap-s", self.max_gap_s, infinite=True)
        positive("--rest-s", self.rest_s)
        self.onsets = _onsets_in(self.onset_at or [])

    def resample(self, data: Dataset) -> Dataset:
        """Resample what has another rate than the one asked for; the same data set where nothing has."""
        if self.rate_hz is None or all(recording.rate_hz == self.rate_hz for recording in data):
            return data
        limit = None if math.isinf(self.max_gap_s) else self.max_gap_s
        return data.resample(self.rate_hz, max_gap_s=limit, on_gap=self.on_gap)

    def with_onsets(self, data: Dataset) -> Dataset:
        """Find the onsets of recordings that share a rate; triggers that were stored give way."""
        _refuse_unequal_rates(data)
        return data.find_onsets(rest_s=self.rest_s, overrule=self.onsets or None, replace=True)

    def refuse_missing_onsets(self, data: Dataset) -> None:
        """Refuse recordings in which no onset was found, unless they are left out."""
        without = [recording.name for recording in data if recording.trigger_index is None]
        if without and self.on_short == "raise":
            raise GranularIdError(
                f"no onset in {len(without)} of {len(data)} recordings, the first is {without[0]!r}: state it "
                "with --onset-at NAME=SECONDS, try another --rest-s, or add --on-short skip to leave them out"
            )


@dataclass(kw_only=True)
class Steps(StepOptions):
    """What to do with recordings once they are read."""

    begin_at: Literal["first", "trigger", "onset"] = option(
        PANEL,
        "Keep from the first sample, the stored trigger, or the onset of motion found in the forces.",
        default="first",
    )
    lead_s: float = option(PANEL, "Seconds to keep ahead of trigger or onset.", default=0.0)
    duration_s: float | None = option(PANEL, "Keep this many seconds from there on.")
    n_samples: str | None = option(PANEL, "Keep this many samples, or: shortest.")
    window_s: float | None = option(PANEL, "Cut recordings into windows of so many seconds, after all else.")
    hop_s: float | None = option(PANEL, "From one window to the next. Default: --window-s, no overlap.")
    exclude: str = option(PANEL, "Materials to leave out, separated by commas.", default="")
    length: int | Literal["shortest"] | None = field(init=False)

    def __post_init__(self) -> None:
        if self.duration_s is not None and self.n_samples is not None:
            raise GranularIdError("give one of --duration-s and --n-samples, not both")
        if self.begin_at != "first" and self.duration_s is None and self.n_samples is None:
            raise GranularIdError(
                f"--begin-at {self.begin_at} crops recordings: add --duration-s or --n-samples (a number, or "
                "shortest)"
            )
        if self.lead_s and self.begin_at == "first":
            raise GranularIdError("--lead-s is time kept ahead of a trigger: add --begin-at trigger or onset")
        positive("--duration-s", self.duration_s)
        positive("--window-s", self.window_s)
        positive("--hop-s", self.hop_s)
        if self.hop_s is not None and self.window_s is None:
            raise GranularIdError("--hop-s is the way from one window to the next: add --window-s")
        super().__post_init__()
        if self.rate_hz is None and (self.max_gap_s != MAX_GAP_S or self.on_gap != "raise"):
            unused = "--max-gap-s" if self.max_gap_s != MAX_GAP_S else "--on-gap"
            raise GranularIdError(f"{unused} is about gaps that resampling fills: add --rate-hz")
        self.length = _length_of(self.n_samples)

    def taken(self, data: Dataset, *, quiet: bool = False, onsets_later: bool = False) -> Dataset:
        """Leave out labels, resample, find onsets, crop and cut into windows as asked; say what each step did.

        `onsets_later`: stating some onsets makes sense without ``--begin-at onset``.
        """
        if not onsets_later:
            self.refuse_unused_onsets()
        data = self._without_excluded(data, quiet=quiet)
        for made in self.each(data):
            data = say_step(made, quiet=quiet)
        return data

    def refuse_unused_onsets(self) -> None:
        """Refuse onsets that are stated for nothing."""
        if self.onsets and self.begin_at != "onset":
            raise GranularIdError(
                "--onset-at states an onset, but nothing begins there: add --begin-at onset"
            )

    def each(self, data: Dataset) -> Iterator[Dataset]:
        """Resample, find onsets, crop and cut into windows as asked; yield what each step made."""
        resampled = self.resample(data)
        if resampled is not data:
            data = resampled
            yield data
        if self.begin_at == "onset":
            data = self.with_onsets(data)
            yield data
            self.refuse_missing_onsets(data)
        if self.duration_s is not None or self.length is not None:
            _refuse_unequal_rates(data)
            data = data.align(
                self.length,
                duration_s=self.duration_s,
                trigger=None if self.begin_at == "first" else "recorded",
                lead_s=self.lead_s,
                on_short=self.on_short,
            )
            yield data
        if self.window_s is not None:
            _refuse_unequal_rates(data)
            yield data.windows(self.window_s, self.hop_s, on_short=self.on_short)

    def _without_excluded(self, data: Dataset, *, quiet: bool) -> Dataset:
        excluded = [known_label(name, data.labels) for name in names_in(self.exclude)]
        if not excluded:
            return data
        unknown = sorted(set(excluded) - set(data.labels))
        if unknown:
            known = ", ".join(data.labels)
            raise GranularIdError(
                f"--exclude names {unknown[0]!r}, which is no label here; there are {known}"
            )
        kept = [label for label in data.labels if label not in excluded]
        if not kept:
            raise GranularIdError("--exclude leaves no recording")
        remaining = data.select(labels=kept)
        if not quiet:
            counts = Counter(r.label for r in data if r.label not in remaining.labels)
            out = ", ".join(f"{label or 'no label'} ({counted(n)})" for label, n in counts.items())
            show(
                f"--exclude left out {out}; {counted(len(remaining))}, {counted(len(kept), 'material')} remain"
            )
        return remaining


GRAVITY = (
    "Where gravity points, in the frame of the wrench: x,y,z for all recordings, or a CSV file with the columns "
    "name,gx,gy,gz. Default: what their metadata say under these names, or as gravity."
)
"""Help of ``--gravity``."""

GRAVITY_WANTED = "x,y,z, or a CSV file with the columns name,gx,gy,gz"


@dataclass(kw_only=True)
class WrenchSteps:
    """How wrenches of another set-up become those of a training."""

    compensate: Path | None = option(
        SETUP, "Take weight and zero of a tool off, as `granular-id setup payload` writes them."
    )
    gravity: str | None = option(SETUP, GRAVITY)
    rotate: str | None = option(
        SETUP,
        "Turn from the old frame into the new one: roll,pitch,yaw in degrees about fixed axes, or a quaternion "
        "x,y,z,w; as tf gives it for (new frame, old frame).",
    )
    translate: str | None = option(SETUP, "Position of the old origin in the new frame: x,y,z in m.")
    flip: str = option(
        SETUP,
        "Axes whose sign to change before that, such as fx,tx of a driver that mirrors them.",
        default="",
    )
    sign: str | None = option(SETUP, "Where all six are flipped: whose force on whom it is then.")
    frame: str | None = option(SETUP, "Name of the new frame, which models compare.")

    def __post_init__(self) -> None:
        if self.gravity is not None and self.compensate is None:
            raise GranularIdError("--gravity says in which direction a payload weighs: add --compensate")
        for name in ("rotate", "translate"):
            if getattr(self, name) is not None and self.frame is None:
                raise GranularIdError(f"--{name} makes another frame: add --frame with its name")
        wanted = "roll,pitch,yaw in degrees or a quaternion x,y,z,w"
        self._turn = [] if self.rotate is None else numbers_in("--rotate", self.rotate, wanted)
        if len(self._turn) not in (0, 3, 4):
            raise GranularIdError(f"--rotate must be {wanted}, got {self.rotate!r}")
        self._origin = [0.0, 0.0, 0.0]
        if self.translate is not None:
            self._origin = numbers_in("--translate", self.translate, "x,y,z in m", 3)
            if max(map(abs, self._origin)) >= _FAR_M:
                raise GranularIdError(
                    f"--translate must be x,y,z in m, less than {_FAR_M:g}, got {self.translate!r}"
                )
        if self.compensate is not None:
            from granular_id.recording import Payload

            self._payload, self._gravity = Payload.load(self.compensate), gravity_in(self.gravity)

    def taken(self, data: Dataset) -> Dataset:
        """Take off a payload and turn, as asked; say what each step did."""
        if self.compensate is not None:
            data = say_step(data.compensate(self._payload, gravity_at(data, self._gravity)), quiet=False)
        flip = names_in(self.flip)
        if self.frame is not None or flip or self.sign is not None:
            turned = data.transform(
                self._rotation(), self._origin, frame=self.frame, flip=flip, sign=self.sign
            )
            data = say_step(turned, quiet=False)
        return data

    def _rotation(self) -> FloatArray | list[float] | None:
        if len(self._turn) != 3:
            return self._turn or None
        from scipy.spatial.transform import Rotation

        matrix = Rotation.from_euler("xyz", self._turn, degrees=True).as_matrix()
        turn: FloatArray = matrix.round(15)  # right angles only change places and signs
        return turn


_FAR_M = 10.0  # no robot reaches so far: these are millimetres

Gravity = list[float] | dict[str, Mapping[str, Any]] | None
"""One direction, what a table says by the name of a recording, or nothing: then the metadata say it."""


def gravity_in(text: str | None) -> Gravity:
    """Read ``--gravity``."""
    if text is None or Path(text).is_file():
        return None if text is None else _poses_in(Path(text))
    if text.endswith(".csv"):
        raise GranularIdError(f"--gravity {text}: no such file")
    return numbers_in("--gravity", text, GRAVITY_WANTED, 3)


def gravity_at(data: Dataset, stated: Gravity) -> FloatArray:
    """Return where gravity points in each recording, shape (n, 3)."""
    import numpy as np

    from granular_id.recording import gravity_in as read

    if isinstance(stated, list):
        return np.tile(stated, (len(data), 1))
    found = []
    for one in data:
        entry = one.meta if stated is None else stated.get(one.name)
        if entry is None:
            raise GranularIdError(f"--gravity has no line for the recording {one.name!r}")
        try:
            down = read(entry)
        except ValueError as error:
            raise GranularIdError(f"gravity of {one.name!r} must be three numbers: {error}") from None
        if down is None:
            raise GranularIdError(
                f"recording {one.name!r} does not say where gravity points: add --gravity {GRAVITY_WANTED}"
            )
        found.append(down)
    return np.array(found)


def _poses_in(path: Path) -> dict[str, Mapping[str, Any]]:
    """Read a table of directions, a line a recording."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = csv.DictReader(file, skipinitialspace=True)
            columns, rows = lines.fieldnames or (), list(lines)
    except (ValueError, csv.Error) as error:
        raise GranularIdError(f"--gravity {path}: no CSV file: {error}") from None
    from granular_id.recording import GRAVITY as DIRECTION

    if not {"name", *DIRECTION} <= {*columns}:
        came = ", ".join(columns) or "nothing"
        raise GranularIdError(f"--gravity {path} must be {GRAVITY_WANTED}, got the columns {came:.200}")
    names = [row["name"] for row in rows]
    if len({*names}) < len(names):
        raise GranularIdError(f"--gravity {path}: names {Counter(names).most_common(1)[0][0]!r} twice")
    return dict(zip(names, rows, strict=True))


def equal_recordings(reading: Reading, steps: Steps, *, quiet: bool) -> Dataset:
    """Read and prepare labelled recordings of one rate and one length, as every method needs them.

    Where they have no labels or differ, and no option says what to do, the error proposes the option.
    """
    data = reading.load(quiet=quiet)
    if not data.labels:
        notes = (note for note in data.history[-1].notes if "no column label" in note)
        raise GranularIdError(f"{reading.path}: {next(notes, 'no recording has a label')}")
    data = steps.taken(data, quiet=quiet)
    refuse_unequal(data)
    return data


def refuse_unequal(data: Dataset) -> None:
    """Raise ValueError proposing an option where recordings differ in rate or length."""
    _refuse_unequal_rates(data)
    lengths = sorted(recording.n_samples for recording in data)
    if lengths[0] == lengths[-1]:
        return
    short = min(data, key=lambda recording: recording.n_samples)
    middle = lengths[len(lengths) // 2]
    raise GranularIdError(
        f"recordings last {lengths[0]} to {lengths[-1]} samples ({lengths[0] / data.rate_hz:g} to "
        f"{lengths[-1] / data.rate_hz:g} s), the shortest is {short.name!r}; nothing is cropped unasked: "
        f"add --n-samples shortest to keep the first {lengths[0]} of all, or a larger number with "
        f"--on-short skip to leave out the shorter ones (half have at least {middle}), or --window-s to cut all into "
        "windows of one length"
    )


_PAUSE_S = 1.0
"""So long a pause is none of jitter: several pushes stand in one log."""


def _refuse_unequal_rates(data: Dataset) -> None:
    irregular = [recording for recording in data if recording.rate_hz is None]
    rates = sorted({recording.rate_hz for recording in data if recording.rate_hz is not None})
    if not irregular and len(rates) == 1:
        return
    if not irregular:
        raise GranularIdError(
            f"recordings were sampled at {rates[0]:g} to {rates[-1]:g} Hz; nothing is resampled unasked: "
            f"add --rate-hz {rates[0]:g}"
        )
    import numpy as np

    some = f"{len(irregular)} of {counted(len(data))}"
    steps = np.concatenate([np.diff(recording.times()) for recording in irregular])
    if not steps.size:
        raise GranularIdError(
            f"{some} {verb(len(irregular), 'holds', 'hold')} a single sample, the first is "
            f"{irregular[0].name!r}: wanted recordings of a whole push"
        )
    step_s, pause_s = float(np.median(steps)), float(steps.max())
    if pause_s >= _PAUSE_S:
        raise GranularIdError(
            f"{some} {verb(len(irregular), 'has', 'have')} pauses of up to {pause_s:.3g} s; granular-id data convert "
            f"--split-gap-s {_PAUSE_S:g} makes a recording of each stretch"
        )
    raise GranularIdError(
        f"{some} {verb(len(irregular), 'is', 'are')} sampled irregularly, with a median step of "
        f"{1000 * step_s:.3g} ms; nothing is resampled unasked: add --rate-hz {_round_below(1 / step_s):g}"
    )


def _round_below(rate_hz: float) -> float:
    """Return the largest of 1, 2, 5, 10, 20, 50, ... that is not above a rate."""
    power = 10.0 ** math.floor(math.log10(rate_hz))
    return max(step * power for step in (1, 2, 5) if step * power <= rate_hz * (1 + 1e-9))


def _length_of(text: str | None) -> int | Literal["shortest"] | None:
    """Read ``--n-samples``."""
    if text is None or text == "shortest":
        return "shortest" if text else None
    try:
        length = int(text)
    except ValueError:
        raise GranularIdError(f"--n-samples must be a whole number or 'shortest', got {text!r}") from None
    at_least("--n-samples", length, 1)
    return length


def _onsets_in(texts: Sequence[str]) -> dict[str, float | None]:
    """Read ``--onset-at``: NAME=SECONDS, or NAME=none for a recording without an onset."""
    onsets: dict[str, float | None] = {}
    for text in texts:
        name, _, value = text.rpartition("=")
        try:
            seconds = None if value == "none" else float(value)
        except ValueError:
            name = ""
        if not name:
            raise GranularIdError(f"--onset-at must be NAME=SECONDS or NAME=none, got {text!r}")
        if name in onsets:
            raise GranularIdError(f"--onset-at names {name!r} twice")
        onsets[name] = seconds
    return onsets


def say_loaded(data: Dataset, *, quiet: bool) -> None:
    """Say what was read: numbers, length, rate, and what deserves mention; when quiet, only what was skipped."""
    from granular_id.recording import headline, noticed_lines, skipped_lines

    report = data.history[-1]
    lines = skipped_lines(report)
    if not quiet:
        lines = [headline(data.recordings), *lines, *noticed_lines(report)]
    if lines:
        show("\n".join(lines))


def say_step(data: Dataset, *, quiet: bool) -> Dataset:
    """Say what the last step of a data set did, or when quiet only what it left out; return the data set."""
    from granular_id.recording import skipped_lines

    step = data.history[-1]
    # of single recordings only those left out; the JSON file has all
    brief = replace(step, rows=[row for row in step.rows if "skipped" in row])
    text = "\n".join(skipped_lines(step)) if quiet else str(brief)
    if text:
        show(text)
    return data
