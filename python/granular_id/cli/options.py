"""Options that several commands share, and how their texts are read."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Mapping
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from typer import Argument, Option

from granular_id._core import GranularIdError

FOUND_ERRORS = 3
"""Exit code where recordings were read, and hold what would spoil, or spoils, an evaluation."""


def within(low: float, high: float = math.inf) -> Callable[[float | None], float | None]:
    """Return the callback of an option that refuses numbers outside of an open interval."""

    def callback(value: float | None) -> float | None:
        if value is not None and not low < value < high:
            wanted = "be positive and finite" if math.isinf(high) else f"lie between {low:g} and {high:g}"
            raise typer.BadParameter(f"must {wanted}, got {value:g}")
        return value

    return callback


POSITIVE, SHARE = within(0), within(0, 1)

Skip = Literal["raise", "skip"]


class Difference(str, Enum):
    """Choices of ``--accept``."""

    frame = "frame"
    transform = "transform"
    sign = "sign"
    units = "units"


Recordings = Annotated[Path, Argument(metavar="PATH", help="What `data convert` wrote, or a folder.")]
Model = Annotated[Path, Argument(metavar="MODEL", help="Model file, from `granular-id train`.")]
Archive = Annotated[Path, Argument(metavar="ARCHIVE", help="Folder of an archive.")]
NewModel = Annotated[Path, Option("--output", "-o", help="Model file to write: .safetensors.")]

Force = Annotated[bool, Option("--force", help="Replace files that are there, of the same kind.")]
Quiet = Annotated[bool, Option("--quiet", "-q", help="Print the answer only, and no progress.")]
Details = Annotated[bool, Option("--details", help="Print more than one screen.")]
Json = Annotated[Path | None, Option(help="Write all numbers into this file, for programs.")]
Figure = Annotated[Path | None, Option(help="Draw it: png, svg or pdf.")]
Seed = Annotated[int, Option(min=0, help="Same seed, same numbers.")]
Jobs = Annotated[int | None, Option("--jobs", "-j", min=1, help="Threads. Default: one a core.")]
Scheduler = Annotated[str | None, Option(help="Dask cluster: tcp://HOST:8786. Default: threads.")]

Space = Annotated[
    str,
    Option(
        help="Feature space. best: what held-out recordings choose of multi-band features; multiband: the same "
        "without a choice; raw+hfmh: the paper's."
    ),
]
HoldOut = Annotated[
    str,
    Option(
        help="auto: sessions where half of the materials have several, else halves in time, else random folds. Or "
        "session, time, random; or a condition: day, tool, sensor, any entry of the metadata."
    ),
]
CutoffHz = Annotated[
    float | None, Option(callback=POSITIVE, help="High-pass of the histogram (HFMH). Default: 23 Hz.")
]
BinRange = Annotated[
    str | None, Option(help="LOW,HIGH of the histogram; auto: of each axis. Default: -1.5,1.5.")
]
ShareKnown = Annotated[float, Option(callback=SHARE, help="Share of known recordings not called unknown.")]
Accept = Annotated[
    list[Difference] | None, Option(help="Take it though this is not as in the training. Repeatable.")
]

# How recordings are read that do not follow the convention.

Label = Annotated[
    str | None,
    Option(help="Where labels stand: folder, parent (above it), file (its name), column:NAME, meta:PATH."),
]
Session = Annotated[str | None, Option(help="Where sessions stand, what was recorded in one go: as --label.")]
Axes = Annotated[str | None, Option(help="Columns that are the axes: wx,wy,wz. Default: fx,fy,fz,tx,ty,tz.")]
Units = Annotated[
    str | None,
    Option(help="Units that files do not state: one, one an axis, or one for each three (rad/s,m/s2)."),
]
Csv = Annotated[list[str] | None, Option(help="KEY=VALUE for pandas.read_csv: skiprows=7. Repeatable.")]


def csv_in(texts: list[str] | None) -> dict[str, Any] | None:
    """Read ``--csv KEY=VALUE``: values are those of Python where they look so, else texts."""
    options: dict[str, Any] = {}
    for text in texts or ():
        key, equals, value = text.partition("=")
        if not equals or not key.isidentifier():
            raise GranularIdError(f"--csv must be KEY=VALUE, an option of pandas.read_csv, got {text!r}")
        try:
            options[key] = ast.literal_eval(value)
        except (ValueError, SyntaxError):
            options[key] = value
    return options or None


def numbers_in(option: str, text: str, wanted: str, count: int | None = None) -> list[float]:
    """Split numbers at commas."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if not numbers or count not in (None, len(numbers)):
        raise GranularIdError(f"{option} must be {wanted}, got {text!r}")
    return numbers


def names_in(text: str) -> list[str]:
    """Split names at commas."""
    return [name.strip() for name in text.split(",") if name.strip()]


def histogram_settings(cutoff_hz: float | None, bin_range: str | None) -> dict[str, Any]:
    """Return the settings of the histogram that were given, as `granular_id.spaces.feature_spaces` takes them."""
    settings: dict[str, Any] = {} if cutoff_hz is None else {"cutoff_hz": cutoff_hz}
    if bin_range is not None:
        settings["bin_range"] = "auto" if bin_range == "auto" else _range_in(bin_range)
    return settings


def _range_in(text: str) -> tuple[float, float]:
    """Read ``--bin-range``."""
    wanted = "LOW,HIGH such as -1.5,1.5, or auto"
    low, high = numbers_in("--bin-range", text, wanted, 2)
    if not -math.inf < low < high < math.inf:
        raise GranularIdError(f"--bin-range must be {wanted}, with LOW below HIGH, got {text!r}")
    return low, high


def jobs_of(jobs: int | None, scheduler: str | None) -> int | None:
    """Return ``n_jobs``: all cores, unless fewer are requested or the workers of a cluster do the work."""
    return -1 if jobs is None and scheduler is None else jobs


def refuse(options: Mapping[str, object], why: str) -> None:
    """Refuse the first option that was given."""
    for name, value in options.items():
        if value:
            raise GranularIdError(f"{name} {why}: leave it out")
