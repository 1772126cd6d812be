"""An arm is stopped in time, whatever goes wrong and whenever, stands, and is sent nowhere afterwards unasked."""

import signal
from contextlib import suppress
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest

from granular_id.live import FailureReason, signals
from granular_id.recording import SampleFlag
from world import MS, TOO_MUCH, World, failed, feels, push, pushes_of, refused, stopped_at

LIMIT, ROBOT, SOURCE, GAP = (FailureReason[name] for name in ("LIMIT", "ROBOT", "SOURCE", "GAP"))
NO_ROWS, INTERRUPTED = FailureReason.NO_ROWS, FailureReason.INTERRUPTED

PHASES = {"rest": 0.05, "pushing": 0.3, "braking": 0.8, "back": 2.0}
"""When an event happens. The motion begins at 0.1 s, the last row is of 0.6 s; a second later the arm goes back."""


class Fault(NamedTuple):
    """What goes wrong, why the push fails then, how soon `stop` is due; and what comes of it at rest."""

    happen: object
    reason: FailureReason
    within_ms: int
    at_rest: FailureReason | None = None
    phases: str = "rest pushing braking back"


def marks(flag):
    return lambda w: setattr(w.sensor, "flags", flag)


def calm(w):
    w.sensor.force, w.sensor.flags, w.sensor.silent, w.sensor.noise_n = lambda _: 1.0, 0, False, 0.01
    vars(w.sensor).pop("health", None)


def overrun(w):
    n = w.sensor.buffer.capacity + 1
    rows = np.random.default_rng(0).normal(0, 0.01, (n, 6))
    w.sensor.buffer.push_block(rows, (w.sensor.n + np.arange(n)) / 500, host_ns=np.full(n, w.ns))
    w.sensor.n += n


def stands_at(*place):
    return lambda w: setattr(w.arm, "tcp_pose", lambda: (*place, 0.0, 0.0, 0.0))


def lasts(w):
    w.arm.motion.until_ns += round(1e12)


MOVING = "pushing braking back"
EVENTS = {
    "force": Fault(TOO_MUCH, LIMIT, 5, None, MOVING),
    "torque": Fault(feels(0, 0, 0, 0, 3, 0), LIMIT, 5, None, MOVING),
    "NaN": Fault(feels(*[np.nan] * 6), LIMIT, 50, NO_ROWS),
    "infinity": Fault(feels(np.inf, 0, 0, 0, 0, 0), LIMIT, 50, NO_ROWS),
    "saturated": Fault(marks(SampleFlag.SATURATED), LIMIT, 50, FailureReason.NO_TRIGGER),
    "bad status": Fault(marks(SampleFlag.BAD_STATUS), LIMIT, 50, FailureReason.NO_TRIGGER),
    "silence": Fault(lambda w: setattr(w.sensor, "silent", True), NO_ROWS, 150, NO_ROWS),
    "gap": Fault(lambda w: setattr(w.sensor, "lose", 3), GAP, 20),
    "restart": Fault(lambda w: w.sensor.buffer.new_epoch(), FailureReason.RESTART, 20),
    "overrun": Fault(overrun, FailureReason.OVERFLOW, 20, FailureReason.OVERFLOW),
    "dead source": Fault(lambda w: setattr(w.sensor, "error", "no cable"), SOURCE, 50, SOURCE),
    "end of source": Fault(lambda w: setattr(w.sensor, "finished", True), SOURCE, 60, SOURCE),
    "health() raises": Fault(lambda w: setattr(w.sensor, "health", None), SOURCE, 20, None, MOVING),
    "frozen": Fault(lambda w: setattr(w.sensor, "noise_n", 0), NO_ROWS, 300, NO_ROWS),
    "robot's error": Fault(lambda w: setattr(w.arm.motion, "error", "reflex"), ROBOT, 20, None, MOVING),
    "ends early": Fault(lambda w: setattr(w.arm.motion, "until_ns", w.ns), ROBOT, 20, None, "pushing"),
    "off its path": Fault(stands_at(0.0, 0.2, 0.0), ROBOT, 20, None, MOVING),
    "beyond its path": Fault(stands_at(0.2, 0.0, 0.0), ROBOT, 20, None, MOVING),
    "lasts too long": Fault(lasts, ROBOT, 2000, None, "braking back"),
    "exception": Fault(lambda w: None, INTERRUPTED, 30, INTERRUPTED),
    "left": Fault(lambda w: None, INTERRUPTED, 30, INTERRUPTED),
    "signal": Fault(lambda w: signals._stop_all(signal.SIGTERM), INTERRUPTED, 5, INTERRUPTED),
}
CASES = [(name, phase) for name, event in EVENTS.items() for phase in event.phases.split() if phase != "rest"]


def happens(w, name, phase, pushes):
    """Make a push in which something goes wrong; return its capture."""
    at_s, w.arm.longer_s = PHASES[phase], 1.0
    if name.endswith("its path"):
        stands_at(0.0, 0.0, 0.0)(w)
    w.after(at_s, lambda: EVENTS[name].happen(w))
    with suppress(ZeroDivisionError), next(pushes) as attempt:
        for _ in attempt:
            if name == "exception" and w.s > at_s:
                raise ZeroDivisionError
            if name == "left" and w.s > at_s:
                break
    return attempt.capture


