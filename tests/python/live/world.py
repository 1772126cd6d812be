"""A bench in simulated time: sensor, arm and supervisor take their turns every millisecond, without threads."""

from threading import Event

import numpy as np
import pytest

from granular_id.live import CaptureError, Health, MotionTrigger, SourceInfo, WrenchBuffer, host_ns
from granular_id.live.clock import Clock
from granular_id.live.limits import Limits
from granular_id.live.push import Pushes
from granular_id.live.stream import Stream

MS = 1_000_000


def pushes_of(world, trigger=MotionTrigger, *, by_hand=False, **limits):
    """Pushes of 0.5 s behind 0.1 s of rest."""
    limits = {"max_force_n": 50.0, "max_torque_n_m": 2.0, "timeout_s": 3.0} | limits
    robot = None if by_hand else world.arm
    return Pushes(world.stream, robot, trigger, Limits(**limits), n_samples=300, pre_s=0.1)


def push(pushes, on_step=lambda step: False):
    """Make a push, left where `on_step` returns True; return its capture."""
    with next(pushes) as attempt:
        for step in attempt:
            if on_step(step):
                break
    return attempt.capture


def failed(pushes, reason, on_step=lambda step: False):
    """Make a push that fails; return how."""
    capture = push(pushes, on_step)
    assert capture.reason is reason, capture.text
    return capture.text


def refused(pushes, reason, match):
    """Ask for a push that is refused."""
    with pytest.raises(CaptureError, match=match) as raised:
        push(pushes)
    assert raised.value.reason is reason


def feels(*wrench):
    """Return what lets the sensor feel a wrench."""
    return lambda w: setattr(w.sensor, "force", lambda _: wrench)


TOO_MUCH = feels(60, 0, 0, 0, 0, 0)


def stopped_at(w, pushes, event=TOO_MUCH, at_s=0.3):
    """Make a push in which something goes wrong, by itself a force beyond the limit; return its text."""
    w.after(at_s, lambda: event(w))
    return push(pushes).text


class World(Clock):
    """The clock of a bench with a sensor and an arm; `run` lets time pass."""

    def __init__(self, **about):
        self.ns = self.begun_ns = host_ns()
        self._works, self._busy, self._calls, self._events, self._ticks = [], [], [], [], 0
        self.sensor = Sensor(self, **about)
        self.arm = Arm(self)
        self.stream = Stream(self.sensor, self.sensor.buffer, self)

    @property
    def s(self):
        """Seconds since the beginning."""
        return 1e-9 * (self.ns - self.begun_ns)

    def now_ns(self):
        return self.ns

    def wait(self, reader, seconds):
        until_ns = self.ns + round(1e9 * seconds)
        while self.ns < until_ns and not reader.wait(0.0):
            self._tick()

    def start(self, work, when, urgent):
        if isinstance(when, Event):
            self._calls.append((work, when))
        else:
            self._works.append((work, 10 if when is None else 1))

    def after(self, seconds, do):
        """Call `do` in so many seconds."""
        self._events.append((self.ns + round(1e9 * seconds), do))

    def run(self, seconds):
        """Let time pass."""
        until_ns = self.ns + round(1e9 * seconds)
        while self.ns < until_ns:
            self._tick()

    def _tick(self):
        self.ns += MS
        self._ticks += 1
        for event in [event for event in self._events if event[0] <= self.ns]:
            self._events.remove(event)
            event[1]()
        self.sensor.tick()
        for work in [work for work in self._works if self._ticks % work[1] == 0]:
            if work not in self._busy:  # one that takes its time, by `run`, does not hold up the others
                self._busy.append(work)
                if not work[0]():
                    self._works.remove(work)
                self._busy.remove(work)
        for call in [call for call in self._calls if call[1].is_set()]:
            self._calls.remove(call)
            call[0]()


class Sensor:
    """500 rows/s; what it feels, loses and marks is set at any moment."""

    replays = False

    def __init__(self, world, *, rate_hz=500.0, device_clock=True, **about):
        self.info = SourceInfo("bench", rate_hz, device_clock=device_clock, **about)
        self.buffer = WrenchBuffer(60.0, rate_hz=rate_hz)
        self.world, self.n = world, 0
        self.force = lambda s: 1.0  # N along x, or six numbers
        self.noise_n, self.flags, self.lose, self.silent, self.late_s = 0.01, 0, 0, False, 0.0
        self.error, self.finished = None, False

    def tick(self):
        while self.n / self.info.rate_hz <= self.world.s - self.late_s and not (self.error or self.finished):
            self._send()
            self.n += 1

    def _send(self):
        felt = self.force(self.world.s)
        row = np.array(felt if np.ndim(felt) else [felt, 0, 0, 0, 0, 0], float)
        row[0] += self.noise_n * (self.n % 3)
        if self.lose:
            self.lose -= 1
        elif not self.silent:
            t = self.n / self.info.rate_hz if self.info.device_clock else None
            self.buffer.push(row, t, flags=self.flags, host_ns=self.world.ns)

    def health(self):
        return Health(self.error is None, self.error, self.finished)


class Shown:
    """Views that keep each snapshot."""

    def __init__(self):
        self.snapshots = []
        self.publish = self.snapshots.append

    def wants_snapshot(self):
        return True


class Motion:
    """A motion along x by the world's clock."""

    start_time_s = error = None

    def __init__(self, world, begin_m, speed_m_s, seconds):
        self.world, self.begin_m, self.speed_m_s = world, begin_m, speed_m_s
        self.start_host_ns, self.until_ns = world.ns, world.ns + round(1e9 * seconds)

    @property
    def place_m(self):
        return self.begin_m + 1e-9 * self.speed_m_s * (min(self.world.ns, self.until_ns) - self.start_host_ns)

    def finished(self):
        return self.world.ns >= self.until_ns

    def report(self):
        return {"robot": "bench arm"}


class Arm:
    """Moves by the world's clock; `log` holds (what, s, place in m) of each command. `back_s`: it goes back."""

    def __init__(self, world):
        self.world, self.log, self.on, self.motion = world, [], {}, None
        self.braking_s = self.longer_s = 0.0

    def goes_back(self, seconds=1.0):
        """Give it a way back that takes so long."""

        def move_back():
            speed_m_s = (self.start_m - self.place_m) / seconds
            return None if self.motion is None else self._begin("back", speed_m_s, seconds)

        self.start_m, self.move_back = 0.0, move_back
        return self

    def tells_place(self):
        """Give it a pose."""
        self.tcp_pose = lambda: (self.place_m, 0.0, 0.0, 0.0, 0.0, 0.0)
        return self

    @property
    def place_m(self):
        return self.motion.place_m if self.motion else 0.0

    def when(self, what, after_s=0.0):
        """Return when that was called first, s; None: never."""
        return next((s for w, s, _ in self.log if w == what and s >= after_s), None)

    def times(self, what):
        return sum(w == what for w, *_ in self.log)

    def move_line(self, direction, speed_m_s, duration_s):
        self.start_m = self.place_m
        return self._begin("push", speed_m_s, duration_s + self.longer_s)

    def stop(self):
        self._note("stop")
        if self.motion is not None:
            self.motion.until_ns = min(self.motion.until_ns, self.world.ns + round(1e9 * self.braking_s))

    def _begin(self, what, speed_m_s, seconds):
        self.motion = Motion(self.world, self.place_m, speed_m_s, seconds)
        self._note(what)
        return self.motion

    def _note(self, what):
        self.log.append((what, self.world.s, self.place_m))
        self.on.get(what, lambda: None)()
