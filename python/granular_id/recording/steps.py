"""Steps of a data set: pick recordings and axes out of it, crop recordings, cut them into stretches and windows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import replace
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_id._checks import WayOutError, argument_error, checked_choice, finite_number, thaw, whole_number
from granular_id._core import GranularIdError
from granular_id._text import counted, fixed, typed
from granular_id.recording.clock import samples_in, uniform_rate
from granular_id.recording.recording import Recording, SampleFlag, common_axes, common_rate
from granular_id.recording.report import StepReport, first_names, subject


def select_recordings(
    recordings: Sequence[Recording],
    labels: str | Sequence[str] | None,
    sessions: str | Sequence[str] | None,
    indices: ArrayLike | None,
    axes: Sequence[str] | None,
) -> tuple[list[Recording], StepReport]:
    """Keep what meets every condition; see :meth:`Dataset.select`, which calls this."""
    places = list(range(len(recordings))) if indices is None else _places(indices, len(recordings))
    parameters: dict[str, object] = {"indices": None if indices is None else "given"}
    for name, wanted in (("label", labels), ("session", sessions)):
        values = None if wanted is None else set(_texts(wanted, f"{name}s"))
        parameters[f"{name}s"] = None if values is None else sorted(values, key=str)
        if values is None:
            continue
        present: set[str | None] = {getattr(r, name) for r in recordings}
        if not values <= present:
            there = first_names(sorted(map(repr, present)), 20)
            missing = first_names(sorted(map(repr, values - present)), 20)
            raise GranularIdError(f"{name}s: no recording has {missing}; there are {there}")
        places = [i for i in places if getattr(recordings[i], name) in values]
    if not places:
        problem = "no index is given, or the conditions exclude each other"
        raise GranularIdError(f"select() leaves no recording: {problem}")
    chosen = [recordings[i] for i in places]
    if axes is not None:
        if isinstance(axes, (str, Set)) or not (columns := _texts(axes, "axes")):
            raise GranularIdError(f"axes={axes!r}; wanted a sequence of names like ['fx', 'fz']")
        parameters["axes"] = columns
        chosen = [_with_axes(recording, columns) for recording in chosen]
    totals = {"recordings_before": len(recordings), "recordings_after": len(places)}
    return chosen, StepReport("select", parameters, totals)


def _texts(value: object, name: str) -> list[str]:
    """Return one text or several as a list; None stands for recordings without a label or session."""
    several = isinstance(value, Iterable) and not isinstance(value, (str, bytes))
    texts: list[Any] = [*value] if several else [value]  # type: ignore[misc]
    if any(not isinstance(text, (str, type(None))) for text in texts):
        raise argument_error(TypeError, name, f"must be a str or a sequence of str, got {value!r:.60}")
    return texts


def _with_axes(recording: Recording, axes: Sequence[str]) -> Recording:
    missing = [axis for axis in axes if axis not in recording.axes]
    if missing:
        have = " ".join(recording.axes)
        raise GranularIdError(f"axes: recording {recording.name!r} has no axis {missing[0]!r}; it has {have}")
    columns = [recording.axes.index(axis) for axis in axes]
    return replace(recording, wrench=recording.wrench[:, columns], axes=tuple(axes))


def _places(indices: ArrayLike, n: int) -> list[int]:
    array = np.asarray(indices)
    if array.size == 0:
        return []
    if array.ndim != 1 or array.dtype.kind not in "iub":
        came = f"has dtype {array.dtype} and shape {array.shape}"
        raise argument_error(TypeError, "indices", f"{came}; wanted a list of int, or a mask")
    if array.dtype.kind == "b" and len(array) != n:
        raise GranularIdError(f"indices is a mask of {len(array)} for {n} recordings")
    try:
        return [int(i) for i in np.arange(n)[array]]
    except IndexError as error:
        raise IndexError(f"indices reach outside the {n} recordings: {error}") from error


def align_recordings(
    recordings: Sequence[Recording],
    n_samples: int | Literal["shortest"] | None,
    duration_s: float | None,
    trigger: Literal["recorded"] | None,
    lead_s: float,
    on_short: Literal["raise", "skip"],
) -> tuple[list[Recording], StepReport]:
    """Crop recordings to one length; see :meth:`Dataset.align`, which calls this."""
    rate_hz = common_rate(recordings)
    checked_choice("on_short", on_short, "raise", "skip")
    starts = _starts(recordings, rate_hz, trigger, lead_s, on_short)
    room = [
        0 if start is None or start < 0 else recording.n_samples - start
        for recording, start in zip(recordings, starts, strict=True)
    ]
    n = _length(room, rate_hz, n_samples, duration_s)
    fitting: list[tuple[Recording, int]] = []
    cropped: list[dict[str, Any]] = []
    skipped: list[dict[str, Any]] = []
    for recording, start in zip(recordings, starts, strict=True):
        row = {"name": recording.name, "samples_before": recording.n_samples}
        missing = _missing(recording, start, n)
        if missing and on_short == "raise":
            share, least = f"{sum(samples < n for samples in room)} of {len(room)} recordings", min(room)
            fits = (f"n_samples={least} fits all ", typed(duration_s=least / rate_hz))
            raise WayOutError(
                f"recording {recording.name!r} {missing}; {share} have no room; ",
                *(fits if least > 0 else ["ask for less lead"]),
                ", or pass on_short='skip' to leave such recordings out ",
                typed(on_error="skip"),
            )
        if start is None or missing:
            skipped.append({**row, "skipped": missing})
            continue
        fitting.append((recording, start))
        end = recording.n_samples - start - n
        if start or end:
            cropped.append({**row, "dropped_start": start, "dropped_end": end})
    if not fitting:
        none = f"none of the {counted(len(recordings))} has {fixed(n)} samples from its start or trigger on"
        raise GranularIdError(f"{none}: the first {skipped[0]['skipped']}")
    totals = {
        "recordings": len(fitting),
        "recordings_cropped": len(cropped),
        "recordings_skipped": len(skipped),
        "dropped_samples": sum(row["dropped_start"] + row["dropped_end"] for row in cropped),
    }
    parameters: dict[str, Any] = {"n_samples": n, "duration_s": duration_s}
    parameters |= {"trigger": trigger, "lead_s": lead_s, "on_short": on_short}
    common_axes([recording for recording, _ in fitting])
    # one block that all results look into, so that Dataset.X needs no second copy
    block = np.stack([recording.wrench[start : start + n] for recording, start in fitting])
    block.flags.writeable = False
    results = [
        _stretch(recording, start, start + n, start / rate_hz, wrench=wrench)
        for wrench, (recording, start) in zip(block, fitting, strict=True)
    ]
    return results, StepReport("align", parameters, totals, skipped + cropped)


def _starts(
    recordings: Sequence[Recording],
    rate: float,
    trigger: Literal["recorded"] | None,
    lead_s: float,
    on_short: Literal["raise", "skip"],
) -> list[int | None]:
    """Return the sample at which each recording is to begin; negative where there is no room for the lead."""
    lead = round(finite_number("lead_s times the rate", finite_number("lead_s", lead_s) * rate))
    if trigger not in (None, "recorded"):
        raise argument_error(GranularIdError, "trigger", f"={trigger!r}; wanted None or 'recorded'")
    if trigger is None:
        if lead:
            problem = f"={lead_s:g} is time before the trigger: give trigger= too"
            raise argument_error(GranularIdError, "lead_s", problem)
        return [0] * len(recordings)
    without = [r.name for r in recordings if r.trigger_index is None]
    if without and on_short == "raise":
        names = first_names([*map(repr, without)])
        raise WayOutError(
            f"{subject(len(without))} no trigger_index: {names}; call .find_onsets() ",
            typed(begin_at="onset"),
            ", state it with .find_onsets(overrule={name: seconds}), or pass on_short='skip' to leave such recordings "
            "out ",
            typed(on_error="skip"),
        )
    if len(without) == len(recordings):
        raise WayOutError(
            f"none of the {counted(len(without))} has a trigger_index; call .find_onsets() ",
            typed(begin_at="onset"),
            ", or see in its report why it found none",
        )
    return [None if r.trigger_index is None else r.trigger_index - lead for r in recordings]


def _length(
    room: Sequence[int], rate: float, n_samples: int | Literal["shortest"] | None, duration_s: float | None
) -> int:
    """Return how many samples to keep."""
    if (n_samples is None) == (duration_s is None):
        raise GranularIdError("give exactly one of n_samples (a number, or 'shortest') and duration_s")
    if duration_s is not None:
        return samples_in("duration_s", duration_s, rate)
    if isinstance(n_samples, str):
        if n_samples != "shortest":
            problem = f"={n_samples!r}; wanted a number or 'shortest'"
            raise argument_error(GranularIdError, "n_samples", problem)
        # those without the lead are refused or left out, and do not shorten the others
        return min((samples for samples in room if samples > 0), default=1)
    return whole_number("n_samples", n_samples)


def _missing(recording: Recording, start: int | None, n: int) -> str:
    """Say why a recording cannot be cropped; nothing where it can."""
    if start is None:
        return "has no trigger"
    if start < 0:
        return f"begins {fixed(-start)} samples too late for the lead before its trigger"
    if recording.n_samples - start >= n:
        return ""
    after = f" after sample {fixed(start)}" if start else ""
    return f"is too short: {fixed(recording.n_samples - start)} samples{after}, {fixed(n)} wanted"


def _stretch(recording: Recording, begin: int, end: int, begin_s: float, **changes: Any) -> Recording:
    """Return the samples from `begin` to `end` as a recording that begins so many seconds later."""
    start, flags, trigger = recording.start_time, recording.flags, recording.trigger_index
    known: dict[str, Any] = {
        "start_time": None if start is None else start + begin_s,
        "trigger_index": None if trigger is None or not begin <= trigger < end else trigger - begin,
        "flags": None if flags is None else flags[begin:end],
    }
    return replace(recording, **{"wrench": recording.wrench[begin:end], **known, **changes})


def split_recordings(recordings: Sequence[Recording], gap_s: float) -> tuple[list[Recording], StepReport]:
    """Make a recording of each stretch between gaps; see :meth:`Dataset.split`, which calls this."""
    limit = finite_number("gap_s", gap_s, positive=True)
    results: list[Recording] = []
    rows: list[dict[str, Any]] = []
    for recording in recordings:
        gaps = np.flatnonzero(np.diff(recording.times()) > limit) + 1
        if recording.rate_hz is not None or not len(gaps):
            results.append(recording)
            continue
        edges = [0, *gaps.tolist(), recording.n_samples]
        stretches = [_between_gaps(recording, begin, end) for begin, end in pairwise(edges)]
        seconds = [stretch.duration_s for stretch in stretches]
        row = {"name": recording.name, "stretches": len(stretches)}
        rows.append({**row, "shortest_s": min(seconds), "longest_s": max(seconds)})
        results += stretches
    totals = {"recordings_before": len(recordings), "recordings_after": len(results)}
    return results, StepReport("split", {"gap_s": limit}, totals, rows)


def _between_gaps(recording: Recording, begin: int, end: int) -> Recording:
    times = recording.times()[begin:end]
    time_s, begin_s = times - times[0], float(times[0])
    rate = uniform_rate(time_s)
    return _stretch(
        recording,
        begin,
        end,
        begin_s,
        rate_hz=rate,
        time_s=time_s if rate is None else None,
        name=f"{recording.name} @ {round(begin_s, 6):.12g} s".strip(),
    )


_COMPARED = 8  # samples of two windows

WINDOW = "window"
"""Where a window's ``meta`` says what it was cut from: ``recording`` and ``start_s``, seconds from its first sample."""


