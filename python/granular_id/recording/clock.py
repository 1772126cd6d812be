"""Clocks: what stamps of samples mean, and the rate that they have."""

from __future__ import annotations

import math
import re
import warnings
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray, argument_error, finite_number
from granular_id._core import GranularIdError
from granular_id._text import RATE, Unknown, alternatives, in_both, install
from granular_id.recording.columns import NUMERIC_ROWS, TAKEN, TableError, factor

SINCE_1970 = 1e8
"""Stamps above this (1973) are seconds since 1970; below, a clock of the recording's own."""

NOT_SECONDS = 1e11
"""Stamps above this (the year 5138) count milliseconds or less since 1970."""

MAX_GAP_S = 0.25
"""Default of ``max_gap_s``: at the paper's 0.03 m/s the tool moves 7.5 mm in it, less than half its width."""

UNIFORM_TOLERANCE = 0.01
"""Stamps within this part of a step of an even grid count as uniform: finer than clocks jitter."""

ROUND_TOLERANCE = 1e-3
"""A rate that is nearer than this part to a round figure is that figure: clocks of computers drift apart."""

STATED_TOLERANCE = 0.5
"""A rate the user states holds while every stamp is nearer to its own place than to its neighbours'."""

_RATE_TOLERANCE = 0.01
"""A rate that a file states and its stamps may differ by this part."""

_LONGEST_STEP_S, _SHORTEST_STEP_S = 0.1, 1e-5
"""Forces are sampled faster than ten times a second, and slower than at 100 kHz, unless somebody says otherwise."""

_MOST_LATE = 0.1
"""If more samples than this part are late, a clock that ran back to its begin was started again."""

_BURST, _MOST_CLOSE = 0.1, 0.5
"""Stamps that follow each other within this part of the mean step came in packets, if more than this part does so."""

_DAYS = ".assign(**{{{clock!r}: lambda f: f[{clock!r}] * 86400}})"

_TICKS = 621_355_968_000_000_000
"""Ticks of .NET, of 100 ns, from the year 1 to 1970."""

_FROM_TICKS = f".assign(**{{{{{{clock!r}}: lambda f: (f[{{clock!r}}] - {_TICKS}) / 1e7}}}})"

SEVERAL = "several recordings must be distinguished: a file each, or a column that does (id=, --id)"

STATE_RATE = in_both(rate_hz=RATE)
_IGNORED_OUT = ("; state the rate, and the clock is ignored: pass ", STATE_RATE, ", the one in Hz")

_CLOCK_TEXT = re.compile(r"(-?\d+ days )?[+-]?\d{1,3}:\d{2}:\d{2}(\.\d+)?")
_MINUTES_TEXT = re.compile(r"\d{1,3}:\d{2}\.\d+")
_FRACTION = re.compile(r"(?:(?<=:\d\d),|(?<=\d:\d\d:\d\d):)(?=\d)")
"""What stands before a fraction of a second where no dot does: a comma, which pandas would drop, or a colon."""


@dataclass(frozen=True)
class Stamps:
    """Stamps of the samples of a recording, in seconds from the first."""

    time_s: FloatArray
    first_s: float  # what the first one is by its own clock
    resolution_s: float  # by which rounding may have moved each


