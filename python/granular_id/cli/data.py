"""``granular-id data``: look at recordings, check them, convert them; one command a file."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from granular_id._text import counted
from granular_id.cli.errors import guarded
from granular_id.cli.method import at_least, between, names_in, option, positive, taking
from granular_id.cli.prepare import Steps, with_onsets
from granular_id.cli.reading import Reading
from granular_id.cli.session import JSON_FILE, PICTURE, Force, check_outputs, say_written

if TYPE_CHECKING:
    from granular_id.recording import Dataset, Recording
# The argument OUTPUT and the option --to: where recordings are written, and in which format.

PANEL = "Output"


class Target:
    """A place for recordings, where there is nothing yet and which can be written."""

    def __init__(
        self,
        output: Annotated[Path, typer.Argument(metavar="OUTPUT", help="File or folder to write.")],
        *,
        to: Annotated[
            str | None,
            option("--to", PANEL, "csv, npz, hdf5, parquet or mcap. Default: told by the ending of OUTPUT."),
        ] = None,
    ) -> None:
        from granular_id.io.saving import check_save

        check_save(output, to)
        self.path = output
        self._format = to

    def save(self, data: Dataset) -> None:
        """Write recordings, with a bar where it takes long."""
        from granular_id.io import save

        save(data, self.path, self._format, progress=True)


# ``granular-id data info``: what a folder or file of recordings holds.

TEXT = """
Say what a folder or file holds: recordings, materials, sessions, rates, lengths, gaps, flags, history.

Examples:

`granular-id data info recordings`

`granular-id data info pushes.mat`

`granular-id data info recordings --json info.json`
"""

OUTPUT = "Output"


@guarded
@taking(Reading)
def info(
    reading: Reading,
    *,
    json: Annotated[Path | None, option("--json", OUTPUT, "Write the summary and all steps.")] = None,
    force: Force = False,
) -> None:
    """Print a summary; see `TEXT`."""
    check_outputs(("--json", json, JSON_FILE), source=reading.path, force=force)
    data = reading.load(quiet=False)
    console = Console(highlight=False)
    summary = data.summary()
    axes = sorted({" ".join(recording.axes) for recording in data})
    keys = sorted({key for recording in data for key in recording.meta})
    synthetic = sum(recording.is_synthetic for recording in data)
    steps = [*(str(step).partition("\n")[0] for step in data.history)]
    lines = [
        f"format: {data.history[-1].parameters['format']}",
        f"axes: {' or '.join(axes)}",
        *([f"SYNTHETIC: {synthetic} of {len(data)} recordings"] if synthetic else []),
        f"meta: {', '.join(keys) or 'none'}",
        *(f"step {number}: {step}" for number, step in enumerate(steps, start=1)),
        "",
        str(summary),
    ]
    console.print("\n".join(lines), soft_wrap=True, markup=False)
    if json is not None:
        from granular_id._files import write_json

        write_json(json, {"summary": summary.to_dict(), "history": [step.to_dict() for step in data.history]})
        say_written(console, [json], None)


info.__doc__ = TEXT

# ``granular-id data head``: the first samples of a recording, as numbers.

TEXT_HEAD = """
Print what is known of one recording and its first samples: forces in N, torques in N m.

Examples:

`granular-id data head recordings`

`granular-id data head recordings --name rice/rice_07.csv -n 20`
"""

SHOWN = "Shown"


@guarded
@taking(Reading)
def head(
    reading: Reading,
    *,
    n: Annotated[int, option("-n", SHOWN, "Samples to print.")] = 10,
    name: Annotated[
        str | None, option("--name", SHOWN, "Name of the recording. Default: the first one.")
    ] = None,
) -> None:
    """Print the first samples of a recording; see `TEXT_HEAD`."""
    at_least("-n", n, 1)
    data = reading.load(quiet=False)
    Console(highlight=False).print("\n".join(_lines(_chosen(data, name), n)), soft_wrap=True, markup=False)


def _chosen(data: Dataset, name: str | None) -> Recording:
    if name is None:
        return data[0]
    found = [recording for recording in data if recording.name == name]
    if not found:
        from difflib import get_close_matches

        near = get_close_matches(name, data.names, 3, 0.4) or data.names[:3]
        raise ValueError(f"--name: no recording is called {name!r}; there are {', '.join(near)} ...")
    return found[0]


def _lines(recording: Recording, n: int) -> list[str]:
    from textwrap import shorten

    from granular_id._checks import thaw
    from granular_id.recording import (
        text_table,
        unit_of,
    )

    known = ("label", "session", "start_time", "trigger_index")
    facts = [f"{field}: {value}" for field in known if (value := getattr(recording, field)) is not None]
    facts += [f"meta.{key}: {shorten(str(thaw(value)), 100)}" for key, value in recording.meta.items()]
    header = ["time s", *(f"{axis} {unit_of(axis, recording.meta)}" for axis in recording.axes)]
    rows = []
    for i in range(min(n, recording.n_samples)):
        cells = [f"{recording.times()[i]:.6g}", *(f"{value:.6g}" for value in recording.wrench[i])]
        row = dict(zip(header, cells, strict=True))
        if recording.flags is not None:
            row["flags"] = str(recording.flags[i])
        rows.append(row)
    return ["", repr(recording), *facts, "", *text_table(rows)]


head.__doc__ = TEXT_HEAD

# ``granular-id data check``: what would spoil an evaluation, recording by recording.

TEXT_CHECK = """
Look recordings over for what would spoil an evaluation, and give each a verdict.

