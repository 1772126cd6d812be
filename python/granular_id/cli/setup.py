"""``granular-id setup``: what recordings and models were made with; payloads and tares."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Literal

import typer

from granular_id._core import GranularIdError
from granular_id._files import MODELS, check_source
from granular_id._text import Table, counted, in_columns
from granular_id.cli.data import Target
from granular_id.cli.options import FORCE, command, option, positive
from granular_id.cli.outputs import JSON_FILE, check_outputs, print_table, say_written, show, typed_command
from granular_id.cli.recordings import (
    GRAVITY,
    Reading,
    ReadingOptions,
    StepOptions,
    gravity_at,
    gravity_in,
    say_step,
)

if TYPE_CHECKING:
    from granular_id.recording import Dataset, Payload

OUTPUT, POSES, REST = "Output", "Poses", "Rest"


# What recordings and models were made with.


@dataclass(frozen=True)
class _Side:
    """What is shown, as recordings; of a model one for each value that occurred in its training."""

    name: str
    data: Dataset
    model: bool

    def values(self) -> dict[str, Counter[str]]:
        """Return how many recordings state what of each thing."""
        from granular_id.recording import UNSTATED, Setup, axes_in_words, setups_in

        rates = ("irregular in time" if r.rate_hz is None else f"{r.rate_hz:g} Hz" for r in self.data)
        found = {"rate": Counter(rates), "axes": Counter(axes_in_words(r) for r in self.data)}
        setups = setups_in(self.data)
        return found | {
            f.name: Counter(getattr(s, f.name) or UNSTATED for s in setups) for f in fields(Setup)
        }

    def told(self, values: Counter[str]) -> str:
        """Say the values of a thing, and where they differ how many recordings have each."""
        most, n_more = values.most_common(_SHOWN), max(0, len(values) - _SHOWN)
        numbers = len(values) > 1 and not self.model
        words = [f"{value} ({n})" if numbers else value for value, n in most]
        return (", " if numbers else " or ").join(words) + f", {n_more} more" * bool(n_more)


_SHOWN = 8


@command
def show_setup(
    reading: ReadingOptions,
    *,
    path: Path = typer.Argument(
        metavar="RECORDINGS|MODEL", help="Folder or file of recordings, or a model.", show_default=False
    ),
    other: Path | None = typer.Argument(
        None, metavar="[RECORDINGS|MODEL]", help="What to compare with it.", show_default=False
    ),
) -> None:
    """Say with which set-up recordings were made, or a model was trained: frame, sensor, tool, tare, trigger ...

    With two it says what differs and what follows where a model of the one meets recordings of the other: refused,
    a warning, or nothing (fine). Of a model and recordings the model is the training, else what comes first.

    Examples:

    `granular-id setup show recordings`
    `granular-id setup show kitchen.safetensors`
    `granular-id setup show kitchen.safetensors today`
    """
    for each in (path, other):
        if each is not None:
            check_source(each)
    sides = [_side(each, reading) for each in (path, other) if each is not None]
    for side in sides:
        show(side.name)
    if len(sides) == 1:
        rows = [(name, sides[0].told(values)) for name, values in sides[0].values().items()]
        show("\n".join(["", *in_columns(rows)]))
        return
    training, now = sides if sides[0].model or not sides[1].model else sides[::-1]
    show("\n".join(["", *_compared(training, now)]))


def _side(path: Path, reading: ReadingOptions) -> _Side:
    from granular_id.recording import headline

    if path.suffix.lower() not in MODELS:
        data = reading.load_path(path, quiet=False)
        return _Side(f"{path}: {headline(data.recordings)}", data, model=False)

    import numpy as np

    from granular_id.identifier import Identifier
    from granular_id.recording import UNSTATED, Dataset, Recording

    model = Identifier.load(path)
    setup = model.trained.get("setup") or {}
    recordings = []
    for i in range(max(map(len, setup.values()), default=1)):
        each = {name: values[min(i, len(values) - 1)] for name, values in setup.items()}
        meta = {name: value for name, value in each.items() if value != UNSTATED}
        units = {axis: unit for axis, unit in zip(model.axes, model.units, strict=True) if unit}
        samples = np.zeros((1, len(model.axes)))
        recordings.append(
            Recording(samples, rate_hz=model.rate_hz, axes=model.axes, meta={**meta, "units": units})
        )
    return _Side(
        f"{path}: model of {counted(len(model.classes), 'material')}", Dataset(recordings), model=True
    )


def _compared(training: _Side, now: _Side) -> Iterator[str]:
    """Say what differs between a training and recordings, and what follows."""
    from granular_id.recording import UNSTATED

    follows = _follows(training.data, now.data)
    before, after = training.values(), now.values()
    rows = [("", "follows", "training", "now")]
    for name in before:
        unstated = [set(side[name]) == {UNSTATED} for side in (before, after)]
        if not all(unstated) or name in follows:
            what = follows.get(name, "not compared" if any(unstated) else "fine")
            told = training.told(before[name]), now.told(after[name])
            rows.append((name, what, told[0], "the same" if told[0] == told[1] else told[1]))
    yield from in_columns(rows)
    yield ""
    refused = [name for name, what in follows.items() if what == "refused"]
    yield f"refused: {', '.join(refused) or 'nothing'}"
    yield from (f"{name}: {_WAYS_OUT[name]}" for name in follows if name in _WAYS_OUT)


def _follows(training: Dataset, now: Dataset) -> dict[str, str]:
    from granular_id.recording import common_units, setup_differences, setups_in, unit_differences, values_in

    follows = {}
    if {r.rate_hz for r in now} - {r.rate_hz for r in training}:
        follows["rate"] = "refused"
    if {r.axes for r in now} - {r.axes for r in training}:
        follows["axes"] = "refused"
    known = values_in(setups_in(training))
    units = dict(zip(training.axes, common_units(training), strict=True))
    for recording, setup in zip(now, setups_in(now), strict=True):
        for found in (*unit_differences(units, recording.meta), *setup_differences(known, setup)):
            name = "axes" if found.name == "units" else found.name
            follows[name] = "refused" if found.consequence == "refuse" else "warning"
    return follows


_TURN = "bring recordings into it with granular-id data convert --{}, or where only the name is another add --accept {}"
_WAYS_OUT = {
    "rate": "resample with --rate-hz",
    "axes": "choose them with --axes, state units with --units",
    "frame": _TURN.format("rotate ... --frame", "frame"),
    "transform": "turn recordings with granular-id data convert --rotate ... --frame, and add --accept transform",
    "sign": _TURN.format("flip fx,fy,fz,tx,ty,tz --sign", "sign"),
    "tare": "take the rest before the motion off both with granular-id setup tare",
}


# The tool's weight.


@command
def payload(
    reading: Reading,
    *,
    gravity: str | None = option(POSES, GRAVITY),
    output: Path = option(OUTPUT, "JSON file to write.", "--output", "-o", default=...),
    force: bool = FORCE,
) -> None:
    """Identify what a tool weighs, where its centre of mass is, and the zero of the sensor.

    It takes rests, nothing touching the tool: one recording an orientation, four or more, turned by 30 degrees or
    more about two axes; half a second or more of each. `granular-id data convert --compensate` takes the payload off.

    Examples:

    `granular-id setup payload rests -o tool.json`
    `granular-id setup payload rests -o tool.json --gravity poses.csv`
    """
    check_outputs(("--output", output, JSON_FILE), source=reading.path, force=force)
    reading.refuse_absent()
    stated = gravity_in(gravity)
    from granular_id.recording import Payload

    data = reading.load()
    found = Payload.fit(data, gravity_at(data, stated))
    print_table(_table_of(found))
    found.save(output)
    say_written([output])
    words = typed_command("data", "convert", "PATH", "OUTPUT", "--compensate", output, "--gravity", "X,Y,Z")
    show(f"take it off with: {words}")


def _table_of(payload: Payload) -> Table:
    from granular_id.recording import AXES, unit_of

    rows = [("mass", f"{payload.mass_kg:.4f} kg", "")]
    for axis, at in zip("xyz", payload.centre_of_mass_m, strict=True):
        rows.append((f"centre of mass {axis}", f"{1000 * at:.2f} mm", ""))
    for axis, zero, left in zip(AXES, payload.bias, payload.residual or (), strict=True):
        unit = unit_of(axis)
        rows.append((f"zero of {axis}", f"{zero:.4g} {unit}", f"{left:.2g} {unit}"))
    notes = (f"condition number {payload.condition:.2g}: 1.2 to 2 with poses all around, above 30 refused",)
    title = f"Payload of {counted(payload.n_rests or 0, 'rest')}"
    title += f", frame {payload.frame!r}" * (payload.frame is not None)
    return Table(title, ("", "value", "residual"), tuple(rows), notes)


# The zero.


@command
def tare(
    reading: Reading,
    steps: StepOptions,
    *,
    begin_at: Literal["trigger", "onset"] = option(
        REST,
        "Where the rest ends: the stored trigger, or the onset of motion found in the forces.",
        default="trigger",
    ),
    lead_s: float | None = option(
        REST, "Seconds of rest before it that are averaged. Default: all there is, 0.1 to 2 s."
    ),
    output: Path = option(OUTPUT, "File or folder to write.", "--output", "-o", default=...),
    to: str | None = option(OUTPUT, "csv, npz or parquet. Default: told by the ending."),
) -> None:
    """Take the rest before the motion for zero: its mean is taken off each recording, which is written anew.

    What a tool weighs, and a zero that drifts from push to push, are gone as far as the tool keeps its pose. A model
    that was trained on recordings without it warns of such with it, and the other way round: treat all alike.

    Examples:

    `granular-id setup tare recordings -o tared.npz`
    `granular-id setup tare recordings -o tared --to csv --begin-at onset --lead-s 0.1`
    """
    positive("--lead-s", lead_s)
    if steps.onsets and begin_at != "onset":
        raise GranularIdError("--onset-at states an onset, but no rest ends there: add --begin-at onset")
    target = Target(output=output, to=to)
    data = reading.load()
    resampled = steps.resample(data)
    data = resampled if resampled is data else say_step(resampled, quiet=False)
    if begin_at == "onset":
        data = say_step(steps.with_onsets(data), quiet=False)
        steps.refuse_missing_onsets(data)
    if steps.on_short == "skip":
        from granular_id.recording import TARE_S

        data = _with_rest(data, TARE_S[0] if lead_s is None else lead_s)
    data = say_step(data.tare(lead_s=lead_s), quiet=False)
    zeros = {axis: sorted(row[axis] for row in data.history[-1].rows) for axis in data.axes}
    rows = tuple(
        (axis, *(f"{value:.3g}" for value in (values[0], median(values), values[-1])))
        for axis, values in zeros.items()
    )
    print_table(Table("Zeros taken off", ("axis", "smallest", "median", "largest"), rows))
    target.save(data)
    say_written([output])


def _with_rest(data: Dataset, lead_s: float) -> Dataset:
    """Leave out recordings whose rest is too short, or ends nobody knows where."""
    from granular_id.recording import samples_in

    short = [
        one.name
        for one in data
        if one.rate_hz is not None and (one.trigger_index or 0) < samples_in("lead_s", lead_s, one.rate_hz)
    ]
    if not short:
        return data
    if len(short) == len(data):
        raise GranularIdError(
            f"none of {counted(len(data))} has {lead_s:g} s of rest before its motion; try another --lead-s"
        )
    show(
        f"left out {counted(len(short))} without {lead_s:g} s of rest before the motion, the first is {short[0]!r}"
    )
    return data.select(where=lambda one: one.name not in short)


setup = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="markdown",
    help="What recordings and models were made with; the tool's weight, the zero.",
)
setup.command("show")(show_setup)
for made in (payload, tare):
    setup.command()(made)