def stamps_of(values: NDArray[Any], unit: str | None, stated: str | None, rate_hz: float | None) -> Stamps:
    """Turn numbers, dates, times or texts of these into seconds: they count `unit`, by the file, or `stated`."""
    if values.dtype.kind in "OUT":
        values = _from_text(values)
    kind = values.dtype.kind
    if kind in "mM":
        if np.isnat(values).any():
            raise TableError(("the stamp is empty", *_IGNORED_OUT), int(np.isnat(values).argmax()))
        ns = values.astype(f"{kind}8[ns]").astype(np.int64)
        return Stamps((ns - ns[0]) / 1e9, int(ns[0]) / 10**9, 0.0)  # of integers, rounded once
    if kind not in "iuf":
        raise TableError(f"the clock holds {values.dtype}; wanted seconds as numbers, or dates and times")
    bad = np.flatnonzero(~np.isfinite(values))
    if len(bad):
        few = len(bad) <= _MOST_LATE * len(values)  # rows that are no samples, as a mean below them
        problem = f"the stamp is {values[bad[0]]}" + "; rows without one may be no samples" * few
        raise TableError((problem, *_IGNORED_OUT), int(bad[0]), mend=NUMERIC_ROWS * few)
    scale = 1.0 if unit is None and stated is None else _per_second(unit, stated, rate_hz)
    if kind in "iu" and scale != 1:
        ticks = values.astype(np.int64)
        return Stamps((ticks - ticks[0]) / scale, float(ticks[0]) / scale, 0.0)
    stamps = np.asarray(values, np.float64)
    stamps = stamps if scale == 1 else stamps / scale
    if _TICKS <= stamps[0] < 1.1 * _TICKS and unit is None and stated is None:
        raise TableError(
            f"the stamp {stamps[0]:.6g} counts ticks of 100 ns since the year 1", mend=_FROM_TICKS
        )
    if abs(stamps[0]) > NOT_SECONDS:
        step = float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.0
        problem = f"the stamp {stamps[0]:.6g} cannot be seconds since 1970; pass "
        raise TableError((problem, *_other_units(step)), 0)
    time_s = stamps - stamps[0]
    if not np.abs(time_s).max() < np.inf:
        raise TableError(f"the stamps span {time_s[-1]:g} s", len(stamps) - 1)
    return Stamps(time_s, float(stamps[0]), float(np.spacing(np.abs(stamps).max())))


def _per_second(unit: str | None, stated: str | None, rate_hz: float | None) -> float:
    """Return how many of what is counted make a second."""
    if stated == "sample":
        if unit is not None or rate_hz is None:
            came = "no rate is stated" if rate_hz is None else f"the file says that its stamps are in {unit}"
            raise TableError(f"time_unit='sample', but {came}")
        return rate_hz
    scales = [None if one is None else factor(one, "s") for one in (unit, stated)]
    if unit is not None and scales[0] is None:
        raise TableError(f"stamps are in {unit!r:.40}; wanted {TAKEN['s']}")
    if None not in scales and scales[0] != scales[1]:
        raise TableError(f"time_unit={stated!r}, but the file says that its stamps are in {unit}")
    return float(round(1 / next(scale for scale in scales if scale is not None)))


def _from_text(values: NDArray[Any]) -> NDArray[Any]:
    """Read dates and times, or times of a day, as pandas does; those without a zone count as UTC."""
    try:
        pandas = import_module("pandas")
    except ImportError as error:
        raise ImportError(f"pandas is needed to read dates: {install('app')}") from error
    series = pandas.Series(values)
    empty = series.isna()
    if empty.any():
        raise TableError(("the stamp is empty", *_IGNORED_OUT), int(empty.to_numpy().argmax()))
    texts = series.astype(str).str.strip().str.replace(_FRACTION, ".", regex=True)
    numbers = pandas.to_numeric(texts, errors="coerce")
    if not numbers.isna().any():  # rows that are no samples made text of them
        return np.asarray(numbers)
    of_an_hour = texts.str.fullmatch(_MINUTES_TEXT).all()
    texts = "00:" + texts if of_an_hour else texts
    if texts.str.fullmatch(_CLOCK_TEXT).all():  # one that begins anew, at midnight, goes on
        clock, hours = pandas.to_timedelta(texts).to_numpy(), 1 if of_an_hour else 24
        n_times = np.concatenate([[0], np.cumsum(np.diff(clock) < np.timedelta64(-hours * 30, "m"))])
        return np.asarray(clock + n_times * np.timedelta64(hours, "h"))
    ways: list[dict[str, Any]] = [{"format": "ISO8601"}, {}, {"dayfirst": True}]
    readings = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # where no one format is found, each text is read for itself
        for how in ways:
            try:
                found = pandas.to_datetime(texts, utc=True, **how)
            except (ValueError, TypeError, OverflowError):
                continue
            readings.append(np.asarray(found.dt.tz_localize(None).to_numpy()))
            if "format" in how:
                break
    if readings:  # 04.03. and 05.03. are a day apart, not a month: the shortest reading
        return min(readings, key=lambda dates: np.abs(np.diff(dates)).sum())
    no_number = numbers.isna().to_numpy()
    first = int(no_number.argmax())
    way_out: tuple[str, ...] = ()
    mend = ""
    if first == 0:  # a later row may be no sample
        way_out = _IGNORED_OUT
    elif no_number[first:].all():
        below = in_both(csv={"skipfooter": len(values) - first})
        way_out = ("; what stands below the samples is left out: pass ", below)
    elif no_number.mean() < _MOST_LATE:
        mend = NUMERIC_ROWS
    problem = f"the stamp {str(values[first])[:40]!r} is no number and no date"
    raise TableError((problem, *way_out), first, mend=mend)


