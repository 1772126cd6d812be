"""``Recording``: one push through a material, as the sensor saw it; its axes, and what several have in common."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntFlag
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import (
    FloatArray,
    argument_error,
    as_floats,
    checked_text,
    finite_number,
    frozen_mapping,
    locked,
    thaw,
    whole_number,
)
from granular_id._core import AXES, SAMPLE_FLAGS, UNITS, GranularIdError
from granular_id._text import counted, fixed, verb
from granular_id.recording.columns import column_names

_Value = TypeVar("_Value")

_WRENCH = "a real array of shape (T, C), T >= 1, as a rule with the axes fx fy fz (N) tx ty tz (N m)"
_TIME = "a real array of shape (T,): seconds from the first sample, strictly increasing, time_s[0] == 0"


class SampleFlag(IntFlag):
    """What can be wrong with a sample: bits of one element of ``Recording.flags`` (uint8); a sample may carry several.

    Examples
    --------
    >>> from granular_id import SampleFlag
    >>> SampleFlag.GAP_FILLED | SampleFlag.SATURATED == 3
    True
    """

    GAP_FILLED = SAMPLE_FLAGS["GAP_FILLED"]
    """Interpolated inside a gap of the source: no measurement was taken near this instant."""
    SATURATED = SAMPLE_FLAGS["SATURATED"]
    """At least one axis was at the end of the sensor's range."""
    BAD_STATUS = SAMPLE_FLAGS["BAD_STATUS"]
    """The sensor reported an error with this sample."""
    TIME_REPAIRED = SAMPLE_FLAGS["TIME_REPAIRED"]
    """The sample's time stamp ran backwards or was repeated, and the sample was sorted or merged."""


KNOWN_FLAGS = sum(SAMPLE_FLAGS.values())
"""All defined bits together; any other bit in ``Recording.flags`` is refused."""