@pytest.mark.parametrize(("name", "phase"), CASES)
def test_a_moving_arm_is_stopped_in_time_and_stands(w, name, phase):
    event, pushes = EVENTS[name], pushes_of(w)
    capture = happens(w, name, phase, pushes)
    assert capture.reason is event.reason, capture.text
    assert 1e3 * (w.arm.when("stop") - PHASES[phase]) <= event.within_ms
    assert (pushes.arm.moves, w.arm.motion.finished(), signals.MOVING) == (False, True, set())
    assert [what for what, *_ in w.arm.log if what != "stop"] == ["push", "back"][: 1 + (phase == "back")]
    assert capture.text.endswith("the robot was stopped")


@pytest.mark.parametrize("name", ["force", "NaN", "saturated", "silence", "frozen", "dead source"])
def test_an_arm_is_stopped_where_rows_have_no_time(name):
    test_a_moving_arm_is_stopped_in_time_and_stands(World(device_clock=False), name, "pushing")


@pytest.mark.parametrize("name", [name for name, event in EVENTS.items() if "rest" in event.phases])
def test_what_goes_wrong_at_rest_moves_no_arm(w, name):
    reason = EVENTS[name].at_rest
    assert happens(w, name, "rest", pushes_of(w)).reason is reason
    if name == "frozen":  # which nobody knows before a quarter of a second is over
        assert 0.25 <= w.arm.when("stop") - w.arm.when("push") <= 0.3
    elif reason is None:
        assert w.arm.when("push") > PHASES["rest"] + 0.09, "its rest begins anew"
    else:
        assert w.arm.log == []


@pytest.mark.parametrize(("name", "phase"), list(dict(CASES).items()))
def test_after_a_failure_the_arm_goes_back_first_or_nowhere(w, name, phase):
    event, pushes = EVENTS[name], pushes_of(w)
    happens(w, name, phase, pushes)
    n = len(w.arm.log)
    calm(w)
    if event.reason in (LIMIT, ROBOT):
        refused(pushes, event.reason, "^nothing moves until resume")
        assert len(w.arm.log) == n
        pushes.resume()
        assert push(pushes).reason is None
        assert [what for what, *_ in w.arm.log[n:]] == ["push", "back"], "from where it stands"
    elif event.reason is SOURCE and name != "health() raises":
        failed(pushes, SOURCE)
    elif name == "signal":
        refused(pushes, INTERRUPTED, "a signal has ended this: nothing moves until resume")
    elif name != "overrun":  # its sensor's time has run ahead
        assert push(pushes).reason is None
        assert [what for what, *_ in w.arm.log[n:]] == ["back", "push", "back"]


@pytest.mark.parametrize("name", ["force", "robot's error"])
def test_what_goes_wrong_while_it_brakes_blocks(w, name):
    w.arm.braking_s, pushes = 0.3, pushes_of(w)
    w.after(0.4, lambda: EVENTS[name].happen(w))
    stopped_at(w, pushes, EVENTS["gap"].happen)
    refused(pushes, EVENTS[name].reason, "^nothing moves until resume")


def test_a_limit_while_it_brakes_for_an_answer_is_no_answer(w):
    w.arm.braking_s, pushes = 0.3, pushes_of(w)
    w.after(0.4, lambda: TOO_MUCH(w))
    with next(pushes) as attempt:
        attempt.answered = next(True for _ in attempt if w.s > 0.3)
    assert (attempt.answered, attempt.capture.reason) == (False, LIMIT)


@pytest.mark.parametrize(("lifted_s", "reason"), [(0.3, ROBOT), (1.0, None)])
def test_a_tool_may_be_lifted_on_its_way_back(w, lifted_s, reason):
    w.arm.tcp_pose = lambda: [0.0, 0.0, 0.02 * (lifted_s < w.s < lifted_s + 0.2), 0.0, 0.0, 0.0]
    assert push(pushes_of(w)).reason is reason


@pytest.mark.parametrize("pose", [(0.0, 0.0), "somewhere"])
def test_a_pose_of_another_shape_moves_no_arm(w, pose):
    w.arm.tcp_pose = lambda: pose
    assert failed(pushes_of(w), ROBOT).startswith("the robot refused the motion: ")
    assert w.arm.times("push") == 0


@pytest.mark.parametrize("name", ["force", "NaN", "robot's error", "silence", "gap", "signal"])
def test_no_push_follows_a_way_back_that_fails(w, name):
    pushes = pushes_of(w)
    stopped_at(w, pushes, EVENTS["gap"].happen)
    n = len(w.arm.log)
    w.after(0.5, lambda: EVENTS[name].happen(w))
    failed(pushes, EVENTS[name].reason)
    assert [what for what, *_ in w.arm.log[n:]] == ["back", "stop"]


