"""Who owns a robot's arm: a thread that watches rows, source and arm from before it moves until it stands."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granular_id._core import Block, WrenchReader
from granular_id._text import counted
from granular_id.live import signals
from granular_id.live.capture import RESTART, missing, overrun
from granular_id.live.clock import WAIT_S
from granular_id.live.limits import Limits
from granular_id.live.outcome import CaptureError, FailureReason, Fault
from granular_id.live.priority import reading_threads
from granular_id.live.robot import Motion, Robot, checked_motion, checked_move, goes_back
from granular_id.live.rows import BAD
from granular_id.live.stream import Stream

__all__ = ["Mover", "Supervisor"]

_LOG = logging.getLogger(__name__)

_SILENT_S, _SILENT_SIMULATED_S, _SILENT_ROWS = 0.1, 5.0, 5
"""So long may no row come while an arm moves; a simulated arm hurts nobody, and shares a computer with its sensor."""

_FROZEN_S = 0.25
_AGAIN_S, _MOST_CALLS = 0.05, 3
"""How often ``stop()`` is called until the arm stands, and how many calls may be on their way."""

_BRAKE_S = 2.0
"""So long may a robot brake after ``stop()``, or after its push should have ended where that is later."""

_BACK_S = 60.0
"""So long may the way back take, which is as long as the push, and as fast as the robot likes."""

_ANSWER_S = 2.0
"""So long may one call of a driver take, the command too: beyond, nobody knows what the arm does."""

_BLIND_S, _REFUSED_S = 0.5, 0.5
"""So long may nobody look at the rows; so long is stop() repeated after a command that failed, and may be taken."""

_AHEAD_S = 30.0
"""So long after its command may a motion begin."""

_STILL_M, _STILL_S = 1e-4, 0.25
"""A tool that has moved by less for so long after ``stop()`` stands."""

_BESIDE_M, _BESIDE_BACK_M = 0.01, 0.1
"""So far may a tool be from the line of its push; on the way back it may be lifted over the bed."""

_START_M = 0.005
"""So far from the start of the first push may another begin: arms, and people who guide them, are not exact."""

_GOES_ON = "the robot's last motion still goes on: nothing else moves it before it stands"


@dataclass(frozen=True)
class _Path:
    """Where a tool may be during a push, and how much of it must be whole."""

    direction: NDArray[np.float64]
    length_m: float
    duration_s: float
    recorded_s: float
    origin: NDArray[np.float64] | None = None


class _Seen(NamedTuple):
    """What a robot's driver says of its motion, when, and how often `stop` was called before it was queried."""

    finished: bool
    error: str | None
    place: NDArray[np.float64] | None
    at_ns: int
    n_stops: int


class _PlaceError(RuntimeError):
    """The tool is not where a push may begin."""


class Mover:
    """Whoever pushes, a person or a machine: a signal that ends the program ends either."""

    def __init__(self) -> None:
        self._n_signals = signals.number_heard()

    @property
    def interrupted(self) -> bool:
        """Whether a signal that ends the program was heard since this was made, or since `resume`."""
        return signals.number_heard() != self._n_signals

    def resume(self) -> None:
        """Let it move again."""
        self._n_signals = signals.number_heard()


