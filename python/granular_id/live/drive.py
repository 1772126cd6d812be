"""Stream, robot and capture together: one push from the first row at rest to the last one."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import argument_error, freeze, thaw
from granular_id._core import WrenchReader, host_ns
from granular_id.live.capture import Capture, CaptureError, CaptureState, FailureReason
from granular_id.live.priority import at_once, reading_threads
from granular_id.live.robot import Motion, Robot, checked_motion
from granular_id.live.rows import BlockLike, Rows
from granular_id.live.setup import starts_exactly
from granular_id.live.stopping import InMotion
from granular_id.live.stream import Stream, left_out
from granular_id.live.trigger import MotionTrigger, Trigger
from granular_id.recording import SampleFlag

__all__ = [
    "LIMITS",
    "Step",
    "capture_from",
    "check_limits",
    "drive",
    "limits_matter",
    "motion_duration_s",
    "push_facts",
    "step_warnings",
    "truth_of",
    "was_cut_short",
]

_WAIT_S = 0.02
_LONGEST_WAIT_S = 1.0  # of a robot for what `may_move` speaks for: a view that is stuck holds up no push
"""How long to wait for a row at a time: so soon are errors, Ctrl-C and the end noticed."""

_MARGIN_S = 0.05
"""So much longer does the robot move than is recorded: no sample may fall into its braking."""

_STAND_S = 2.0
"""So long may a robot brake after `stop`, or after its motion should have ended where that is later."""

_BACK_S = 60.0
"""So long may the way back take, which is as long as the push, and as fast as the robot likes."""

_BEHIND_S, _AHEAD_S = 0.02, 30.0
"""So far from the newest row may the start of a motion be: further, and its clock is not the sensor's."""


@dataclass(frozen=True)
class Step:
    """What came of one look at the buffer.

    All rows that were read, none perhaps; those of them that belong to the capture, shape (k, C); and the motion of the
    robot, once commanded.
    """

    block: BlockLike
    rows: NDArray[np.float64]
    motion: Motion | None


LIMITS = (
    "max_gap",
    "allow_saturated",
    "rate_tolerance",
    "max_lag_s",
    "lag_patience_s",
    "timeout_s",
    "max_force_n",
    "max_torque_n_m",
)
"""What a push must be like: parameters of `Capture`."""


def check_limits(given: Iterable[str], known: Sequence[str] = LIMITS) -> None:
    """Refuse limits that there are none of."""
    for name in given:
        if name not in known:
            raise argument_error(TypeError, name, f"is not known here; known limits: {', '.join(known)}")


def capture_from(stream: Stream, trigger: Trigger, **limits: Any) -> Capture:
    """Return a new capture of what a stream delivers; `limits` are further parameters of `Capture`."""
    check_limits(limits, ("n_samples", "pre_s", *LIMITS))
    info = stream.info
    return Capture(info.rate_hz, trigger=trigger, info=info, utc_at_zero_s=stream.utc_at_zero_s, **limits)


def motion_duration_s(capture: Capture) -> float:
    """Return how long the robot must move for a capture."""
    return (capture.n_samples - capture.n_pre) / capture.rate_hz + _MARGIN_S


def limits_matter(stream: Stream, robot: Robot | None, capture: Capture) -> bool:
    """Whether a real robot is to be stopped at a limit, so that every millisecond counts."""
    return starts_exactly(robot) and capture.has_limits and not stream.info.synthetic


def was_cut_short(capture: Capture, motion: Motion | None) -> bool:
    """Whether a robot was stopped on its push for a reason that the next push may not share: it may go back first."""
    return motion is not None and capture.reason is not None and not capture.reason.is_lasting


def truth_of(stream: Stream, capture: Capture) -> str | None:
    """Return the material of a capture, where the source knows it; a replay may have moved on meanwhile."""
    begun_s = capture.trigger_time_s
    return stream.truth if begun_s is None else stream.truth_at(begun_s)


