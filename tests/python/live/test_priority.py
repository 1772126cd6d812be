"""Real-time priority while an arm is held against limits: set, given back, and never needed."""

import os
import sys
import threading
import warnings
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from granular_id.live import Limits, ManualTrigger, opened, priority
from granular_id.live.clock import Clock
from granular_id.live.push import Pushes
from granular_id.live.supervisor import Supervisor
from granular_id.testing import FakeNetft
from world import World

pytestmark = [
    pytest.mark.thread_unsafe(reason="the switch interval is one for all threads"),
    pytest.mark.skipif(not hasattr(os, "sched_setscheduler"), reason="no scheduler to ask"),
]


@pytest.fixture
def calls(monkeypatch):
    """Calls of the system: (thread, policy, priority)."""
    policies, calls = {}, []

    def setscheduler(thread, policy, param):
        calls.append((thread, policy & ~os.SCHED_RESET_ON_FORK, param.sched_priority))
        policies[thread] = policy

    monkeypatch.setattr(os, "sched_setscheduler", setscheduler)
    monkeypatch.setattr(os, "sched_getscheduler", lambda thread: policies.get(thread, os.SCHED_OTHER))
    return calls


def test_threads_have_priority_until_the_last_holder_leaves(calls, monkeypatch):
    """The way back begins while the watch of the push still ends."""
    me, before = threading.get_native_id(), sys.getswitchinterval()
    other = SimpleNamespace(native_id=me + 2)  # whoever keeps Python's lock
    monkeypatch.setattr(priority.threading, "enumerate", lambda: [other])
    push, back = (priority.at_once([me, me + 1], all_of_python=True) for _ in range(2))
    with back:
        with push, priority.at_once():  # what has it already keeps it
            pass
        assert sorted(calls) == [(me + k, os.SCHED_FIFO, level) for k, level in enumerate((3, 2, 1))]
        assert sys.getswitchinterval() == pytest.approx(5e-4)
    assert sorted(calls[3:]) == [(me + k, os.SCHED_OTHER, 0) for k in range(3)]
    assert sys.getswitchinterval() == before


def test_a_thread_that_reads_raises_no_other(calls):
    with priority.at_once():
        assert calls == [(threading.get_native_id(), os.SCHED_FIFO, 3)]


def test_what_is_called_in_a_thread_runs_with_it(calls):
    called, now = threading.Event(), threading.Event()
    now.set()
    Clock().start(called.set, now, [])
    assert called.wait(20)
    assert (os.SCHED_FIFO, 3) in [call[1:] for call in calls]


@pytest.mark.parametrize("synthetic", [False, True])
def test_only_the_watch_of_a_real_arm_is_urgent(monkeypatch, synthetic):
    urgent, world = {}, World(synthetic=synthetic)
    monkeypatch.setattr(world, "start", lambda work, _, threads: urgent.setdefault(work.__name__, threads))
    world.sensor.threads = [4711]
    Supervisor(world.stream, world.arm, Limits()).push((1, 0, 0), 0.03, 1.0, 0.9, [0.0] * 6)
    rest = None if synthetic else []
    assert urgent == {"look": None if synthetic else [4711], "ask": rest, "call_stop": rest}


@pytest.mark.parametrize(
    ("limits", "synthetic", "granted", "warns"),
    [
        ({"max_force_n": 10}, False, False, True),
        ({"max_force_n": 10}, False, True, False),
        ({"max_torque_n_m": 1}, True, False, False),
        ({}, False, False, False),
    ],
)
def test_a_refusal_is_warned_of_where_limits_matter(calls, monkeypatch, limits, synthetic, granted, warns):
    if not granted:
        monkeypatch.setattr(os, "sched_setscheduler", Mock(side_effect=PermissionError))
    world = World(synthetic=synthetic)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for arm in (world.arm, None):
            Pushes(world.stream, arm, ManualTrigger, Limits(**limits))
    assert ["rtprio" in str(one.message) for one in caught] == [True] * warns


def test_the_thread_that_reads_a_sensor_is_found():
    with FakeNetft() as box, opened(box.url) as real, opened("sim:rice?speed=20") as simulated:
        (receiver,), (python,) = (priority.reading_threads(one.source) for one in (real, simulated))
        others = {thread.native_id for thread in threading.enumerate()}
    assert receiver not in others
    assert python in others - {threading.get_native_id()}
