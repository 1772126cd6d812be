"""``granular-id data``: look at recordings, check them, draw them."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from typer import Option

from granular_id._core import GranularIdError
from granular_id._text import counted
from granular_id.cli import options as opt
from granular_id.cli.outputs import COLUMNS, PICTURE, check_outputs, json_of, numbers, show, write_files
from granular_id.cli.recordings import read, say_step

if TYPE_CHECKING:
    from granular_id.recording import Dataset

_MOST_LINES, _MOST_UNREADABLE = 16, 8

Drawn = Literal["recordings", "mean", "onset"]


def info(
    path: opt.Recordings,
    *,
    label: opt.Label = None,
    session: opt.Session = None,
    axes: opt.Axes = None,
    units: opt.Units = None,
    csv: opt.Csv = None,
    json: opt.Json = None,
    force: opt.Force = False,
    details: opt.Details = False,
) -> None:
    """Say what a folder or file holds: recordings, materials, sessions, rates, lengths, gaps, flags, history.

    Examples:

    - `granular-id data info recordings`
    - `granular-id data info pushes.mat --json info.json`
    - `granular-id data info drives --axes wx,wy,wz,ax,ay,az --units rad/s,m/s2`
    """
    check_outputs(("--json", json, json_of("info")), source=path, force=force)
    from granular_id.recording import axes_in_words

    data = read(
        path, quiet=details, label=label, session=session, axes=axes, units=units, csv=opt.csv_in(csv)
    )
    summary = data.summary()
    synthetic = sum(recording.is_synthetic for recording in data)
    keys = sorted({key for recording in data for key in recording.meta})
    lines = [
        str(summary),
        f"axes: {' or '.join(sorted({axes_in_words(recording) for recording in data}))}",
        *([f"SYNTHETIC: {synthetic} of {len(data)} recordings"] if synthetic else []),
        f"format: {data.history[-1].parameters['format']}",
        f"meta: {', '.join(keys) or 'none'}",
        *(f"step {k}: {step}" for k, step in enumerate(data.history, start=1)),
    ]
    show("\n".join(lines), most=None if details else _MOST_LINES)
    everything = {"summary": summary.to_dict(), "history": [step.to_dict() for step in data.history]}
    write_files((json, numbers("info", lambda: everything)))


def check(
    path: opt.Recordings,
    *,
    label: opt.Label = None,
    session: opt.Session = None,
    axes: opt.Axes = None,
    units: opt.Units = None,
    csv: opt.Csv = None,
    json: opt.Json = None,
    force: opt.Force = False,
    details: opt.Details = False,
) -> None:
    """Look recordings over for what would spoil an evaluation; files that cannot be read are named, all others checked.

    Rate, jitter, gaps, clipping, stuck axes, outliers, duplicates, and what gives a label away without
    the forces: the clock and the session; and whether frame, sign, tare and payload are the same.
    Exit code 0 when there is no error, 3 when there is one, or a file that cannot be read.

    Examples:

    - `granular-id data check recordings`
    - `granular-id data check recordings --json check.json`
    """
    check_outputs(("--json", json, json_of("check")), source=path, force=force)
    from granular_id.recording import mixed_setup_warnings

    given = {"label": label, "session": session, "axes": axes, "units": units, "csv": opt.csv_in(csv)}
    data, unreadable = _read_what_can_be(path, given)
    report = data.check()
    mixed = mixed_setup_warnings(data)
    if unreadable:
        lines = [f"{counted(len(unreadable), 'file')} cannot be read:", *(f"  {line}" for line in unreadable)]
        show("\n".join(lines), "bold red", most=None if details else _MOST_UNREADABLE)
    n_lines = _MOST_LINES - _MOST_UNREADABLE * bool(unreadable)
    show(report.text(width=COLUMNS), most=None if details else n_lines)
    if mixed:
        show("\n".join(mixed), "bold yellow", most=None if details else 3)
    write_files(
        (json, numbers("check", lambda: {**report.to_dict(), "setup": mixed, "unreadable": unreadable}))
    )
    if unreadable or report.worst == "error":
        raise typer.Exit(opt.FOUND_ERRORS)


def _read_what_can_be(path: Path, given: dict[str, Any]) -> tuple[Dataset, list[str]]:
    """Read recordings; return what is wrong with the files that cannot be read, too, where there are others."""
    try:
        return read(path, **given), []
    except GranularIdError as error:
        if not getattr(error, "skippable", False):
            raise
        from granular_id.io import load

        with suppress(GranularIdError):
            data = load(path, on_error="skip", **given)
            return data, [row["skipped"] for row in data.history[-1].rows if "skipped" in row]
        raise


def plot(
    path: opt.Recordings,
    *,
    label: opt.Label = None,
    session: opt.Session = None,
    axes: opt.Axes = None,
    units: opt.Units = None,
    csv: opt.Csv = None,
    output: Annotated[Path, Option("--output", "-o", help="Picture: png, svg, pdf.")] = Path(
        "recordings.png"
    ),
    what: Annotated[Drawn, Option(help="What to draw.")] = "recordings",
    n: Annotated[
        int | None, Option("-n", min=1, help="Recordings of each material; of onsets in all.")
    ] = None,
    force: opt.Force = False,
) -> None:
    """Draw recordings: some of each material as they are stored, their mean, or where the motion begins.

    Axes of one unit are drawn together; `--axes` chooses them.

    Examples:

    - `granular-id data plot recordings -o recordings.png`
    - `granular-id data plot recordings -o onset.png --what onset -n 5`
    - `granular-id data plot recordings -o mean.svg --what mean --axes tx,ty,tz`
    """
    if n is not None and what == "mean":
        raise GranularIdError("-n does not go with --what mean, which is made of all recordings")
    check_outputs(("--output", output, PICTURE), source=path, force=force)
    from granular_id import plotting

    data = read(
        path,
        prepared=what == "mean",
        label=label,
        session=session,
        axes=axes,
        units=units,
        csv=opt.csv_in(csv),
    )
    if what == "mean":
        plotting.plot_mean_forces(data, path=output)
    elif what == "onset":
        plotting.plot_onsets(say_step(data.find_onsets(replace=True)), n=n or 10, path=output)
    else:
        plotting.plot_recordings(data, n=n or 5, path=output)
    show(f"wrote {output}")