def push_facts(truth: str | None, motion: Motion | None) -> dict[str, Any]:
    """Gather what is worth keeping beside the samples; an odd report must not cost the recording."""
    facts: dict[str, Any] = {} if truth is None else {"truth": truth}
    if motion is not None:
        try:
            report = thaw(freeze(dict(motion.report()), "the robot's report"))
        except Exception as error:  # whatever the robot's library raises
            report = {"report_error": f"{type(error).__name__}: {error}"}
        facts["robot"] = {**report, "error": motion.error}
    return facts


def step_warnings(capture: Capture, step: Step, lag_s: float, *, is_first: bool) -> Iterator[str]:
    """Yield what an answer about the rows of a step should warn of."""
    # Putting all rows of a capture together takes the longer, the longer it lasts: only where there is something to
    # find. The first rows came in earlier blocks as well.
    if is_first or step.block.flags.any() or step.block.missing_before.any():
        flags = capture.rows.flags[-len(step.rows) :]
        if (flags & SampleFlag.GAP_FILLED).any():
            yield "gap"
        if (flags & SampleFlag.SATURATED).any():
            yield "saturation"
    if lag_s > capture.max_lag_s:
        yield "lag"


def drive(
    stream: Stream,
    capture: Capture,
    *,
    robot: Robot | None = None,
    direction: Sequence[float] = (1.0, 0.0, 0.0),
    speed_m_s: float = 0.03,
    rows_timeout_s: float = 1.0,
    reader: WrenchReader | None = None,
    may_move: Callable[[], bool] = lambda: True,
    back_first: bool = False,
) -> Generator[Step, None, None]:
    """Feed a capture until it is over and the robot stands; it is set in motion as soon as the rest is there.

    A robot that can go back to where the push began (`move_back`) is sent there when all rows are taken, and stands
    there at the end. Every row from the first command on is held against `max_force_n` and `max_torque_n_m` of the
    capture before anything else is done with it, also those after the last one that is taken: beyond, the robot is
    stopped and the capture has failed. So that no busy program comes between, this thread and those that read the
    sensor get real-time priority meanwhile, where the system grants it (see :doc:`/guide/live`).

    Whenever this ends, the robot stands, or CaptureError says that it could not be stopped. It is stopped on any
    failure, on Ctrl-C, where a motion lasts for twice its time, where you leave the loop early and close the generator
    (``contextlib.closing``), and at the end of the interpreter. On SIGTERM and SIGHUP it ends within
    `stop_on_signals`, and none begins after one. After ``stop()`` the motion must be `finished` within 2 s, or within
    2 s of when it should have ended by itself. While it goes on, no other begins: the next push of that robot fails
    with `FailureReason.ROBOT`, and calls ``stop()`` again.

    Parameters
    ----------
    stream : Stream
    capture : Capture
        New; a `MotionTrigger` is told the robot's motion.
    robot : Robot, optional
        None: somebody else moves, and the trigger notices.
    direction, speed_m_s
        See `Robot.move_line`; the paper's 0.03 m/s.
    rows_timeout_s : float, default 1
        A source that delivers nothing for so long has failed; pauses of its own come on top.
    reader : WrenchReader, optional
        Read on from there; rows that wait in it do not count for `timeout_s`. Default: a new one, which begins with
        the rows that come in from now on.
    may_move : callable, optional
        The robot waits at rest until this says True, a second at most.
    back_first : bool, default False
        A robot that can is sent back to where its last push began before the rest is looked for: the push before this
        one was stopped on its way.

    Yields
    ------
    Step
        Some fifty times a second, or as rows come in. Those after the capture is complete, while the robot comes to
        its stand, have no rows for it: what is read there is none of the next push's rest. What you do with a step
        takes its time from the look at the next rows, and so from the limits.

    Raises
    ------
    CaptureError
        The robot could not be stopped (`FailureReason.ROBOT`): ``stop()`` has raised, or its motion goes on.
    """
    reader = stream.buffer.reader() if reader is None else reader
    capture.since_ns = host_ns()
    motion: Motion | None = None
    newest: BlockLike | None = None
    silent_s = rows_timeout_s + stream.pause_s
    stands = False
    moving = InMotion(robot)
    priority = ExitStack()
    try:
        urgent = limits_matter(stream, robot, capture)
        priority.enter_context(at_once(reading_threads(stream.source)) if urgent else nullcontext())
        _begin(moving, capture)
        standing = _Standing(reader, capture, moving, robot)
        yield from standing.go_back() if back_first and not capture.state.is_over else ()
        heard_s, may = time.monotonic(), _within_a_while(may_move)
        while not capture.state.is_over and not moving.is_told:
            reader.wait(_WAIT_S)
            block = reader.read()
            if motion is not None and (beyond := capture.beyond_limit(block)):
                capture.fail(FailureReason.LIMIT, beyond)
                break  # to the robot's stop, before anything else
            if len(block):
                if motion is not None and newest is not None:
                    _check_epoch(capture, motion, newest, block)
                newest, heard_s = block, time.monotonic()
            rows = capture.feed(block, stream.lag_s())
            if not len(block):
                _check_source(stream, capture, time.monotonic() - heard_s, silent_s)
            ready = capture.state is CaptureState.ARMED and not moving.is_told
            if robot is not None and motion is None and ready and may():
                moving.moves = starts_exactly(robot)  # else a person, who was only told
                motion = _set_in_motion(robot, moving, capture, direction, speed_m_s, newest)
            if motion is not None:
                _check_motion(motion, capture)
            yield Step(block, rows, motion)
        if capture.state is CaptureState.COMPLETE:
            stands = motion is None or (yield from standing.come_to_it(motion))
    finally:
        try:
            if not stands:
                who = "by a signal; nothing begins to move any more" if moving.is_told else "from outside"
                capture.fail(FailureReason.INTERRUPTED, f"ended {who}")
                _stop(moving, capture, reader)
        finally:
            priority.close()
            moving.over(stands=stands)
        moving.raise_signal()  # not where it could not be stopped: that is the first thing to know


