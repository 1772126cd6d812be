"""Real-time priority while a push is held against limits: asked for, given back, and never needed."""

from __future__ import annotations

import os
import sys
import threading
import time
import warnings
from contextlib import closing

import pytest

from granular_id.live import Capture, MotionTrigger, SimSource, drive as drive_module, opened, priority
from granular_id.live.drive import drive, limits_matter
from granular_id.live.setup import setup_of
from granular_id.testing import FakeNetft
from test_limits import INFO, RATE_HZ, Arm, Bench

linux = pytest.mark.skipif(not hasattr(os, "sched_setscheduler"), reason="no scheduler to ask")
pytestmark = pytest.mark.thread_unsafe(reason="the switch interval is one for all threads")


@pytest.fixture
def asked(monkeypatch):
    """What the system was asked for, which grants everything; policies by thread."""
    policies, calls = {}, []

    def setscheduler(thread, policy, param):
        calls.append((thread, policy & ~os.SCHED_RESET_ON_FORK, param.sched_priority))
        policies[thread] = policy

    monkeypatch.setattr(os, "sched_setscheduler", setscheduler)
    monkeypatch.setattr(os, "sched_getscheduler", lambda thread: policies.get(thread, os.SCHED_OTHER))
    return calls


@pytest.fixture
def refused(monkeypatch):
    def setscheduler(*_):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", setscheduler)
    monkeypatch.setattr(os, "sched_getscheduler", lambda _: os.SCHED_OTHER)


@linux
def test_threads_get_real_time_priority_and_lose_it_again(asked):
    me = threading.get_native_id()
    with priority.at_once([me + 1]):
        assert asked == [(me, os.SCHED_FIFO, 2), (me + 1, os.SCHED_FIFO, 1)]
    assert asked[2:] == [(me, os.SCHED_OTHER, 0), (me + 1, os.SCHED_OTHER, 0)]


@linux
def test_a_thread_that_is_named_twice_loses_it_again(asked):
    me = threading.get_native_id()
    with priority.at_once([me]):
        pass
    assert asked == [(me, os.SCHED_FIFO, 2), (me, os.SCHED_OTHER, 0)]


@linux
def test_a_thread_that_has_it_already_keeps_what_it_has(asked):
    with priority.at_once(), priority.at_once():
        pass
    assert len(asked) == 2


@linux
def test_python_switches_threads_sooner_meanwhile(asked):
    before = sys.getswitchinterval()
    with priority.at_once():
        with priority.at_once():
            pass
        assert sys.getswitchinterval() == pytest.approx(5e-4)
    assert sys.getswitchinterval() == before


@linux
def test_a_refusal_is_no_error_and_told_with_the_way_out(refused):
    with priority.at_once():
        pass
    with pytest.warns(
        RuntimeWarning, match=r"usual priority.*'USER - rtprio 1' in /etc/security/limits.conf"
    ):
        priority.warn_if_refused()


@linux
def test_nothing_is_told_where_it_is_granted(asked):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        priority.warn_if_refused()
    assert asked[-1][1] == os.SCHED_OTHER


@linux
def test_a_push_with_limits_runs_with_it_from_the_first_row_on_and_gives_it_back(asked):
    bench = Bench()
    bench.write(20)
    capture = Capture(RATE_HZ, n_samples=40, pre_s=0.04, trigger=MotionTrigger(), info=INFO, max_force_n=49)
    reader = bench.buffer.reader(from_oldest=True)
    with closing(drive(bench, capture, robot=Arm(bench), reader=reader)) as steps:
        next(steps)
        assert asked[-1][1] == os.SCHED_FIFO
    assert asked[-1][1] == os.SCHED_OTHER


@pytest.mark.parametrize(("limits", "matter"), [({}, False), ({"max_torque_n_m": 1}, True)])
def test_only_limits_of_a_real_robot_matter(limits, matter):
    bench = Bench()
    capture = Capture(RATE_HZ, trigger=MotionTrigger(), info=INFO, **limits)
    assert limits_matter(bench, Arm(bench), capture) is matter
    assert not limits_matter(bench, None, capture)
    with opened(SimSource("rice", speed=20)) as stream:
        assert not limits_matter(stream, setup_of(stream.source).robot, capture)


@pytest.mark.skipif(sys.platform != "linux", reason="threads are told by /proc")
def test_the_receiver_of_a_box_is_found_and_no_other_thread():
    with FakeNetft() as box, opened(box.url) as stream:
        until_s = time.monotonic() + 30  # it names itself when it first runs
        while not (found := priority.reading_threads(stream.source)) and time.monotonic() < until_s:
            time.sleep(0.01)
        assert found
        assert not {*found} & {thread.native_id for thread in threading.enumerate()}


def test_the_thread_of_a_source_in_python_is_its_reading_thread():
    with opened(SimSource("rice", speed=20)) as stream:
        (found,) = priority.reading_threads(stream.source)
        assert found in {thread.native_id for thread in threading.enumerate()} - {threading.get_native_id()}


def test_a_view_that_is_stuck_holds_a_robot_up_for_a_second_only(monkeypatch):
    monkeypatch.setattr(drive_module, "_LONGEST_WAIT_S", 0.05)
    bench = Bench()
    bench.write(20)
    capture = Capture(RATE_HZ, n_samples=40, pre_s=0.04, trigger=MotionTrigger(), info=INFO)
    robot, begun_s = Arm(bench), time.monotonic()
    steps = drive(
        bench, capture, robot=robot, reader=bench.buffer.reader(from_oldest=True), may_move=lambda: False
    )
    with closing(steps):
        while not robot.told and time.monotonic() < begun_s + 30:
            next(steps)
        assert robot.told == ["move"]
        assert time.monotonic() > begun_s + 0.05


def test_a_robot_waits_until_it_may_move():
    bench = Bench()
    bench.write(20)
    capture = Capture(RATE_HZ, n_samples=40, pre_s=0.04, trigger=MotionTrigger(), info=INFO)
    robot, may = Arm(bench), []
    reader = bench.buffer.reader(from_oldest=True)
    steps = drive(bench, capture, robot=robot, reader=reader, may_move=lambda: bool(may))
    with closing(steps):
        next(steps)
        assert robot.told == []
        may.append(1)
        bench.write(1)
        next(steps)
        assert robot.told == ["move"]