@dataclass(frozen=True, eq=False)
class Recording:
    """One recording: validated once, then never changed.

    Exactly one of `rate_hz` and `time_s` is given: a recording is either uniform at a known rate, or carries
    the stamps of its samples and must be resampled before anything that needs a rate.

    Parameters
    ----------
    wrench : array_like, shape (T, C)
        Samples; as a rule C = 6, axes fx fy fz in N and tx ty tz in N m. Copied unless it is read-only float64. Tables
        with named columns are read by :meth:`Dataset.from_frames`.
    rate_hz : float or None
        Sampling rate of a uniform recording, Hz.
    label : str or None
        Name of the material; None where it is unknown.
    session : str or None
        What was recorded in one go (same set-up, same filling). None: not known, nothing is guessed.
    start_time : float or None
        Time of the first sample, seconds since 1970-01-01 UTC.
    trigger_index : int or None
        Sample at which the motion (or whatever was waited for) began.
    time_s : array_like, shape (T,), or None
        Seconds from the first sample, strictly increasing; None for uniform recordings.
    meta : mapping
        Sensor, calibration, filter, frame, sign, tool, speed, fill height ...: any JSON-like tree. ``"units"`` holds
        the unit of each axis by its name, or a list of one an axis.
    flags : array_like of uint8, shape (T,), or None
        Bits of :class:`SampleFlag` per sample; None when no sample has any.
    name : str
        How reports call this recording, for example the file it came from.
    axes : sequence of str
        Names of the C columns of `wrench`; fx fy fz tx ty tz where there are six and nothing is stated.

    Raises
    ------
    TypeError, ValueError
        Naming the argument, what came and what is wanted (the first NaN or infinity by its index).

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id import Recording
    >>> Recording(np.zeros((1600, 6)), rate_hz=500, label="rice", name="rice_01")
    Recording('rice_01', label='rice', 1600 samples at 500 Hz)
    """

    wrench: FloatArray
    rate_hz: float | None = None
    label: str | None = None
    session: str | None = None
    start_time: float | None = None
    trigger_index: int | None = None
    time_s: FloatArray | None = None
    meta: Mapping[str, Any] = field(default_factory=dict)
    flags: NDArray[np.uint8] | None = None
    name: str = ""
    axes: tuple[str, ...] = ()

    __hash__ = None  # type: ignore[assignment]  # equality looks at the samples: hashing them would be a trap

    def __post_init__(self) -> None:
        wrench, axes = _checked_wrench(self.wrench, self.axes)
        checked: dict[str, object] = {"wrench": wrench, "axes": axes}
        n_samples = len(wrench)
        if (self.rate_hz is None) == (self.time_s is None):
            came = "neither" if self.rate_hz is None else "both"
            raise GranularIdError(f"give exactly one of rate_hz (uniform) and time_s (irregular), got {came}")
        if self.rate_hz is not None:
            checked["rate_hz"] = rate = finite_number("rate_hz", self.rate_hz, positive=True)
            if not np.isfinite(n_samples / rate):
                problem = f"={self.rate_hz} makes {n_samples} samples last for ever"
                raise argument_error(GranularIdError, "rate_hz", problem)
        if self.time_s is not None:
            checked["time_s"] = _checked_time(self.time_s, n_samples)
        for name in ("label", "session"):
            if getattr(self, name) is not None:
                checked[name] = checked_text(getattr(self, name), name, spaced=False)
        checked["name"] = checked_text(self.name, "name", empty=True)
        if self.start_time is not None:
            checked["start_time"] = finite_number("start_time", self.start_time)
        if self.trigger_index is not None:
            checked["trigger_index"] = index = whole_number("trigger_index", self.trigger_index, least=0)
            if index >= n_samples:
                raise GranularIdError(f"trigger_index={fixed(index)} is outside the {n_samples} samples")
        checked["meta"] = frozen_mapping("meta", with_named_units(self.meta, axes))
        if self.flags is not None:
            checked["flags"] = _checked_flags(self.flags, n_samples)
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @property
    def n_samples(self) -> int:
        """Number of samples T."""
        return len(self.wrench)

    @property
    def is_synthetic(self) -> bool:
        """Whether it was simulated rather than measured: ``meta["synthetic"]`` says so."""
        return bool(self.meta.get("synthetic", False))

    @property
    def duration_s(self) -> float:
        """Seconds from the first to the last sample."""
        return float(self.times()[-1])

    def times(self) -> FloatArray:
        """Return seconds from the first sample, shape (T,), whether uniform or not."""
        if self.time_s is not None:
            return self.time_s
        return np.arange(self.n_samples) / finite_number("rate_hz", self.rate_hz, positive=True)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Recording):
            return NotImplemented
        plain = ("rate_hz", "label", "session", "start_time", "trigger_index", "name", "meta", "axes")
        return all(getattr(self, n) == getattr(other, n) for n in plain) and all(
            np.array_equal(getattr(self, n), getattr(other, n)) for n in ("wrench", "time_s", "flags")
        )

    def __repr__(self) -> str:
        if self.rate_hz is not None:
            rate = f"at {self.rate_hz:g} Hz"
        elif self.n_samples > 1:
            rate = f"irregular, {(self.n_samples - 1) / self.duration_s:.3g} Hz on average"
        else:
            rate = "irregular"
        axes = "" if self.axes == AXES else f", axes {' '.join(self.axes)}"
        return f"Recording({self.name!r}, label={self.label!r}, {self.n_samples} samples {rate}{axes})"

    def __reduce__(self) -> tuple[Any, ...]:
        # unpickled arrays are writable and read-only mappings do not pickle: go through the checks again
        fields = (thaw(self.meta) if n == "meta" else getattr(self, n) for n in self.__dataclass_fields__)
        return (Recording, tuple(fields))


