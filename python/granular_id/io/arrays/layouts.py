"""Recordings from a tree of named arrays that nobody described: NPZ archives, MATLAB files, HDF5 files.

What is recognised, by shapes first and by names where shapes leave a choice:

- one array of shape (recordings, samples, 6), in any order of axes that can be told, with or without labels;
- a list (cell array) of (samples, 6) arrays, of any lengths, with or without labels;
- an array or a list per material, under the material's name;
- structs or groups, each a recording of its own;
- one recording: (samples, 6), or a vector for each axis called fx, fy ... tz;
- any of these as forces and torques side by side, with three axes each.

Labels, names of classes, sessions, rates, stamps, start times and triggers are found by their names (``names``).
Everything guessed is said in the notes; what could mean two things is refused, with a list of what the file holds.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from granular_id.io.arrays.found import Found, Push
from granular_id.io.arrays.names import FORCES, TORQUES, is_other_thing, plain_name, role_of
from granular_id.io.arrays.search import Search
from granular_id.io.arrays.shapes import THREE, Known
from granular_id.io.arrays.stated import names_of
from granular_id.io.arrays.tree import MAX_DEPTH, Origin, as_tree, is_numbers
from granular_id.io.errors import RecordingFileError
from granular_id.io.flat import NO_TRIGGER, FlatRecordings, joined, unflatten
from granular_id.io.options import LoadOptions
from granular_id.io.source import FileContent, FileSource
from granular_id.io.stamped import stamped_recording
from granular_id.recording import AXES, Recording

_MOST_NOTES = 20


def recordings_of(
    arrays: Mapping[str, Any],
    source: FileSource,
    options: LoadOptions,
    describe: str,
    *,
    single: bool = False,
) -> FileContent:
    """Find the recordings in named arrays, with a note on everything that was guessed.

    `arrays` lead from names to nodes of a tree (see ``arrays.tree``, also on `describe` and `single`). A rate that is
    stated outside is used where the file has none, and must equal the file's own. Refused are no recordings, more
    than one way to read them, labels or times that do not fit, values that are not finite.

    Examples
    --------
    >>> from pathlib import Path
    >>> arrays = {"X": np.zeros((2, 1600, 6)), "y": np.array([1, 2]), "materials": ["rice", "peas"]}
    >>> arrays["fs"] = np.array(500)
    >>> content = recordings_of(arrays, FileSource.alone(Path("pushes.mat")), LoadOptions(), "variable")
    >>> content.recordings[1]
    Recording('pushes.mat[1]', label='peas', 1600 samples at 500 Hz)
    >>> content.notes
    ['X (2, 1600, 6) taken as recordings, samples, axes', 'labels are the numbers in y, counted from 1 in materials']
    """
    origin = Origin(source.path, describe, arrays, single)
    search = Search(origin, options)
    axes = options.axes if options.other_sensor or len(options.axes or ()) == len(AXES) else None
    unnamed = Known() if axes is None else Known(axes)
    found = search.level(arrays, "", unnamed)
    if not len(found) and options.axes is not None and len(options.axes) < len(AXES):
        found = search.level(arrays, "", Known(options.axes))
    if options.label is not None and not search.label_found:
        raise origin.unclear(f"label={options.label!r} is not there")
    if not len(found) and options.array is not None:
        raise origin.unclear(f"array={options.array!r} names no recordings")
    if not len(found):
        raise origin.unclear(f"no recordings are recognised: {_what_is_missing(arrays, options.axes)}")
    if len({push.axes for push in found.pushes}) > 1:
        raise origin.unclear("recordings differ in their axes")
    _share_stamps(found, source, options, origin)
    _set_rates(found, source, options, origin)
    if any("stamps" in push.about for push in found.pushes):
        content = _stamped(found, source, options)
    else:
        content = unflatten(_flat(found), source.path, source, finite=True)
    more = len(origin.notes) - _MOST_NOTES
    content.obeyed = ("axes",)
    content.notes += origin.notes[:_MOST_NOTES]
    content.notes += [f"... and {more} more notes like these"] if more > 0 else []
    return content


def _set_rates(found: Found, source: FileSource, options: LoadOptions, origin: Origin) -> None:
    """Give every recording without stamps the rate that is stated; it must be the file's own where that has one."""
    stated = options.rate_hz if source.rate_hz is None else source.rate_hz
    for push in found.pushes:
        own = push.about.get("rate")
        if "stamps" in push.about:
            continue
        if own is None and stated is None:
            beside = "" if origin.single else ", or save fs (Hz) or t (s) beside the samples"
            raise origin.fault(push.place, f"has neither a rate nor stamps; pass rate_hz={beside}")
        if own is not None and stated not in (None, own):
            problem = f"the stated rate is {stated:g} Hz, but the file says {own:g} Hz"
            raise origin.fault(push.place, problem)
        push.about["rate"] = own or stated