class Supervisor(Mover):
    """Owns an arm from before it moves until it stands, on its way back as well.

    Three threads run while the arm moves. One watches every row against the limits, the source and what the robot says;
    one talks to the robot's driver, which may hang without holding up the first; one waits for a reason to call
    ``stop()``, which is repeated by others until the arm stands. Whoever commands a motion waits for none of them: it
    looks at `moves` and `fault`.
    """

    def __init__(self, stream: Stream, robot: Robot, limits: Limits) -> None:
        super().__init__()
        self.blocked: Fault | None = None  # after which nothing moves until `resume`
        self.watch: Watch | None = None  # of the latest motion
        self.stream, self.robot, self.limits, self.clock = stream, robot, limits, stream.clock
        self._first: NDArray[np.float64] | None = None  # where the first push began
        self._is_away = False  # it has pushed, and can neither go back nor say where it is
        self.path = _Path(np.zeros(3), 0.0, 0.0, 0.0)  # of the latest push

    @property
    def moves(self) -> bool:
        """Whether a motion was commanded and is not known to have ended."""
        return self.watch is not None and not self.watch.standing.is_set()

    @property
    def fault(self) -> Fault | None:
        """Why the latest motion was stopped."""
        return None if self.watch is None else self.watch.fault

    @property
    def motion(self) -> Motion | None:
        """The latest motion; None until the robot has taken the command."""
        return None if self.watch is None else self.watch.motion

    @property
    def ending(self) -> str:
        """How the latest motion was stopped, to follow the reason."""
        return "" if self.watch is None else self.watch.ending

    def get_ready(self) -> None:
        """Forget the last motion; CaptureError where nothing may begin to move."""
        self._check()
        if self._is_away:
            lacks = "the robot can neither go back (move_back) nor tell its place (tcp_pose)"
            raise CaptureError(FailureReason.ROBOT, f"{lacks}: bring the tool back, then call resume()")
        self.watch = None

    def _check(self) -> None:
        self._check_others()
        if self.moves:
            raise CaptureError(FailureReason.ROBOT, _GOES_ON)
        if self.blocked is not None:
            text = f"nothing moves until resume() is called, after this: {self.blocked.text}"
            raise CaptureError(self.blocked.reason, text)

    def _check_others(self) -> None:
        own: object = self.watch
        if any(one.robot is self.robot and one is not own for one in tuple(signals.MOVING)):
            raise CaptureError(FailureReason.ROBOT, _GOES_ON)

    def push(
        self,
        direction: Sequence[float],
        speed_m_s: float,
        duration_s: float,
        recorded_s: float,
        rest: NDArray[np.float64],
    ) -> None:
        """Command a push, of which the first `recorded_s` must be whole; limits count from the wrench `rest`."""
        ahead, speed_m_s, duration_s = checked_move(direction, speed_m_s, duration_s)
        self._check()
        self.path = _Path(np.array(ahead), speed_m_s * duration_s, duration_s, recorded_s)

        def command() -> Motion | None:
            place = self.place()
            self.path = replace(self.path, origin=place)
            if self._first is None:
                self._first = place
            elif place is not None and (off_m := float(np.linalg.norm(place - self._first))) > _START_M:
                raise _PlaceError(
                    f"the tool stands {1e3 * off_m:.0f} mm from where the first push began: bring it back, then call "
                    "resume()"
                )
            if self.fault is not None:  # while the robot was queried for its place
                return None
            self._is_away = place is None and not goes_back(self.robot)
            return checked_motion(self.robot.move_line(direction, speed_m_s, duration_s), "move_line")

        self._begin(command, rest, returns=False)

    def go_back(self, rest: NDArray[np.float64]) -> None:
        """Send the arm back to where its push began, where it can go back."""
        move_back: Callable[[], Motion | None] | None = getattr(self.robot, "move_back", None)
        if move_back is not None:

            def command() -> Motion | None:
                motion = move_back()
                return None if motion is None else checked_motion(motion, "move_back")

            self._begin(command, rest, returns=True)

    def stop(self, reason: FailureReason, text: str) -> None:
        """Stop the arm where it moves; the first reason counts. After a limit or an error nothing moves any more."""
        watch = self.watch
        self.block(Fault(reason, text))
        if watch is not None:
            watch.stop(reason, text)

    def block(self, fault: Fault) -> None:
        """Let nothing move until `resume`, after a limit or an error."""
        if self.blocked is None and fault.reason in (FailureReason.LIMIT, FailureReason.ROBOT):
            self.blocked = fault

    def resume(self) -> None:
        """Let the arm move again after a limit or an error, from where it stands now."""
        super().resume()
        self.blocked = self._first = None
        self._is_away = False

    def wait_until_it_stands(self, reader: WrenchReader) -> None:
        """Wait for the end of a motion that is being stopped; CaptureError where it goes on."""
        while self.moves and self.watch is not None:
            if (fault := self.watch.not_stopped()) is not None:
                self.blocked = fault
                raise CaptureError(*fault)
            self.clock.wait(reader, WAIT_S)
            reader.read()

    def place(self) -> NDArray[np.float64] | None:
        """Ask the robot where the tool is; None where it cannot tell."""
        tell: Callable[[], Any] | None = getattr(self.robot, "tcp_pose", None)
        pose = None if tell is None else tell()
        return None if pose is None else np.asarray(pose, np.float64)[:3].reshape(3)

    def _begin(
        self, command: Callable[[], Motion | None], rest: NDArray[np.float64], *, returns: bool
    ) -> None:
        self._check()
        watch = Watch(self, command, rest, returns=returns)
        urgent = None if self.stream.info.synthetic else reading_threads(self.stream.source)
        besides: list[int] | None = None if urgent is None else []
        try:
            self.watch = watch
            signals.MOVING.add(watch)
            self._check_others()  # again: another thread may have begun meanwhile
            if self.interrupted:  # since it was looked at; from here on a signal stops this motion
                watch.stop(FailureReason.INTERRUPTED, "ended by a signal")
            self.clock.start(watch.call_stop, watch.must_stop, besides)
            self.clock.start(watch.look, watch.reader, urgent)
            self.clock.start(watch.ask, None, besides)
        except BaseException:  # Ctrl-C, also while the last thread runs already
            watch.give_up()
            raise


