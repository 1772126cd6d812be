"""What is a push: a motion that begins after the call, from rest, whole, and of an arm that moves throughout."""

import numpy as np
import pytest

from granular_id.live import CaptureError, FailureReason, ForceTrigger
from world import MS, World, push, pushes_of


def contacts(*spans, n=5.0, rest=1.0):
    """Return a force that changes by `n` N in these spans of time, s."""
    return lambda s: rest + n * any(begin <= s < end for begin, end in spans)


def test_a_push_is_what_begins_after_the_call(w):
    w.sensor.force = contacts((0.5, 1.5), (3.0, 4.0), (4.3, 4.8), (6.0, 9.0))
    w.run(2.0)
    pushes = pushes_of(w, ForceTrigger, by_hand=True)
    capture = push(pushes)
    assert (capture.reason, capture.trigger_time_s) == (None, pytest.approx(3.0, abs=0.003))
    assert capture.rows.time_s[0] > 1.99
    w.run(1.5)
    assert push(pushes).trigger_time_s == pytest.approx(6.0, abs=0.003)


def test_rows_of_recordings_count_from_the_first(w):
    w.sensor.replays, w.sensor.force = True, contacts((0.5, 0.9), (3.0, 9.0))
    w.run(4.0)
    pushes = pushes_of(w, ForceTrigger, by_hand=True)
    begun_s = [push(pushes).trigger_time_s for _ in range(2)]
    assert begun_s == pytest.approx([0.5, 3.0], abs=0.003)


def test_an_arm_does_not_move_before_the_tool_rests(w):
    w.sensor.force = lambda s: 5.0 * np.sin(40 * s) if s < 1.0 else 0.0
    assert push(pushes_of(w)).reason is None
    assert w.arm.when("push") == pytest.approx(1.1, abs=0.04)


def test_a_tool_that_never_rests_ends_the_wait(w):
    w.sensor.force = lambda s: 5.0 * np.sin(40 * s)
    pushes = pushes_of(w)
    for _ in range(4):
        capture = push(pushes)
        assert capture.reason is FailureReason.NO_TRIGGER
        assert "the rest was broken last by this: the force moved by" in capture.text
    assert w.arm.log == [], "nor does it go back, and no failure of the arm is counted"


@pytest.mark.parametrize("sign", [1, -1])
def test_a_withdrawal_by_hand_is_no_push(w, sign):
    w.sensor.force = lambda s: sign * (5.0 * (0.5 <= s < 2.0) + 6.0 * (s >= 3.0))
    pushes = pushes_of(w, ForceTrigger, by_hand=True)
    assert push(pushes).trigger_time_s == pytest.approx(0.5, abs=0.003)
    assert push(pushes).trigger_time_s == pytest.approx(3.0, abs=0.003)


def test_an_early_answer_knows_the_direction_of_a_push(w):
    w.sensor.force = contacts((0.5, 1.0))
    pushes = pushes_of(w, ForceTrigger, by_hand=True)
    with next(pushes) as attempt:
        attempt.answered = next(True for _ in attempt if attempt.capture.n_rows > 100)
    assert pushes.force_direction == pytest.approx([5, 0, 0], abs=0.1)


@pytest.mark.parametrize(("late_s", "n"), [(0.02, 0), (0.3, 125), (0.5, 225)])
def test_a_contact_that_comes_late_is_refused(w, late_s, n):
    w.arm.on["push"] = lambda: setattr(w.sensor, "force", contacts((w.s + late_s, 9.0)))
    capture = push(pushes_of(w, ForceTrigger))
    if not n:
        assert capture.reason is None
        return
    assert capture.reason is FailureReason.LATE_CONTACT
    assert f"contact {late_s:.1f} s after the start: the last {n}" in capture.text
    assert w.arm.when("stop") == pytest.approx(w.arm.when("push") + late_s, abs=0.03)