def test_three_failures_in_a_row_end_the_pushes(w):
    pushes = pushes_of(w)
    for n in (2, 3):
        for _ in range(n):
            stopped_at(w, pushes, EVENTS["gap"].happen, 1.6)
        if n == 2:
            assert push(pushes).reason is None, "which begins the count anew"
    refused(pushes, ROBOT, "^3 pushes in a row failed, the last one by this: 3 samples")
    pushes.resume()
    assert push(pushes).reason is None


@pytest.mark.parametrize(("off_m", "reason"), [(0.004, None), (0.006, ROBOT), (0.0165, ROBOT)])
def test_pushes_do_not_creep_more_than_5_mm(w, off_m, reason):
    """The way back ends before the start; the last arm has none."""
    w.arm.tells_place()
    if off_m > 0.01:
        del w.arm.move_back
    pushes = pushes_of(w)
    assert push(pushes).reason is None
    w.arm.tcp_pose = lambda: (w.arm.place_m + (off_m if off_m < 0.01 else 0.0), *[0.0] * 5)
    n = w.arm.times("push")
    text = push(pushes).text
    assert w.arm.times("push") - n == (reason is None)
    if reason:
        assert f"stands {1e3 * off_m:.0f} mm from where the first push began" in text
        pushes.resume()
        assert push(pushes).reason is None, "which begins a series anew"


@pytest.mark.parametrize(
    ("absolute", "tool_n", "fx", "beyond"),
    [
        (False, 30.0, 69.0, False),
        (False, 30.0, 71.0, True),
        (False, 30.0, -9.0, False),
        (False, 30.0, -11.0, True),
        (True, 30.0, 39.0, False),
        (True, 30.0, 41.0, True),
        (True, 30.0, -39.0, False),
    ],
)
def test_a_limit_is_of_the_change_or_absolute(w, absolute, tool_n, fx, beyond):
    w.sensor.force = lambda s: tool_n if s < 0.3 else fx
    capture = push(pushes_of(w, max_force_n=40.0, absolute=absolute))
    assert capture.reason is (LIMIT if beyond else None)
    assert not beyond or ("from rest" in capture.text) is not absolute
    assert w.arm.when("stop") == (pytest.approx(0.3, abs=0.005) if beyond else None)


def test_an_absolute_limit_wants_a_rest_within_it(w):
    w.sensor.force = lambda s: 45.0
    text = failed(pushes_of(w, max_force_n=40.0, absolute=True), FailureReason.NO_TRIGGER)
    assert "the rest was broken last by this: force of 45" in text
    assert w.arm.log == []


@pytest.mark.parametrize("column", range(6))
def test_each_axis_counts_and_a_single_row_is_enough(w, column):
    row = np.zeros(6)
    row[column] = -60.0
    w.sensor.force = lambda s: row if 0.3 <= s < 0.301 else 1.0
    assert stopped_at(w, pushes_of(w), lambda w: None).startswith("force" if column < 3 else "torque")
    assert w.arm.when("stop") == pytest.approx(0.3, abs=0.005)


@pytest.mark.parametrize(
    ("limits", "about", "match"),
    [
        ({"max_force_n": 0}, {}, "max_force_n must be positive"),
        ({"max_force_n": 300}, {"full_scale": (290.0,) * 6}, "fx ends at 290: give at most that"),
        ({"max_force_n": 3}, {"axes": ("ax", "ay", "az")}, "max_force_n needs fx fy fz; bench has ax ay az"),
    ],
)
def test_limits_that_mean_nothing_are_refused(limits, about, match):
    with pytest.raises(ValueError, match=match):
        pushes_of(World(**about), **{"max_torque_n_m": None} | limits)


def test_a_way_back_that_ends_elsewhere_fails_the_push(w):
    w.arm.tells_place().on["back"] = lambda: setattr(w.arm.motion, "until_ns", w.ns + 100 * MS)
    assert "the way back ended" in failed(pushes_of(w), ROBOT)


# -- what happens between two lines, and what a driver may say


@pytest.mark.parametrize("start_host_ns", [None, "now", 10**18])
def test_a_motion_of_another_clock_is_stopped_at_once(w, start_host_ns):
    move_line, w.arm.longer_s = w.arm.move_line, 60.0

    def move(*args):
        motion = move_line(*args)
        about = {name: getattr(motion, name) for name in ("start_time_s", "error", "finished", "report")}
        return SimpleNamespace(**about, start_host_ns=start_host_ns)

    w.arm.move_line = move
    failed(pushes_of(w), ROBOT)
    assert w.arm.when("stop") < 0.2
    assert w.arm.motion.finished()


def test_rows_stamped_by_another_clock_do_not_hide_silence(w):
    real = w.sensor.buffer
    w.sensor.buffer = SimpleNamespace(
        push=lambda *row, flags, host_ns: real.push(*row, flags=flags, host_ns=host_ns + 10**18)
    )
    w.arm.longer_s = 60.0
    w.after(0.3, lambda: setattr(w.sensor, "silent", True))
    push(pushes_of(w, timeout_s=60.0))
    assert w.arm.when("stop") < 0.45