def _checked_wrench(value: object, names: object) -> tuple[FloatArray, tuple[str, ...]]:
    if column_names(value) is not None:
        came = f"wrench is a {type(value).__name__} with named columns"
        raise TypeError(f"{came}; wanted {_WRENCH}: call Dataset.from_frames, which reads tables")
    array = as_floats(value, "wrench", _WRENCH)
    if array.ndim != 2 or not array.size:
        raise GranularIdError(f"wrench has shape {array.shape}; wanted {_WRENCH}")
    axes = checked_axes(names, array.shape)
    if not np.isfinite(array).all():
        row, column = (int(i) for i in np.argwhere(~np.isfinite(array))[0])
        came = f"wrench[{row}, {column}] ({axes[column]}) is {array[row, column]}"
        raise GranularIdError(f"{came}; samples must be finite")
    return locked(array), axes


def with_named_units(meta: Mapping[str, Any], axes: tuple[str, ...]) -> Mapping[str, Any]:
    """Give the units that stand in a row to the axes; what is no row of texts, one an axis, stays as it is."""
    units = meta.get("units") if isinstance(meta, Mapping) else None
    if not isinstance(units, Sequence) or isinstance(units, str) or len(units) != len(axes):
        return meta
    return {**meta, "units": dict(zip(axes, units, strict=True))}


def _checked_time(value: object, n_samples: int) -> FloatArray:
    array = as_floats(value, "time_s", _TIME)
    if array.shape != (n_samples,):
        problem = f"has shape {array.shape}, but wrench has {n_samples} samples; wanted {_TIME}"
        raise argument_error(GranularIdError, "time_s", problem)
    if array[0] != 0:
        raise argument_error(GranularIdError, "time_s", f"[0] is {array[0]:g}; wanted {_TIME}")
    wrong = np.flatnonzero(~(np.isfinite(array[1:]) & (array[1:] > array[:-1])))
    if len(wrong):
        i = int(wrong[0])
        came = f"[{i + 1}] is {array[i + 1]:.17g}, behind {array[i]:.17g}"
        raise argument_error(GranularIdError, "time_s", f"{came}; stamps must be finite and increase")
    return locked(array + 0.0)  # -0.0 would not compare equal bit for bit after a round trip through text


def _checked_flags(value: object, n_samples: int) -> NDArray[np.uint8] | None:
    array = np.asarray(value)
    if array.dtype.kind not in "iu":
        raise TypeError(f"flags has dtype {array.dtype}; wanted integers of shape ({n_samples},)")
    if array.shape != (n_samples,):
        raise GranularIdError(f"flags has shape {array.shape}; wanted ({n_samples},)")
    unknown = array[(array.astype(np.int64) & ~KNOWN_FLAGS) != 0]
    if len(unknown):
        raise GranularIdError(f"flags holds {unknown[0]}; wanted bits of SampleFlag (0 to {KNOWN_FLAGS})")
    return locked(np.ascontiguousarray(array, dtype=np.uint8)) if array.any() else None


# Names and units of the columns of a recording.

KNOWN_UNITS = dict(zip(AXES, UNITS, strict=True))

AXIS_COLOURS = ("#0072B2", "#009E73", "#D55E00", "#56B4E9", "#CC79A7", "#E69F00")
"""Okabe & Ito's colours, distinct with any colour vision; one per axis, in the order of `AXES`."""


def checked_axes(names: object, shape: tuple[int, ...]) -> tuple[str, ...]:
    """Return one name per column of samples of this shape: those given, or fx fy fz tx ty tz for six."""
    if names is None or (isinstance(names, tuple) and not names):
        if shape[1] != len(AXES):
            raise GranularIdError(
                f"wrench has shape {shape}; six columns are {' '.join(AXES)}, for any other number give axes="
            )
        return AXES
    if isinstance(names, str) or not isinstance(names, Sequence):
        raise TypeError(f"axes must be a sequence of names, got {type(names).__name__}")
    axes = tuple(checked_text(name, f"axes[{i}]", spaced=False) for i, name in enumerate(names))
    if len(axes) != shape[1]:
        raise GranularIdError(f"axes has {len(axes)} names, but wrench has {shape[1]} columns")
    if len(set(axes)) < len(axes):
        raise GranularIdError(f"axes {axes!r} names an axis twice")
    return axes


