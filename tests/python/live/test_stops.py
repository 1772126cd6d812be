"""A stop is carried through: repeated until the arm stands, whatever its driver and whoever watches do meanwhile."""

import signal
from itertools import chain, repeat
from threading import Event
from unittest.mock import Mock

import numpy as np
import pytest

from granular_id.live import CaptureError, FailureReason, SimSource, opened, signals, supervisor
from granular_id.live.limits import Limits
from granular_id.live.push import Pushes
from granular_id.live.trigger import MotionTrigger
from world import MS, failed, push, pushes_of, refused, stopped_at

ROBOT, INTERRUPTED = FailureReason.ROBOT, FailureReason.INTERRUPTED


def heeds(w, n):
    """Let `stop` be heeded at the n-th call only; return when it was called, s."""
    calls, stop = [], w.arm.stop

    def late():
        calls.append(w.s)
        if len(calls) >= n:
            stop()

    w.arm.stop = late
    return calls


def fails(n):
    """Return a command that raises n times."""
    return Mock(side_effect=chain([OSError("no connection")] * n, repeat(None)))


@pytest.mark.parametrize("n", [1, 5])
def test_a_stop_that_raises_is_called_again(w, n):
    w.arm.on["stop"] = fails(n)
    text = stopped_at(w, pushes_of(w))
    assert text.endswith("; the robot was stopped, after stop() had raised OSError: no connection")
    assert w.arm.times("stop") == n + 1
    assert w.arm.motion.until_ns - w.begun_ns <= (302 + 51 * n) * MS


@pytest.mark.parametrize("n", [2, 6])
def test_a_stop_that_is_lost_is_called_again(w, n):
    calls = heeds(w, n)
    assert stopped_at(w, pushes_of(w)).endswith("; the robot was stopped")
    assert len(calls) == n
    assert np.diff(calls) == pytest.approx(0.05, abs=0.002)


def test_an_arm_that_brakes_long_is_stopped_when_it_stands(w):
    w.arm.braking_s, w.arm.longer_s, pushes = 0.5, 1.0, pushes_of(w)
    w.arm.on["stop"] = lambda: w.after(0.4, lambda: seen.append(pushes.arm.moves))
    seen = []
    assert stopped_at(w, pushes).endswith("; the robot was stopped")
    assert seen[0]
    assert 0.8 <= w.s <= 0.83
    assert w.arm.times("stop") in (10, 11)


def test_a_call_of_stop_that_comes_too_late_stops_nothing(w):
    pushes = pushes_of(w)
    stopped_at(w, pushes)
    n = w.arm.times("stop")
    pushes.arm.watch.call_stop()  # its thread was held up: the next motion may have begun
    assert w.arm.times("stop") == n


def test_an_answer_of_before_stop_is_no_stand(w):
    """A driver that says too early that the motion is over, until `stop`."""

    def end(w):
        motion, finished = w.arm.motion, w.arm.motion.finished
        motion.finished = lambda: w.arm.when("stop") is None or finished()

    w.arm.braking_s = 0.2
    assert "motion ended after" in stopped_at(w, pushes_of(w), end)
    assert w.arm.motion.until_ns <= w.ns


@pytest.mark.parametrize("phase", ["pushing", "back"])
def test_an_arm_that_never_stands_is_stopped_on_and_on(w, monkeypatch, phase):
    monkeypatch.setattr(supervisor, "_BACK_S", 60.0)
    at_s, calls, pushes = {"pushing": 0.3, "back": 1.0}[phase], heeds(w, 1000), pushes_of(w)
    w.arm.goes_back(60.0).longer_s = 60.0 * (phase == "pushing")
    with pytest.raises(CaptureError, match="could not be stopped: its motion goes on") as raised:
        stopped_at(w, pushes, at_s=at_s)
    assert raised.value.reason is ROBOT
    assert w.s - at_s == pytest.approx(2.3, abs=0.3)
    n = len(calls)
    w.run(1.0)
    assert len(calls) - n in (19, 20)
    refused(pushes, ROBOT, "last motion still goes on")
    w.arm.motion.until_ns = w.ns
    w.run(0.1)
    refused(pushes, ROBOT, "^nothing moves until resume.* could not be stopped")


def test_a_pose_that_rests_says_that_an_arm_stands(w):
    w.arm.braking_s = 0.2
    w.arm.tells_place().on["stop"] = lambda: setattr(w.arm.motion, "finished", lambda: False)
    assert stopped_at(w, pushes_of(w)).endswith("; the robot was stopped")
    assert w.arm.motion.until_ns < w.ns


