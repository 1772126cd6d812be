"""The loop over pushes: rest, motion, rows, stand; who records or names them sees rows and moves nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from typing_extensions import Self

from granular_id._checks import freeze, thaw
from granular_id._core import Block, WrenchReader
from granular_id.live.capture import Capture, CaptureState
from granular_id.live.clock import WAIT_S
from granular_id.live.limits import Limits
from granular_id.live.outcome import CaptureError, FailureReason
from granular_id.live.priority import warn_if_refused
from granular_id.live.robot import ManualRobot, Motion, Robot, checked_move
from granular_id.live.rows import Rows
from granular_id.live.stream import Stream
from granular_id.live.supervisor import Mover, Supervisor
from granular_id.live.trigger import ForceTrigger, MotionTrigger, Trigger

__all__ = ["Attempt", "Pushes", "Step"]

_MARGIN_S = 0.05
"""So much longer does the robot move than is recorded: no sample may fall into its braking."""

_QUIET_S = 1.0
"""A source that delivers nothing for so long has failed; pauses of its own come on top."""

_BEHIND_S, _AHEAD_S = 0.02, 30.0
"""So far from the newest row may the start of a motion be: further, and its clock is not the sensor's."""

_MOST_FAILURES = 3
"""So many pushes of an arm may fail in a row."""

_DIRECTION_S = 0.1
"""The force of the first push is that of its first rows: later it may turn."""


class Hand(Mover):
    """A person who is prompted to push, or nobody: to a push loop what a `Supervisor` is, though nobody watches."""

    fault = blocked = None
    moves, ending = False, ""

    def __init__(self, robot: Robot | None) -> None:
        super().__init__()
        self.motion: Motion | None = None
        self._robot = robot

    def get_ready(self) -> None:
        """Forget the last motion."""
        self.motion = None

    def push(self, direction: Sequence[float], speed_m_s: float, duration_s: float, *_: object) -> None:
        """Say that the push is to begin."""
        if self._robot is not None:
            self.motion = self._robot.move_line(direction, speed_m_s, duration_s)

    def stop(self, *_: object) -> None:
        """Say that the push is over."""
        if self._robot is not None and self.motion is not None:
            self._robot.stop()

    def go_back(self, *_: object) -> None:
        """Nothing moves by itself."""

    wait_until_it_stands = go_back


@dataclass(frozen=True)
class Step:
    """All rows that were read, none perhaps, and those of them that belong to the recording, shape (k, C)."""

    block: Block
    rows: NDArray[np.float64]


