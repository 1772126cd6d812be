"""``granular-id setup``: what recordings and models were made with; what a tool weighs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from granular_id._files import MODELS, check_source
from granular_id._text import Table, counted, in_columns, short
from granular_id.cli.options import Details, Force, Recordings
from granular_id.cli.outputs import COLUMNS, check_outputs, json_of, print_table, show
from granular_id.cli.recordings import read

if TYPE_CHECKING:
    from granular_id.recording import Dataset, Payload

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

    def words(self, values: Counter[str]) -> str:
        """Say the values of a thing, and where they differ how many recordings have each."""
        most, n_more = values.most_common(_SHOWN), max(0, len(values) - _SHOWN)
        numbers = len(values) > 1 and not self.model
        words = [f"{value} ({n})" if numbers else value for value, n in most]
        return (", " if numbers else " or ").join(words) + f", {n_more} more" * bool(n_more)


_SHOWN = 8

_NARROW = 16


def show_setup(
    path: Annotated[Path, Argument(metavar="RECORDINGS|MODEL", help="Recordings, or a model.")],
    other: Annotated[
        Path | None, Argument(metavar="RECORDINGS|MODEL", help="What to compare with it.")
    ] = None,
    *,
    details: Details = False,
) -> None:
    """Say with which set-up recordings were made, or a model was trained: frame, sensor, tool, tare, trigger ...

    With two it says what differs and what follows where a model of the one meets recordings of the other: refused,
    a warning, or nothing (fine). Of a model and recordings the model is the training, else what comes first.

    Examples:

    - `granular-id setup show recordings`
    - `granular-id setup show kitchen.safetensors`
    - `granular-id setup show kitchen.safetensors today`
    """
    for each in (path, other):
        if each is not None:
            check_source(each)
    sides = [_side(each) for each in (path, other) if each is not None]
    if len(sides) == 1:
        rows = [(name, sides[0].words(values)) for name, values in sides[0].values().items()]
        show("\n".join([sides[0].name, *_in_columns(rows, details=details)]))
        return
    training, now = sides if sides[0].model or not sides[1].model else sides[::-1]
    show("\n".join(_compared(training, now, details=details)))


def _in_columns(rows: Sequence[tuple[str, ...]], *, details: bool) -> list[str]:
    """Lay out texts in columns, on a line of the screen each unless details are wanted."""
    if not details:
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        known = sum(width for width in widths if width <= _NARROW) + 2 * (len(widths) - 1)
        most = (COLUMNS - known) // max(1, sum(width > _NARROW for width in widths))
        rows = [tuple(cell if len(cell) <= _NARROW else short(cell, most) for cell in row) for row in rows]
    return [line.rstrip() for line in in_columns(rows)]


def _side(path: Path) -> _Side:
    from granular_id.recording import headline

    if path.suffix.lower() not in MODELS:
        data = read(path, quiet=True)
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


def _compared(training: _Side, now: _Side, *, details: bool) -> Iterator[str]:
    """Say what differs between a training and recordings, and what follows."""
    from granular_id.recording import UNSTATED

    follows = _follows(training.data, now.data)
    before, after = training.values(), now.values()
    refused = [name for name, what in follows.items() if what == "refused"]
    yield f"refused: {', '.join(refused) or 'nothing'}"
    yield from (f"{name}: {_WAYS_OUT[name]}" for name in follows if name in _WAYS_OUT)
    yield f"training: {training.name}"
    yield f"now: {now.name}"
    rows: list[tuple[str, ...]] = [("", "follows", "training", "now")]
    for name in before:
        unstated = [set(side[name]) == {UNSTATED} for side in (before, after)]
        if not all(unstated) or name in follows:
            what = follows.get(name, "not compared" if any(unstated) else "fine")
            both = training.words(before[name]), now.words(after[name])
            rows.append((name, what, both[0], "the same" if both[0] == both[1] else both[1]))
    if not details:
        yield from _in_columns(rows, details=False)
        return
    for name, what, before_, after_ in rows[1:]:
        yield f"{name}: {what}"
        yield from _in_columns([("  training", before_), ("  now", after_)], details=True)


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


_WAYS_OUT = {
    "rate": "data convert --resample-hz",
    "axes": "data convert --axes, --units",
    "frame": "data convert --frame NAME=roll,pitch,yaw, or where only the name is another add --accept frame",
    "transform": "data convert --frame NAME=roll,pitch,yaw, and add --accept transform",
    "sign": "Dataset.transform(flip=..., sign=...), or where only the words are others add --accept sign",
    "tare": "data convert --tare-s takes the rest before the motion off both",
}


# The tool's weight.


def payload(
    path: Recordings,
    *,
    output: Annotated[Path, Option("--output", "-o", help="JSON file to write.")],
    force: Force = False,
) -> None:
    """Identify what a tool weighs, where its centre of mass is, and the zero of the sensor.

    It takes rests, nothing touching the tool: one recording an orientation, four or more, turned by 30 degrees or
    more about two axes; half a second or more of each. Metadata say where gravity points, as the columns `gx`, `gy`,
    `gz` of an `index.csv`. `granular-id data convert --compensate` takes the payload off.

    Examples:

    - `granular-id setup payload rests -o tool.json`
    """
    check_outputs(("--output", output, json_of("payload")), source=path, force=force)
    from granular_id.recording import Payload

    found = Payload.fit(read(path))
    print_table(_table_of(found))
    found.save(output)
    show(f"wrote {output}")
    show(f"take it off with:\ngranular-id data convert PATH OUTPUT --compensate {output} --gravity X,Y,Z")


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
