"""Options that several commands share, and how their texts are read."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import typer

from granular_id._core import GranularIdError

FOUND_ERRORS = 3
"""Exit code where recordings were read, and hold what would spoil, or spoils, an evaluation."""


def within(low: float, high: float = math.inf, *, but: str = "") -> Callable[[float | None], float | None]:
    """Return the callback of an option that refuses numbers outside of an open interval."""

    def callback(value: float | None) -> float | None:
        if value is not None and not low < value < high:
            wanted = "be positive and finite" if math.isinf(high) else f"lie between {low:g} and {high:g}"
            raise typer.BadParameter(f"must {wanted}{but}, got {value:g}")
        return value

    return callback


class Difference(str, Enum):
    """Choices of ``--accept``."""

    frame = "frame"
    transform = "transform"
    sign = "sign"
    units = "units"


Recordings = Annotated[
    Path,
    typer.Argument(metavar="PATH", help="Recordings: what `granular-id data convert` wrote, or a folder."),
]
Model = Annotated[Path, typer.Argument(metavar="MODEL", help="Model file, from `granular-id train`.")]
Force = Annotated[
    bool, typer.Option("--force", help="Replace files that are there, where they are of the same kind.")
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print the answer only, and no progress.")]
Details = Annotated[bool, typer.Option("--details", help="Print all there is, not one screen.")]
Json = Annotated[Path | None, typer.Option(help="Write all numbers into this file, for programs.")]
Figure = Annotated[Path | None, typer.Option(help="Draw it: png, svg or pdf.")]
Seed = Annotated[int, typer.Option(min=0, help="Same seed, same numbers.")]
Jobs = Annotated[int | None, typer.Option("--jobs", "-j", min=1, help="Threads. Default: one a core.")]
Space = Annotated[
    str,
    typer.Option(
        help="Feature space. best: what held-out recordings choose of multi-band features; multiband: the same "
        "without a choice; raw+hfmh: the paper's."
    ),
]
HoldOut = Annotated[
    str,
    typer.Option(
        help="auto: sessions where half of the materials have several, else halves in time, else random folds. Or "
        "session, time, random; or a condition: day, tool, sensor, any entry of the metadata."
    ),
]
CutoffHz = Annotated[float | None, typer.Option(help="High-pass of the histogram (HFMH). Default: 23 Hz.")]
BinRange = Annotated[
    str | None,
    typer.Option(
        help="LOW,HIGH of the histogram, N and N m; auto: learned for each axis. Default: -1.5,1.5."
    ),
]
Share = Annotated[
    float, typer.Option(callback=within(0, 1), help="Share of known recordings that are not called unknown.")
]
Accept = Annotated[
    list[Difference] | None,
    typer.Option(help="Go on though this is not as in the training, with a warning. Repeatable."),
]
Scheduler = Annotated[
    str | None,
    typer.Option(help="Scheduler of a Dask cluster that does the work: tcp://HOST:8786. Default: threads."),
]

# How recordings are read that do not follow the convention.

Label = Annotated[
    str | None,
    typer.Option(
        help="Where labels stand: folder, parent (above it), file (its name), column:NAME, meta:PATH."
    ),
]
Session = Annotated[
    str | None,
    typer.Option(help="Where sessions stand, what was recorded in one go: as --label."),
]
Axes = Annotated[
    str | None, typer.Option(help="Columns that are the axes: wx,wy,wz. Default: fx,fy,fz,tx,ty,tz.")
]
Units = Annotated[
    str | None,
    typer.Option(help="Units that files do not state: one, one an axis, or one a run of axes (rad/s,m/s2)."),
]
Csv = Annotated[
    list[str] | None,
    typer.Option(help="Option of pandas.read_csv: skiprows=7, decimal=, or encoding=cp1252. Repeatable."),
]


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
        wanted = "LOW,HIGH such as -1.5,1.5, or auto"
        auto = bin_range == "auto"
        settings["bin_range"] = "auto" if auto else tuple(numbers_in("--bin-range", bin_range, wanted, 2))
    return settings
