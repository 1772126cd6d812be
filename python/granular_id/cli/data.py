"""``granular-id data``: look at recordings, check them, convert them."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer
from rich.console import Console

from granular_id._core import GranularIdError
from granular_id._files import write_json
from granular_id._text import counted
from granular_id.cli.errors import FOUND_ERRORS
from granular_id.cli.options import FORCE, at_least, between, command, names_in, option, positive
from granular_id.cli.outputs import JSON_FILE, PICTURE, check_outputs, say_written, show, write_files
from granular_id.cli.recordings import PANEL, Reading, Steps, WrenchSteps, say_step

if TYPE_CHECKING:
    from granular_id.recording import Dataset

OUTPUT, SENSOR, PICTURES, PUSHES = "Output", "Sensor", "Picture", "Pushes"


@dataclass(kw_only=True)
class Target:
    """A place for recordings, where there is nothing yet and which can be written."""

    output: Path = typer.Argument(metavar="OUTPUT", help="File or folder to write.")
    to: str | None = option(OUTPUT, "csv, npz or parquet. Default: told by the ending of OUTPUT.")

    def __post_init__(self) -> None:
        from granular_id.io.formats import check_save

        check_save(self.output, self.to)

    def save(self, data: Dataset) -> None:
        """Write recordings, with a bar where it takes long."""
        from granular_id.io import save

        save(data, self.output, self.to, progress=True)


@dataclass(kw_only=True)
class TableReading(Reading):
    """Recordings to read, with what only text tables need."""

    csv: list[str] | None = option(
        PANEL,
        "An option of pandas.read_csv for text tables: skiprows=7, decimal=, or encoding=cp1252. Repeatable.",
    )
    id: str | None = option(
        PANEL, "Column that tells recordings of a table apart. Default: recording, trial or id."
    )
    time: str | None = option(PANEL, "Column of a table that is the clock. Default: time, t, timestamp ...")

    def _of_load(self, axes: Sequence[str] | None = None) -> dict[str, Any]:
        given = {"csv": _csv_in(self.csv or []) or None, "id": self.id, "time": self.time}
        return {**super()._of_load(axes), **given}


def _csv_in(texts: Sequence[str]) -> dict[str, Any]:
    """Read ``--csv KEY=VALUE``: values are those of Python where they look so, else texts."""
    options: dict[str, Any] = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not equals or not key.isidentifier():
            raise GranularIdError(f"--csv must be KEY=VALUE, an option of pandas.read_csv, got {text!r}")
        try:
            options[key] = ast.literal_eval(value)
        except (ValueError, SyntaxError):
            options[key] = value
    return options


@command
def info(
    reading: TableReading,
    steps: Steps,
    *,
    json: Path | None = option(OUTPUT, "Write the summary and all steps."),
    force: bool = FORCE,
) -> None:
    """Say what a folder or file holds: recordings, materials, sessions, rates, lengths, gaps, flags, history.

    Examples:

    `granular-id data info recordings`
    `granular-id data info pushes.mat`
    `granular-id data info recordings --json info.json`
    `granular-id data info drives --axes wx,wy,wz,ax,ay,az --units rad/s,m/s2 --rate-hz 100 --window-s 1.7`
    """
    from granular_id.recording import axes_in_words

    check_outputs(("--json", json, JSON_FILE), source=reading.path, force=force)
    loaded = reading.load()
    data = steps.taken(loaded)
    summary = data.summary()
    axes = sorted({axes_in_words(recording) for recording in data})
    keys = sorted({key for recording in data for key in recording.meta})
    synthetic = sum(recording.is_synthetic for recording in data)
    lines = [
        f"format: {loaded.history[-1].parameters['format']}",
        f"axes: {' or '.join(axes)}",
        *([f"SYNTHETIC: {synthetic} of {len(data)} recordings"] if synthetic else []),
        f"meta: {', '.join(keys) or 'none'}",
        *(f"step {k}: {step}".partition("\n")[0] for k, step in enumerate(data.history, start=1)),
        "",
        str(summary),
    ]
    show("\n".join(lines))
    everything = {"summary": summary.to_dict(), "history": [step.to_dict() for step in data.history]}
    write_files((json, lambda path: write_json(path, everything)))


@command
def check(
    reading: TableReading,
    steps: Steps,
    *,
    false_alarm_rate: float = option(
        SENSOR, "Chance that sound data show an outlier or a leak.", default=0.01
    ),
    strict: bool = option(OUTPUT, "Exit with 3 for warnings too.", "--strict", default=False),
    json: Path | None = option(OUTPUT, "Write the findings."),
    force: bool = FORCE,
) -> None:
    """Look recordings over for what would spoil an evaluation, and give each a verdict.

    Rate, jitter, gaps, clipping, stuck axes, outliers, duplicates, and what gives a label away without
    the forces: the clock, the length, the session, the file; and whether frame, sign, tare and payload are the
    same. Exit code 0 when there is no error, 3 when there is one.

    Examples:

    `granular-id data check recordings`
    `granular-id data check recordings --json check.json`
    `granular-id data check recordings --strict`
    """
    check_outputs(("--json", json, JSON_FILE), source=reading.path, force=force)
    from granular_id.recording import mixed_setup_warnings

    between("--false-alarm-rate", false_alarm_rate)
    data = steps.taken(reading.load())
    report = data.check(false_alarm_rate=false_alarm_rate)
    show("\n" + report.text(width=min(Console().width, 100)))
    mixed = mixed_setup_warnings(data)
    for line in mixed:
        show(line, "bold yellow")
    write_files((json, lambda path: write_json(path, {**report.to_dict(), "setup": mixed})))
    if report.worst == "error" or (strict and (mixed or report.worst == "warning")):
        raise typer.Exit(FOUND_ERRORS)


@command
def plot(
    reading: TableReading,
    steps: Steps,
    *,
    output: Path = option(
        PICTURES, "Picture: png, svg or pdf.", "--output", "-o", default=Path("recordings.png")
    ),
    what: Literal["recordings", "mean", "onset"] = option(
        PICTURES, "Single recordings, means of materials, or onsets of motion.", default="recordings"
    ),
    draw: str = option(
        PICTURES,
        "Axes to draw, of one unit. Default: fx,fy,fz (fx,fz for mean); of others those with the first one's unit.",
        default="",
    ),
    n: int | None = option(PICTURES, "Recordings per material (recordings) or in all (onset).", "-n"),
    force: bool = FORCE,
) -> None:
    """Draw recordings: some of each material as they are stored, their mean, or where the motion begins.

    Examples:

    `granular-id data plot recordings -o recordings.png`
    `granular-id data plot recordings -o onset.png --what onset --rate-hz 100 --max-gap-s inf`
    `granular-id data plot recordings -o mean.svg --what mean --n-samples shortest --draw tx,ty`
    `granular-id data plot drives --axes wx,wy,wz,ax,ay,az --units rad/s,m/s2`
    """
    at_least("-n", n, 1)
    if draw and what == "onset":
        raise GranularIdError("--draw does not go with --what onset, which draws the axes of one unit")
    if n is not None and what == "mean":
        raise GranularIdError("-n does not go with --what mean, which is made of all recordings")
    check_outputs(("--output", output, PICTURE), source=reading.path, force=force)

    from granular_id import plotting

    data = steps.taken(reading.load(), onsets_later=what == "onset")
    chosen = names_in(draw)
    if what == "mean":
        plotting.plot_mean_forces(data, axes=chosen or None, path=output)
    elif what == "onset":
        data = steps.with_onsets(data)
        show(str(data.history[-1]))
        plotting.plot_onsets(data, n=n or 10, path=output)
    else:
        plotting.plot_recordings(data, axes=chosen or None, n=n or 5, path=output)
    say_written([output])


@command
def convert(
    reading: TableReading,
    steps: Steps,
    wrench: WrenchSteps,
    target: Target,
    *,
    split_gap_s: float | None = option(
        PANEL, "Make a recording of each stretch between longer gaps, before all else: of a log with pauses."
    ),
    verify: bool = option(OUTPUT, "Read back what was written and compare.", default=True),
) -> None:
    """Convert recordings into CSV, NPZ or Parquet.

    It reads CSV, NumPy, MATLAB, HDF5, Parquet, ROS bags and MCAP. Samples, stamps, flags, labels, sessions and history
    are kept to the last bit, unless an option asks for a step; what was written is read back and compared. Nothing is
    overwritten.

    Recordings of another set-up come into that of a training: the weight of a tool is taken off, and the wrench is
    given in another frame. The rest before the motion is taken off by `granular-id setup tare`, after that.

    Examples:

    `granular-id data convert pushes.mat pushes.npz --recorded-hz 500`
    `granular-id data convert recordings archive --to parquet`
    `granular-id data convert bags pushes.npz --rate-hz 500 --begin-at onset --lead-s 0.1 --duration-s 3.2`
    `granular-id data convert log.csv pushes.npz --split-gap-s 1 --rate-hz 500`
    `granular-id data convert today turned.npz --compensate tool.json --gravity 0,0,1 --rotate 0,0,90 --frame flange`
    """
    from granular_id.io import load

    positive("--split-gap-s", split_gap_s)
    data = reading.load()
    if split_gap_s is not None:
        data = say_step(data.split(split_gap_s), quiet=False)
    data = steps.taken(wrench.taken(data))
    target.save(data)
    try:
        equal = not verify or load(target.output, progress=True) == data
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            f"Interrupted: {target.output} is written, but was not read back and compared."
        ) from None
    if not equal:
        raise GranularIdError(f"{target.output} was written, but does not read back equal: do not rely on it")
    said = ", read back and found equal" if verify else ""
    show(f"wrote {target.output}{said}")


@command
def synthesize(
    target: Target,
    *,
    materials: str = option(PUSHES, "Names separated by commas. Default: the paper's eleven.", default=""),
    per_class: int = option(PUSHES, "Recordings of each material.", default=62),
    sessions: int | None = option(PUSHES, "Sessions they come from. Default: see synthesize()."),
    duration_s: float = option(PUSHES, "Length of a recording; of an IMU as long as you like.", default=3.2),
    rate_hz: float = option(PUSHES, "Sampling rate.", default=500.0),
    sensor: Literal["wrench", "imu"] = option(
        PUSHES,
        "Forces and torques of one push, or an IMU on the tool during many strokes.",
        default="wrench",
    ),
    seed: int = option(PUSHES, "Same seed, same recordings.", default=0),
) -> None:
    """Write SYNTHETIC recordings: pushes through simulated materials.

    They come from a physical model and not from a sensor. With `--sensor imu` they are long files of another sensor:
    angular rates in rad/s and accelerations in m/s2 of the tool holder, while the tool strokes to and fro.

    Examples:

    `granular-id data synthesize pushes.npz`
    `granular-id data synthesize few --to csv --materials rice,oat_flakes --per-class 5`
    `granular-id data synthesize drives --to csv --sensor imu --per-class 6 --duration-s 60 --rate-hz 100`
    """
    at_least("--per-class", per_class, 1)
    at_least("--sessions", sessions, 1)
    at_least("--seed", seed, 0)
    positive("--duration-s", duration_s)
    positive("--rate-hz", rate_hz)

    from granular_id.synthetic import synthesize as make

    data = make(
        names_in(materials) or None,
        n_per_class=per_class,
        sessions=sessions,
        rate_hz=rate_hz,
        duration_s=duration_s,
        seed=seed,
        sensor="imu" if sensor == "imu" else None,
    )
    target.save(data)
    what = f"{counted(len(data), 'SYNTHETIC recording')} of {counted(len(data.labels), 'material')}"
    show(f"wrote {target.output}: {what}")


data = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="markdown",
    help="Look at recordings, check them, convert them.",
)
for shown in (info, check, plot, convert, synthesize):
    data.command()(shown)
