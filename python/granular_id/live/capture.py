"""One capture: from rows as they come to a recording, or to a reason why there is none."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import argument_error, finite_number, whole_number
from granular_id._core import host_ns
from granular_id._text import counted, fixed, verb
from granular_id.live.rows import (
    ArrivalClock,
    BlockLike,
    GapFiller,
    Rows,
    late_s,
    measured_rate_hz,
    start_utc_s,
    timing_in_words,
    timing_of,
)
from granular_id.live.source import SourceInfo
from granular_id.live.trigger import Trigger
from granular_id.live.wrench import WrenchLimits
from granular_id.recording import Recording, SampleFlag

if TYPE_CHECKING:
    from granular_id.identifier import Decision

__all__ = ["Capture", "CaptureError", "CaptureState", "FailureReason", "Push", "meta_of"]

SATURATED = np.uint8(SampleFlag.SATURATED)

_NEW_LOOKS = 10
"""How often rows are looked at anew for being at rest, within the time that they are to rest."""


class CaptureState(Enum):
    """States of a capture, in the order it goes through them."""

    IDLE = "idle"
    """Nothing was fed yet."""
    ARMING = "arming"
    """Rows at rest are gathered, as many as belong before the trigger."""
    ARMED = "armed"
    """They are there: the motion may begin."""
    TRIGGERED = "triggered"
    """The motion has begun, its rows are taken."""
    COMPLETE = "complete"
    """All rows are there, and nothing is wrong with them."""
    FAILED = "failed"
    """There will be no recording; `Capture.reason` says why."""

    @property
    def is_over(self) -> bool:
        """Whether nothing more will change."""
        return self in (CaptureState.COMPLETE, CaptureState.FAILED)


class FailureReason(Enum):
    """Why there is no recording."""

    TRIGGER_TOO_EARLY = "trigger too early"
    """Triggered before enough rows at rest were there."""
    NO_REST = "no rest"
    """The tool never rested as long as it should before the motion."""
    OVERFLOW = "overflow"
    """Rows were overwritten before they were read."""
    GAP = "gap"
    """More instants without a sample than `max_gap`."""
    SATURATION = "saturation"
    """The sensor was at the end of its range."""
    RESTART = "restart"
    """The sensor's time began anew."""
    RATE = "rate"
    """The samples came at another rate than the source's."""
    LIMIT = "limit"
    """Force or torque was larger than it may be."""
    LAG = "lag"
    """Samples without a time of the sensor's own came in late for too long."""
    NO_TRIGGER = "no trigger"
    """Nothing triggered within the time."""
    NO_ROWS = "no rows"
    """The source delivered nothing any more."""
    SOURCE = "source"
    """The source died or came to its end."""
    ROBOT = "robot"
    """The robot refused the motion, or it failed."""
    INTERRUPTED = "interrupted"
    """Ended from outside: Ctrl-C or another signal, or the program went on to something else."""

    @property
    def is_lasting(self) -> bool:
        """Whether no other capture should follow by itself.

        It would fail as well: nobody delivers, nobody moves, the program is to end. Or the tool has met something.
        """
        return self in _LASTING


_LASTING = frozenset(
    (
        FailureReason.SOURCE,
        FailureReason.ROBOT,
        FailureReason.LIMIT,
        FailureReason.NO_ROWS,
        FailureReason.NO_TRIGGER,
        FailureReason.INTERRUPTED,
    )
)


class CaptureError(RuntimeError):
    """A capture that gave no recording.

    Parameters
    ----------
    reason : FailureReason
    text : str
        What happened, in words.
    """

    def __init__(self, reason: FailureReason, text: str) -> None:
        super().__init__(text)
        self.reason = reason

    def __reduce__(self) -> tuple[type[CaptureError], tuple[FailureReason, str]]:
        return type(self), (self.reason, str(self))


