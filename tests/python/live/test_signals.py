"""Handlers of signals: whose they are, and what a signal leaves behind."""

import os
import signal
import threading
import warnings
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from unittest.mock import Mock

import pytest

from granular_id.live import CaptureError, FailureReason, Recorder, signals, stop_on_signals
from world import World

pytestmark = [
    pytest.mark.usefixtures("heeding_interrupts"),
    pytest.mark.thread_unsafe(reason="signals are for the main thread"),
]
posix = pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="signals of POSIX systems")


@posix
def test_what_is_ignored_stays_ignored_and_handlers_come_back():
    before = {number: signal.getsignal(number) for number in signals.SIGNALS}
    signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
    try:
        with stop_on_signals():
            with stop_on_signals(), pytest.raises(SystemExit):
                signal.raise_signal(signal.SIGTERM)
            signal.raise_signal(signal.SIGHUP)
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before[signal.SIGHUP])
    assert {number: signal.getsignal(number) for number in signals.SIGNALS} == before
    assert signal.set_wakeup_fd(-1) == -1


def test_what_was_made_before_a_signal_moves_after_resume_only(tmp_path):
    world = World(synthetic=True)
    before, after = (Recorder(world.stream, world.arm, tmp_path, n_samples=300) for _ in range(2))
    with stop_on_signals():
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        after.resume()  # maybe before the thread that listens has heard it
    with pytest.raises(CaptureError) as caught:
        before.record("rice")
    assert (caught.value.reason, world.arm.log) == (FailureReason.INTERRUPTED, [])
    assert after.record("rice").recording.n_samples == 300
    before.resume()
    assert before.record("rice").recording.n_samples == 300


class Arm:
    """An arm in motion, which stands as soon as it is stopped unless it is `deaf`."""

    def __init__(self, *, deaf):
        self.standing, self.deaf, self.reasons = threading.Event(), deaf, []

    def stop(self, reason, _):
        self.reasons.append(reason)
        if not self.deaf:
            self.standing.set()


@pytest.mark.parametrize(("deaf", "stopped"), [([], None), ([False], True), ([False, True], False)])
def test_robots_are_reported_stopped_where_all_stand(deaf, stopped):
    arms = [Arm(deaf=one) for one in deaf]
    signals.MOVING.update(arms)
    with stop_on_signals(), suppress(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    assert [arm.reasons for arm in arms] == [[FailureReason.INTERRUPTED]] * len(arms)
    assert signals.stopped_robots() is stopped


@posix
def test_signals_of_a_forked_child_do_not_stop_the_parents_robot():
    signals.MOVING.add(arm := Mock(standing=threading.Event()))
    with stop_on_signals(), warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of a fork beside threads
        if not (child := os.fork()):
            signals._at_exit()
            os._exit(arm.stop.called or signal.set_wakeup_fd(-1) != -1)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    assert {arm} == signals.MOVING


def test_other_threads_are_refused():
    with ThreadPoolExecutor(1) as pool, pytest.raises(RuntimeError, match="main thread"):
        pool.submit(stop_on_signals().__enter__).result()


# -- a program of its own


def code_of(number):
    """Exit code of a program in Python that a signal has ended."""
    return -number if number == signal.SIGINT else 128 + number


@posix
@pytest.mark.parametrize(
    ("how", "number"),
    [
        *(("plain", number) for number in signals.SIGNALS),
        ("nested", signals.SIGNALS[-1]),
        ("hangs once", signal.SIGTERM),  # stop() does not return
    ],
)
def test_a_signal_stops_the_robot_and_ends_the_program(begin, how, number):
    session = begin(how)
    session.signal(number)
    assert session.ended()[0] == code_of(number)


@posix
@pytest.mark.parametrize(("how", "code"), [("thread", 143), ("deaf", 0)])
def test_nothing_moves_after_a_signal_where_others_go_on(begin, how, code):
    session = begin(how)
    session.signal(signal.SIGTERM)
    assert session.ended()[0] == code
    assert session.notes[-1] == "interrupted"


@posix
def test_stop_is_called_though_the_main_thread_hears_nothing(begin):
    session = begin("held up")
    session.signal(signal.SIGTERM)
    assert "goes on" not in session.notes
    session.process.stdin.write("!")
    assert session.ended()[0] == 143


@posix
def test_a_second_signal_ends_a_program_whose_driver_hangs(begin):
    session = begin("hangs")
    session.signal(signal.SIGTERM)
    session.wait_for("stop")  # again, while the first call has not returned
    session.process.send_signal(signal.SIGTERM)
    assert session.ended()[0] == 143


@posix
def test_the_end_of_the_interpreter_stops_what_a_thread_moves(begin):
    assert begin("exit").ended()[0] == 0
