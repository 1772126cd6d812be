"""``granular-id data convert``: recordings brought into the shape that all commands take; ``data synthesize``."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from typer import Argument, Option

from granular_id._core import GranularIdError
from granular_id._files import NO_FOLDERS, RECORDINGS, check_source, whole_file
from granular_id._text import counted
from granular_id.cli import options as opt
from granular_id.cli.outputs import DATA_SET, check_outputs, show
from granular_id.cli.recordings import history_of, read, refuse_uneven, say_step

if TYPE_CHECKING:
    from granular_id._checks import FloatArray
    from granular_id.recording import Dataset, Payload

STEPS, SETUP = "Steps, in this order", "Another set-up, before the steps"

Begin = Literal["first", "trigger", "onset"]
TimeUnit = Literal["s", "ms", "us", "ns", "sample"]

_TURN = "NAME=roll,pitch,yaw in degrees, or a quaternion NAME=x,y,z,w"

MAX_GAP_S = 0.25
"""Default of ``--max-gap-s``, as of `Dataset.resample`."""

Output = Annotated[
    Path, Argument(metavar="OUTPUT", help="x.npz; x.parquet, an archive; else a folder of CSV.")
]


def convert(
    path: Annotated[Path, Argument(metavar="PATH", help="Folder or file of recordings, of any format.")],
    output: Output,
    *,
    label: opt.Label = None,
    session: opt.Session = None,
    axes: opt.Axes = None,
    units: opt.Units = None,
    csv: opt.Csv = None,
    id_: Annotated[str | None, Option("--id", help="Column that tells recordings of a table apart.")] = None,
    array: Annotated[str | None, Option(help="Array that holds the samples, where it is not X.")] = None,
    topic: Annotated[str | None, Option(help="Topic of a bag; /topic.field inside its messages.")] = None,
    time: Annotated[str | None, Option(help="Column that is the clock, of any name.")] = None,
    recorded_hz: Annotated[
        float | None, Option(callback=opt.POSITIVE, help="Rate; the clock is ignored.")
    ] = None,
    time_unit: Annotated[TimeUnit | None, Option(help="What stamps count. Default: seconds.")] = None,
    on_error: Annotated[
        opt.Skip, Option(help="What is unreadable, too short, or has too long gaps: refuse, or leave it out.")
    ] = "raise",
    split_gap_s: Annotated[
        float | None,
        Option(callback=opt.POSITIVE, help="Make a recording of each stretch between longer gaps."),
    ] = None,
    compensate: Annotated[
        Path | None,
        Option(rich_help_panel=SETUP, help="Take a tool's weight off: a file of `setup payload`."),
    ] = None,
    gravity: Annotated[
        str | None, Option(rich_help_panel=SETUP, help="Where it points: x,y,z. Default: what metadata say.")
    ] = None,
    flip: Annotated[str, Option(rich_help_panel=SETUP, help="Axes that a driver mirrors: fx,tx.")] = "",
    frame: Annotated[
        str | None,
        Option(
            rich_help_panel=SETUP,
            help="NAME=roll,pitch,yaw turns into another frame, in degrees about fixed axes, or a quaternion x,y,z,w; "
            "as tf gives it for (new frame, old frame). NAME alone names the frame, which models compare.",
        ),
    ] = None,
    resample_hz: Annotated[
        float | None, Option(rich_help_panel=STEPS, callback=opt.POSITIVE, help="Bring all to one rate.")
    ] = None,
    max_gap_s: Annotated[
        float, Option(rich_help_panel=STEPS, help="Longest gap to fill then, flagged; inf: any.")
    ] = MAX_GAP_S,
    begin_at: Annotated[
        Begin,
        Option(rich_help_panel=STEPS, help="First sample, stored trigger, or onset found in the forces."),
    ] = "first",
    tare_s: Annotated[
        float | None,
        Option(
            rich_help_panel=STEPS, callback=opt.POSITIVE, help="Take so much rest ahead of that for zero."
        ),
    ] = None,
    lead_s: Annotated[float, Option(rich_help_panel=STEPS, help="Seconds to keep ahead of it.")] = 0.0,
    duration_s: Annotated[
        str | None, Option(rich_help_panel=STEPS, help="Keep so many seconds from there, or: shortest.")
    ] = None,
    window_s: Annotated[
        float | None,
        Option(rich_help_panel=STEPS, callback=opt.POSITIVE, help="Cut into windows of so many seconds."),
    ] = None,
    force: opt.Force = False,
) -> None:
    """Read recordings of any format, bring them into shape, and write what all commands take.

    Nothing is resampled, cropped or left out unless an option asks for it. Samples, stamps, labels, sessions and
    history stay the same to the last bit, and what was written is read back and compared.

    Examples:

    - `granular-id data convert drives drives.npz --axes wx,wy,wz,ax,ay,az --units rad/s,m/s2 --window-s 2`
    - `granular-id data convert bags pushes.npz --resample-hz 500 --begin-at onset --lead-s 0.1 --duration-s 3.2`
    - `granular-id data convert export pushes.npz --csv skiprows=7 --recorded-hz 500`
    - `granular-id data convert log.csv pushes.npz --split-gap-s 1 --resample-hz 500`
    - `granular-id data convert today turned.npz --compensate tool.json --gravity 0,0,1 --frame flange=0,0,90`
    """
    for is_alone, problem in (
        (
            begin_at != "first" and duration_s is None and tare_s is None,
            f"--begin-at {begin_at} crops recordings: add --duration-s (seconds, or shortest)",
        ),
        (
            lead_s and begin_at == "first",
            "--lead-s is time ahead of a trigger: add --begin-at trigger or onset",
        ),
        (
            max_gap_s != MAX_GAP_S and resample_hz is None,
            "--max-gap-s is about gaps that resampling fills: add --resample-hz",
        ),
        (
            gravity is not None and compensate is None,
            "--gravity says in which direction a payload weighs: add --compensate",
        ),
    ):
        if is_alone:
            raise GranularIdError(problem)
    seconds = None if duration_s in (None, "shortest") else _seconds(duration_s)
    check_save(output, source=path, force=force)
    down = None if gravity is None else opt.numbers_in("--gravity", gravity, "x,y,z", 3)
    frame_name, turn = _frame_in(frame)
    payload, of_csv = None if compensate is None else _payload_in(compensate), opt.csv_in(csv)
    check_source(path)
    rest = history_of(output, {})
    data = read(
        path,
        rest=rest,
        output=output,
        label=label,
        session=session,
        axes=axes,
        units=units,
        csv=of_csv,
        id=id_,
        time=time,
        array=array,
        topic=topic,
        rate_hz=recorded_hz,
        time_unit=time_unit,
        on_error=on_error,
    )
    from granular_id.recording import mixed_setup_warnings, short_warnings

    if warnings := [*mixed_setup_warnings(data), *(short_warnings(data) if duration_s is None else ())]:
        show("\n".join(warnings), "bold yellow", err=True, most=3)
    reported = partial(say_step, rest=rest)
    if split_gap_s is not None:
        data = reported(data.split(split_gap_s))
    if payload is not None:
        data = reported(data.compensate(payload, down))
    if flip or frame is not None:
        data = reported(data.transform(turn, frame=frame_name, flip=opt.names_in(flip)))
    if resample_hz is not None and any(recording.rate_hz != resample_hz for recording in data):
        limit = None if math.isinf(max_gap_s) else max_gap_s
        data = reported(data.resample(resample_hz, max_gap_s=limit, on_gap=on_error))
    if begin_at == "onset" or tare_s is not None or duration_s is not None or window_s is not None:
        refuse_uneven(data)
    if begin_at == "onset":
        data = reported(data.find_onsets(replace=True))
    if tare_s is not None:
        data = reported(
            (_with_rest(data, tare_s, reported) if on_error == "skip" else data).tare(lead_s=tare_s)
        )
    if duration_s is not None:
        cropped = data.align(
            None if seconds else "shortest",
            duration_s=seconds,
            trigger=None if begin_at == "first" else "recorded",
            lead_s=lead_s,
            on_short=on_error,
        )
        _warn_of_loss(data, cropped)
        data = reported(cropped)
    if window_s is not None:
        data = reported(data.windows(window_s, on_short=on_error))
    _save_checked(data, output)


def _warn_of_loss(data: Dataset, cropped: Dataset) -> None:
    """Warn where most of what was recorded goes: a recording may hold several pushes, of which the first is left."""
    names = set(cropped.names)
    before, after = (sum(one.n_samples for one in each if one.name in names) for each in (data, cropped))
    if after < before / 2:
        show(
            f"warning: {1 - after / before:.0%} of the samples are dropped: of each recording one piece is left, from "
            "its first motion or sample on; where it holds several pushes --window-s instead of --duration-s cuts "
            "all of it into windows",
            "bold yellow",
            err=True,
        )


def _seconds(text: str | None) -> float:
    """Read ``--duration-s``."""
    try:
        seconds = float(text or "")
    except ValueError:
        seconds = math.nan
    if not 0 < seconds < math.inf:
        raise GranularIdError(f"--duration-s must be seconds, or shortest, got {text!r}")
    return seconds


def _payload_in(file: Path) -> Payload:
    from granular_id.recording import Payload

    return Payload.load(file)


def _frame_in(text: str | None) -> tuple[str | None, FloatArray | list[float] | None]:
    """Read ``--frame``: a name, and a rotation as a matrix or a quaternion."""
    name, equals, angles = (text or "").partition("=")
    if text is not None and (not name or (equals and not angles)):
        raise GranularIdError(f"--frame must be NAME, or {_TURN}, got {text!r}")
    if not angles:
        return name or None, None
    turn = opt.numbers_in("--frame", angles, _TURN)
    if len(turn) == 4:
        return name, turn
    if len(turn) != 3:
        raise GranularIdError(f"--frame must be {_TURN}, got {angles!r}")
    from scipy.spatial.transform import Rotation

    # right angles only change places and signs
    return name, Rotation.from_euler("xyz", turn, degrees=True).as_matrix().round(15)


def _with_rest(data: Dataset, rest_s: float, reported: Callable[[Dataset], Dataset]) -> Dataset:
    """Leave out recordings whose rest is too short, or ends nobody knows where."""
    enough = round(rest_s * data.rate_hz)
    rested = [i for i, one in enumerate(data) if (one.trigger_index or 0) >= enough]
    if not rested:
        raise GranularIdError(
            f"none of {counted(len(data))} has {rest_s:g} s of rest before its motion (--tare-s)"
        )
    return data if len(rested) == len(data) else reported(data[rested])


# Writing.


def check_save(output: Path, *, source: Path | None = None, force: bool) -> None:
    """Refuse what `save` would refuse, before any work; with `force` a file of recordings may be replaced."""
    from granular_id.io.formats import check_save as check

    if output.is_file() and output.suffix.lower() == ".npz":
        check_outputs(("OUTPUT", output, DATA_SET), source=source, force=force)
    elif output.is_dir() and any(output.iterdir()):
        raise FileExistsError(f"{output} is a folder, --force replaces files only: give another name")
    else:
        check(output, _format_of(output))


def save(data: Dataset, output: Path) -> None:
    """Write recordings, with a bar where it takes long; a file that is there is replaced."""
    from granular_id.io import save as save_data

    if not output.is_file():
        save_data(data, output, _format_of(output), progress=True)
        return
    with whole_file(output) as draft:
        draft.unlink()
        save_data(data, draft, "npz", progress=True)


def _format_of(output: Path) -> str | None:
    """Return the format that a name asks for: a folder without an ending is one of CSV files."""
    formats = {".npz": "npz", ".parquet": "parquet"}
    return formats.get(
        output.suffix.lower(), None if output.name.lower().endswith((*RECORDINGS, *NO_FOLDERS)) else "csv"
    )


def _save_checked(data: Dataset, output: Path) -> None:
    """Write recordings, read them back and compare."""
    from granular_id.io import load

    save(data, output)
    try:
        equal = load(output, progress=True) == data
    except KeyboardInterrupt:
        why = f"Interrupted: {output} is written, but was not read back and compared."
        raise KeyboardInterrupt(why) from None
    if not equal:
        raise GranularIdError(f"{output} was written, but does not read back equal: do not rely on it")
    show(f"wrote {output}, {counted(len(data))}, read back and found equal")


def synthesize(
    output: Output,
    *,
    materials: Annotated[str, Option(help="Names separated by commas. Default: the paper's eleven.")] = "",
    n_per_class: Annotated[int, Option(min=1, help="Recordings of each material.")] = 62,
    sessions: Annotated[int | None, Option(min=1, help="Sessions that they come from.")] = None,
    duration_s: Annotated[float, Option(callback=opt.POSITIVE, help="Length of a recording.")] = 3.2,
    rate_hz: Annotated[float, Option(callback=opt.POSITIVE, help="Sampling rate.")] = 500.0,
    sensor: Annotated[Literal["wrench", "imu"], Option(help="One push, or strokes under an IMU.")] = "wrench",
    seed: opt.Seed = 0,
    force: opt.Force = False,
) -> None:
    """Write SYNTHETIC recordings: pushes through simulated materials.

    They come from a physical model and not from a sensor. With `--sensor imu` they are long files of another sensor:
    angular rates in rad/s and accelerations in m/s2 of the tool holder, while the tool strokes to and fro.

    Examples:

    - `granular-id data synthesize pushes.npz`
    - `granular-id data synthesize few --materials rice,oat_flakes --n-per-class 5 --sessions 2`
    - `granular-id data synthesize drives --sensor imu --n-per-class 6 --duration-s 60 --rate-hz 100`
    """
    check_save(output, force=force)
    from granular_id.synthetic import synthesize as make

    data = make(
        opt.names_in(materials) or None,
        n_per_class=n_per_class,
        sessions=sessions,
        rate_hz=rate_hz,
        duration_s=duration_s,
        seed=seed,
        sensor="imu" if sensor == "imu" else None,
    )
    save(data, output)
    what = f"{counted(len(data), 'SYNTHETIC recording')} of {counted(len(data.labels), 'material')}"
    show(f"wrote {output}: {what}")