def _within_a_while(may_move: Callable[[], bool]) -> Callable[[], bool]:
    until_s = np.inf

    def may() -> bool:
        nonlocal until_s
        until_s = min(until_s, time.monotonic() + _LONGEST_WAIT_S)
        return may_move() or time.monotonic() > until_s

    return may


@dataclass(frozen=True)
class _Standing:
    """What comes after the last row of a capture, until the robot stands: at its start, where it can go back."""

    reader: WrenchReader
    capture: Capture
    moving: InMotion
    robot: Robot | None

    def come_to_it(self, push: Motion) -> Generator[Step, None, bool]:
        """Wait for the end of the push and of the way back; False: the robot must be stopped."""
        if not (yield from self._ended(push, push, motion_duration_s(self.capture))):
            return False
        yield from self.go_back(push)
        return self.capture.state is CaptureState.COMPLETE

    def go_back(self, push: Motion | None = None) -> Generator[Step, None, None]:
        """Send the robot back and wait for it; the capture fails where it does not get there."""
        back = None if self.moving.is_told else _way_back(self.robot, self.moving, self.capture)
        if back is None:
            return
        if not (yield from self._ended(push, back, _BACK_S)) or back.error is not None:
            why = back.error or f"it was not over within {_BACK_S:g} s"
            self.capture.fail(FailureReason.ROBOT, f"the robot's way back failed: {why}", complete=True)

    def _ended(self, push: Motion | None, motion: Motion, seconds: float) -> Generator[Step, None, bool]:
        """Read on until a motion has ended; False: not within the time, a signal came, or a limit was passed."""
        deadline_s, stands = time.monotonic() + seconds, False
        while not stands and not self.moving.is_told and time.monotonic() < deadline_s:
            stands = motion.finished()
            self.reader.wait(_WAIT_S)
            block = self.reader.read()
            if beyond := self.capture.beyond_limit(block):
                self.capture.fail(FailureReason.LIMIT, beyond, complete=True)
                return False
            yield Step(block, Rows.none().wrench, push)
        return stands


def _begin(moving: InMotion, capture: Capture) -> None:
    moving.begin()
    if moving.motion is not None:
        capture.fail(FailureReason.ROBOT, "the robot's last motion still went on")