class Pushes(Iterator["Attempt"]):
    """One push after another, each to be gone through in a ``with`` block.

    ``for push in Pushes(stream, robot, trigger, limits)``: a robot is set in motion as soon as the rest is there, and
    watched by a `Supervisor` until it stands. After a push that failed it goes back first; after a limit or an error of
    the robot nothing moves until `resume`; three failures in a row end the loop.
    """

    def __init__(
        self,
        stream: Stream,
        robot: Robot | None,
        trigger: Callable[[], Trigger],
        limits: Limits,
        *,
        n_samples: int = 1600,
        pre_s: float = 0.25,
        direction: Sequence[float] = (1.0, 0.0, 0.0),
        speed_m_s: float = 0.03,
    ) -> None:
        self.stream, self.robot, self.limits, self.clock = stream, robot, limits, stream.clock
        self.n_samples, self.pre_s, self.direction, self.speed_m_s = n_samples, pre_s, direction, speed_m_s
        self.force_direction: NDArray[np.float64] | None = None  # of the first push by hand
        self.rest = np.zeros(len(stream.info.axes))  # before the last push: limits count from it
        # What a tool bears before a push is held against it.
        self.first_rest: NDArray[np.float64] | None = None
        self.back_first = False
        self._trigger = trigger
        self._n_failures = 0
        self._last: Capture | None = None
        self._reader: WrenchReader | None = None
        self.by_hand = robot is None or isinstance(robot, ManualRobot)
        self.arm = Hand(robot) if robot is None or self.by_hand else Supervisor(stream, robot, limits)
        # Refused before anything moves.
        limits.check_source(stream.info)
        checked_move(direction, speed_m_s, self.motion_s(self.capture()))
        if limits.watched and not (self.by_hand or stream.info.synthetic):
            warn_if_refused()

    def __next__(self) -> Attempt:
        if self._n_failures == _MOST_FAILURES and self._last is not None and self._last.reason is not None:
            text = f"{_MOST_FAILURES} pushes in a row failed, the last one by this: {self._last.text}"
            raise CaptureError(FailureReason.ROBOT, f"{text}; nothing moves until resume() is called")
        if self.arm.interrupted:
            raise CaptureError(
                FailureReason.INTERRUPTED, "a signal has ended this: nothing moves until resume()"
            )
        self.arm.get_ready()
        # Rows of before the call are of no push that is to come, unless they are those of recordings.
        if self._reader is None or not self.stream.replays:
            self._reader = self.stream.buffer.reader(from_oldest=self.stream.replays)
        return Attempt(self, self.capture(), self._reader)

    def capture(self) -> Capture:
        """Return the capture of the next push."""
        trigger = self._trigger()
        if isinstance(trigger, ForceTrigger) and self.by_hand and not self.stream.replays:
            trigger.direction = self.force_direction
        return Capture(
            self.stream.info,
            trigger,
            self.limits,
            n_samples=self.n_samples,
            pre_s=self.pre_s,
            since_ns=self.clock.now_ns(),
            utc_at_zero_s=self.stream.utc_at_zero_s,
        )

    def motion_s(self, capture: Capture) -> float:
        """Return how long the robot must move for a capture."""
        return (capture.n_samples - capture.n_pre) / capture.rate_hz + _MARGIN_S

    def resume(self) -> None:
        """Go on after a limit, an error of the robot or three failures, from where the tool stands now."""
        self._n_failures, self.back_first = 0, False
        self.arm.resume()

    def ended(self, capture: Capture, *, moved: bool, early: bool) -> None:
        """Take note of how a push has ended; `moved`: a motion of it was commanded."""
        self._last, moved = capture, moved and not self.by_hand
        failed = capture.reason is not None and not early
        if capture.reason is not FailureReason.INTERRUPTED:  # from outside: no failure of the arm's
            self._n_failures = self._n_failures + moved if failed else 0
        if moved:
            self.back_first = failed or early