def unit_of(axis: str, meta: Mapping[str, object] | None = None) -> str:
    """Return the unit of an axis: what ``meta["units"]`` says, else N or N m for the six of a wrench, else "".

    Examples
    --------
    >>> from granular_id.recording import unit_of
    >>> unit_of("tz"), unit_of("depth", {"units": {"depth": "mm"}}), unit_of("load")
    ('N m', 'mm', '')
    """
    units = (meta or {}).get("units")
    stated = units.get(axis) if isinstance(units, Mapping) else None
    return stated if isinstance(stated, str) else KNOWN_UNITS.get(axis, "")


def single_values(meta: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the texts and numbers of metadata by their path, such as "rig.speed_m_s"."""
    for key, value in meta.items():
        if isinstance(value, Mapping):
            yield from single_values(value, f"{path}{key}.")
        elif isinstance(value, str | int | float):
            yield f"{path}{key}", value


# What recordings have in common.


def places_of(values: Iterable[_Value]) -> dict[_Value, list[int]]:
    """Return the places at which each value stands, values in order of first appearance."""
    places: dict[_Value, list[int]] = {}
    for i, value in enumerate(values):
        places.setdefault(value, []).append(i)
    return places


def common_axes(recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Return the axes that all recordings share, or raise ValueError naming the method that helps."""
    first = recordings[0]
    other = next((r for r in recordings if r.axes != first.axes), None)
    if other is not None:
        raise GranularIdError(
            f"recordings differ in their axes: {first.name!r} has {' '.join(first.axes)}, {other.name!r} has "
            f"{' '.join(other.axes)}; call .select(axes=...) to keep those that all have"
        )
    return first.axes


def irregular_among(recordings: Sequence[Recording]) -> str:
    """Say how many recordings are irregularly sampled, for an error; "" where none is."""
    irregular = [r.name for r in recordings if r.rate_hz is None]
    if not irregular:
        return ""
    return (
        f"{len(irregular)} of {counted(len(recordings))} {verb(len(irregular), 'is', 'are')} irregularly sampled "
        f"(the first is {irregular[0]!r})"
    )


def common_rate(recordings: Sequence[Recording]) -> float:
    """Return the rate that all recordings share, Hz, or raise ValueError naming the method that makes one."""
    irregular = irregular_among(recordings)
    if irregular:
        raise GranularIdError(f"{irregular}; call .resample(rate_hz) first, nothing is resampled silently")
    rates = sorted({r.rate_hz for r in recordings if r.rate_hz is not None})
    if len(rates) > 1:
        raise GranularIdError(
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
        raise GranularIdError(
            f"recordings differ in length ({min(lengths)} to {max(lengths)} samples); call "
            ".align(n_samples=...) or .align(duration_s=...) first, nothing is cropped silently"
        )
    parts = [r.wrench for r in recordings]
    block = shared_base(parts)
    if block is None:
        block = np.stack(parts)
        block.flags.writeable = False
    shape = (len(parts), *parts[0].shape)
    return block if block.shape == shape else block.reshape(shape)


def shared_base(parts: Sequence[FloatArray]) -> FloatArray | None:
    """Return the array that the parts fill, one after the other and without a rest, if there is one."""
    base = parts[0].base
    if not isinstance(base, np.ndarray) or base.nbytes != sum(part.nbytes for part in parts):
        return None
    # of another type where the parts view its bytes as numbers
    if base.dtype != parts[0].dtype or not base.flags.c_contiguous:
        return None
    address = base.ctypes.data
    for part in parts:
        if part.base is not base or not part.flags.c_contiguous or part.ctypes.data != address:
            return None
        address += part.nbytes
    return base