def has_date(values: NDArray[Any]) -> bool:
    """Return True if stamps say in which year they were taken: numpy's dates, or texts that begin with one."""
    if values.dtype.kind == "M":
        return True
    return values.dtype.kind in "OUT" and bool(re.match(r"\s*\d{4}-\d{2}-\d{2}", str(values[0])))


@dataclass(frozen=True)
class Order:
    """Rows of samples that stay: which, those that were moved, and how many were merged into others."""

    rows: NDArray[np.intp]
    touched: NDArray[np.bool_]
    n_moved: int = 0
    n_merged: int = 0


def time_order(time_s: FloatArray, wrench: FloatArray, *, rate_stated: bool, repair: bool) -> Order:
    """Sort samples, or refuse stamps that run back; merge rows that are there twice, refuse packets without a rate."""
    rows = np.arange(len(time_s))
    touched = np.zeros(len(rows), bool)
    late = time_s < np.maximum.accumulate(time_s)
    if late.any():
        if not repair:
            first = int(late.argmax())
            before, after = time_s[first - 1 : first + 1]
            parts: list[str] = [f"time runs back from {before:.9g} to {after:.9g} s after the first sample"]
            restarts = bool(after <= 0)
            if not restarts or late.sum() <= 2 + _MOST_LATE * len(late):
                parts += ["; to sort samples pass ", in_both(on_time_error="repair")]
            raise TableError([*parts, "; ", SEVERAL] if restarts else parts, first)
        rows = np.argsort(time_s, kind="stable")
        touched = late[rows]
    n_moved = int(touched.sum())
    if rate_stated:
        return Order(rows, touched, n_moved)
    stamps, values = time_s[rows], wrench[rows]
    again = np.concatenate([[False], (stamps[1:] == stamps[:-1]) & (values[1:] == values[:-1]).all(axis=1)])
    touched |= np.concatenate([again[1:], [False]])  # what it is merged into
    rows, touched, stamps = rows[~again], touched[~again], stamps[~again]
    repeated = np.flatnonzero(stamps[1:] == stamps[:-1])
    if len(repeated):
        most = int(np.unique(stamps, return_counts=True)[1].max())
        mean = f" (by the stamps {(len(stamps) - 1) / float(stamps[-1]):.4g} Hz)" if stamps[-1] > 0 else ""
        raise TableError(
            (
                f"up to {most} different rows have one stamp: readings came in packets, and are not averaged; state "
                f"the rate in Hz at which they were taken{mean}, and the clock is ignored: pass ",
                STATE_RATE,
            ),
            int(rows[repeated[0] + 1]),
        )
    return Order(rows, touched, n_moved, int(again.sum()))