def test_a_pose_that_rests_while_stop_hangs_is_no_stand(w):
    moves, stop, pushes = [], w.arm.stop, pushes_of(w)

    def hang():
        stop()
        w.run(1.0)
        moves.append(pushes.arm.moves or w.s > 1.5)

    w.arm.braking_s, w.arm.stop = 0.2, hang
    w.arm.tells_place().on["push"] = lambda: setattr(w.arm.motion, "finished", lambda: w.s > 1.5)
    stopped_at(w, pushes)
    assert all(moves)


@pytest.mark.parametrize("pose", ["old", "nan", "deaf"])
def test_a_pose_that_says_nothing_is_no_stand(w, pose):
    """A driver that hangs after a look at the arm, one without an answer, one whose stop() raises."""
    heeds(w, 1000)
    if pose == "deaf":
        w.arm.stop = None
    w.arm.longer_s = 60.0

    def finished():
        if pose == "old" and w.s > 0.33:
            w.run(3.0)
        return False

    w.arm.on["push"] = lambda: setattr(w.arm.motion, "finished", finished)
    w.arm.tcp_pose = lambda: (
        [{"nan": np.nan, "deaf": 0.01}.get(pose, w.s * 0.03) if w.s > 0.32 else 0.0] + [0.0] * 5
    )
    with pytest.raises(CaptureError, match="could not be stopped"):
        stopped_at(w, pushes_of(w))


def test_a_pose_that_never_moved_is_no_stand(w):
    """The controller begins 1 s after the command, and obeys no stop() before."""
    w.arm.longer_s = 3.0
    w.arm.tcp_pose = lambda: ((w.arm.place_m if w.s > 1.0 else 0.0), 0.0, 0.0, 0.0, 0.0, 0.0)
    w.arm.stop = lambda: w.arm._note("stop")
    w.arm.on["stop"] = lambda: setattr(w.arm.motion, "until_ns", w.ns) if w.s > 1.5 else None
    pushes = pushes_of(w)
    w.after(0.3, lambda: pushes.arm.stop(INTERRUPTED, "ended"))
    push(pushes)
    assert w.arm.times("stop") > 20
    assert w.arm.motion.finished()


def test_a_pose_that_was_nan_is_no_move(w):
    w.arm.longer_s = 3.0
    w.arm.tcp_pose = lambda: (np.nan if 0.35 < w.s < 0.4 else 0.0, *[0.0] * 5)
    heeds(w, 20)
    stopped_at(w, pushes_of(w))
    assert w.arm.motion.finished()


def test_a_command_that_failed_is_stopped_until_stop_returns(w):
    """The arm may have taken it nevertheless."""
    w.arm.move_line = w.arm.stop = command = fails(3)
    assert failed(pushes_of(w), ROBOT).startswith("the robot refused the motion: no connection")
    assert command.call_count > 3
    assert w.s == pytest.approx(0.7, abs=0.1)  # it may take the command late


def test_an_arm_that_has_not_begun_is_stopped_for_a_while(w):
    """Its controller calls itself at rest before it begins, and heeds no stop() until then."""
    w.arm.on["push"] = lambda: setattr(w.arm.motion, "finished", lambda: begun_s > w.s or over())
    begun_s, over = 0.4, lambda: w.ns >= w.arm.motion.until_ns
    w.arm.longer_s, stop = 60.0, w.arm.stop
    w.arm.stop = lambda: stop() if w.s > begun_s else None
    assert "motion ended after 0.0" in failed(pushes_of(w), ROBOT)
    assert over()


def test_an_arm_with_an_error_is_stopped_until_stop_returns(w):
    """It calls itself at rest, perhaps because nobody reaches it."""
    errors = iter([OSError("no connection")] * 3)

    def fail():
        for error in errors:
            raise error

    def lose():
        w.arm.motion.error, w.arm.motion.finished = "connection lost", lambda: True

    w.arm.longer_s, w.arm.on["stop"] = 60.0, fail
    w.after(0.3, lose)
    assert "connection lost" in failed(pushes_of(w), ROBOT)
    assert w.ns >= w.arm.motion.until_ns


def test_an_end_that_is_no_truth_is_an_error_of_the_robot(w):
    """By itself, it would end the thread that calls stop() again."""
    calls = heeds(w, 5)
    w.after(0.3, lambda: setattr(w.arm.motion, "finished", lambda: np.zeros(2)))
    w.after(0.4, lambda: vars(w.arm.motion).pop("finished"))
    assert "ValueError" in failed(pushes_of(w), ROBOT)
    assert len(calls) == 5


# -- drivers that hang, and threads that do


