"""Recordings from a tree of named arrays that nobody described: NPZ archives, MATLAB files, HDF5 files.

What is recognised, by shapes first and by names where shapes leave a choice:

- one array of shape (recordings, samples, 6), in any order of axes that can be told, with or without labels;
- a list (cell array) of (samples, 6) arrays, of any lengths, with or without labels;
- an array or a list per material, under the material's name;
- structs or groups, each a recording of its own;
- one recording: (samples, 6), or a vector for each axis called fx, fy ... tz;
- any of these as forces and torques side by side, with three axes each.

Labels, names of classes, sessions, rates, stamps, start times and triggers are found by their names
(``names``). Everything guessed is said in the notes; what could mean two things is refused, with a list of
what the file holds.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from granular_id.io.arrays.axes import Known
from granular_id.io.arrays.details import Found
from granular_id.io.arrays.hints import nothing_found
from granular_id.io.arrays.search import Search
from granular_id.io.arrays.tree import Origin
from granular_id.io.errors import RecordingFileError
from granular_id.io.flat import FlatRecordings, joined, unflatten
from granular_id.io.flat_checks import NO_TRIGGER
from granular_id.io.options import LoadOptions
from granular_id.io.source import FileContent, FileSource
from granular_id.io.stamped import stamped_recording
from granular_id.recording import Recording

_MOST_NOTES = 20


def recordings_of(
    arrays: Mapping[str, Any],
    source: FileSource,
    options: LoadOptions,
    describe: str,
    *,
    single: bool = False,
) -> FileContent:
    """Find the recordings in named arrays.

    Parameters
    ----------
    arrays : mapping
        Names to numpy arrays, or to anything with ``shape``, ``dtype`` and ``read()``; mappings (structs, groups),
        lists (cells) and ``str`` may stand in their place, to any depth.
    source, options
        As for every reader; a rate stated there is used where the file has none, and must equal the file's own.
    describe : str
        What the format calls an entry, for errors: ``"array"``, ``"variable"``, ``"data set"``.
    single : bool
        Whether such a file can hold one array only.

    Returns
    -------
    FileContent
        With a note on everything that was guessed.

    Raises
    ------
    RecordingFileError
        No recordings, more than one way to read them, labels or times that do not fit, values that are not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from pathlib import Path
    >>> from granular_id.io.arrays.layouts import recordings_of
    >>> from granular_id.io.options import LoadOptions
    >>> from granular_id.io.source import FileSource
    >>> arrays = {"X": np.zeros((2, 1600, 6)), "y": np.array([1, 2]), "materials": ["rice", "peas"]}
    >>> arrays["fs"] = np.array(500)
    >>> content = recordings_of(arrays, FileSource.alone(Path("pushes.mat")), LoadOptions(), "variable")
    >>> content.recordings[1]
    Recording('pushes.mat[1]', label='peas', 1600 samples at 500 Hz)
    >>> content.notes
    ['X (2, 1600, 6) taken as recordings, samples, axes', 'labels are the numbers in y, counted from 1 in materials']
    """
    origin = Origin(source.path, describe, arrays, single)
    search = Search(origin)
    groups = search.level(arrays, "", Known(), {}, 0)
    every = [found for group in groups for found in group]
    if not every:
        raise origin.unclear(f"no recordings are recognised: {nothing_found(origin.tree)}")
    if len({found.axes for found in every}) > 1:
        raise origin.unclear("recordings differ in their axes")
    notes = list(dict.fromkeys(search.notes))
    _set_rates(every, source, options, origin, notes)
    if any("stamps" in found.about for found in every):
        content = _stamped(every, source, options)
    else:
        content = unflatten(_flat(every), source.path, source, finite=True)
    more = [f"... and {len(notes) - _MOST_NOTES} more notes like these"] if len(notes) > _MOST_NOTES else []
    content.notes += notes[:_MOST_NOTES] + more
    return content


def _set_rates(
    every: list[Found], source: FileSource, options: LoadOptions, origin: Origin, notes: list[str]
) -> None:
    """Give every recording without stamps its rate; stamps that all share and that are even become one."""
    stated = options.rate_hz if source.rate_hz is None else source.rate_hz
    _share_stamps(every, source, options, notes)
    for found in every:
        own = found.about.get("rate")
        if "stamps" in found.about:
            continue
        if own is None and stated is None:
            beside = "" if origin.single else ", or save fs (Hz) or t (s) beside the samples"
            raise origin.fault(found.place, f"has neither a rate nor stamps; pass rate_hz={beside}")
        if own is not None and stated is not None and own != stated:
            raise origin.fault(found.place, f"the stated rate is {stated:g} Hz, but the file says {own:g} Hz")
        found.about["rate"] = stated if own is None else own


def _share_stamps(every: list[Found], source: FileSource, options: LoadOptions, notes: list[str]) -> None:
    stamps = every[0].about.get("stamps")
    if stamps is None or len(every) == 1 or source.irregular:
        return
    same = all(
        "stamps" in found.about and np.array_equal(found.about["stamps"], stamps[: len(found.wrench)])
        for found in every
    )
    if not same:
        return
    shared = stamps - stamps[0]  # one vector cannot say when each of several recordings began
    recording, _ = _read_stamped(
        replace(every[0], about={**every[0].about, "stamps": shared}), source, options
    )
    if recording.rate_hz is not None and len(recording.wrench) == len(every[0].wrench):
        for found in every:
            del found.about["stamps"]
            found.about["rate"] = recording.rate_hz
        notes.append(f"the stamps that all recordings share are even: {recording.rate_hz:g} Hz")


def _stamped(every: list[Found], source: FileSource, options: LoadOptions) -> FileContent:
    """Make recordings one by one, where stamps must be looked at."""
    recordings: list[Recording] = []
    rows: list[dict[str, Any]] = []
    for i, found in enumerate(every):
        named = found.about.get("name") or (source.name if len(every) == 1 else f"{source.name}[{i}]")
        own = replace(source, name=named, rate_hz=found.about.get("rate", source.rate_hz))
        recording, remarks = _read_stamped(found, own, options)
        labels = {key: found.about[key] for key in ("label", "session") if key in found.about}
        try:
            recordings.append(replace(recording, **labels))
        except (TypeError, ValueError) as error:
            raise RecordingFileError(source.path, str(error), place=found.place) from error
        rows += [{"name": named, **remarks}] if remarks else []
    return FileContent(recordings, rows)


def _read_stamped(found: Found, source: FileSource, options: LoadOptions) -> tuple[Recording, dict[str, Any]]:
    about = found.about
    stamps = about.get("stamps")
    if stamps is not None:
        stamps = np.asarray(stamps, np.float64)
        if not np.isfinite(stamps).all():
            first = int(np.flatnonzero(~np.isfinite(stamps))[0])
            problem = f"the stamp of sample {first} is {stamps[first]}; wanted seconds"
            raise RecordingFileError(source.path, problem, place=found.place)

    def locate(sample: int | None) -> dict[str, Any]:
        return {"place": found.place if sample is None else f"{found.place}, sample {sample}"}

    return stamped_recording(
        found.wrench,
        source,
        options,
        stamps=stamps,
        start_time=about.get("start"),
        flags=about.get("flags"),
        trigger=about.get("trigger"),
        axes=found.axes,
        meta=about.get("meta"),
        locate=locate,
    )


def _flat(every: Sequence[Found]) -> FlatRecordings:
    def column(attribute: str, missing: Any = None) -> list[Any]:
        return [found.about.get(attribute, missing) for found in every]

    flags = None
    if any("flags" in found.about for found in every):
        flags = np.concatenate(
            [found.about.get("flags", np.zeros(len(found.wrench), np.uint8)) for found in every]
        )
    return FlatRecordings(
        axes=every[0].axes,
        wrench=joined([found.wrench for found in every]),
        n_samples=np.array([len(found.wrench) for found in every], np.int64),
        rate_hz=np.array(column("rate"), np.float64),
        start_time=np.array(column("start", np.nan), np.float64),
        trigger_index=np.array(column("trigger", NO_TRIGGER), np.int64),
        label=column("label"),
        session=column("session"),
        name=column("name"),
        meta_json=[json.dumps(meta) if meta else None for meta in column("meta")],
        flags=flags,
    )