def uniform_rate(time_s: FloatArray, resolution_s: float = 0.0) -> float | None:
    """Find the rate of evenly spaced stamps, each off by `resolution_s` at most: the shortest number that fits all.

    Where a round figure is near, it is meant: one of at most two digits, or of 125, 375, 625, 875.
    """
    if len(time_s) < 2:
        return None
    mean = (len(time_s) - 1) / float(time_s[-1])
    if largest_offset(time_s, mean) > 2 * (UNIFORM_TOLERANCE / mean + resolution_s) * (1 + 1e-6):
        return None  # the mean rate fits at least half as well as the best one: no rate will do
    for digits in range(1, 18):
        rate = float(f"{mean:.{digits}g}")
        if largest_offset(time_s, rate) <= UNIFORM_TOLERANCE / rate + resolution_s:
            power = 10.0 ** (math.floor(math.log10(rate)) - 1)
            for step in (power, 1.25 * power):
                near = float(f"{round(rate / step) * step:.6g}")
                is_round = step == power or near / power in (12.5, 37.5, 62.5, 87.5)
                if is_round and abs(rate / near - 1) <= ROUND_TOLERANCE:
                    return near
            return rate
    return None


def largest_offset(time_s: FloatArray, rate_hz: float) -> float:
    """Seconds between the stamps and the places an even grid would give them, at worst."""
    return float(np.abs(time_s - np.arange(len(time_s)) / rate_hz).max())


def samples_in(name: str, seconds: object, rate_hz: float) -> int:
    """Return how many samples so many seconds hold, at least one; `name` is what errors call them."""
    known = finite_number(name, seconds, positive=True)
    n = round(finite_number(f"{name} times the rate", known * rate_hz))
    if n < 1:
        raise argument_error(GranularIdError, name, f"={known:g} at {rate_hz:g} Hz is less than one sample")
    return n


def rate_of(
    stamps: Stamps, stated_hz: float | None, file_hz: float | None, *, doubtful: bool = False
) -> tuple[float | None, str | None]:
    """Return the rate of a recording, or None where its stamps must stay; and what there is to remark.

    What a user states wins over packets, and is refused where stamps have pauses or another rate; what the file states
    must be confirmed by them. `doubtful`: nobody says what the stamps count.
    """
    time_s = stamps.time_s
    if len(time_s) < 2:
        return (stated_hz or file_hz), None
    with np.errstate(over="ignore", divide="ignore"):
        steps = np.diff(time_s)
        median, mean = float(np.median(steps)), float(steps.mean())  # neither pauses nor bursts count
        measured_hz = [1 / step if step > 0 else np.inf for step in (mean, median)]
    step = median if median >= _LONGEST_STEP_S else mean if mean <= _SHORTEST_STEP_S else None
    if doubtful and step is not None:
        guess = "milliseconds, microseconds, nanoseconds or an index" if step > 1e-3 else "minutes or days"
        came = f"stamps lie {step:g} apart: that would be {1 / step:.3g} Hz"
        if 3e4 < stamps.first_s < 6e4 and step < 1e-3:  # of Excel, 1982 to 2064
            raise TableError(f"{came}; most likely they count days", mend=_DAYS)
        raise TableError((f"{came}; most likely they count {guess}: pass ", *_other_units(step)))
    if (
        file_hz is not None
        and time_s[-1] > 0
        and not np.isclose(measured_hz, file_hz, _RATE_TOLERANCE, 0).any()
    ):
        problem = f"the file states {file_hz:g} Hz, but its stamps {measured_hz[0]:.6g} Hz"
        units = _other_units(median, file_hz)
        raise TableError((f"{problem}; save the one that is true, or if stamps are no seconds pass ", *units))
    known_hz = file_hz if stated_hz is None else stated_hz
    if known_hz is not None and largest_offset(time_s, known_hz) <= STATED_TOLERANCE / known_hz:
        return known_hz, None
    if stated_hz is not None:
        return stated_hz, _ignored_clock(time_s, steps, stated_hz)
    if file_hz is None and _are_bursts(steps):
        packets = f"most stamps follow within {_BURST:g} of the mean step: readings came in packets; state the rate in "
        raise TableError((f"{packets}Hz at which they were taken: pass ", STATE_RATE))
    rate_hz = uniform_rate(time_s, resolution_s=stamps.resolution_s)
    if rate_hz is not None or (digit_s := _last_digit(time_s)) is None:
        return rate_hz, None
    rate_hz = uniform_rate(time_s, resolution_s=digit_s)
    rounded = (
        f"stamps, rounded to {1000 * digit_s:g} ms, are those of an even {rate_hz:g} Hz" if rate_hz else None
    )
    return rate_hz, rounded