def _share_stamps(found: Found, source: FileSource, options: LoadOptions, origin: Origin) -> None:
    """Turn stamps that all recordings share, and that are even, into a rate."""
    first, *others = found.pushes
    stamps = first.about.get("stamps")
    if stamps is None or not others or source.irregular:
        return
    for push in others:
        own = push.about.get("stamps")
        if own is None or not np.array_equal(own, stamps[: len(push.wrench)]):
            return
    shared = stamps - stamps[0]  # one vector cannot say when each of several recordings began
    begun = replace(first, about={**first.about, "stamps": shared})
    recording, _ = _read_stamped(begun, source, options)
    if recording.rate_hz is not None and len(recording.wrench) == len(first.wrench):
        for push in found.pushes:
            del push.about["stamps"]
            push.about["rate"] = recording.rate_hz
        origin.note(f"the stamps that all recordings share are even: {recording.rate_hz:g} Hz")


def _stamped(found: Found, source: FileSource, options: LoadOptions) -> FileContent:
    """Make recordings one by one, where stamps must be looked at."""
    recordings: list[Recording] = []
    rows: list[dict[str, Any]] = []
    for i, push in enumerate(found.pushes):
        named = push.about.get("name") or (source.name if len(found) == 1 else f"{source.name}[{i}]")
        recording, remarks = _read_stamped(push, replace(source, name=named), options)
        labels = {key: push.about[key] for key in ("label", "session") if key in push.about}
        try:
            recordings.append(replace(recording, **labels))
        except (TypeError, ValueError) as error:
            raise RecordingFileError(source.path, str(error), place=push.place) from error
        rows += [{"name": named, **remarks}] if remarks else []
    return FileContent(recordings, rows)


def _read_stamped(push: Push, source: FileSource, options: LoadOptions) -> tuple[Recording, dict[str, Any]]:
    about, place = push.about, push.place
    stamps = about.get("stamps")
    if stamps is not None:
        stamps = np.asarray(stamps, np.float64)
        if not np.isfinite(stamps).all():
            first = int(np.flatnonzero(~np.isfinite(stamps))[0])
            problem = f"the stamp of sample {first} is {stamps[first]}; wanted seconds"
            raise RecordingFileError(source.path, problem, place=place)

    def locate(sample: int | None) -> dict[str, Any]:
        return {"place": place if sample is None else f"{place}, sample {sample}"}

    return stamped_recording(
        push.wrench,
        source,
        options,
        stamps=stamps,
        start_time=about.get("start"),
        flags=about.get("flags"),
        trigger=about.get("trigger"),
        axes=push.axes,
        meta=about.get("meta"),
        locate=locate,
        time_unit=about.get("time_unit"),
        file_rate_hz=about.get("rate"),
    )