def cut_windows(
    recordings: Sequence[Recording],
    duration_s: float,
    hop_s: float | None,
    on_short: Literal["raise", "skip"],
) -> tuple[list[Recording], StepReport]:
    """Cut recordings into windows; see :meth:`Dataset.windows`, which calls this."""
    rate_hz = common_rate(recordings)
    checked_choice("on_short", on_short, "raise", "skip")
    n = samples_in("duration_s", duration_s, rate_hz)
    hop = n if hop_s is None else samples_in("hop_s", hop_s, rate_hz)
    names = Counter(recording.name.strip() for recording in recordings)
    windows: list[Recording] = []
    rows: list[dict[str, Any]] = []
    skipped: list[dict[str, Any]] = []
    unmeasured = 0
    for i, recording in enumerate(recordings):
        possible = range(0, recording.n_samples - n + 1, hop)
        if possible:
            starts = [start for start in possible if _is_measured(recording, start, n)]
            name = recording.name.strip() or "recording"
            if names[name] > 1 or not recording.name.strip():  # a window must tell its recording from others
                name += f" {i + 1}"
            windows += _windows_of(recording, name, starts, n, rate_hz)
            used = int(np.minimum(np.diff(starts), n).sum()) + n if starts else 0
            row = {"name": recording.name, "windows": len(starts)}
            rows.append({**row, "dropped": recording.n_samples - used})
            unmeasured += len(possible) - len(starts)
            continue
        short = f"is shorter than a window: {fixed(recording.n_samples)} samples, {fixed(n)} wanted"
        if on_short == "raise":
            n_short = sum(one.n_samples < n for one in recordings)
            raise WayOutError(
                f"recording {recording.name!r} {short}; {n_short} of {len(recordings)} recordings are too short: "
                "ask for shorter windows, or pass on_short='skip' to leave such recordings out ",
                typed(on_error="skip"),
            )
        skipped.append({"name": recording.name, "samples_before": recording.n_samples, "skipped": short})
    if not windows:
        why = "no window has a measured sample: all are filled gaps"
        if not rows:
            why = f"none of the {counted(len(recordings))} is as long as a window of {fixed(n)} samples"
        raise GranularIdError(why)
    totals = {
        "recordings": len(rows),
        "windows": len(windows),
        "windows_without_a_measured_sample": unmeasured,
        "recordings_skipped": len(skipped),
        "dropped_samples": sum(row["dropped"] for row in rows),
    }
    parameters = {"duration_s": n / rate_hz, "hop_s": hop / rate_hz, "n_samples": n, "on_short": on_short}
    return windows, StepReport("windows", parameters, totals, skipped + rows)