class Attempt:
    """One push under way: iterate over it for its steps, within ``with``; afterwards `capture` holds what came of it.

    At the end of the block the robot stands, or CaptureError says that it could not be stopped. Leave the loop early,
    or raise, and it is stopped.
    """

    def __init__(self, pushes: Pushes, capture: Capture, reader: WrenchReader) -> None:
        self.capture = capture
        self.answered = False  # early: what ends the push is no failure
        self.motion: Motion | None = None  # once the robot has taken the command
        self._pushes, self._reader = pushes, reader
        self._stream, self._clock, self._arm = pushes.stream, pushes.clock, pushes.arm
        self._newest: Block | None = None
        self._begun_s: float | None = None  # device time of the newest row when the push was commanded
        self._moved = self._commanded = False  # commanded: its push; moved: the way back as well
        self._over = False  # left by nobody

    def __enter__(self) -> Self:
        return self

    def __iter__(self) -> Iterator[Step]:
        """Yield some fifty times a second, or as rows come in.

        Steps after the last row, while the robot comes to its stand or moves back, have no rows for the recording.
        """
        capture, arm = self.capture, self._arm
        if self._pushes.back_first and self._hears():
            yield from self._go_back()
        heard_ns, held = self._clock.now_ns(), list[Block]()
        while not capture.state.is_over:
            self._clock.wait(self._reader, WAIT_S)
            # Of recordings no row of the next push may be read with this one, however fast they are played.
            most = capture.n_samples - max(capture.n_rows, capture.n_pre) if self._stream.replays else None
            block = self._reader.read(most)
            if len(block):
                self._newest, heard_ns = block, self._clock.now_ns()
            elif not arm.moves:
                self._check_source(1e-9 * (self._clock.now_ns() - heard_ns))
            if self._arm.interrupted:
                capture.fail(FailureReason.INTERRUPTED, "ended by a signal")
            held.append(block)
            if arm.moves and arm.motion is None and arm.fault is None:
                continue  # the trigger must know the motion before it sees these rows
            if self._commanded and self.motion is None and arm.motion is not None and arm.fault is None:
                self._follow(arm.motion)
            while held:
                step = self._fed(held.pop(0))
                if capture.state is CaptureState.ARMED and not self._commanded:
                    self._push()  # before anybody looks at the step, which may take long: the rest is of now
                yield step
        if capture.state is CaptureState.COMPLETE:
            yield from self._stand()
            if capture.state is CaptureState.COMPLETE:
                yield from self._go_back()
        self._over = True

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        capture, arm = self.capture, self._arm
        left = not (self._over or self.answered)  # while it brakes or moves back, too
        capture.fail(FailureReason.INTERRUPTED, "ended from outside", complete=left)
        try:
            if capture.reason is not None or arm.moves:  # or it was answered at its last row
                arm.stop(capture.reason or FailureReason.INTERRUPTED, capture.text or "answered")
                arm.wait_until_it_stands(self._reader)
        finally:
            self._end()
            if capture.reason is None or self.answered:
                self._learn_direction()
            self._pushes.ended(capture, moved=self._moved, early=self.answered)

    def facts(self, truth: str | None) -> dict[str, Any]:
        """Gather what is worth keeping beside the samples; an odd report must not cost the recording."""
        facts: dict[str, Any] = {} if truth is None else {"truth": truth}
        if self.motion is not None:
            try:
                report = thaw(freeze(dict(self.motion.report()), "the robot's report"))
            except Exception as error:  # whatever the robot's library raises
                report = {"report_error": f"{type(error).__name__}: {error}"}
            facts["robot"] = {**report, "error": self.motion.error}
        return facts

    @property
    def truth(self) -> str | None:
        """The material, where the source knows it; a replay may have moved on meanwhile."""
        return self._stream.truth_at(self.capture.trigger_time_s)

    def _end(self) -> None:
        """Say why and how the arm was stopped."""
        capture, arm = self.capture, self._arm
        if arm.fault is None:
            return
        if arm.blocked is not None:  # counts most: nothing moves any more
            self.answered = False
            capture.fail(*arm.blocked, complete=True)
            capture.reason, capture.text = arm.blocked
        if capture.reason is not None and (arm.blocked in (None, arm.fault) or not arm.moves):
            capture.text += arm.ending

    def _learn_direction(self) -> None:
        capture = self.capture
        is_first = self._pushes.by_hand and self._pushes.force_direction is None
        if is_first and isinstance(capture.trigger, ForceTrigger) and capture.n_rows:
            first = capture.rows.wrench[capture.n_pre :][: round(_DIRECTION_S * capture.rate_hz)]
            self._pushes.force_direction = first[:, :3].mean(axis=0) - self._rest()[:3]

    def _fed(self, block: Block) -> Step:
        capture, pushes = self.capture, self._pushes
        rows = capture.feed(block, self._stream.lag_s())
        if self._arm.fault is not None:
            capture.fail(*self._arm.fault)
        if len(rows) and pushes.by_hand and pushes.limits.watched:
            if beyond := pushes.limits.beyond(capture.rows[-len(rows) :], self._rest()):
                capture.fail(FailureReason.LIMIT, beyond)
        elif len(rows) and not pushes.by_hand and capture.state is CaptureState.TRIGGERED:
            self._check_contact()
        return Step(block, rows)

    def _push(self) -> None:
        """Set the robot in motion; a person is only prompted."""
        pushes, self._commanded = self._pushes, True
        self._begun_s = None if self._newest is None else float(self._newest.time_s[-1])
        seconds, pushes.rest = pushes.motion_s(self.capture), self._rest()
        if pushes.first_rest is None:
            pushes.first_rest = pushes.rest
        if borne := pushes.limits.beyond(self.capture.rest, pushes.first_rest):
            self.capture.fail(FailureReason.LIMIT, f"before the push the tool bears a {borne}")
            return
        self._moved = True
        self._arm.push(pushes.direction, pushes.speed_m_s, seconds, seconds - _MARGIN_S, pushes.rest)

    def _hears(self) -> bool:
        """Wait for a row: no arm moves where the sensor is silent."""
        begun_ns = self._clock.now_ns()
        while not (self._reader.wait(0.0) or self.capture.state.is_over):
            self._clock.wait(self._reader, WAIT_S)
            self._check_source(1e-9 * (self._clock.now_ns() - begun_ns))
        return not self.capture.state.is_over

    def _follow(self, motion: Motion) -> None:
        self.motion = motion
        start_s, info = motion.start_time_s, self._stream.info
        if start_s is not None and self._begun_s is not None and self._newest is not None:
            now_s, behind_s = float(self._newest.time_s[-1]), _BEHIND_S * max(1.0, info.speed)
            if not self._begun_s - behind_s <= start_s <= now_s + _AHEAD_S:
                both = f"the robot's motion begins at {start_s:.3f} s, the sensor's newest row is of {now_s:.3f} s"
                self.capture.fail(FailureReason.ROBOT, f"{both}: they do not share a clock")
        if isinstance(self.capture.trigger, MotionTrigger):
            self.capture.trigger.follow(motion)

    def _check_contact(self) -> None:
        """Refuse a force that comes so late that the last rows would be of an arm that stands."""
        capture, motion = self.capture, self.motion
        if motion is None or isinstance(capture.trigger, MotionTrigger):
            return
        if motion.start_time_s is None or capture.trigger_time_s is None:
            late_s = 1e-9 * (capture.trigger_ns - motion.start_host_ns) * self._stream.info.speed
        else:
            late_s = capture.trigger_time_s - motion.start_time_s
        n = round((late_s - _MARGIN_S) * capture.rate_hz)
        if n > 0:
            rows = f"the last {n} rows would be of an arm that stands"
            capture.fail(FailureReason.LATE_CONTACT, f"contact {late_s:.1f} s after the start: {rows}")

    def _stand(self) -> Iterator[Step]:
        """Read on until the arm stands; what goes wrong meanwhile fails the push."""
        arm = self._arm
        while arm.moves and arm.fault is None:
            self._clock.wait(self._reader, WAIT_S)
            yield Step(self._reader.read(), Rows.none().wrench)
            if self._arm.interrupted:
                self.capture.fail(FailureReason.INTERRUPTED, "ended by a signal", complete=True)
                return
        if arm.fault is not None:
            self.capture.fail(*arm.fault, complete=True)

    def _go_back(self) -> Iterator[Step]:
        self._moved = True
        self._arm.go_back(self._pushes.rest)
        yield from self._stand()

    def _rest(self) -> NDArray[np.float64]:
        """Return the wrench at rest: what limits count from."""
        rest, newest = self.capture.rest.wrench, self._newest
        if len(rest):
            return np.asarray(rest.mean(axis=0))
        return np.zeros(len(self._stream.info.axes)) if newest is None else newest.wrench[-1]

    def _check_source(self, quiet_s: float) -> None:
        if fault := self._stream.fault(quiet_s, _QUIET_S):
            self.capture.fail(*fault)
