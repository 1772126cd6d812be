"""Stand-ins for the libraries of sensors and robots: the part of their interface that the adapters use.

Signatures and behaviour as documented by ur-rtde 1.6.5 and bota-driver 1.1.16.
"""

from __future__ import annotations

import itertools
import sys
import time
from types import ModuleType, SimpleNamespace


class Fake:
    """A library: `calls` are those that change something, `modules` what is imported of it."""

    def __init__(self):
        self.calls = []
        self._start_s = time.monotonic()

    def note(self, name, answer=None):
        """A function that notes its name."""

        def called():
            self.calls.append((name,))
            return answer

        return called

    def ticks(self, per_second):
        return int((time.monotonic() - self._start_s) * per_second)

    def installed(self, monkeypatch):
        for name, content in self.modules().items():
            made = ModuleType(name)
            vars(made).update(content)
            monkeypatch.setitem(sys.modules, name, made)
        return self


class FakeUR(Fake):
    """A controller with a clock of 2 ms: both of ur-rtde's modules look at it."""

    refuse = moving = False
    hangs = release = None  # events: a call of stopL hangs; it may go on
    connected = True
    began_s = 100.0
    pose = (0.4, -0.1, 0.2, 0.0, 3.1, 0.0)

    def _receive(self, hostname, frequency=-1.0):
        assert isinstance(hostname, str)
        self.calls.append(("receive", hostname, frequency))
        return SimpleNamespace(
            isConnected=lambda: self.connected,
            getTimestamp=lambda: self.began_s + 0.002 * self.ticks(500),
            getActualTCPForce=lambda: [1.0, 2.0, 3.0, 0.1, 0.2, 0.3],
            getActualTCPPose=lambda: list(self.pose),
            disconnect=self.note("receive disconnect"),
        )

    def _control(self, hostname, frequency=-1.0):
        self.calls.append(("control", hostname))
        return SimpleNamespace(
            moveL=self._move,
            getAsyncOperationProgressEx=lambda: SimpleNamespace(isAsyncOperationRunning=lambda: self.moving),
            stopL=self._stop,
            stopScript=self.note("stopScript"),
            disconnect=self.note("control disconnect"),
        )

    def _move(self, pose, speed=0.25, acceleration=1.2, asynchronous=False):
        self.calls.append(("moveL", [float(p) for p in pose], speed, acceleration, asynchronous))
        self.moving = not self.refuse
        return not self.refuse

    def _stop(self, a=10.0, asynchronous=False):
        self.calls.append(("stopL", a, asynchronous))
        if self.hangs is not None and not self.hangs.is_set():
            self.hangs.set()
            self.release.wait(20)
        self.moving = False

    def modules(self):
        return {
            "rtde_receive": {"RTDEReceiveInterface": self._receive},
            "rtde_control": {"RTDEControlInterface": self._control},
        }


class FakeBota(Fake):
    """A sensor at 1000 Hz that stamps in microseconds; every 50th frame is out of range, every 70th invalid."""

    configures = activates = True

    def _frames(self):
        for n in itertools.count():
            flags = {"invalid": int(n % 70 == 69), "overrange": int(n % 50 == 49)}
            wrench = {"force": [1.0, 2.0, float(n)], "torque": [0.1, 0.2, 0.3]}
            time.sleep(0.0005)
            yield SimpleNamespace(**wrench, timestamp=5_000_000 + 1000 * n, status=SimpleNamespace(**flags))

    def _driver(self, config):
        self.calls.append(("config", config))
        return SimpleNamespace(
            configure=lambda: self.configures,
            activate=self.note("activate", self.activates),
            deactivate=self.note("deactivate"),
            shutdown=self.note("shutdown"),
            get_expected_timestep_us=lambda: 1000,
            get_driver_version_string=lambda: "V1.1.16",
            read_frame_blocking=self._frames().__next__,
        )

    def modules(self):
        return {"bota_driver": {"BotaDriver": self._driver}}