def _is_measured(recording: Recording, start: int, n: int) -> bool:
    """Whether any of `n` samples was measured rather than filled in inside a gap."""
    flags = recording.flags
    return flags is None or not (flags[start : start + n] & SampleFlag.GAP_FILLED).all()


def cut_from(recording: Recording) -> tuple[str, float] | None:
    """Return the name of the recording that a window was cut from and where it begins, s; None for what is none."""
    window = recording.meta.get(WINDOW)
    if not isinstance(window, Mapping) or not {"recording", "start_s"} <= window.keys():
        return None
    return window["recording"], window["start_s"]


def recordings_cut(recordings: Sequence[Recording]) -> NDArray[np.intp]:
    """Return the number of the recording that each is a window of; what is no window is one of its own."""
    found: dict[object, int] = {}
    numbers = [
        found.setdefault(row if (window := cut_from(recording)) is None else window[0], len(found))
        for row, recording in enumerate(recordings)
    ]
    return np.array(numbers, dtype=np.intp)


def overlapping_windows(recordings: Sequence[Recording]) -> Iterator[tuple[int, int]]:
    """Yield the places of windows of one recording that share samples, pair by pair."""
    of_one: dict[str, list[tuple[float, int]]] = {}
    for place, recording in enumerate(recordings):
        if (known := cut_from(recording)) is not None:
            of_one.setdefault(known[0], []).append((known[1], place))
    for windows in of_one.values():
        windows.sort()
        for i, (start_s, place) in enumerate(windows):
            step_s = recordings[place].duration_s / max(1, recordings[place].n_samples - 1)
            end_s = start_s + recordings[place].duration_s + step_s / 2
            for later_s, other in windows[i + 1 :]:
                if later_s >= end_s:
                    break
                if _share_samples(recordings[place], recordings[other], later_s - start_s):
                    yield place, other


def _share_samples(one: Recording, other: Recording, later_s: float) -> bool:
    """Whether the beginning of a window stands in another one, so much earlier: names may be those of other files."""
    if one.rate_hz is None or one.axes != other.axes:
        return False
    shared = one.wrench[round(later_s * one.rate_hz) :][:_COMPARED]
    return len(shared) > 0 and np.array_equal(shared, other.wrench[: len(shared)])


def _windows_of(
    recording: Recording, name: str, starts: Iterable[int], n: int, rate_hz: float
) -> Iterable[Recording]:
    """Yield the windows of one recording, which are views of its samples."""
    whole, offset_s = cut_from(recording) or (name, 0.0)  # of a window that is cut once more
    meta = thaw(recording.meta)
    for start in starts:
        start_s = offset_s + start / rate_hz
        yield _stretch(
            recording,
            start,
            start + n,
            start / rate_hz,
            name=f"{whole} @ {round(start_s, 6):.12g} s",
            meta={**meta, WINDOW: {"recording": whole, "start_s": start_s}},
        )