@pytest.mark.parametrize("method", ["finished", "tcp_pose", "move_line", "stop"])
def test_a_slow_driver_delays_no_stop(w, method):
    w.arm.tells_place()
    w.arm.longer_s = 2.0

    def slowly(do):
        def call(*args):
            answer = do(*args)
            w.run(1.0)
            return answer

        return call

    if method == "finished":
        w.arm.on["push"] = lambda: setattr(w.arm.motion, "finished", slowly(w.arm.motion.finished))
    else:
        setattr(w.arm, method, slowly(getattr(w.arm, method)))
    at_s = 1.2 if method == "tcp_pose" else 0.3
    assert "the limit is 50 N" in stopped_at(w, pushes_of(w, timeout_s=5.0), at_s=at_s)
    assert w.arm.when("stop") == pytest.approx(at_s, abs=0.005)


class Hanging:
    """A simulated arm whose driver does not return from one of its methods before the test ends."""

    def __init__(self, source, method):
        self.arm, self.method, self.n_stops = source.robot(), method, 0
        self.hangs, self.moving, self.thrice, self.release = Event(), Event(), Event(), Event()

    def move_line(self, direction, speed_m_s, duration_s):
        motion = self.arm.move_line(direction, speed_m_s, duration_s)
        self.hang("move_line")
        finished = motion.finished

        def is_finished():
            if self.method in ("finished", "stop, lost"):
                return self.hang("finished")
            if not (ended := finished()):
                self.moving.set()
            return ended

        motion.finished = is_finished
        return motion

    def stop(self):
        self.n_stops += 1
        if self.method != "stop, lost":
            self.arm.stop()
        if self.n_stops == 3:
            self.thrice.set()
        self.hang("stop")

    def hang(self, method):
        if self.method.startswith(method):
            self.hangs.set()
            self.release.wait()
        return False


@pytest.fixture
def hanging(request, monkeypatch):
    """With threads and time as they are: the pushes of an arm that hangs."""
    if request.param != "stop":  # one that stands may take its time on a loaded machine
        monkeypatch.setattr(supervisor, "_BRAKE_S", 0.3)
    with opened(SimSource("rice", seed=1)) as stream:
        robot = Hanging(stream.source, request.param)
        yield robot, Pushes(stream, robot, MotionTrigger, Limits(), n_samples=100, pre_s=0.1)
        robot.release.set()


@pytest.mark.parametrize("hanging", ["move_line", "finished", "stop, lost"], indirect=True)
def test_a_driver_that_hangs_is_reported_and_stopped(hanging):
    robot, pushes = hanging
    with pytest.raises(CaptureError, match=r"could not be stopped: its (driver|motion)") as raised:
        push(pushes, lambda _: robot.hangs.is_set() or (robot.method == "stop, lost" and pushes.arm.moves))
    assert raised.value.reason is ROBOT
    assert robot.thrice.wait(10)
    assert pushes.arm.moves
    if robot.method == "stop, lost":
        assert robot.n_stops == 3, "so many may be on their way"


@pytest.mark.parametrize("hanging", ["stop"], indirect=True)
def test_an_arm_that_heeds_a_stop_that_hangs_stands(hanging):
    robot, pushes = hanging
    assert "; the robot " in failed(pushes, INTERRUPTED, lambda _: robot.moving.is_set())
    assert not pushes.arm.moves


def test_a_driver_that_does_not_answer_is_stopped_for_it(w):
    w.arm.longer_s = 60.0
    w.arm.on["push"] = lambda: setattr(w.arm.motion, "finished", lambda: w.run(30.0))
    pushes = pushes_of(w)
    with pytest.raises(CaptureError, match="the robot's driver has not answered for 2 s"):
        push(pushes)
    assert 2.0 < w.arm.when("stop") < 2.5


def test_a_driver_is_polled_again_once_its_answer_was_seen(w):
    """Else the last question of a motion may stand beside the command of the next."""
    n, health = [], w.sensor.health

    def slowly():
        before = len(n)
        w.run(0.05)
        assert len(n) - before <= 1
        return health()

    w.sensor.health = slowly
    w.arm.tcp_pose = lambda: n.append(w.s) or (0.0,) * 6
    assert push(pushes_of(w)).reason is None
    assert len(n) > 20


@pytest.mark.parametrize("why", ["its thread is gone", "health() hangs"])
def test_an_arm_that_nobody_watches_is_stopped_on_and_on(w, why):
    """The thread that talks to the driver asks for it."""
    calls, health, w.arm.longer_s = heeds(w, 5), w.sensor.health, 60.0
    if why == "health() hangs":
        w.after(0.3, lambda: setattr(w.sensor, "silent", True))
        w.sensor.health = lambda: (w.s > 0.3 and w.run(10.0)) or health()
    else:
        w.after(0.3, lambda: setattr(w, "_works", [work for work in w._works if work[1] > 1]))
    with pytest.raises(CaptureError, match=r"could not be stopped.*nobody has looked at the rows for 0\.5 s"):
        push(pushes_of(w))
    assert 0.78 < calls[0] < 0.92
    assert calls[4] - calls[0] == pytest.approx(0.2, abs=0.05)


