"""How commands read recordings, and the ``data convert`` that a refusal ends with."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from granular_id._checks import WayOutError
from granular_id._core import GranularIdError
from granular_id._text import PYTHON_ONLY, RATE, WayOut, command_words, counted, is_unknown, typed, verb
from granular_id.cli.outputs import show

if TYPE_CHECKING:
    from granular_id.recording import Dataset, Recording

_FEW_LINES, _MOST_LINES, _ALL_LINES = 4, 6, 14
"""Lines of what was read: ahead of figures, where something was left out, and where nothing else is printed."""

_OTHER_RATE = 1.9
"""Usual steps of a recording, in those of all, from which on it was sampled at another rate."""

_SPECIAL = '"$`\\!'
"""What a shell takes for something else between double quotes."""

_OF_INFO = ("label", "session", "axes", "units", "csv")


def read(
    path: Path,
    *,
    prepared: bool = False,
    quiet: bool = False,
    rest: str | None = None,
    output: Path | None = None,
    **options: Any,
) -> Dataset:
    """Read the recordings of a path, say on standard error what was read; when quiet, only what was skipped.

    `prepared`: they must have labels, one rate and one length, as every method needs them; `rest`: the command that
    says all of it, where it is not one about the path; `output`: where they are converted to. `options`: those of
    `load`.
    """
    from granular_id.io import load
    from granular_id.recording import headline, noticed_lines, skipped_lines

    try:
        data = load(path, progress=not quiet, **options)
        if prepared and (
            not data.labels or len({(r.rate_hz, r.n_samples) for r in data}) > 1 or not data[0].rate_hz
        ):
            raise _unprepared(data, path)
    except GranularIdError as error:
        _tell(error, path, options, output)
        raise
    report = data.history[-1]
    lines = skipped = skipped_lines(report)
    if not quiet:
        lines = [headline(data.recordings), *lines, *noticed_lines(report)]
    if lines:
        given = {name: options[name] for name in _OF_INFO if name in options}
        # what has files that cannot be read is no data set of `data info`
        rest = rest or history_of(path, given, "check" if skipped else "info")
        most = _ALL_LINES if output is not None else _MOST_LINES if skipped else _FEW_LINES
        show("\n".join(lines), err=True, most=most, rest=rest)
    return data


@contextmanager
def about(path: Path) -> Iterator[None]:
    """Let refusals of a block be about the recordings of a path."""
    try:
        yield
    except GranularIdError as error:
        _tell(error, path, {})
        raise


def _tell(error: Any, path: Path, options: dict[str, Any], output: Path | None = None) -> None:
    """Give a refusal what it is about: `with_way_out` makes a command of it."""
    given = {name: value for name, value in options.items() if value not in (None, "raise")}
    error.source = path, given, output
    if getattr(error, "skippable", False):
        error.parts += ("; or leave such files out ", typed(on_error="skip"))
        error.args = (f"{error}{''.join(error.parts[-2:])}",)


def with_way_out(error: Exception, message: str, words: Sequence[str] = ()) -> str:
    """Return the message of an error, and below it the commands that prepare recordings so, the best first.

    Lines of Python become one of them where they need nothing that only the user knows. `words` are those typed behind
    the name of the command: where converting was refused they are typed again, with more.
    """
    from granular_id.io.files import printable
    from granular_id.io.ways_out import joined

    path, given, output = getattr(error, "source", (None, {}, None))
    if path is None or not isinstance(error, WayOutError):
        return message
    target = _prepared(path)
    known = [way for way in error.ways if not is_unknown(way)]
    options = [way for way in known if PYTHON_ONLY not in way]
    commands = []
    if options:
        also = "".join(f"\nor with {command_words(way)}" for way in options[1:])
        typed_ahead = shlex.join(words)
        if output is None:
            typed_ahead, options[0] = shlex.join([str(path), target]), joined(given, options[0])
        commands.append(f"granular-id data convert {typed_ahead} {command_words(options[0])}{also}")
    for way in known:
        if PYTHON_ONLY in way:
            passed = ", ".join(f"{name}={value!r}" for name, value in joined(given, way).items())
            commands.append(
                _python(f"from granular_id import load; data = load({str(path)!r}, {passed})", target)
            )
    for part in error.parts:
        if isinstance(part, WayOut) and part.code and RATE not in part.code:
            message = message.replace(printable(part), "")
            where = f"where {part.why}:\n" * bool(part.why)
            commands.append(where + _python(part.code, target))
    return message + ":\n" * bool(commands) + "\nor:\n".join(commands)


def _python(code: str, target: str) -> str:
    """Return the command that runs lines of Python, and saves what they make."""
    code += f"; from granular_id import save; save(data, {target!r})"
    if not set(code) & set(_SPECIAL):
        return f'python -c "{code}"'
    if '"' not in code:
        code = code.replace("'", '"')
    return f"python -c {shlex.quote(code)}"


def history_of(path: Path, given: dict[str, Any], command: str = "info") -> str:
    """Return the command that prints all of what reading and steps say of recordings."""
    words = command_words({name: value for name, value in given.items() if value})
    return f"granular-id data {command} {shlex.quote(str(path))} {words}{' ' * bool(words)}--details"


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
        raise _unprepared(data, None)


def _prepared(path: Path) -> str:
    """Return the name under which a path is converted; an archive becomes one."""
    from granular_id.io.parquet.layout import is_parquet_archive

    ending = "parquet" if is_parquet_archive(path) else "npz"
    return f"{path.resolve().stem}-prepared.{ending}"


def _unprepared(data: Dataset, path: Path | None) -> WayOutError:
    """Return the refusal of recordings without labels, one rate or one length; it names what gives them those."""
    from granular_id.recording import SHORT

    if not data.labels:
        return _unlabelled(data, path)
    rates = sorted({recording.rate_hz for recording in data if recording.rate_hz is not None})
    irregular = [recording for recording in data if recording.rate_hz is None]
    ends = [float(recording.times()[-1] - recording.times()[0]) for recording in data]
    even = {"duration_s": "shortest"} if max(ends) - min(ends) > 1e-9 else {}
    if irregular:
        return _irregular(len(data), irregular, even)
    if len(rates) > 1:
        return WayOutError(
            f"recordings were sampled at {rates[0]:g} to {rates[-1]:g} Hz; nothing is resampled unasked ",
            typed(resample_hz=rates[0], **even),
        )
    short = min(data, key=lambda recording: recording.n_samples)
    lengths = sorted(recording.n_samples / data.rate_hz for recording in data)
    usual = lengths[len(lengths) // 2]
    is_cut_off = lengths[0] <= SHORT * usual
    whole = usual if not is_cut_off else next(one for one in lengths if one > SHORT * usual)
    ways = [
        ("keep of all what the shortest has ", typed(duration_s="shortest")),
        ("leave out the shorter ones ", typed(duration_s=whole, on_error="skip")),
    ]
    first, second = reversed(ways) if is_cut_off else ways  # the others shall not be halved
    return WayOutError(
        f"recordings last {lengths[0]:.9g} to {lengths[-1]:.9g} s, the shortest is {short.name!r}; nothing is cropped "
        "unasked: ",
        *first,
        ", or ",
        *second,
        ", or cut windows ",
        typed(window_s=lengths[0]),
    )


def _irregular(n_in_all: int, irregular: Sequence[Recording], even: dict[str, Any]) -> WayOutError:
    """Return the refusal of recordings that are sampled irregularly."""
    import numpy as np

    from granular_id.recording import PAUSE_S

    some = f"{len(irregular)} of {counted(n_in_all)}"
    steps = np.concatenate([np.diff(recording.times()) for recording in irregular])
    if not steps.size:
        problem = f"{some} {verb(len(irregular), 'holds', 'hold')} a single sample, the first is"
        return WayOutError(f"{problem} {irregular[0].name!r}: wanted recordings of a whole push")
    step_s, gap_s = float(np.median(steps)), float(steps.max())
    if gap_s >= PAUSE_S:
        return WayOutError(
            f"{some} {verb(len(irregular), 'has', 'have')} pauses of up to {gap_s:.3g} s; a recording of each "
            "stretch ",
            typed(split_gap_s=PAUSE_S),
        )
    fill = {"max_gap_s": math.ceil(10 * gap_s) / 10} if gap_s > 0.25 else {}
    medians = {r.name: float(np.median(np.diff(r.times()))) for r in irregular if r.n_samples > 1}
    slow = max(medians, key=medians.__getitem__)
    if medians[slow] > _OTHER_RATE * step_s:
        low_hz = _round_below(1 / medians[slow])
        return WayOutError(
            f"{slow!r} was sampled at about {low_hz:g} Hz and others at {1 / step_s:.3g} Hz; nothing is resampled "
            "unasked: leave it out, or bring all to the lower rate ",
            typed(resample_hz=low_hz, **fill, **even),
        )
    return WayOutError(
        f"{some} {verb(len(irregular), 'is', 'are')} sampled irregularly, with a median step of "
        f"{1000 * step_s:.3g} ms and gaps of up to {1000 * gap_s:.3g} ms; nothing is resampled unasked ",
        typed(resample_hz=_round_below(1 / step_s), **fill, **even),
    )


def _unlabelled(data: Dataset, path: Path | None) -> WayOutError:
    """Say where labels may stand: in metadata, as those of an index.csv, else in folders or names of files."""
    from granular_id.io.sources import labels_of
    from granular_id.recording import LABEL, meaning_of

    listed = "no column label" in "".join(data.history[-1].notes)
    problem = "index.csv has no column label" if listed else "no recording has a label"
    texts = {key: [recording.meta.get(key) for recording in data] for key in data[0].meta if key != "read_as"}
    kinds = {
        key: len(set(values))
        for key, values in texts.items()
        if all(isinstance(value, str) and value for value in values)
    }
    named = [key for key in kinds if meaning_of(key).what == LABEL]
    keys = named or [key for key, n in kinds.items() if 1 < n < len(data)]
    if keys:
        ways = [part for key in keys for part in (f"; if {key!r} is it ", typed(label=f"meta:{key}"))]
        return WayOutError(f"{problem}; metadata hold {', '.join(texts)}", *ways)
    if path is None or path.is_file():
        return WayOutError(f"{problem}: keep a file or a folder for each material, called like it")
    places = [Path(recording.name) for recording in data]
    labels = set(labels_of(places))
    ways = (
        ["; if their folder is it ", typed(label="folder")] if all(len(p.parts) > 1 for p in places) else []
    )
    if None not in labels:
        some = ", ".join(sorted(filter(None, labels))[:3])
        ways += [f"; if the name of the file is it ({some}) ", typed(label="file")]
    return WayOutError(problem, *ways, "; an index.csv with the columns file and label may say it")


def _round_below(rate_hz: float) -> float:
    """Return the largest of 1, 2, 5, 10, 20, 50, ... that is not above a rate."""
    power = 10.0 ** math.floor(math.log10(rate_hz))
    return max(step * power for step in (1, 2, 5) if step * power <= rate_hz * (1 + 1e-9))