class Watch:
    """One motion, from its command until the arm stands."""

    def __init__(
        self,
        arm: Supervisor,
        command: Callable[[], Motion | None],
        rest: NDArray[np.float64],
        *,
        returns: bool,
    ) -> None:
        self.motion: Motion | None = None
        self.fault: Fault | None = None
        self.standing, self.must_stop = threading.Event(), threading.Event()
        self.reader = arm.stream.buffer.reader()
        self._arm, self._command, self._rest, self._returns = arm, command, rest, returns
        self._stream, self._limits, self._clock = arm.stream, arm.limits, arm.clock
        self.robot = arm.robot
        self._what = "way back" if returns else "motion"
        self._call_ns = 0  # when the call of the driver began that has not returned
        self._is_late = False  # it does not stand long after stop()
        self._stood_ns = 0
        self._lock = threading.Lock()
        self._seen: _Seen | None = None
        self._ended = False  # the command was refused, or there is no way back
        self._commanded = False  # the robot may have taken the command
        self._has_begun = False  # to talk to the driver
        self._was_moving = False  # the robot has reported so
        self._has_stopped = False  # a call of stop() has returned
        self._looked_ns = 0
        self._begun_ns = self._heard_ns = self._stopped_ns = self._clock.now_ns()
        self._due_ns = self._begun_ns + round(1e9 * (_BACK_S if returns else arm.path.duration_s))
        self._called_ns = self._n_stops = self._n_calls = self._n_same = 0
        self._stop_error = self._stop_raised = ""
        # Since when the tool is there, after stop().
        self._still: tuple[int, NDArray[np.float64]] | None = None
        self._has_slid = False
        self._row: NDArray[np.float64] | None = None
        self._epoch: int | None = None
        self._n_hidden = self._not_finite()

    def ask(self) -> bool:
        """Talk to the robot's driver: command the motion, then ask how it is. False: that is over."""
        now_ns = self._clock.now_ns()
        with self._lock:
            if self.standing.is_set():
                return False
            if not self._looked_ns:  # nothing is commanded before somebody watches
                return True
            self._has_begun = True
        if now_ns - self._looked_ns > 1e9 * _BLIND_S:
            self.stop(FailureReason.SOURCE, f"nobody has looked at the rows for {_BLIND_S:g} s")
            self._stop_again(now_ns)
        if self._seen is not None and self._seen.at_ns >= self._looked_ns:
            return True  # it may be the last answer: the driver is not queried beside the next motion
        self._call_ns = now_ns
        if self.motion is None:
            return self._tell()
        n_stops, place = self._n_stops, None
        try:
            finished = bool(self.motion.finished())
            self._was_moving |= not finished
            error = self.motion.error  # many controllers tell one only when queried for the end
            place = self._arm.place()
        except Exception as raised:  # whatever the robot's library raises
            finished, error = False, f"{type(raised).__name__}: {raised}"
        self._seen, self._call_ns = _Seen(finished, error, place, self._clock.now_ns(), n_stops), 0
        return True

    def _tell(self) -> bool:
        """Command the motion; False: there is none to ask about."""
        try:
            motion = None if self.fault is not None else self._command()
        except Exception as error:  # whatever the robot's library raises
            self._commanded = not isinstance(error, _PlaceError)
            text = f"the robot refused the {self._what}: {error}" if self._commanded else str(error)
            self.stop(FailureReason.ROBOT, text)
            self._ended = True  # last: it ends the watch
            return False
        self._call_ns, self._ended = 0, motion is None
        if motion is not None:
            self._follow(motion)
        self.motion = motion
        return motion is not None

    def look(self) -> bool:
        """Look at rows, source and arm once; False: the arm stands."""
        now_ns = self._clock.now_ns()
        try:
            block = self.reader.read()
            # A limit and an error count even where the arm brakes already: nothing moves it any more.
            fault = self._wrong(block, now_ns) if self.fault is None else self._hidden(block) or self._error()
        except Exception as error:  # whatever the source raises: nobody else watches
            fault = Fault(FailureReason.SOURCE, f"the source failed: {type(error).__name__}: {error}")
        if fault is not None:
            self.stop(*fault)
        if self.standing.is_set() or self._stands(now_ns):  # the first where nothing began
            self._stood_ns = now_ns
            self.end()
            return False
        if self.fault is not None:
            self._stop_again(now_ns)
        self._looked_ns = now_ns
        return True

    def _stop_again(self, now_ns: int) -> None:
        if now_ns - self._called_ns >= 1e9 * _AGAIN_S:
            self._called_ns = now_ns
            self.must_stop.set()  # where Ctrl-C came before stop() did so
            if self._n_calls < _MOST_CALLS:
                try:
                    self._clock.start(self.call_stop, self.must_stop, None)
                except (RuntimeError, MemoryError):  # at its end the interpreter starts no thread any more
                    self.call_stop()

    def _follow(self, motion: Motion) -> None:
        """Take the start of a motion, which may be by another clock."""
        try:
            delay_s = 1e-9 * max(0, round(motion.start_host_ns) - self._begun_ns)
        except (TypeError, ValueError, OverflowError):
            delay_s = np.inf
        if delay_s <= _AHEAD_S:
            self._due_ns += round(1e9 * delay_s)
        else:
            start = f"the robot's motion begins at {motion.start_host_ns!r:.30} ns"
            self.stop(FailureReason.ROBOT, f"{start}, which is no time of the host's clock")

    def give_up(self) -> None:
        """Stop what was begun, or have it not begin."""
        with self._lock:
            if not self._has_begun:
                self.end()
        self.stop(FailureReason.INTERRUPTED, "ended from outside")

    def end(self) -> None:
        """Say that the arm stands."""
        signals.MOVING.discard(self)
        self.standing.set()
        self.must_stop.set()  # ends the thread that waits for it, where nothing had to be stopped

    def stop(self, reason: FailureReason, text: str) -> None:
        """Stop the arm; the first reason counts. From any thread, and waits for nothing."""
        fault = Fault(reason, text)
        with self._lock:
            if self.standing.is_set():
                return
            self._arm.block(fault)
            if self.fault is None:
                self.fault = fault
                self._stopped_ns = self._called_ns = self._clock.now_ns()
        self.must_stop.set()

    def call_stop(self) -> None:
        """Call the robot's ``stop()``, in a thread of its own."""
        if self.fault is None or self.standing.is_set():  # else it might stop the next motion
            return
        with self._lock:
            self._n_stops += 1
            self._n_calls += 1
        try:
            self._arm.robot.stop()
            self._stop_error, self._has_stopped = "", True
        except Exception as error:  # whatever the robot's library raises
            self._stop_error = f"{type(error).__name__}: {error}"
            if not self._stop_raised:
                self._stop_raised = self._stop_error
                _LOG.error(
                    "robot.stop() raised %s; it is called again until the arm stands", self._stop_error
                )
        finally:
            with self._lock:
                self._n_calls -= 1
        # In this thread: a log may hang as well.
        if not self._is_late and self._clock.now_ns() - self._stopped_ns > 1e9 * _BRAKE_S:
            self._is_late = True
            _LOG.error(
                "the robot does not stand %g s after stop(), which is called again: %s", _BRAKE_S, self._how()
            )

    def not_stopped(self) -> Fault | None:
        """Return that the arm moves on long after it was to stop; None where it may still come to its stand."""
        now_ns = self._clock.now_ns()
        until_ns = self._stopped_ns if self._returns else max(self._stopped_ns, self._due_ns)
        if now_ns <= until_ns + 1e9 * _BRAKE_S:
            return None
        why = "its motion did not end by itself" if self.fault is None else self.fault.text
        return Fault(
            FailureReason.ROBOT, f"the robot could not be stopped: {self._how()} (it was to stop: {why})"
        )

    def _how(self) -> str:
        """Say what keeps the arm from being known to stand."""
        if self._stop_error:
            return self._stop_error
        if self._n_calls:
            return "its driver does not return from stop()"
        if self._call_ns and self._clock.now_ns() - self._call_ns > 1e9 * _ANSWER_S:
            return "its driver does not say whether it stands"
        return f"its motion goes on {1e-9 * (self._clock.now_ns() - self._stopped_ns):.1f} s after stop()"

    @property
    def ending(self) -> str:
        """How the stop went, to follow its reason; empty where nothing had to be stopped."""
        if self.fault is None or self.motion is None:
            return ""
        raised = self._stop_raised and f", after stop() had raised {self._stop_raised}"
        if not self.standing.is_set():
            return f"; the robot was commanded to stop{raised}"
        took_s = 1e-9 * (self._stood_ns - self._stopped_ns)
        return f"; the robot {'was stopped' if took_s < 1 else f'stood {took_s:.1f} s after stop()'}{raised}"

    def _stands(self, now_ns: int) -> bool:
        seen = self._seen
        may_begin = not self._has_stopped or now_ns - self._stopped_ns <= 1e9 * _REFUSED_S
        if self._ended:
            return not (self._commanded and may_begin)
        if seen is None or (
            self.fault is not None and not seen.n_stops
        ):  # an answer from before the first stop()
            return False
        if self.fault is None:
            return seen.finished
        if seen.finished and not self._was_moving:
            return not may_begin
        # One with an error calls itself at rest perhaps because it is out of reach.
        return (seen.finished and (seen.error is None or self._has_stopped)) or self._lies_still(seen)

    def _lies_still(self, seen: _Seen) -> bool:
        """Whether the tool has moved on after stop() and then stood: one that never moved may still begin to."""
        if seen.place is None or np.isnan(seen.place).any() or self._stop_error or self._n_calls:
            return False
        if self._still is None:
            self._still = seen.at_ns, seen.place
        elif np.linalg.norm(seen.place - self._still[1]) > _STILL_M:
            self._still, self._has_slid = (seen.at_ns, seen.place), True
        return self._has_slid and seen.at_ns - self._still[0] > 1e9 * _STILL_S

    def _wrong(self, block: Block, now_ns: int) -> Fault | None:
        return self._hidden(block) or self._wrong_rows(block, now_ns) or self._wrong_motion(now_ns)

    def _hidden(self, block: Block) -> Fault | None:
        """Hold rows against the limits, and those that hide them: an overload must not look like silence."""
        if not self._limits.watched:
            return None
        if beyond := self._limits.beyond(block, self._rest):
            return Fault(FailureReason.LIMIT, beyond)
        if (block.flags & BAD).any():
            return Fault(
                FailureReason.LIMIT, "a row that the sensor marks as saturated or wrong hides the limits"
            )
        if n := self._not_finite() - self._n_hidden:
            return Fault(
                FailureReason.LIMIT,
                f"{counted(n, 'row')} with NaN or infinity, as of an overload: no limit is seen",
            )
        return None

    def _wrong_rows(self, block: Block, now_ns: int) -> Fault | None:
        info = self._stream.info
        if not len(block):
            return self._wrong_source(now_ns)
        if block.missed:
            return overrun(block)
        if self._epoch not in (None, block.epoch):
            return RESTART
        first = 1 if self._row is None else 0  # what is missing before the first row is nobody's loss
        most = max(np.asarray(block.missing_before)[first:], default=0)
        if most > self._limits.max_gap:
            return Fault(FailureReason.GAP, f"{missing(int(most), info.rate_hz)} while the robot moved")
        self._epoch, self._heard_ns = block.epoch, min(int(block.host_ns[-1]), now_ns)
        rows = block.wrench if self._row is None else np.vstack([self._row, block.wrench])
        changes = np.flatnonzero((rows[1:] != rows[:-1]).any(axis=1))
        self._n_same = len(rows) - 2 - int(changes[-1]) if len(changes) else self._n_same + len(rows) - 1
        self._row = rows[-1]
        if self._n_same >= _FROZEN_S * info.rate_hz and not info.repeats:
            same = f"{info.name} delivered the same row for {_FROZEN_S:g} s"
            return Fault(FailureReason.NO_ROWS, f"{same}; one that may do so says it (SourceInfo.repeats)")
        return None

    def _wrong_source(self, now_ns: int) -> Fault | None:
        info = self._stream.info
        least_s = _SILENT_SIMULATED_S if info.synthetic else _SILENT_S
        quiet_s = 1e-9 * (now_ns - max(self._heard_ns, self._begun_ns))
        return self._stream.fault(quiet_s, max(least_s, _SILENT_ROWS / (info.rate_hz * info.speed)))

    def _wrong_motion(self, now_ns: int) -> Fault | None:
        seen, path, motion = self._seen, self._arm.path, self.motion
        begun_ns = self._begun_ns if motion is None else max(motion.start_host_ns, self._begun_ns)
        # One that ramps up slowly needs longer.
        late_s = 0.0 if self._returns else max(path.duration_s, _BRAKE_S)
        if not (seen is not None and seen.finished) and now_ns > self._due_ns + 1e9 * late_s:
            text = f"the robot's {self._what} was not over after {1e-9 * (now_ns - begun_ns):.1f} s"
            return Fault(FailureReason.ROBOT, text)
        if self._call_ns and now_ns - self._call_ns > 1e9 * _ANSWER_S:
            text = f"the robot's driver has not answered for {_ANSWER_S:g} s"
            return Fault(FailureReason.ROBOT, text)
        if seen is None:
            return None
        if fault := self._error():
            return fault
        lasted_s = 1e-9 * (seen.at_ns - begun_ns)
        if seen.finished and not self._returns and lasted_s < path.recorded_s / self._stream.info.speed:
            text = f"the robot's motion ended after {max(lasted_s, 0.0):.2f} s of {path.duration_s:.2f} s"
            return Fault(FailureReason.ROBOT, text)
        return self._beside(seen.place, ended=seen.finished)

    def _error(self) -> Fault | None:
        error = None if self._seen is None else self._seen.error
        text = f"the robot's {self._what} failed: {error}"
        return None if error is None else Fault(FailureReason.ROBOT, text)

    def _beside(self, place: NDArray[np.float64] | None, *, ended: bool) -> Fault | None:
        path = self._arm.path
        if place is None or path.origin is None:
            return None
        shift = place - path.origin
        back_m = float(np.linalg.norm(shift))
        if self._returns and ended and back_m > _START_M:
            text = f"the way back ended {1e3 * back_m:.0f} mm from where the push began"
            return Fault(FailureReason.ROBOT, text)
        along_m = float(np.clip(shift @ path.direction, 0.0, path.length_m))
        off_m = float(np.linalg.norm(shift - along_m * path.direction))
        if off_m <= (_BESIDE_BACK_M if self._returns else _BESIDE_M):
            return None
        return Fault(
            FailureReason.ROBOT, f"the tool is {1e3 * off_m:.0f} mm off its path (poses are in metres)"
        )

    def _not_finite(self) -> int:
        return self._stream.buffer.stats().get("non_finite", 0)