Rate, jitter, gaps, clipping, stuck axes, drift, outliers, duplicates, and what gives a label away without the forces:
the clock, the length, the session, the file. Exit code 0 when there is no error, 3 when there is one.

Examples:

`granular-id data check recordings`

`granular-id data check recordings --sensor-range 145,145,290,5,5,5 --json check.json`

`granular-id data check recordings --sensor-range "ATI Mini45 SI-145-5" --strict`
"""

OUTPUT_CHECK, SENSOR = "Output", "Sensor"
FOUND_ERRORS = 3


@guarded
@taking(Reading)
def check(
    reading: Reading,
    *,
    sensor_range: Annotated[
        str | None,
        option("--sensor-range", SENSOR, "Largest values of the axes, or a name: 'ATI Mini45 SI-145-5'."),
    ] = None,
    false_alarm_rate: Annotated[
        float,
        option("--false-alarm-rate", SENSOR, "Chance that a sound data set shows an outlier or a leak."),
    ] = 0.01,
    strict: Annotated[bool, option("--strict", OUTPUT_CHECK, "Exit with 3 for warnings too.")] = False,
    json: Annotated[Path | None, option("--json", OUTPUT_CHECK, "Write findings and verdicts.")] = None,
    force: Force = False,
) -> None:
    """Print findings and verdicts; see `TEXT_CHECK`."""
    check_outputs(("--json", json, JSON_FILE), source=reading.path, force=force)
    between("--false-alarm-rate", false_alarm_rate)
    limits = _range_of(sensor_range)
    data = reading.load(quiet=False)
    report = data.check(sensor_range=limits, false_alarm_rate=false_alarm_rate, progress=True)
    console = Console(highlight=False)
    console.print()
    console.print(report.text(width=min(console.width, 100)), soft_wrap=True, markup=False)
    if json is not None:
        from granular_id._files import whole_file

        with whole_file(json) as draft:  # JSON also where the name has no ending
            draft.write_text(report.to_json() + "\n", encoding="utf-8")
        say_written(console, [json], None)
    if report.worst == "error" or (strict and report.worst == "warning"):
        raise typer.Exit(FOUND_ERRORS)


def _range_of(text: str | None) -> str | float | list[float] | None:
    """Read ``--sensor-range``: a name, one number, or a number per axis."""
    if text is None:
        return None
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        if "," in text:
            wanted = "a number, one per axis such as 145,145,290,5,5,5, or the name of a sensor"
            raise ValueError(f"--sensor-range must be {wanted}, got {text!r}") from None
        return text
    return numbers if len(numbers) > 1 else numbers[0]


check.__doc__ = TEXT_CHECK

# ``granular-id data plot``: recordings over time, as a picture.

TEXT_PLOT = """
Draw recordings: some of each material as they are stored, their mean, or where the motion begins.

Examples:

`granular-id data plot recordings -o recordings.png`

`granular-id data plot recordings -o onset.png --what onset --rate-hz 100 --max-gap-s inf`

