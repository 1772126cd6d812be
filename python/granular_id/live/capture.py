"""One recording: from rows as they come to all that belong to a push, or to a reason why there is none."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import argument_error, finite_number, whole_number
from granular_id._core import Block, GranularIdError, host_ns
from granular_id._text import counted, fixed, verb
from granular_id.live.limits import Limits
from granular_id.live.outcome import CaptureError, FailureReason, Fault
from granular_id.live.rows import BAD, ArrivalClock, GapFiller, Rows, measured_rate_hz, start_utc_s, timing_of
from granular_id.live.source import SourceInfo
from granular_id.live.trigger import Trigger
from granular_id.recording import Recording, SampleFlag

__all__ = ["RESTART", "Capture", "CaptureState", "meta_of", "missing", "overrun", "wrong_rate"]

_NEW_LOOKS = 10
"""How often rows are looked at anew for being at rest, within the time that they are to rest."""

_LAG_PATIENCE_S = 0.1
"""So long may rows without a time of their own be late: a busy computer stumbles, and no sample is lost by it."""

_MARKS = {
    SampleFlag.SATURATED: Fault(FailureReason.SATURATION, "the sensor was at the end of its range"),
    SampleFlag.BAD_STATUS: Fault(FailureReason.STATUS, "the sensor reported an error with its sample"),
}

RESTART = Fault(FailureReason.RESTART, "the sensor's time began anew")


class CaptureState(Enum):
    """States of a capture, in the order it goes through them."""

    IDLE = "idle"  # nothing was fed yet
    ARMING = "arming"  # rows at rest are gathered, as many as belong before the trigger
    ARMED = "armed"  # they are there: the motion may begin
    TRIGGERED = "triggered"
    COMPLETE = "complete"
    FAILED = "failed"

    @property
    def is_over(self) -> bool:
        """Whether nothing more will change."""
        return self in (CaptureState.COMPLETE, CaptureState.FAILED)


class Capture:
    """Takes the rows of one push out of a stream: `pre_s` of rest, the trigger, and what follows."""

    # Which rows it takes depends on the stream only, never on the pieces it comes in. What is wrong at rest (a gap,
    # saturation, a restart) makes the rest begin anew; what is wrong after the trigger, or within `pre_s` before it,
    # fails the capture. Nothing is ever shortened.

    def __init__(
        self,
        info: SourceInfo,
        trigger: Trigger,
        limits: Limits,
        *,
        n_samples: int = 1600,
        pre_s: float = 0.25,
        since_ns: int = 0,  # of the host's monotonic clock: rows of before do not count towards the timeout
        utc_at_zero_s: float | None = None,  # at device time 0, for clocks of another speed than the host's
    ) -> None:
        self.rate_hz = info.rate_hz
        self.n_samples = whole_number("n_samples", n_samples, least=2)
        self.n_pre = round(finite_number("pre_s", pre_s, least=0) * self.rate_hz)
        if self.n_pre >= self.n_samples:
            rows = f"{fixed(self.n_pre)} rows at {self.rate_hz:g} Hz, of n_samples={n_samples} in all"
            raise argument_error(GranularIdError, "pre_s", f"={pre_s:g} is {rows}")
        if isinstance(trigger, type) or not callable(getattr(trigger, "arm", None)):
            text = f"must be a trigger like ForceTrigger(), got {trigger!r:.60}"
            raise argument_error(TypeError, "trigger", text)
        self.trigger, self.limits, self.info = trigger, limits, info
        self._since_ns, self._utc_at_zero_s = since_ns, utc_at_zero_s

        self.state = CaptureState.IDLE
        self.reason: FailureReason | None = None
        self.text = ""
        self.trigger_time_s: float | None = None
        self.trigger_ns = 0  # when the first row of the motion came in
        self.n_rows = 0
        self.rest = Rows.none()  # the newest ones, as many as belong before the trigger
        self._epoch: int | None = None
        self._gaps = GapFiller(limits.max_gap)
        self._arrival = ArrivalClock(info.speed, limits.rate_tolerance)
        self._n_left = round(limits.timeout_s * self.rate_hz)  # that may still come before the trigger
        self._broken: Fault | None = None  # what broke the rest last
        self._taken: list[Rows] = []
        self._n_late = 0

    def feed(self, block: Block, lag_s: float = 0.0) -> NDArray[np.float64]:
        """Take the next rows of the stream, the newest `lag_s` late; return those of the recording, shape (k, C)."""
        if self.state is CaptureState.IDLE:
            self.state = CaptureState.ARMING
        n_before = len(self._taken)
        if block.missed and self._epoch is not None:  # before the first row it is nobody's loss
            self.fail(*overrun(block))
        elif len(block):
            self._go_through(block)
        if not self.info.device_clock:  # with one, a complete recording is none the worse for a lag
            self._judge_lag(len(block), lag_s)
        return Rows.joined(self._taken[n_before:]).wrench

    def fail(self, reason: FailureReason, text: str, *, complete: bool = False) -> None:
        """End the capture for a reason from outside, unless it has failed already, or is over and not `complete`."""
        if not self.state.is_over or (complete and self.reason is None):
            self.state, self.reason, self.text = CaptureState.FAILED, reason, text

    @property
    def timing(self) -> dict[str, float] | None:
        """How the rows came in, see `Push.timing`; None before all are there."""
        return timing_of(self.rows, self.info) if self.state is CaptureState.COMPLETE else None

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
        """Make the recording, `meta` beside the facts about source and capture; raise CaptureError if it failed."""
        if self.reason is not None:
            raise CaptureError(self.reason, self.text)
        if self.state is not CaptureState.COMPLETE:
            raise RuntimeError(f"the capture is {self.state.value}: {self.n_rows} of {self.n_samples} rows")
        facts = {"trigger": self.trigger.name, "lead_s": self.n_pre / self.rate_hz, **(meta or {})}
        rows = self.rows
        late_s = timing_of(rows, self.info).get("late_s", 0.0)
        if late_s > self.limits.max_lag_s:
            facts["late_s"] = late_s
        if self._utc_at_zero_s is None:
            start_time = start_utc_s(rows, time.time() - 1e-9 * host_ns())
        else:
            start_time = round(self._utc_at_zero_s + float(rows.time_s[0]), 6)
        return Recording(
            rows.wrench,
            rate_hz=self.rate_hz,
            label=label,
            session=session,
            name=name,
            trigger_index=self.n_pre,
            start_time=start_time,
            meta=meta_of(self.info, facts),
            flags=rows.flags,
            axes=self.info.axes,
        )

    def _go_through(self, block: Block) -> None:
        if self._epoch not in (None, block.epoch):
            self._break(*RESTART)
            self._gaps.begin_anew()
            self._arrival = ArrivalClock(self.info.speed, self.limits.rate_tolerance)
        self._epoch = block.epoch
        rows = self._gaps.fill(block)
        self._n_left += int(np.count_nonzero(rows.host_ns < self._since_ns))
        bad = rows.flags & (np.uint8(SampleFlag.BAD_STATUS) if self.limits.allow_saturated else BAD)
        done = 0
        for at in np.flatnonzero((rows.missing_before > 0) | (bad > 0)).tolist():
            self._take(rows[done:at])
            when = f"at {fixed(rows.time_s[at], 3)} s of the sensor's time"
            if n := int(rows.missing_before[at]):
                self._break(FailureReason.GAP, f"{missing(n, self.rate_hz)} {when}")
            if bad[at]:
                reason, text = next(fault for flag, fault in _MARKS.items() if bad[at] & flag)
                self._break(reason, f"{text} {when}")
                self._n_left -= 1  # it is left out
            done = at + bool(bad[at])
        self._take(rows[done:])

    def _break(self, reason: FailureReason, text: str) -> None:
        """Take note that two rows do not belong together."""
        if self.state is CaptureState.TRIGGERED:
            self.fail(reason, f"{text}, {self.n_rows} of {self.n_samples} rows in")
        elif not self.state.is_over:
            self.state = CaptureState.ARMING
            self.rest, self._broken = Rows.none(), Fault(reason, text)

    def _take(self, rows: Rows) -> None:
        """Go through rows without a fault among them."""
        while not self.state.is_over:
            if self.state is CaptureState.ARMING and len(self.rest) == self.n_pre:
                self._arm()
            if self.state is CaptureState.TRIGGERED:
                self._add(rows[: self.n_samples - self.n_rows])
                return
            if self._n_left <= 0:
                why = f"; the rest was broken last by this: {self._broken[1]}" if self._broken else ""
                text = f"nothing triggered within {self.limits.timeout_s:g} s{why}"
                self.fail(FailureReason.NO_TRIGGER, text)
            elif len(rows):
                rows = self._wait(rows)
            else:
                return

    def _arm(self) -> None:
        beyond = self.limits.beyond(self.rest, np.zeros(6)) if self.limits.absolute else ""
        unrest = beyond or self.trigger.arm(self.rest)
        if unrest is None:
            self.state, self._broken = CaptureState.ARMED, None
            return
        # The oldest rows go; a fixed share, so that nothing depends on how rows come in.
        self.rest = self.rest[max(1, self.n_pre // _NEW_LOOKS) :]
        self._broken = Fault(FailureReason.LIMIT if beyond else FailureReason.NO_REST, unrest)

    def _wait(self, rows: Rows) -> Rows:
        """Look for the trigger in as many rows as may be looked at alike; return the others."""
        arming = self.state is CaptureState.ARMING
        wanted = max(1, self.n_pre - len(self.rest)) if arming else self._n_left
        looked = due = rows[: min(self._n_left, wanted)]
        if self.info.device_clock:  # by the host's clock, late rows do not move the trigger
            due = replace(looked, host_ns=self._arrival.due_ns(looked))
        found = self.trigger.index(due)
        if found is not None and arming:
            text = f"triggered after {len(self.rest) + found} rows at rest, wanted {self.n_pre}"
            if self._broken is None:
                self.fail(FailureReason.TRIGGER_TOO_EARLY, text)
            else:
                self.fail(self._broken[0], f"{text}: {self._broken[1]}")
            return rows
        if found is not None and (refused := self.trigger.refuse(looked[found : found + 1])):
            self._break(FailureReason.NO_REST, refused)
            self._n_left -= found + 1
            return rows[found + 1 :]
        resting = looked[:found]
        self._n_left -= len(resting)
        self.rest = Rows.joined([self.rest, resting])
        self.rest = self.rest[max(0, len(self.rest) - self.n_pre) :]
        if found is not None:
            self.state = CaptureState.TRIGGERED
            self.trigger_time_s, self.trigger_ns = float(looked.time_s[found]), int(due.host_ns[found])
            self._add(self.rest)
        return rows[len(resting) :]

    def _add(self, rows: Rows) -> None:
        self._taken.append(rows)
        self.n_rows += len(rows)
        if self.n_rows < self.n_samples:
            return
        if wrong := wrong_rate(self.rows, self.info, self.limits):
            self.fail(FailureReason.RATE, wrong)
        else:
            self.state = CaptureState.COMPLETE

    def _judge_lag(self, n_rows: int, lag_s: float) -> None:
        """Fail where the newest row is late for so long that it is no stumble any more."""
        max_s = self.limits.max_lag_s
        is_late = lag_s > max_s
        self._n_late = self._n_late + n_rows if is_late else 0
        lasts = self._n_late >= _LAG_PATIENCE_S * self.rate_hz or lag_s > max_s + _LAG_PATIENCE_S
        if self.state is CaptureState.TRIGGERED and is_late and lasts:
            wanted = f"at most {1e3 * max_s:g} ms, or more for {1e3 * _LAG_PATIENCE_S:g} ms at most"
            self.fail(FailureReason.LAG, f"rows came in {fixed(1e3 * lag_s, 0)} ms late; wanted {wanted}")


def overrun(block: Block) -> Fault:
    """Return that rows of a reader were lost."""
    return Fault(FailureReason.OVERFLOW, f"{block.missed} rows were overwritten before they were read")


def missing(n: int, rate_hz: float) -> str:
    """Say how many samples are missing."""
    return f"{counted(n, 'sample')} ({1e3 * n / rate_hz:g} ms) {verb(n, 'is', 'are')} missing"


def wrong_rate(rows: Rows, info: SourceInfo, limits: Limits) -> str:
    """Say that rows without gaps, at least two, came at another rate than wanted; empty where they did not."""
    measured_hz, tolerance = measured_rate_hz(rows, info), limits.rate_tolerance
    if abs(measured_hz / info.rate_hz - 1) <= tolerance:
        return ""
    return f"measured {measured_hz:.6g} Hz, wanted {info.rate_hz:g} Hz within {100 * tolerance:g} %"


def meta_of(info: SourceInfo, facts: Mapping[str, Any]) -> dict[str, Any]:
    """Return the metadata of a recording: what its source says, and `facts`."""
    units = {"units": info.units_of_axes} if info.units_of_axes else {}
    return {"source": info.to_dict(), "synthetic": info.synthetic, **units, **facts}