def test_stop_is_repeated_while_the_log_hangs(w, monkeypatch):
    """Whoever reads the terminal does so no more."""
    calls, n, w.arm.longer_s = heeds(w, 1000), [], 60.0

    def log(*_):
        n.append(len(calls))
        w.run(1.0)
        n.append(len(calls))

    monkeypatch.setattr(supervisor._LOG, "error", log)
    with pytest.raises(CaptureError, match="could not be stopped"):
        stopped_at(w, pushes_of(w))
    w.run(1.0)
    assert n[1] - n[0] in (19, 20, 21)


# -- what happens between two lines


def test_nothing_is_commanded_before_somebody_watches(w):
    start = w.start

    def late(work, when, urgent):
        w.after(0.3 if work.__name__ == "look" else 0.0, lambda: start(work, when, urgent))

    w.start = late
    push(pushes_of(w))
    assert w.arm.when("push") >= 0.35


@pytest.mark.parametrize("thread", ["none", "call_stop", "look", "ask"])
def test_ctrl_c_while_threads_start_leaves_no_arm_moving(w, thread):
    """Thread.start waits until the thread runs, and by then that may have commanded the motion."""

    def interrupted(begin):
        def started(work, *args):
            if thread == "none":
                raise KeyboardInterrupt
            begin(work, *args)
            if work.__name__ == thread:
                w.run(0.05)
                raise KeyboardInterrupt

        return started

    w.start = interrupted(w.start)
    pushes = pushes_of(w)
    with pytest.raises(KeyboardInterrupt):
        push(pushes)
    w.run(0.05)
    assert w.arm.motion is None or w.arm.motion.finished()
    assert (pushes.arm.moves, signals.MOVING, w._works) == (False, set(), []), "nor is a thread left"


def test_ctrl_c_while_a_stop_begins_delays_it_only(w):
    """It comes when the reason is there, and before the thread that waits for it is woken."""
    pushes = pushes_of(w)

    def interrupted():
        vars(pushes.arm.watch.must_stop).pop("set")
        raise KeyboardInterrupt

    def leave(_):
        if w.s > 0.3:
            pushes.arm.watch.must_stop.set = interrupted
        return w.s > 0.3

    with pytest.raises(KeyboardInterrupt):
        push(pushes, leave)
    w.run(0.1)
    assert 0.3 < w.arm.when("stop") < 0.4
    assert not pushes.arm.moves


@pytest.mark.parametrize("when", ["looked", "begun", "reads its place"])
def test_a_signal_before_the_command_leaves_the_arm_at_rest(w, when):
    pushes = pushes_of(w)

    def end(*_):
        if pushes.arm.moves or when == "looked":
            signals._stop_all(signal.SIGTERM)

    if when == "looked":
        pushes.arm._check = lambda: pushes.rest.any() and end()  # once there was a rest
    elif when == "reads its place":
        w.arm.tcp_pose = end
    failed(pushes, INTERRUPTED, end if when == "begun" else lambda _: False)
    assert w.arm.times("push") == 0


def test_a_refusal_is_known_before_the_watch_ends(w, monkeypatch):
    """Another thread may look at the arm before that of the driver knows why nothing moves."""
    stop = supervisor.Watch.stop

    def late(watch, *fault):
        w.run(0.01)
        stop(watch, *fault)

    w.arm.tells_place()
    pushes = pushes_of(w)
    push(pushes)
    w.arm.tcp_pose = lambda: (0.3, *[0.0] * 5)
    monkeypatch.setattr(supervisor.Watch, "stop", late)
    assert "from where the first push began" in failed(pushes, ROBOT)
    refused(pushes, ROBOT, "^nothing moves until resume")


def test_two_threads_with_one_arm_do_not_move_it_at_once(w, monkeypatch):
    """One begins while the other has looked whether anything moves, and nothing did."""
    first, second = (pushes_of(w).arm for _ in range(2))
    move = ((1, 0, 0), 0.03, 0.5, 0.4, np.zeros(6))
    make, begins = supervisor.Watch, [lambda: None, lambda: second.push(*move)]

    def made(*args, **kwargs):
        begins.pop()()
        return make(*args, **kwargs)

    monkeypatch.setattr(supervisor, "Watch", made)
    with pytest.raises(CaptureError, match="still goes on"):
        first.push(*move)
    w.run(0.1)
    assert (w.arm.times("push"), first.moves, second.moves) == (1, False, True)