`granular-id data plot recordings -o mean.svg --what mean --n-samples shortest --axes tx,ty`
"""

PANEL_PLOT = "Picture"


class What(str, Enum):
    """Choices of ``--what``."""

    recordings = "recordings"
    mean = "mean"
    onset = "onset"


@guarded
@taking(Reading, Steps)
def plot(
    reading: Reading,
    steps: Steps,
    *,
    output: Annotated[Path, option("--output -o", PANEL_PLOT, "File to write: png, svg or pdf.")] = Path(
        "recordings.png"
    ),
    what: Annotated[
        What, option("--what", PANEL_PLOT, "Single recordings, means of materials, or onsets of motion.")
    ] = What.recordings,
    axes: Annotated[
        str,
        option(
            "--axes", PANEL_PLOT, "Axes separated by commas, of one unit. Default: fx,fy,fz; fx,fz for mean."
        ),
    ] = "",
    n: Annotated[
        int | None, option("-n", PANEL_PLOT, "Recordings per material (recordings) or in all (onset).")
    ] = None,
    force: Force = False,
) -> None:
    """Draw a picture; see `TEXT_PLOT`."""
    at_least("-n", n, 1)
    if axes and what is What.onset:
        raise ValueError("--axes does not go with --what onset, which draws all forces")
    if n is not None and what is What.mean:
        raise ValueError("-n does not go with --what mean, which is made of all recordings")
    check_outputs(("--output", output, PICTURE), source=reading.path, force=force)

    from granular_id import plotting

    data = steps.taken(reading.load(quiet=False), quiet=False, onsets=what is What.onset)
    chosen = names_in(axes)
    if what is What.mean:
        plotting.plot_mean_forces(data, axes=chosen or ("fx", "fz"), path=output)
    elif what is What.onset:
        data = with_onsets(data, steps.preparation)
        Console(highlight=False).print(str(data.history[-1]), soft_wrap=True, markup=False)
        plotting.plot_onsets(data, output, n=n or 10, rest_s=steps.preparation.rest_s)
    else:
        plotting.plot_recordings(data, output, axes=chosen or None, n=n or 5)
    say_written(Console(highlight=False), [output], None)


plot.__doc__ = TEXT_PLOT

# ``granular-id data convert``: recordings of any known format into one that can be written.

TEXT_CONVERT = """
Convert recordings: CSV, NumPy, MATLAB, HDF5, Parquet, ROS bags, MCAP and GM10-ts in; CSV, NPZ, HDF5, Parquet and
MCAP out.

Samples, stamps, flags, labels, sessions and history are kept to the last bit, unless an option asks for a step; what
was written is read back and compared. Nothing is overwritten.

Examples:

`granular-id data convert pushes.mat pushes.npz --recorded-hz 500`

`granular-id data convert recordings archive --to parquet`

`granular-id data convert bags pushes.h5 --rate-hz 500 --begin-at onset --lead-s 0.1 --duration-s 3.2`
"""


@guarded
@taking(Reading, Steps, Target)
def convert(
    reading: Reading,
    steps: Steps,
    target: Target,
    *,
    verify: Annotated[
        bool, option("--verify/--no-verify", PANEL, "Read back what was written and compare.")
    ] = True,
) -> None:
    """Read, take the steps asked for, write, compare; see `TEXT_CONVERT`."""
    from granular_id.io import load

    data = steps.taken(reading.load(quiet=False), quiet=False)
    target.save(data)
    try:
        equal = not verify or load(target.path, max_file_bytes=2**40, progress=True) == data
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            f"Interrupted: {target.path} is written, but was not read back and compared."
        ) from None
    if not equal:
        raise ValueError(f"{target.path} was written, but does not read back equal: do not rely on it")
    said = ", read back and found equal" if verify else ""
    Console(highlight=False).print(f"wrote {target.path}{said}", soft_wrap=True, markup=False)


convert.__doc__ = TEXT_CONVERT

# ``granular-id data synthesize``: simulated recordings in a file, to try things on.

TEXT_SYNTHESIZE = """
Write SYNTHETIC recordings: pushes through simulated materials, from a physical model and not from a sensor.

Examples:

`granular-id data synthesize pushes.npz`

`granular-id data synthesize few --to csv --materials rice,oat flakes --per-class 5`
"""

PUSHES = "Pushes"


@guarded
@taking(Target)
def synthesize(
    target: Target,
    *,
    materials: Annotated[
        str, option("--materials", PUSHES, "Names separated by commas. Default: the paper's eleven.")
    ] = "",
    per_class: Annotated[int, option("--per-class", PUSHES, "Pushes of each material.")] = 62,
    sessions: Annotated[
        int | None, option("--sessions", PUSHES, "Sessions they come from. Default: see synthesize().")
    ] = None,
    rate_hz: Annotated[float, option("--rate-hz", PUSHES, "Sampling rate.")] = 500.0,
    seed: Annotated[int, option("--seed", PUSHES, "Same seed, same recordings.")] = 0,
) -> None:
    """Write simulated recordings; see `TEXT_SYNTHESIZE`."""
    at_least("--per-class", per_class, 1)
    at_least("--sessions", sessions, 1)
    at_least("--seed", seed, 0)
    positive("--rate-hz", rate_hz)

    from granular_id.synthetic import synthesize as make

    data = make(
        names_in(materials) or None, n_per_class=per_class, sessions=sessions, rate_hz=rate_hz, seed=seed
    )
    target.save(data)
    what = f"{counted(len(data), 'SYNTHETIC recording')} of {counted(len(data.labels), 'material')}"
    Console(highlight=False).print(f"wrote {target.path}: {what}", soft_wrap=True, markup=False)


synthesize.__doc__ = TEXT_SYNTHESIZE

data = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="markdown",
    help="Look at recordings, check them, convert them.",
)
for command in (info, head, check, plot, convert, synthesize):
    data.command()(command)
