"""How commands read recordings, and the ``data convert`` that a refusal ends with."""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Iterator, Set
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from granular_id._core import GranularIdError
from granular_id._text import counted, in_both, verb
from granular_id.cli.outputs import show

if TYPE_CHECKING:
    from granular_id.recording import Dataset

_PAUSE_S = 1.0
"""So long a pause is none of jitter: several pushes stand in one log."""

_MOST_LINES = 6

_OF_INFO = ("label", "session", "axes", "units", "csv")


def read(path: Path, *, prepared: bool = False, quiet: bool = False, **options: Any) -> Dataset:
    """Read the recordings of a path, say on standard error what was read; when quiet, only what was skipped.

    `prepared`: they must have labels, one rate and one length, as every method needs them. `options`: those of `load`.
    """
    from granular_id.io import load
    from granular_id.recording import headline, noticed_lines, skipped_lines

    try:
        data = load(path, progress=not quiet, **options)
        if prepared and (
            not data.labels or len({(r.rate_hz, r.n_samples) for r in data}) > 1 or not data[0].rate_hz
        ):
            raise _unprepared(data)
    except GranularIdError as error:
        _tell(error, path, options)
        raise
    report = data.history[-1]
    lines = skipped = skipped_lines(report)
    if not quiet:
        lines = [headline(data.recordings), *lines, *noticed_lines(report)]
    if lines:
        given = {name: options[name] for name in _OF_INFO if name in options}
        show("\n".join(lines), err=True, most=_MOST_LINES if skipped else 4, rest=history_of(path, given))
    return data


@contextmanager
def about(path: Path) -> Iterator[None]:
    """Let refusals of a block be about the recordings of a path."""
    try:
        yield
    except GranularIdError as error:
        _tell(error, path, {})
        raise


def _tell(error: Any, path: Path, options: dict[str, Any]) -> None:
    """Give a refusal what it is about: `way_out` makes a command of it."""
    error.source = path, options
    if getattr(error, "skippable", False):
        error.args = (f"{error}; or leave such files out (--on-error skip)",)


def way_out(error: Exception, converts: Set[str]) -> str:
    """Return the command that prepares recordings as a refusal says: it names options, ``(--csv skiprows=7)``.

    `converts`: the options of ``data convert``. Empty where the refusal names others or none, or converting was it.
    """
    path, given = getattr(error, "source", (None, {}))
    ways = [
        way
        for way in re.findall(r"\((--[^()]+)\)", str(error))
        if {*re.findall(r"(?<!\S)--[\w-]+", way)} <= converts
    ]
    if path is None or not ways or "on_error" in given:
        return ""
    others = "".join(f"\nor with {way}" for way in ways[1:])
    return f":\n{_convert(path)}{_typed(given)} {ways[0]}{others}"


def _typed(given: dict[str, Any]) -> str:
    """Return options of `load` as they are typed."""
    plain = {
        name: value if isinstance(value, dict | str) else ",".join(value)
        for name, value in given.items()
        if value
    }
    words = [in_both(**{name: value}) for name, value in plain.items()]
    return "".join(f" {text[text.index('(--') + 1 : -1]}" for text in words)


def history_of(path: Path, given: dict[str, Any]) -> str:
    """Return the command that prints all of what reading and steps say of recordings."""
    return f"granular-id data info {shlex.quote(str(path))}{_typed(given)} --details"


def say_step(data: Dataset, *, err: bool = False, rest: str = "") -> Dataset:
    """Say what the last step of a data set did, what it left out before all else; return the data set."""
    from granular_id.recording import skipped_lines

    step = data.history[-1]
    first, *others = str(replace(step, rows=())).splitlines()
    show("\n".join([first, *skipped_lines(step), *others]), err=err, most=_MOST_LINES, rest=rest)
    return data


def refuse_uneven(data: Dataset) -> None:
    """Refuse recordings without one rate, with the option that gives them one."""
    rates = {recording.rate_hz for recording in data}
    if None in rates or len(rates) > 1:
        raise _unprepared(data)


def _convert(path: Path) -> str:
    """Return the words that convert a path, up to the options; an archive becomes one."""
    from granular_id.io.parquet.layout import is_parquet_archive

    ending = "parquet" if is_parquet_archive(path) else "npz"
    output = f"{path.resolve().stem}-prepared.{ending}"
    return f"granular-id data convert {shlex.quote(str(path))} {shlex.quote(output)}"


def _unprepared(data: Dataset) -> GranularIdError:
    """Return the refusal of recordings without labels, one rate or one length; it names what gives them those."""
    import numpy as np

    if not data.labels:
        notes = (note for note in data.history[-1].notes if "no column label" in note)
        return GranularIdError(
            f"{next(notes, 'no recording has a label')}; say where it stands (--label file)"
        )
    rates = sorted({recording.rate_hz for recording in data if recording.rate_hz is not None})
    irregular = [recording for recording in data if recording.rate_hz is None]
    ends = [float(recording.times()[-1] - recording.times()[0]) for recording in data]
    even = " --duration-s shortest" if max(ends) - min(ends) > 1e-9 else ""
    if irregular:
        some = f"{len(irregular)} of {counted(len(data))}"
        steps = np.concatenate([np.diff(recording.times()) for recording in irregular])
        if not steps.size:
            problem = f"{some} {verb(len(irregular), 'holds', 'hold')} a single sample, the first is"
            return GranularIdError(f"{problem} {irregular[0].name!r}: wanted recordings of a whole push")
        step_s, gap_s = float(np.median(steps)), float(steps.max())
        if gap_s >= _PAUSE_S:
            return GranularIdError(
                f"{some} {verb(len(irregular), 'has', 'have')} pauses of up to {gap_s:.3g} s; a recording of each "
                f"stretch (--split-gap-s {_PAUSE_S:g})"
            )
        fill = f" --max-gap-s {math.ceil(10 * gap_s) / 10:g}" if gap_s > 0.25 else ""
        return GranularIdError(
            f"{some} {verb(len(irregular), 'is', 'are')} sampled irregularly, with a median step of "
            f"{1000 * step_s:.3g} ms and gaps of up to {1000 * gap_s:.3g} ms; nothing is resampled unasked "
            f"(--resample-hz {_round_below(1 / step_s):g}{fill}{even})"
        )
    if len(rates) > 1:
        return GranularIdError(
            f"recordings were sampled at {rates[0]:g} to {rates[-1]:g} Hz; nothing is resampled unasked "
            f"(--resample-hz {rates[0]:g}{even})"
        )
    short = min(data, key=lambda recording: recording.n_samples)
    lengths = sorted(recording.n_samples / data.rate_hz for recording in data)
    return GranularIdError(
        f"recordings last {lengths[0]:.9g} to {lengths[-1]:.9g} s, the shortest is {short.name!r}; nothing is cropped "
        "unasked: keep of all what the shortest has (--duration-s shortest), or leave out the shorter ones "
        f"(--duration-s {lengths[len(lengths) // 2]:.9g} --on-error skip), or cut windows "
        f"(--window-s {lengths[0]:.9g})"
    )


def _round_below(rate_hz: float) -> float:
    """Return the largest of 1, 2, 5, 10, 20, 50, ... that is not above a rate."""
    power = 10.0 ** math.floor(math.log10(rate_hz))
    return max(step * power for step in (1, 2, 5) if step * power <= rate_hz * (1 + 1e-9))
