"""Stream, robot and capture together: one push from the first row at rest to the last one."""

from __future__ import annotations

import time
from collections.abc import Generator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from granular_id._core import WrenchReader
from granular_id.live.capture import Capture
from granular_id.live.capture_state import CaptureState, FailureReason
from granular_id.live.robot import Motion, Robot
from granular_id.live.rows import BlockLike
from granular_id.live.stream import Stream
from granular_id.live.trigger import MotionTrigger

__all__ = ["Step", "drive", "motion_duration_s"]

_WAIT_S = 0.02
"""How long to wait for a row at a time: so soon are errors, Ctrl-C and the end noticed."""

_MARGIN_S = 0.05
"""So much longer does the robot move than is recorded: no sample may fall into its braking."""


@dataclass(frozen=True)
class Step:
    """What came of one look at the buffer.

    Attributes
    ----------
    block : Block
        All rows that were read, none perhaps.
    rows : ndarray, shape (k, 6)
        Those that belong to the capture, in order.
    motion : Motion or None
        The robot's, once commanded.
    """

    block: BlockLike
    rows: NDArray[np.float64]
    motion: Motion | None


def motion_duration_s(capture: Capture) -> float:
    """Return how long the robot must move for a capture."""
    return (capture.n_samples - capture.n_pre) / capture.rate_hz + _MARGIN_S


def drive(
    stream: Stream,
    capture: Capture,
    *,
    robot: Robot | None = None,
    direction: Sequence[float] = (1.0, 0.0, 0.0),
    speed_m_s: float = 0.03,
    rows_timeout_s: float = 1.0,
    reader: WrenchReader | None = None,
) -> Generator[Step, None, None]:
    """Feed a capture until it is over; the robot is set in motion as soon as the rest is there.

    Close the generator when you leave its loop early (``contextlib.closing``): the robot is stopped then, as it is
    on any failure and on Ctrl-C.

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
        A source that delivers nothing for so long has failed.
    reader : WrenchReader, optional
        Read on from there. Default: a new one, which begins with the rows that come in from now on.

    Yields
    ------
    Step
        Some fifty times a second, or as rows come in. When the last one was given, `capture` is over.
    """
    reader = stream.buffer.reader() if reader is None else reader
    motion: Motion | None = None
    newest_s = time.monotonic()
    came_to_its_end = False
    try:
        while not capture.state.is_over:
            reader.wait(_WAIT_S)
            block = reader.read()
            rows = capture.feed(block, stream.lag_s())
            if len(block):
                newest_s = time.monotonic()
            else:
                _check_source(stream, capture, time.monotonic() - newest_s, rows_timeout_s)
            if robot is not None and motion is None and capture.state is CaptureState.ARMED:
                motion = _set_in_motion(robot, capture, direction, speed_m_s)
            if motion is not None:
                motion.finished()  # many controllers tell an error only when asked for the end
                if motion.error is not None:
                    capture.fail(FailureReason.ROBOT, f"the robot's motion failed: {motion.error}")
            yield Step(block, rows, motion)
        came_to_its_end = capture.state is CaptureState.COMPLETE
    finally:
        if not came_to_its_end:
            capture.fail(FailureReason.INTERRUPTED, "ended from outside")
            if robot is not None:
                robot.stop()


def _set_in_motion(
    robot: Robot, capture: Capture, direction: Sequence[float], speed_m_s: float
) -> Motion | None:
    try:
        motion = robot.move_line(direction, speed_m_s, motion_duration_s(capture))
    except Exception as error:  # whatever the robot's library raises
        capture.fail(FailureReason.ROBOT, f"the robot refused the motion: {error}")
        return None
    if isinstance(capture.trigger, MotionTrigger):
        capture.trigger.follow(motion)
    return motion


def _check_source(stream: Stream, capture: Capture, silent_s: float, timeout_s: float) -> None:
    health = stream.source.health()
    if health.error is not None:
        capture.fail(FailureReason.SOURCE, f"the source died: {health.error}")
    elif health.finished and silent_s > 2 * _WAIT_S:  # so that what it wrote last was read
        capture.fail(FailureReason.SOURCE, "the source came to its end")
    elif silent_s > timeout_s:
        capture.fail(FailureReason.NO_ROWS, f"{stream.info.name} delivered nothing for {timeout_s:g} s")
