"""The steps that make a uniform array of recordings: select, resample, find onsets, align."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence, Set
from dataclasses import replace
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from granular_id._checks import FloatArray, checked_index, checked_number
from granular_id._text import counted, fixed, verb
from granular_id.recording.onset import FALSE_ALARM_RATE, REST_S, find_all_onsets
from granular_id.recording.recording import Recording, common_axes
from granular_id.recording.report import StepReport
from granular_id.recording.resampling import MAX_GAP_S, Method, resample_recordings

# Make one array of many recordings, where they share a rate and a length.


def common_rate(recordings: Sequence[Recording]) -> float:
    """Return the rate that all recordings share, Hz, or raise ValueError naming the method that makes one."""
    irregular = [r.name for r in recordings if r.rate_hz is None]
    if irregular:
        raise ValueError(
            f"{len(irregular)} of {counted(len(recordings))} "
            f"{verb(len(irregular), 'is', 'are')} irregularly sampled (the first is "
            f"{irregular[0]!r}); call .resample(rate_hz) first, nothing is resampled silently"
        )
    rates = sorted({r.rate_hz for r in recordings if r.rate_hz is not None})
    if len(rates) > 1:
        raise ValueError(
            f"recordings differ in rate ({rates[0]:g} to {rates[-1]:g} Hz); call .resample(rate_hz) first, "
            "nothing is resampled silently"
        )
    return rates[0]


def stack(recordings: Sequence[Recording]) -> FloatArray:
    """Return the samples as one read-only array, shape (n, T, C), or raise naming the method that helps."""
    common_rate(recordings)
    common_axes(recordings)
    lengths = [r.n_samples for r in recordings]
    if len(set(lengths)) > 1:
        raise ValueError(
            f"recordings differ in length ({min(lengths)} to {max(lengths)} samples); call "
            ".align(n_samples=...) or .align(duration_s=...) first, nothing is cropped silently"
        )
    parts = [r.wrench for r in recordings]
    block = shared_base(parts)
    if block is None:
        block = np.stack(parts)
        block.flags.writeable = False
        return block
    shape = (len(parts), *parts[0].shape)
    return block if block.shape == shape else block.reshape(shape)


def shared_base(parts: Sequence[FloatArray]) -> FloatArray | None:
    """Return the array that the parts fill, one after the other and without a rest, if there is one.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.recording.steps import shared_base
    >>> block = np.zeros((2, 1600, 6))
    >>> shared_base(list(block)) is block, shared_base([block[1], block[0]]) is None
    (True, True)
    """
    base = parts[0].base
    if not isinstance(base, np.ndarray) or base.nbytes != sum(part.nbytes for part in parts):
        return None
    # of another type where the parts view its bytes as numbers
    if base.dtype != parts[0].dtype or not base.flags.c_contiguous:
        return None
    address = base.__array_interface__["data"][0]
    for part in parts:
        if part.base is not base or not part.flags.c_contiguous:
            return None
        if part.__array_interface__["data"][0] != address:
            return None
        address += part.nbytes
    return base


# Pick recordings out of a data set by label, session, name, place or anything else, and axes out of them.


def select_recordings(
    recordings: Sequence[Recording],
    labels: str | Sequence[str] | None,
    sessions: str | Sequence[str] | None,
    indices: ArrayLike | None,
    *,
    names: str | Sequence[str] | None = None,
    where: Callable[[Recording], bool] | None = None,
    axes: Sequence[str] | None = None,
) -> tuple[list[Recording], StepReport]:
    """Keep what meets every condition; see :meth:`Dataset.select`, which calls this."""
    kept = list(range(len(recordings))) if indices is None else _places(indices, len(recordings))
    parameters: dict[str, object] = {"indices": None if indices is None else "given"}
    for name, wanted in (("label", labels), ("session", sessions), ("name", names)):
        values = None if wanted is None else set(_texts(wanted, f"{name}s"))
        parameters[f"{name}s"] = None if values is None else sorted(values, key=str)
        if values is None:
            continue
        present: set[str | None] = {getattr(r, name) for r in recordings}
        if not values <= present:
            raise ValueError(
                f"{name}s: no recording has {_some(values - present)}; there are {_some(present)}"
            )
        kept = [i for i in kept if getattr(recordings[i], name) in values]
    if where is not None:
        if not callable(where):
            raise TypeError(f"where must be callable, got {type(where).__name__}")
        parameters["where"] = "given"
        kept = [i for i in kept if where(recordings[i])]
    if not kept:
        raise ValueError(
            "select() leaves no recording: no index is given, or the conditions exclude each other"
        )
    chosen = [recordings[i] for i in kept]
    if axes is not None:
        if isinstance(axes, (str, Set)) or not len(columns := _texts(axes, "axes")):
            raise ValueError(f"axes={axes!r}; wanted a sequence of names like ['fx', 'fz']")
        parameters["axes"] = columns
        chosen = [_with_axes(recording, columns) for recording in chosen]
    totals = {"recordings_before": len(recordings), "recordings_after": len(kept)}
    return chosen, StepReport("select", parameters, totals)


def _texts(value: object, name: str) -> list[str]:
    """Return one text or several as a list; None stands for recordings without a label or session."""
    if isinstance(value, str):
        return [value]
    if isinstance(value, bytes) or not isinstance(value, Iterable):
        raise TypeError(f"{name} must be a str or a sequence of str, got {type(value).__name__}")
    texts = list(value)
    wrong = next((i for i, text in enumerate(texts) if not isinstance(text, (str, type(None)))), None)
    if wrong is not None:
        raise TypeError(f"{name}[{wrong}] must be a str, got {type(texts[wrong]).__name__}")
    return texts


def _some(values: Collection[str | None], most: int = 20) -> str:
    shown = sorted(map(repr, values))
    return ", ".join(shown[:most]) + (f" and {len(shown) - most} more" if len(shown) > most else "")


def _with_axes(recording: Recording, axes: Sequence[str]) -> Recording:
    missing = [axis for axis in axes if axis not in recording.axes]
    if missing:
        have = " ".join(recording.axes)
        raise ValueError(f"axes: recording {recording.name!r} has no axis {missing[0]!r}; it has {have}")
    columns = [recording.axes.index(axis) for axis in axes]
    return replace(recording, wrench=recording.wrench[:, columns], axes=tuple(axes))


def _places(indices: ArrayLike, n: int) -> list[int]:
    array = np.asarray(indices)
    if array.size == 0:
        return []
    if array.ndim != 1 or array.dtype.kind not in "iub":
        raise TypeError(
            f"indices has dtype {array.dtype} and shape {array.shape}; wanted a list of int, or a mask"
        )
    if array.dtype.kind == "b" and len(array) != n:
        raise ValueError(f"indices is a mask of {len(array)} for {n} recordings")
    try:
        return [int(i) for i in np.arange(n)[array]]
    except IndexError as error:
        raise IndexError(f"indices reach outside the {n} recordings: {error}") from error


# Crop recordings to one length, from their start or around a trigger, saying what was dropped.


def align_recordings(
    recordings: Sequence[Recording],
    rate_hz: float,
    *,
    n_samples: int | Literal["shortest"] | None = None,
    duration_s: float | None = None,
    trigger: Literal["recorded"] | Sequence[int] | None = None,
    lead_s: float = 0.0,
    on_short: Literal["raise", "skip"] = "raise",
    on_missing: Literal["raise", "skip"] = "raise",
) -> tuple[list[Recording], StepReport]:
    """Crop recordings of one rate to one length; see :meth:`Dataset.align`, which calls this."""
    if on_short not in ("raise", "skip"):
        raise ValueError(f"on_short={on_short!r}; wanted 'raise' or 'skip'")
    if on_missing not in ("raise", "skip"):
        raise ValueError(f"on_missing={on_missing!r}; wanted 'raise' or 'skip'")
    without: list[Recording] = []
    if isinstance(trigger, str) and on_missing == "skip":
        without = [r for r in recordings if r.trigger_index is None]
        recordings = [r for r in recordings if r.trigger_index is not None]
        if not recordings:
            raise ValueError(
                f"none of the {counted(len(without))} has a trigger_index; call .find_onsets(), or see in its "
                "report why it found none"
            )
    starts = _starts(recordings, rate_hz, trigger, lead_s)
    n = _length(recordings, starts, rate_hz, n_samples, duration_s)
    kept: list[tuple[Recording, int]] = []
    rows: list[dict[str, Any]] = [
        {"name": r.name, "samples_before": r.n_samples, "skipped": "has no trigger"} for r in without
    ]
    for recording, start in zip(recordings, starts, strict=True):
        if start < 0 or start + n > recording.n_samples:
            missing = _missing(recording, start, n)
            if on_short == "raise":
                raise ValueError(
                    f"recording {recording.name!r} {missing}; {_way_out(recordings, starts, n, rate_hz)}"
                )
            rows.append({"name": recording.name, "samples_before": recording.n_samples, "skipped": missing})
            continue
        kept.append((recording, start))
        end = recording.n_samples - start - n
        if start or end:
            before = recording.n_samples
            rows.append(
                {"name": recording.name, "samples_before": before, "dropped_start": start, "dropped_end": end}
            )
    if not kept:
        wanted = f"{n} samples from its start or trigger on"
        if all(start < 0 for start in starts):
            wanted = f"the lead before its trigger (lead_s={lead_s:g})"
        raise ValueError(
            f"none of the {counted(len(recordings))} has {wanted}; the longest has "
            f"{counted(max(r.n_samples for r in recordings), 'sample')} in all"
        )
    rows.sort(key=lambda row: "skipped" not in row)
    cropped = _crop(kept, n)
    changed = [row for row in rows if "skipped" not in row]
    totals = {
        "recordings": len(cropped),
        "recordings_cropped": len(changed),
        "recordings_skipped": len(rows) - len(changed),
        "dropped_samples": sum(row["dropped_start"] + row["dropped_end"] for row in changed),
    }
    parameters = {
        "n_samples": n,
        "duration_s": duration_s,
        "trigger": trigger if trigger is None or isinstance(trigger, str) else "given",
        "lead_s": lead_s,
        "on_short": on_short,
        "on_missing": on_missing if isinstance(trigger, str) else None,
    }
    return cropped, StepReport("align", parameters, totals, rows)


def _starts(
    recordings: Sequence[Recording],
    rate: float,
    trigger: Literal["recorded"] | Sequence[int] | None,
    lead_s: float,
) -> list[int]:
    lead = round(checked_number(checked_number(lead_s, "lead_s") * rate, "lead_s times the rate"))
    if trigger is None:
        if lead:
            raise ValueError(f"lead_s={lead_s:g} is time kept before the trigger: give trigger= too")
        return [0] * len(recordings)
    if isinstance(trigger, str):
        if trigger != "recorded":
            raise ValueError(
                f"trigger={trigger!r}; wanted None, 'recorded' or one sample index per recording"
            )
        without = [r.name for r in recordings if r.trigger_index is None]
        if without:
            names = ", ".join(map(repr, without[:3])) + (", ..." if len(without) > 3 else "")
            n = len(without)
            raise ValueError(
                f"{counted(n)} {verb(n, 'has', 'have')} no trigger_index: {names}; call .find_onsets(), state it with "
                ".find_onsets(overrule={name: seconds}), or pass on_missing='skip' to leave such recordings out"
            )
        return [(r.trigger_index or 0) - lead for r in recordings]
    indices = [checked_index(i, "trigger") for i in np.asarray(trigger).ravel()]
    if len(indices) != len(recordings):
        raise ValueError(f"trigger has {len(indices)} indices for {len(recordings)} recordings")
    for recording, index in zip(recordings, indices, strict=True):
        if not 0 <= index < recording.n_samples:
            raise ValueError(
                f"trigger {index} is outside recording {recording.name!r} ({recording.n_samples} samples)"
            )
    return [i - lead for i in indices]


def _length(
    recordings: Sequence[Recording],
    starts: Sequence[int],
    rate: float,
    n_samples: int | Literal["shortest"] | None,
    duration_s: float | None,
) -> int:
    if (n_samples is None) == (duration_s is None):
        raise ValueError("give exactly one of n_samples (a number, or 'shortest') and duration_s")
    if duration_s is not None:
        seconds = checked_number(duration_s, "duration_s")
        n = round(checked_number(seconds * rate, "duration_s times the rate"))
        what = f"duration_s={seconds:g} at {rate:g} Hz"
    elif isinstance(n_samples, str):
        if n_samples != "shortest":
            raise ValueError(f"n_samples={n_samples!r}; wanted a number or 'shortest'")
        # those without the lead are refused or left out, and do not shorten the others
        n = min(
            (r.n_samples - start for r, start in zip(recordings, starts, strict=True) if start >= 0),
            default=1,
        )
        what = "n_samples='shortest'"
    else:
        n = checked_index(n_samples, "n_samples")
        what = f"n_samples={fixed(n)}"
    if n < 1:
        raise ValueError(f"{what} gives {fixed(n)} samples; at least one is wanted")
    return n


def _missing(recording: Recording, start: int, n: int) -> str:
    if start < 0:
        return f"begins {fixed(-start)} samples too late for the lead before its trigger"
    after = f" after sample {fixed(start)}" if start else ""
    return f"is too short: {fixed(recording.n_samples - start)} samples{after}, {fixed(n)} wanted"


def _way_out(recordings: Sequence[Recording], starts: Sequence[int], n: int, rate_hz: float) -> str:
    """Say how many recordings are in the way, and what would fit all."""
    room = [r.n_samples - start if start >= 0 else 0 for r, start in zip(recordings, starts, strict=True)]
    skip = "pass on_short='skip' to leave such recordings out"
    said = f"{sum(samples < n for samples in room)} of {len(room)} recordings have no room"
    if min(room) <= 0:
        return f"{said}; ask for less lead, or {skip}"
    return f"{said}, n_samples={min(room)} ({min(room) / rate_hz:g} s) fits all; ask for that, or {skip}"


def _crop(kept: Sequence[tuple[Recording, int]], n: int) -> list[Recording]:
    # one block that all results look into, so that Dataset.X needs no second copy
    block = np.empty((len(kept), n, len(common_axes([recording for recording, _ in kept]))))
    for row, (recording, start) in zip(block, kept, strict=True):
        row[:] = recording.wrench[start : start + n]
    block.flags.writeable = False
    return [_cropped(recording, start, row) for (recording, start), row in zip(kept, block, strict=True)]


def _cropped(recording: Recording, start: int, wrench: np.ndarray[Any, np.dtype[np.float64]]) -> Recording:
    n = len(wrench)
    trigger = None if recording.trigger_index is None else recording.trigger_index - start
    rate = recording.rate_hz or 1.0
    return replace(
        recording,
        wrench=wrench,
        start_time=None if recording.start_time is None else recording.start_time + start / rate,
        trigger_index=trigger if trigger is not None and 0 <= trigger < n else None,
        flags=None if recording.flags is None else recording.flags[start : start + n],
    )


D = TypeVar("D", bound="DatasetSteps")


class DatasetSteps:
    """What can be done to a :class:`Dataset`: each step gives a new one whose ``history[-1]`` reports it."""

    recordings: Sequence[Recording]
    history: Sequence[StepReport]

    def _after(self: D, recordings: Sequence[Recording], report: StepReport) -> D:
        raise NotImplementedError

    def select(
        self: D,
        labels: str | Sequence[str] | None = None,
        sessions: str | Sequence[str] | None = None,
        indices: ArrayLike | None = None,
        *,
        names: str | Sequence[str] | None = None,
        where: Callable[[Recording], bool] | None = None,
        axes: Sequence[str] | None = None,
    ) -> D:
        """Keep the recordings that meet every condition given, and of their axes those named.

        Parameters
        ----------
        labels, sessions : str or sequence of str, optional
            Labels and sessions to keep; one that does not occur is a ValueError.
        indices : array_like of int or bool, optional
            Recordings to keep, in this order (int), or a mask, shape (n,).
        names : str or sequence of str, optional
            Names of the recordings to keep; one that does not occur is a ValueError.
        where : callable, optional
            Gets a recording and says whether it is kept: ``lambda r: r.meta["speed_m_s"] < 0.05``.
        axes : sequence of str, optional
            Axes to keep, in this order.

        Returns
        -------
        Dataset

        Raises
        ------
        TypeError, ValueError, IndexError
            Indices that are none, or out of range; a label or session that does not occur; nothing left.
        """
        kept, report = select_recordings(
            self.recordings, labels, sessions, indices, names=names, where=where, axes=axes
        )
        return self._after(kept, report)

    def resample(
        self: D,
        rate_hz: float,
        method: Method = "linear",
        *,
        max_gap_s: float | None = MAX_GAP_S,
        on_gap: Literal["raise", "skip"] = "raise",
    ) -> D:
        """Bring every recording to one uniform rate.

        Recordings already at `rate_hz` stay as they are. New samples stand at k / `rate_hz` from the first
        sample to the last; none is extrapolated. Those strictly inside a gap (a step longer than twice the
        recording's median step and twice the new step) get ``SampleFlag.GAP_FILLED``; flags of the neighbours
        carry over.

        Parameters
        ----------
        rate_hz : float
            The new rate, Hz.
        method : {"linear", "polyphase"}
            ``"linear"``: straight lines between samples (as ``numpy.interp``), for any stamps; it does not
            filter, so content above half the new rate folds back. ``"polyphase"``:
            ``scipy.signal.resample_poly`` with its anti-alias filter (zero phase) and straight-line padding;
            uniform input and a rational ratio only.
        max_gap_s : float or None
            Longest gap that is interpolated over; 0.25 s by default, in which the paper's tool moves 7.5 mm,
            less than half its width. None or infinity: no limit.
        on_gap : {"raise", "skip"}
            What to do with a recording whose gap is longer: refuse, or leave it out and say so.

        Returns
        -------
        Dataset
            ``history[-1]`` counts old, new and made-up samples, and names each recording resampled or left out.

        Raises
        ------
        ValueError
            Bad settings, a gap beyond the limit (with recording and place), polyphase on irregular input.
        """
        results, report = resample_recordings(
            self.recordings, rate_hz, method=method, max_gap_s=max_gap_s, on_gap=on_gap
        )
        return self._after(results, report)

    def align(
        self: D,
        n_samples: int | Literal["shortest"] | None = None,
        *,
        duration_s: float | None = None,
        trigger: Literal["recorded"] | Sequence[int] | None = None,
        lead_s: float = 0.0,
        on_short: Literal["raise", "skip"] = "raise",
        on_missing: Literal["raise", "skip"] = "raise",
    ) -> D:
        """Crop every recording to the same number of samples.

        Parameters
        ----------
        n_samples : int or "shortest", optional
            Samples to keep, or as many as the shortest recording offers.
        duration_s : float, optional
            The same in seconds (n = round(duration_s * rate)); exactly one of the two is given.
        trigger : None, "recorded" or sequence of int
            Where to begin: at the first sample, at each recording's `trigger_index`, or at these indices,
            shape (n,).
        lead_s : float
            Seconds kept ahead of the trigger.
        on_short : {"raise", "skip"}
            What to do with a recording that is too short: refuse, or leave it out and say so. Never padded.
        on_missing : {"raise", "skip"}
            What to do, with ``trigger="recorded"``, with a recording that has no trigger: refuse (naming some),
            or leave it out and say so. :meth:`find_onsets` finds triggers, or takes yours.

        Returns
        -------
        Dataset
            ``history[-1]`` counts what was dropped, and names each recording cropped or left out.

        Raises
        ------
        ValueError
            Bad settings, no common rate (resample first), a recording too short, a missing trigger.
        """
        cropped, report = align_recordings(
            self.recordings,
            common_rate(self.recordings),
            n_samples=n_samples,
            duration_s=duration_s,
            trigger=trigger,
            lead_s=lead_s,
            on_short=on_short,
            on_missing=on_missing,
        )
        return self._after(cropped, report)

    def find_onsets(
        self: D,
        *,
        rest_s: float = REST_S,
        false_alarm_rate: float = FALSE_ALARM_RATE,
        overrule: Mapping[str, float | None] | None = None,
        replace: bool = False,
    ) -> D:
        """Set each recording's `trigger_index` to where its motion begins, found from the wrench alone.

        See :func:`granular_id.recording.onset.find_onset` for the method. ``.align(trigger="recorded",
        lead_s=0.1, n_samples=...)`` then cuts all recordings to the same lead, as the paper's are.

        Parameters
        ----------
        rest_s : float, default 0.1
            Seconds at the start of each recording that are known to be at rest; at least 5 samples.
        false_alarm_rate : float, default 0.001
            Probability, at most, that a recording without any motion gets an onset.
        overrule : mapping of str to float or None, optional
            Onsets that you know better, by name of the recording: seconds from its first sample, or None for no
            onset. They also replace a trigger that was recorded.
        replace : bool, default False
            Whether recordings that already have a `trigger_index` get a new one (or none, where none is found).

        Returns
        -------
        Dataset
            ``history[-1]`` says for each recording how its onset came about, or why there is none.

        Raises
        ------
        TypeError, ValueError
            Bad settings, a name that no recording or more than one has, a time outside the recording, and
            irregular recordings, which must be resampled (or overruled) first.
        """
        results, report = find_all_onsets(
            self.recordings,
            rest_s=rest_s,
            false_alarm_rate=false_alarm_rate,
            overrule=overrule,
            replace_recorded=replace,
        )
        return self._after(results, report)