def _way_back(robot: Robot | None, moving: InMotion, capture: Capture) -> Motion | None:
    """Send a robot back to where its push began; None where it cannot go, or refuses to."""
    move_back: Callable[[], Motion | None] | None = getattr(robot, "move_back", None)
    try:
        back = None if move_back is None else move_back()
    except Exception as error:  # whatever the robot's library raises
        capture.fail(FailureReason.ROBOT, f"the robot refused the way back: {error}", complete=True)
        return None
    if back is None:
        return None
    moving.moves = True
    return moving.command(checked_motion(back, "move_back"), 0.0)


def _set_in_motion(
    robot: Robot,
    moving: InMotion,
    capture: Capture,
    direction: Sequence[float],
    speed_m_s: float,
    newest: BlockLike | None,
) -> Motion | None:
    duration_s = motion_duration_s(capture)
    try:
        motion = robot.move_line(direction, speed_m_s, duration_s)
    except Exception as error:  # whatever the robot's library raises
        capture.fail(FailureReason.ROBOT, f"the robot refused the motion: {error}")
        return None
    moving.command(checked_motion(motion, "move_line"), duration_s)
    start_s = motion.start_time_s
    if start_s is not None and newest is not None:
        now_s = float(newest.time_s[-1])
        if not now_s - _BEHIND_S <= start_s <= now_s + _AHEAD_S:
            text = (
                f"the robot's motion begins at {start_s:.3f} s, the sensor's newest row is of {now_s:.3f} s"
            )
            capture.fail(FailureReason.ROBOT, f"{text}: they do not share a clock")
    if isinstance(capture.trigger, MotionTrigger):
        capture.trigger.follow(motion)
    return motion


def _stop(moving: InMotion, capture: Capture, reader: WrenchReader) -> None:
    """Stop the robot, and wait until it stands: what comes in meanwhile is none of the next push's rest."""
    try:
        moving.end()
    except (KeyboardInterrupt, SystemExit):
        moving.end()  # a second Ctrl-C must not leave it moving
        raise
    except Exception as error:  # whatever the robot's library raises
        raise _not_stopped(f"{type(error).__name__}: {error}", capture) from error
    begun_s = time.monotonic()
    until_s = max(begun_s, moving.due_s) + _STAND_S
    while not moving.stands:
        if time.monotonic() > until_s:
            raise _not_stopped(f"its motion goes on {time.monotonic() - begun_s:.1f} s after stop()", capture)
        reader.wait(_WAIT_S)
        reader.read()
    if moving.moves and moving.motion is not None and capture.reason is not None:
        capture.text += "; the robot was stopped"


def _not_stopped(how: str, capture: Capture) -> CaptureError:
    why = capture.text or "its motion did not end by itself"
    text = f"the robot could not be stopped: {how} (it was to stop: {why})"
    capture.state, capture.reason, capture.text = CaptureState.FAILED, FailureReason.ROBOT, text
    return CaptureError(FailureReason.ROBOT, text)


def _check_motion(motion: Motion, capture: Capture) -> None:
    motion.finished()  # many controllers tell an error only when asked for the end
    if motion.error is not None:
        capture.fail(FailureReason.ROBOT, f"the robot's motion failed: {motion.error}")


def _check_epoch(capture: Capture, motion: Motion, before: BlockLike, block: BlockLike) -> None:
    """Fail where device time has begun anew: a start in it says nothing any more."""
    if motion.start_time_s is not None and block.epoch != before.epoch:
        text = "the sensor's time began anew after the motion was commanded"
        if capture.n_rows:
            text += f", {capture.n_rows} of {capture.n_samples} rows in"
        capture.fail(FailureReason.RESTART, text)


def _check_source(stream: Stream, capture: Capture, silent_s: float, timeout_s: float) -> None:
    health = stream.health()
    if health.error is not None:
        capture.fail(FailureReason.SOURCE, f"the source died: {health.error}")
    elif health.finished and silent_s > 2 * _WAIT_S:  # so that what it wrote last was read
        capture.fail(FailureReason.SOURCE, "the source came to its end")
    elif silent_s > timeout_s:
        said = f"{stream.info.name} delivered nothing for {timeout_s:g} s{left_out(health.counters)}"
        capture.fail(FailureReason.NO_ROWS, said)