@pytest.mark.parametrize(("off_s", "shares"), [(0.0, True), (0.5, True), (-0.5, False), (1e9, False)])
@pytest.mark.parametrize("slow_s", [0.0, 1.0])
def test_a_motion_by_another_clock_is_refused(w, off_s, shares, slow_s):
    def begin():
        w.arm.motion.start_time_s = w.s + off_s
        w.arm.motion.until_ns += round(1e9 * min(max(off_s, 0.0), 1.0))
        w.run(slow_s / 4)

    w.arm.on["push"] = begin
    capture = push(pushes_of(w), lambda step: w.run(slow_s))
    if shares:
        assert capture.reason is None, capture.text
        assert capture.trigger_time_s == pytest.approx(w.arm.when("push") + off_s, abs=0.003)
    else:
        assert capture.reason is FailureReason.ROBOT
        assert "they do not share a clock" in capture.text


def test_a_slow_command_costs_no_row_of_the_motion(w):
    """The arm moves 50 ms before its driver says so; rows come in meanwhile."""
    start = w.start
    w.start = lambda work, when, urgent: (
        w._works.append((work, 200)) if when is None else start(work, when, urgent)
    )
    w.arm.on["push"] = lambda: setattr(w.arm.motion, "start_host_ns", w.ns - 50 * MS)
    assert push(pushes_of(w)).trigger_time_s == pytest.approx(w.arm.when("push") - 0.05, abs=0.003)


def test_a_slow_consumer_delays_no_stop(w):
    w.arm.on["push"] = lambda: setattr(w.sensor, "force", contacts((w.s + 0.2, 9.0), n=60.0))
    capture = push(pushes_of(w), lambda step: w.run(1.0))
    assert capture.reason is FailureReason.LIMIT
    assert w.arm.when("stop") == pytest.approx(w.arm.when("push") + 0.2, abs=0.005)


def test_an_arm_moves_from_the_rest_of_now(w):
    w.after(0.5, lambda: setattr(w.sensor, "force", contacts((0.0, 1.3), n=20.0)))
    capture = push(pushes_of(w), lambda step: w.run(1.0) if w.s < 1.0 else None)
    assert capture.reason is None


def test_a_frozen_sensor_fails_no_push_where_it_may_repeat():
    w = World(repeats=True)
    w.sensor.noise_n = 0.0
    assert push(pushes_of(w)).reason is None


def test_two_loops_with_one_arm_do_not_push_at_once(w):
    first, second = pushes_of(w), pushes_of(w)
    with next(first) as attempt:
        for _ in attempt:
            if w.arm.times("push") and not w.arm.motion.finished():
                with pytest.raises(CaptureError, match="still goes on: nothing else moves it"):
                    next(second)
    assert w.arm.times("push") == 1


def test_an_arm_without_place_and_way_back_waits_for_resume():
    w = World()
    pushes = pushes_of(w)
    push(pushes)
    with pytest.raises(CaptureError, match=r"bring the tool back, then call resume\(\)"):
        next(pushes)
    pushes.resume()
    assert push(pushes).reason is None


def test_a_tool_that_bears_the_limit_at_rest_does_not_push(w):
    pushes = pushes_of(w, max_force_n=30.0)
    push(pushes)
    w.sensor.force = lambda _: 33.0  # jammed: each push would begin from a larger force
    assert push(pushes).text.startswith("before the push the tool bears a force of 32")
    with pytest.raises(CaptureError, match=r"^nothing moves until resume"):
        push(pushes)
    assert [what for what, *_ in w.arm.log] == ["push", "back"]


def test_an_arm_does_not_go_back_while_the_sensor_is_silent(w):
    pushes = pushes_of(w)
    w.after(0.3, lambda: setattr(w.sensor, "silent", True))
    assert push(pushes).reason is FailureReason.NO_ROWS
    assert push(pushes).reason is FailureReason.NO_ROWS
    assert w.arm.times("back") == 0
    w.sensor.silent = False
    assert push(pushes).reason is None
    assert [what for what, *_ in w.arm.log] == ["push", "stop", "back", "push", "back"]


def test_an_arm_answered_at_the_last_row_stands_at_the_end(w):
    w.arm.longer_s = 1.0
    pushes = pushes_of(w)
    with next(pushes) as attempt:
        attempt.answered = next(True for _ in attempt if attempt.capture.n_rows == 300)
    assert attempt.capture.reason is None
    assert w.arm.motion.finished()
    assert push(pushes).reason is None