def _are_bursts(steps: FloatArray) -> bool:
    """Whether most rows follow the one before at once, and the others after a while that is no pause."""
    near = steps[steps <= MAX_GAP_S]
    return len(near) > 1 and bool(np.mean(near < _BURST * near.mean()) > _MOST_CLOSE)


def _last_digit(time_s: FloatArray) -> float | None:
    """Return what the last digit of stamps counts where it is coarse: 1 ms, or a tenth or hundredth of it."""
    with np.errstate(over="ignore", invalid="ignore"):
        for digit_s in (1e-3, 1e-4, 1e-5):
            digits = time_s / digit_s
            if np.abs(digits - np.rint(digits)).max() < UNIFORM_TOLERANCE:
                return digit_s
    return None


def _other_units(step: float, rate_hz: float | None = None) -> list[str]:
    """Return the units in which steps of stamps may be counted: those of the rate, or of one that sensors have."""
    low, high = (_SHORTEST_STEP_S, _LONGEST_STEP_S) if rate_hz is None else (0.9 / rate_hz, 1.1 / rate_hz)
    units = [
        unit for unit, second in (("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)) if low < step * second < high
    ]
    ways = [in_both(time_unit=unit) for unit in units or [Unknown("UNIT")]]
    if step == 1:
        ways.append(in_both(time_unit="sample", rate_hz=RATE if rate_hz is None else rate_hz))
    return alternatives(ways)


def _ignored_clock(time_s: FloatArray, steps: FloatArray, rate_hz: float) -> str:
    """Say that a stated rate wins; refuse it where stamps have pauses, or another rate even allowing for packets."""
    steps, stated = steps[steps > 0], f"{rate_hz:g} Hz is stated"
    if not len(steps):
        return f"the clock was ignored: {stated}"
    mean, longest = f"{(len(time_s) - 1) / float(time_s[-1]):.4g} Hz", float(steps.max())
    if longest > max(MAX_GAP_S, 2 * float(np.median(steps))):
        raise TableError(
            f"{stated}, but the stamps have a pause of {longest:.3g} s, which that rate would close; leave the rate "
            f"out, and call .split(gap_s={min(1.0, longest / 2):.2g}) before to make a recording of each stretch"
        )
    if largest_offset(time_s, rate_hz) > 2 * longest + 0.02 * float(time_s[-1]) + STATED_TOLERANCE / rate_hz:
        problem = f"{stated}, but the stamps say {mean}; leave the rate out to use the stamps, then call "
        units = _other_units(float(np.median(steps)), rate_hz)
        raise TableError((f"{problem}.resample(rate_hz), or if they are no seconds pass ", *units))
    return f"the clock was ignored: {stated}, by the stamps {mean} on average"


def unpacked(time_s: FloatArray, rate_hz: float) -> FloatArray | None:
    """Return stamps at a stated rate within each stretch of packets between pauses; None where there are none."""
    steps = np.diff(time_s)
    if not ((steps == 0).any() or _are_bursts(steps)) or not (steps > 0).any():
        return None
    pauses = np.flatnonzero(steps > max(MAX_GAP_S, 2 * float(np.median(steps[steps > 0])))) + 1
    if not len(pauses):
        return None
    starts = np.concatenate([[0], pauses])
    lengths = np.diff([*starts, len(time_s)])
    counts = np.arange(len(time_s)) - np.repeat(starts, lengths)
    found = np.asarray(np.repeat(time_s[starts], lengths) + counts / rate_hz)
    return found if (np.diff(found) > 0).all() else None