def _flat(found: Found) -> FlatRecordings:
    def numbers(attribute: str, missing: float) -> list[Any]:
        return [missing if value is None else value for value in found.get(attribute)]

    lengths, flags = [len(push.wrench) for push in found.pushes], None
    if any("flags" in push.about for push in found.pushes):
        own = zip(found.get("flags"), lengths, strict=True)
        flags = np.concatenate([np.zeros(n, np.uint8) if row is None else row for row, n in own])
    return FlatRecordings(
        axes=found.pushes[0].axes,
        wrench=joined([push.wrench for push in found.pushes]),
        n_samples=np.array(lengths, np.int64),
        rate_hz=np.array(numbers("rate", np.nan), np.float64),
        start_time=np.array(numbers("start", np.nan), np.float64),
        trigger_index=np.array(numbers("trigger", NO_TRIGGER), np.int64),
        label=found.get("label"),
        session=found.get("session"),
        name=found.get("name"),
        meta_json=[json.dumps(meta) if meta else None for meta in found.get("meta")],
        flags=flags,
    )


# -- why nothing was recognised, and how to save it so that it is

_N = len(AXES)


def _what_is_missing(tree: Mapping[str, Any], axes: Sequence[str] | None) -> str:
    """Say what the first array that comes near a recording lacks."""
    if axes is not None:
        return f"axes= names {len(axes)}, wanted an array with an axis of that length"
    arrays = list(_arrays(tree, "", MAX_DEPTH))
    six = next((f"{name} {shape}" for name, shape in arrays if _N in shape), None)
    named = {key: len(names_of(node)) for key, node in tree.items() if role_of(key) == "axes"}
    for key, n_names in named.items():
        if six is not None and n_names != _N:
            return f"{six} has {_N} columns, {key} names {n_names}; wanted a name for each"
    wanted = (
        f"wanted an array with an axis of length {_N}, or axes, the names of the axes that there are, beside it; of "
        "another sensor pass axes= with their names"
    )
    return next((hint for name, shape in arrays if (hint := _hint(name, shape))), wanted)


def _arrays(node: Any, name: str, depth: int) -> Iterator[tuple[str, tuple[int, ...]]]:
    """Yield names and shapes of arrays of numbers that are no vectors."""
    node = as_tree(node)
    if isinstance(node, Mapping) and depth:
        for key, item in node.items():
            yield from _arrays(item, f"{name}/{key}" if name else key, depth - 1)
    elif isinstance(node, list) and depth:
        for item in node[:1]:
            yield from _arrays(item, f"{name}[0]", depth - 1)
    elif is_numbers(node) and len(node.shape) in (2, 3):
        yield name[:200], tuple(node.shape)


def _hint(name: str, shape: tuple[int, ...]) -> str | None:
    """Say what may be wrong with an array, and the way out."""
    last, it = name.rpartition("/")[2], f"{name} {shape}"
    if 0 in shape:
        return f"{it} is empty: it holds no samples" if _N in shape else None
    if _N in shape and is_other_thing(last):
        return (
            f"{it} is no wrench by its name; if it is one, pass array={name!r}, or of another sensor axes= with the "
            "names of its columns"
        )
    if len(THREE) in shape and plain_name(last) in FORCES | TORQUES:
        way_out = "save force and torque as arrays of one shape under these names"
        axes = "or beside the samples axes, the names of those that there are"
        return f"{it} has {len(THREE)} axes, a wrench {_N}; {way_out}, {axes}"
    if shape[-1] == _N + 1:
        time = f"{name}[:, 0]" if len(shape) == 2 else f"{name}[0, :, 0]"
        return (
            f"{it} has {_N + 1} columns; if the first is time, save {name}[..., 1:] as X and {time} as t (s)"
        )
    if len(shape) == 2 and not shape[1] % _N:
        n, n_samples = shape[0], shape[1] // _N
        first = f"{name}.reshape({n}, {_N}, {n_samples}).transpose(0, 2, 1) if all of fx come first"
        second = f"{name}.reshape({n}, {n_samples}, {_N}) if all axes of the first sample do"
        return f"{it} may hold one flattened recording in each row. Save it as {first}, as {second}"
    return None
