"""One capture: from rows as they come to a recording, or to a reason why there is none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import argument_error, finite_number, whole_number
from granular_id._text import fixed
from granular_id.live.capture_state import CaptureError, CaptureState, FailureReason
from granular_id.live.captured import rate_complaint, recording_of
from granular_id.live.clock import ArrivalClock, late_s
from granular_id.live.lag import LagWatch
from granular_id.live.rest import Rest
from granular_id.live.rows import BlockLike, Rows, filled
from granular_id.live.runs import Break, runs
from granular_id.live.source import SourceInfo
from granular_id.live.trigger import Trigger
from granular_id.recording import Recording

__all__ = ["Capture"]


class Capture:
    """Takes the rows of one push out of a stream: `pre_s` of rest, the trigger, and what follows.

    It neither reads nor waits, it is fed; which rows it takes depends on the stream only, never on the pieces it
    comes in. What is wrong at rest (a gap, saturation, a restart) makes the rest begin anew; what is wrong after
    the trigger, or within `pre_s` before it, fails the capture. Nothing is ever shortened.

    Parameters
    ----------
    rate_hz : float
        Rate of the source.
    n_samples : int, default 1600
        Rows of the recording, those before the trigger included: the paper's 3.2 s at 500 Hz.
    pre_s : float, default 0.25
        Rest before the trigger that belongs to the recording.
    trigger : Trigger
    max_gap : int, default 0
        So many missing samples in a row are filled with a straight line and flagged; more is a failure.
    allow_saturated : bool, default False
        Take rows at the end of the sensor's range, flagged, instead of failing.
    rate_tolerance : float, default 0.001
        How far the measured rate may be off, relative: HFMH moves with it. So far may the clocks of sensor and host be
        off, too, where a robot tells its motion by the host's.
    max_lag_s : float, default 0.02
        Lag that is no cause for alarm. Rows of a sensor with its own clock that come in later are good nevertheless,
        and the recording's ``meta["late_s"]`` tells how late at most. Without such a clock nobody knows when they
        were measured, and the capture fails.
    lag_patience_s : float, default 0.1
        So long may the lag be larger than that before it fails: a busy computer stumbles, and no sample is lost by it.
    timeout_s : float, default 30
        From the first row to the trigger, counted in rows: those that are no rest too.
    info : SourceInfo, optional
        Goes into the recording's metadata. Without a device clock, rate and lag are judged by when rows come in.
    utc_at_zero_s : float, optional
        Time of day at device time 0, for clocks that run at another speed than the host's. By default the start
        of the recording follows from when its rows came in.

    Attributes
    ----------
    state : CaptureState
    reason, text : FailureReason or None, str
        What happened, where it failed.
    n_rows, n_pre : int
        Rows taken, of `n_samples`; rows before the trigger.
    trigger_time_s : float or None
        Device time of the first row of the motion.

    Examples
    --------
    >>> from granular_id.live.capture import Capture
    >>> from granular_id.live.trigger import ManualTrigger
    >>> capture = Capture(500, trigger=ManualTrigger())
    >>> capture.n_pre, capture.state.value
    (125, 'idle')
    """

    def __init__(
        self,
        rate_hz: float,
        *,
        n_samples: int = 1600,
        pre_s: float = 0.25,
        trigger: Trigger,
        max_gap: int = 0,
        allow_saturated: bool = False,
        rate_tolerance: float = 1e-3,
        max_lag_s: float = 0.02,
        lag_patience_s: float = 0.1,
        timeout_s: float = 30.0,
        info: SourceInfo | None = None,
        utc_at_zero_s: float | None = None,
    ) -> None:
        self.rate_hz = finite_number("rate_hz", rate_hz, positive=True)
        self.n_samples = whole_number("n_samples", n_samples, least=2)
        self.n_pre = round(finite_number("pre_s", pre_s, least=0) * self.rate_hz)
        if self.n_pre >= self.n_samples:
            raise argument_error(
                ValueError,
                "pre_s",
                f"={pre_s:g} is {fixed(self.n_pre)} rows at {self.rate_hz:g} Hz, of n_samples={n_samples} in all",
            )
        if isinstance(trigger, type) or not callable(getattr(trigger, "arm", None)):
            raise argument_error(
                TypeError, "trigger", f"must be a trigger like ForceTrigger(), got {trigger!r:.60}"
            )
        self.trigger = trigger
        self.info = info
        self._max_gap = whole_number("max_gap", max_gap, least=0)
        self._allow_saturated = bool(allow_saturated)
        self._rate_tolerance = finite_number("rate_tolerance", rate_tolerance, least=0)
        self._lag = LagWatch(max_lag_s, lag_patience_s, self.rate_hz)
        self._rest = Rest(self.n_pre, finite_number("timeout_s", timeout_s, least=0), self.rate_hz)
        self._utc_at_zero_s = utc_at_zero_s
        self._device_clock = info is None or info.device_clock
        self._speed = 1.0 if info is None else info.speed
        self._arrival = ArrivalClock(self._speed, self._rate_tolerance)

        self.state = CaptureState.IDLE
        self.reason: FailureReason | None = None
        self.text = ""
        self.trigger_time_s: float | None = None
        self._epoch: int | None = None
        self._last = Rows.none()
        self._taken: list[Rows] = []
        self.n_rows = 0

    def feed(self, block: BlockLike, lag_s: float = 0.0) -> NDArray[np.float64]:
        """Take the next rows of the stream.

        Parameters
        ----------
        block : Block
            As `WrenchReader.read` returns it.
        lag_s : float, default 0
            How late the newest row is (`WrenchBuffer.lag_s`).

        Returns
        -------
        ndarray, shape (k, 6)
            Rows that belong to the recording, in order: those before the trigger come with the first ones after it.
        """
        if self.state.is_over:
            return Rows.none().wrench
        if self.state is CaptureState.IDLE:
            self.state = CaptureState.ARMING
        if block.missed and self._epoch is not None:  # before the first row it is nobody's loss
            self.fail(FailureReason.OVERFLOW, f"{block.missed} rows were overwritten before they were read")
            return Rows.none().wrench
        if not len(block):
            self._judge_lag(0, lag_s)
            return Rows.none().wrench
        if self._epoch not in (None, block.epoch):
            self._break(Break(FailureReason.RESTART, "the sensor's time began anew"))
            self._last = Rows.none()
            self._arrival = ArrivalClock(self._speed, self._rate_tolerance)
        self._epoch = block.epoch
        rows = filled(self._last, Rows.of(block), self._max_gap)
        first = not len(self._last)
        self._last = rows[-1:]
        taken: list[Rows] = []
        for run in runs(rows, self.rate_hz, allow_saturated=self._allow_saturated, first=first):
            if isinstance(run, Break):
                self._break(run)
            else:
                self._take(run, taken)
            if self.state.is_over:
                break
        self._judge_lag(len(block), lag_s)
        return Rows.joined(taken).wrench

    def fail(self, reason: FailureReason, text: str) -> None:
        """End the capture for a reason from outside, unless it is over already."""
        if not self.state.is_over:
            self.state, self.reason, self.text = CaptureState.FAILED, reason, text

    def raise_failure(self) -> None:
        """Raise CaptureError if the capture failed."""
        if self.reason is not None:
            raise CaptureError(self.reason, self.text)

    @property
    def max_lag_s(self) -> float:
        """Lag that is no cause for alarm."""
        return self._lag.max_lag_s

    @property
    def rows(self) -> Rows:
        """Everything taken so far."""
        return Rows.joined(self._taken)

    def recording(
        self,
        label: str | None = None,
        *,
        session: str | None = None,
        name: str = "",
        meta: Mapping[str, Any] | None = None,
    ) -> Recording:
        """Make the recording.

        Parameters
        ----------
        label, session, name
            See `Recording`.
        meta : mapping, optional
            Kept beside the facts about source and capture.

        Returns
        -------
        Recording
            Uniform, `trigger_index` = `n_pre`, `start_time` in UTC, flags; ``meta["late_s"]`` where rows came in late.

        Raises
        ------
        CaptureError
            The capture failed.
        RuntimeError
            It is not complete yet.
        """
        self.raise_failure()
        if self.state is not CaptureState.COMPLETE:
            raise RuntimeError(f"the capture is {self.state.value}: {self.n_rows} of {self.n_samples} rows")
        facts = {"trigger": self.trigger.name, "lead_s": self.n_pre / self.rate_hz, **(meta or {})}
        rows = self.rows
        if self._speed == 1 and (late := late_s(rows.time_s, rows.host_ns)) > self.max_lag_s:
            facts["late_s"] = late
        return recording_of(
            rows,
            facts,
            info=self.info,
            utc_at_zero_s=self._utc_at_zero_s,
            rate_hz=self.rate_hz,
            label=label,
            session=session,
            name=name,
            trigger_index=self.n_pre,
        )

    def _break(self, why: Break) -> None:
        if self.state is CaptureState.TRIGGERED:
            self.fail(why.reason, f"{why.text}, {self.n_rows} of {self.n_samples} rows in")
            return
        self.state = CaptureState.ARMING
        self._rest.begin_anew(why)
        if not self._rest.n_left:
            self._fail(self._rest.why_over())

    def _fail(self, why: Break) -> None:
        self.fail(why.reason, why.text)

    def _take(self, rows: Rows, taken: list[Rows]) -> None:
        """Go through rows without a fault among them."""
        while not self.state.is_over:
            if self.state is CaptureState.ARMING and not self._rest.n_wanted:
                self._arm()
            if not len(rows):
                return
            if self.state is CaptureState.TRIGGERED:
                self._add(rows[: self.n_samples - self.n_rows], taken)
                return
            rows = self._wait(rows, taken)

    def _arm(self) -> None:
        complaint = self.trigger.arm(self._rest.rows)
        if complaint is None:
            self.state = CaptureState.ARMED
            self._rest.is_accepted()
        else:
            self._rest.look_again(complaint)

    def _wait(self, rows: Rows, taken: list[Rows]) -> Rows:
        """Look for the trigger in as many rows as may be looked at alike; return the others."""
        rest, arming = self._rest, self.state is CaptureState.ARMING
        if not rest.n_left:
            self._fail(rest.why_over())
            return rows
        looked = rows[: min(rest.n_left, rest.n_wanted) if arming else rest.n_left]
        found = self.trigger.index(self._as_due(looked))
        if found is not None and arming:
            self._fail(rest.why_early(found))
            return rows
        resting = looked[:found]
        rest.add(resting)
        if found is not None:
            self.state = CaptureState.TRIGGERED
            self.trigger_time_s = float(looked.time_s[found])
            self._add(rest.rows, taken)
        return rows[len(resting) :]

    def _as_due(self, rows: Rows) -> Rows:
        """Give rows the host time at which they were due: a trigger by the host's clock is not moved by lateness."""
        if not self._device_clock:
            return rows
        return replace(rows, host_ns=self._arrival.due_ns(rows.time_s, rows.host_ns))

    def _add(self, rows: Rows, taken: list[Rows]) -> None:
        self._taken.append(rows)
        taken.append(rows)
        self.n_rows += len(rows)
        if self.n_rows < self.n_samples:
            return
        complaint = rate_complaint(self.rows, self.rate_hz, self._rate_tolerance, self.info)
        if complaint is not None:
            self.fail(FailureReason.RATE, complaint)
        else:
            self.state = CaptureState.COMPLETE

    def _judge_lag(self, n_rows: int, lag_s: float) -> None:
        if self._device_clock:  # a complete recording is none the worse for it
            return
        complaint = self._lag.complaint(n_rows, lag_s)
        if complaint is not None and self.state is CaptureState.TRIGGERED:
            self.fail(FailureReason.LAG, complaint)
