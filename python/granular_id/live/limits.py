"""What a push must be like to be recorded, and how large force and torque may become."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import argument_error, checked_flag, finite_number, positive_number, whole_number
from granular_id._core import Block, GranularIdError
from granular_id._text import fixed
from granular_id.live.rows import Rows
from granular_id.live.source import SourceInfo
from granular_id.recording import AXES

__all__ = ["Limits"]

_PARTS = (
    ("max_force_n", "force", "N", slice(0, 3)),
    ("max_torque_n_m", "torque", "N m", slice(3, 6)),
)


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What a push must be like.

    `Recorder`, `LiveIdentifier` and `granular_id.identify` take each of these by name.

    Parameters
    ----------
    max_gap : int, default 0
        So many missing samples in a row are filled with a straight line and flagged; more is a failure.
    allow_saturated : bool, default False
        Take rows at the end of the sensor's range, flagged, instead of failing; not where there is a limit of force or
        torque, which nobody can see there.
    rate_tolerance : float, default 0.001
        How far the measured rate may be off, relative: HFMH moves with it. So far may the clocks of sensor and host be
        off, too, where a robot tells its motion by the host's.
    max_lag_s : float, default 0.02
        Lag that is no cause for alarm. Rows of a sensor with its own clock that come in later are good nevertheless,
        and the recording's ``meta["late_s"]`` tells how late at most. Without such a clock nobody knows when they were
        measured, and a lag that lasts fails the push.
    timeout_s : float, default 30
        How long to wait for the motion, counted in rows.
    max_force_n, max_torque_n_m : float, optional
        Limits of the lengths of (fx, fy, fz) and (tx, ty, tz). A row beyond one stops the robot, whether it pushes,
        brakes or moves back, and nothing moves it any more. They are limits of the change from the rest before the
        push, so that the weight of a tool and the zero of the sensor do not count. Default: none, as what a tool bears
        nobody knows but you. At most the smallest range of these axes: what is more cannot be seen.
    absolute : bool, default False
        Hold what the sensor tells against the limits, with its zero and the weight of the tool, not the change.

    Raises
    ------
    TypeError, ValueError
        Naming the argument.

    Examples
    --------
    >>> from granular_id.live import Limits
    >>> Limits(max_force_n=40.0).watched
    True
    """

    max_gap: int = 0
    allow_saturated: bool = False
    rate_tolerance: float = 1e-3
    max_lag_s: float = 0.02
    timeout_s: float = 30.0
    max_force_n: float | None = None
    max_torque_n_m: float | None = None
    absolute: bool = False

    def __post_init__(self) -> None:
        whole_number("max_gap", self.max_gap, least=0)
        checked_flag("allow_saturated", self.allow_saturated)
        checked_flag("absolute", self.absolute)
        for name in ("rate_tolerance", "max_lag_s", "timeout_s"):
            finite_number(name, getattr(self, name), least=0)
        for name, *_ in _PARTS:
            if getattr(self, name) is not None:
                positive_number(name, getattr(self, name))

    @property
    def watched(self) -> bool:
        """Whether there is a limit of force or torque."""
        return self.max_force_n is not None or self.max_torque_n_m is not None

    def check_source(self, info: SourceInfo) -> None:
        """Refuse a limit that the source cannot tell, because it lacks the axes or their range ends before."""
        for argument, _, unit, columns in _PARTS:
            limit, axes = getattr(self, argument), AXES[columns]
            if limit is None:
                continue
            if info.axes[columns] != axes:
                problem = f"needs {' '.join(axes)}; {info.name} has {' '.join(info.axes)}: leave it out"
                raise argument_error(GranularIdError, argument, problem)
            ends = info.full_scale[columns] if info.full_scale else (float("inf"),)
            if limit > min(ends):
                end = f"the sensor's {axes[ends.index(min(ends))]} ends at {min(ends):g}: give at most that"
                raise argument_error(GranularIdError, argument, f"is {limit:g} {unit}, but {end}")

    def beyond(self, rows: Block | Rows, rest: NDArray[np.float64]) -> str:
        """Return which is the first of these rows beyond a limit, and by how much; empty where none is."""
        first, text = len(rows), ""
        for argument, name, unit, columns in _PARTS:
            limit = getattr(self, argument)
            if limit is None:
                continue
            zero = 0.0 if self.absolute else rest[columns]
            with np.errstate(over="ignore"):  # infinity is beyond, too
                size = np.linalg.norm(rows.wrench[:, columns] - zero, axis=1)
            over = np.flatnonzero(~(size <= limit))
            if len(over) and over[0] < first:
                first = int(over[0])
                change = "" if self.absolute else " from rest"
                when = f"at {fixed(rows.time_s[first], 3)} s of the sensor's time"
                text = f"{name} of {size[first]:.4g} {unit}{change} {when}, the limit is {limit:g} {unit}"
        return text