@dataclass(frozen=True)
class Push:
    """What came of one push.

    Attributes
    ----------
    decision : Decision or None
        The answer; None where the capture failed before there was one.
    reason : FailureReason or None
        Why the capture failed, if it did; `text` says it in words.
    text : str
    truth : str or None
        The material, where the source knows it: simulations and recordings played again.
    time_s : float or None
        Device time of the newest row, of an answer at a hop; None of pushes.
    recording : Recording or None
        What was captured, with the answer in its ``meta["answer"]``. An answer is no label: its `label` is the truth,
        where the source knows it. None where the capture failed or was ended early, and of an answer at a hop.
    timing : dict of str to float, or None
        How its rows came in: ``rate_hz`` as measured; ``jitter_s``, the standard deviation of their delays, and
        ``late_s``, how late they were at most, where the source runs in real time. None where there is no recording.
    """

    decision: Decision | None = None
    reason: FailureReason | None = None
    text: str = ""
    truth: str | None = None
    time_s: float | None = None
    recording: Recording | None = field(default=None, repr=False, compare=False)
    timing: dict[str, float] | None = field(default=None, compare=False)

    @property
    def is_right(self) -> bool | None:
        """Whether the answer is the truth; None where either is missing.

        An answer that it is like no known material is right where the model does not know the truth.
        """
        if self.decision is None or self.truth is None:
            return None
        if self.decision.unknown:
            return self.truth not in dict(self.decision.ranking)
        return self.decision.label == self.truth

    def to_dict(self) -> dict[str, Any]:
        """Return all of it as plain JSON-like values."""
        return {
            "decision": None if self.decision is None else self.decision.to_dict(),
            "failure": None if self.reason is None else {"reason": self.reason.value, "text": self.text},
            "truth": self.truth,
            **({} if self.time_s is None else {"time_s": self.time_s}),
            **({} if self.timing is None else {"timing": self.timing}),
        }

    def __str__(self) -> str:
        if self.decision is None:
            return f"no answer: {self.text}"
        said = str(self.decision)
        if self.time_s is not None:
            said = f"{fixed(self.time_s, 2)} s: {self.decision.sentence()}"
        verdict = {True: "  right", False: f"  WRONG, it was {self.truth}", None: ""}[self.is_right]
        if self.is_right and self.decision.unknown:
            verdict += f", it was {self.truth}"
        if self.is_right is not None and self.truth not in dict(self.decision.ranking):
            verdict += ", which the model does not know"
        timing = ", ".join(" ".join(pair) for pair in timing_in_words(self.timing))
        return f"{said}{verdict}{'; ' * bool(timing)}{timing}"


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
        From the first row to the trigger, counted in rows: those that are no rest too, but not those that came in
        before `since_ns`.
    max_force_n, max_torque_n_m : float, optional
        Limits of a push, lengths of (fx, fy, fz) and (tx, ty, tz) as the sensor tells them: with its zero, and with the
        tool's weight where that is not taken off. A row beyond one fails the capture; `drive` looks at every row from
        the robot's command until it stands, and stops it. At rest such rows are waited out. Default: none, as what a
        tool bears nobody knows but you. At most the smallest range of these axes: what is more cannot be seen.
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
    since_ns : int
        Moment of the host's monotonic clock from which on `timeout_s` counts; `drive` sets it to when it was called.
        Until then all rows count.

    Examples
    --------
    >>> from granular_id.live import Capture
    >>> from granular_id.live import ManualTrigger
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
        max_force_n: float | None = None,
        max_torque_n_m: float | None = None,
        info: SourceInfo | None = None,
        utc_at_zero_s: float | None = None,
    ) -> None:
        self.rate_hz = finite_number("rate_hz", rate_hz, positive=True)
        self.n_samples = whole_number("n_samples", n_samples, least=2)
        self.n_pre = round(finite_number("pre_s", pre_s, least=0) * self.rate_hz)
        if self.n_pre >= self.n_samples:
            rows = f"{fixed(self.n_pre)} rows at {self.rate_hz:g} Hz, of n_samples={n_samples} in all"
            raise argument_error(ValueError, "pre_s", f"={pre_s:g} is {rows}")
        if isinstance(trigger, type) or not callable(getattr(trigger, "arm", None)):
            text = f"must be a trigger like ForceTrigger(), got {trigger!r:.60}"
            raise argument_error(TypeError, "trigger", text)
        self.trigger = trigger
        self.info = info
        self._max_lag_s = finite_number("max_lag_s", max_lag_s, least=0)
        self._lag_patience_s = finite_number("lag_patience_s", lag_patience_s, least=0)
        self._gaps = GapFiller(whole_number("max_gap", max_gap, least=0))
        self._allow_saturated = bool(allow_saturated)
        self._rate_tolerance = finite_number("rate_tolerance", rate_tolerance, least=0)
        self._timeout_s = finite_number("timeout_s", timeout_s, least=0)
        self._limits = WrenchLimits(max_force_n, max_torque_n_m, info)
        self._utc_at_zero_s = utc_at_zero_s
        self._device_clock = info is None or info.device_clock
        self._speed = 1.0 if info is None else info.speed

        self.state = CaptureState.IDLE
        self.reason: FailureReason | None = None
        self.text = ""
        self.trigger_time_s: float | None = None
        self.since_ns = 0
        self.n_rows = 0
        self._epoch: int | None = None
        self._arrival = ArrivalClock(self._speed, self._rate_tolerance)
        self._n_left = round(self._timeout_s * self.rate_hz)  # that may still come before the trigger
        self._rest = Rows.none()  # the newest ones, as many as belong before the trigger
        self._broken: tuple[FailureReason, str] | None = None  # what broke the rest last
        self._taken: list[Rows] = []
        self._n_late = 0

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
        ndarray, shape (k, C)
            Rows that belong to the recording, in order: those before the trigger come with the first ones after it.
        """
        if self.state.is_over:
            return Rows.none().wrench
        if self.state is CaptureState.IDLE:
            self.state = CaptureState.ARMING
        n_before = len(self._taken)
        if block.missed and self._epoch is not None:  # before the first row it is nobody's loss
            self.fail(FailureReason.OVERFLOW, f"{block.missed} rows were overwritten before they were read")
        elif len(block):
            self._go_through(block)
        self._judge_lag(len(block), lag_s)
        return Rows.joined(self._taken[n_before:]).wrench

    def fail(self, reason: FailureReason, text: str, *, complete: bool = False) -> None:
        """End the capture for a reason from outside, unless it has failed already, or is over and not `complete`."""
        if not self.state.is_over or (complete and self.reason is None):
            self.state, self.reason, self.text = CaptureState.FAILED, reason, text

    def raise_failure(self) -> None:
        """Raise CaptureError if the capture failed."""
        if self.reason is not None:
            raise CaptureError(self.reason, self.text)

    def beyond_limit(self, rows: BlockLike | Rows) -> str:
        """Say which is the first of these rows beyond `max_force_n` or `max_torque_n_m`; empty where none is."""
        return self._limits.beyond(rows)

    @property
    def has_limits(self) -> bool:
        """Whether there is a limit of force or torque."""
        return self._limits.are_given

    @property
    def timing(self) -> dict[str, float] | None:
        """How the rows came in, see `Push.timing`; None before all are there."""
        if self.state is not CaptureState.COMPLETE:
            return None
        return timing_of(self.rows, self._measured_hz(self.rows), real_time=self._speed == 1)

    @property
    def max_lag_s(self) -> float:
        """Lag that is no cause for alarm."""
        return self._max_lag_s

    def wrong_rate(self, rows: Rows) -> str:
        """Say that rows without gaps, at least two, came at another rate than wanted; empty where they did not."""
        measured_hz = self._measured_hz(rows)
        if abs(measured_hz / self.rate_hz - 1) <= self._rate_tolerance:
            return ""
        wanted = f"{self.rate_hz:g} Hz within {100 * self._rate_tolerance:g} %"
        return f"measured {measured_hz:.6g} Hz, wanted {wanted}"

    def _measured_hz(self, rows: Rows) -> float:
        measured_hz = measured_rate_hz(rows, device_clock=self._device_clock)
        return measured_hz if self._device_clock else measured_hz / self._speed

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
        if self._speed == 1 and (late := late_s(rows)) > self._max_lag_s:
            facts["late_s"] = late
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
            axes=() if self.info is None else self.info.axes,
        )

    def _go_through(self, block: BlockLike) -> None:
        if self._epoch not in (None, block.epoch):
            self._break(FailureReason.RESTART, "the sensor's time began anew")
            self._gaps.begin_anew()
            self._arrival = ArrivalClock(self._speed, self._rate_tolerance)
        self._epoch = block.epoch
        rows = self._gaps.fill(block)
        self._n_left += int(np.count_nonzero(rows.host_ns < self.since_ns))
        saturated = np.zeros(len(rows), np.bool_) if self._allow_saturated else rows.flags & SATURATED != 0
        done = 0
        for at in np.flatnonzero((rows.missing_before > 0) | saturated).tolist():
            self._take(rows[done:at])
            when = f"at {fixed(rows.time_s[at], 3)} s of the sensor's time"
            if n := int(rows.missing_before[at]):
                lost = (
                    f"{counted(n, 'sample')} ({1e3 * n / self.rate_hz:g} ms) {verb(n, 'is', 'are')} missing"
                )
                self._break(FailureReason.GAP, f"{lost} {when}")
            if saturated[at]:
                self._break(FailureReason.SATURATION, f"the sensor was at the end of its range {when}", 1)
            done = at + int(saturated[at])
        self._take(rows[done:])

    def _break(self, reason: FailureReason, text: str, n_rows: int = 0) -> None:
        """Take note that two rows do not belong together; `n_rows` between them are left out."""
        if self.state is CaptureState.TRIGGERED:
            self.fail(reason, f"{text}, {self.n_rows} of {self.n_samples} rows in")
        elif not self.state.is_over:
            self.state = CaptureState.ARMING
            self._rest, self._broken = Rows.none(), (reason, text)
            self._n_left -= n_rows
            if self._n_left <= 0:
                self._fail_untriggered()

    def _take(self, rows: Rows) -> None:
        """Go through rows without a fault among them."""
        while not self.state.is_over:
            if self.state is CaptureState.ARMING and len(self._rest) == self.n_pre:
                self._arm()
            if not len(rows):
                return
            if self.state is CaptureState.TRIGGERED:
                self._add(rows[: self.n_samples - self.n_rows])
                return
            rows = self._wait(rows)

    def _arm(self) -> None:
        beyond = self.beyond_limit(self._rest)
        complaint = beyond or self.trigger.arm(self._rest)
        if complaint is None:
            self.state, self._broken = CaptureState.ARMED, None
            return
        # The oldest rows go; a fixed share, so that nothing depends on how rows come in.
        self._rest = self._rest[max(1, self.n_pre // _NEW_LOOKS) :]
        self._broken = FailureReason.LIMIT if beyond else FailureReason.NO_REST, complaint

    def _wait(self, rows: Rows) -> Rows:
        """Look for the trigger in as many rows as may be looked at alike; return the others."""
        if self._n_left <= 0:
            self._fail_untriggered()
            return rows
        arming = self.state is CaptureState.ARMING
        wanted = max(1, self.n_pre - len(self._rest)) if arming else self._n_left
        looked = rows[: min(self._n_left, wanted)]
        found = self.trigger.index(self._as_due(looked))
        if found is not None and arming:
            self._fail_early(len(self._rest) + found)
            return rows
        resting = looked[:found]
        self._n_left -= len(resting)
        self._rest = Rows.joined([self._rest, resting])
        self._rest = self._rest[max(0, len(self._rest) - self.n_pre) :]
        if found is not None:
            self.state = CaptureState.TRIGGERED
            self.trigger_time_s = float(looked.time_s[found])
            self._add(self._rest)
        return rows[len(resting) :]

    def _as_due(self, rows: Rows) -> Rows:
        """Give rows the host time at which they were due: late ones do not move a trigger by the host's clock."""
        if not self._device_clock:
            return rows
        return replace(rows, host_ns=self._arrival.due_ns(rows.time_s, rows.host_ns))

    def _add(self, rows: Rows) -> None:
        if beyond := self.beyond_limit(rows):
            self.fail(FailureReason.LIMIT, beyond)
            return
        self._taken.append(rows)
        self.n_rows += len(rows)
        if self.n_rows < self.n_samples:
            return
        if wrong := self.wrong_rate(self.rows):
            self.fail(FailureReason.RATE, wrong)
        else:
            self.state = CaptureState.COMPLETE

    def _fail_early(self, n_rest: int) -> None:
        text = f"triggered after {n_rest} rows at rest, wanted {self.n_pre}"
        if self._broken is None:
            self.fail(FailureReason.TRIGGER_TOO_EARLY, text)
        else:
            self.fail(self._broken[0], f"{text}: {self._broken[1]}")

    def _fail_untriggered(self) -> None:
        text = f"nothing triggered within {self._timeout_s:g} s"
        if self._broken is not None:
            text += f"; the rest was broken last by this: {self._broken[1]}"
        self.fail(FailureReason.NO_TRIGGER, text)

    def _judge_lag(self, n_rows: int, lag_s: float) -> None:
        """Fail where the newest row is late for so long that it is no stumble any more."""
        if self._device_clock:  # a complete recording is none the worse for it
            return
        is_late = lag_s > self._max_lag_s
        self._n_late = self._n_late + n_rows if is_late else 0
        max_s, patience_s = self._max_lag_s, self._lag_patience_s
        lasts = self._n_late >= patience_s * self.rate_hz or lag_s > max_s + patience_s
        if self.state is CaptureState.TRIGGERED and is_late and lasts:
            wanted = f"at most {1e3 * max_s:g} ms, or more for {1e3 * patience_s:g} ms at most"
            self.fail(FailureReason.LAG, f"rows came in {fixed(1e3 * lag_s, 0)} ms late; wanted {wanted}")


def meta_of(info: SourceInfo | None, facts: Mapping[str, Any]) -> dict[str, Any]:
    """Return the metadata of a recording: what its source says, and `facts`."""
    of_source = {} if info is None else {"source": info.to_dict(), "synthetic": info.synthetic}
    units = {} if info is None or not info.units_of_axes else {"units": info.units_of_axes}
    return {**of_source, **units, **facts}
