"""Stand-ins for the libraries of sensors and robots: the part of their interface that the adapters use.

Signatures and behaviour as documented by ur-rtde 1.6.5, franky-control 2.0.0, bota-driver 1.1.16 and rclpy (Jazzy).
"""

from __future__ import annotations

import itertools
import sys
import threading
import time
from types import ModuleType, SimpleNamespace

import numpy as np


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
    connected = True
    began_s = 100.0

    def _receive(self, hostname, frequency=-1.0):
        assert isinstance(hostname, str)
        self.calls.append(("receive", hostname, frequency))
        return SimpleNamespace(
            isConnected=lambda: self.connected,
            getTimestamp=lambda: self.began_s + 0.002 * self.ticks(500),
            getActualTCPForce=lambda: [1.0, 2.0, 3.0, 0.1, 0.2, 0.3],
            getActualTCPPose=lambda: [0.4, -0.1, 0.2, 0.0, 3.1, 0.0],
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
        self.calls.append(("stopL", a))
        self.moving = False

    def modules(self):
        return {
            "rtde_receive": {"RTDEReceiveInterface": self._receive},
            "rtde_control": {"RTDEControlInterface": self._control},
        }


class Duration:
    """Of franky: whole milliseconds."""

    def __init__(self, milliseconds=0):
        assert isinstance(milliseconds, int)
        self._ms = milliseconds

    def to_sec(self):
        return self._ms / 1000

    def to_msec(self):
        return self._ms


class FakeFranka(Fake):
    """An arm with a clock of 1 ms: franky's module, and the one robot that it connects to."""

    moving = False
    raises = None

    def _robot(self, fci_hostname, relative_dynamics_factor=1.0):
        self.calls.append(("connect", fci_hostname))
        self.fci_hostname = fci_hostname
        return self

    @property
    def state(self):
        time_ms, force = Duration(self.ticks(1000)), np.array([4.0, 0, 0, 0, 0, 0.5])
        return SimpleNamespace(time=time_ms, K_F_ext_hat_K=force)

    @property
    def current_pose(self):
        quarter = np.array([0, 0, np.sqrt(0.5), np.sqrt(0.5)])
        pose = SimpleNamespace(translation=np.array([0.3, 0.0, 0.5]), quaternion=quarter)
        return SimpleNamespace(end_effector_pose=pose)

    def move(self, motion, asynchronous=False, limit_rate=False, cutoff_frequency=100.0):
        self.calls.append(("move", motion, asynchronous))
        self.moving = True

    def join_motion(self, timeout=None):
        assert timeout == 0
        if self.raises is not None:
            raise self.raises
        return not self.moving

    def stop(self):
        self.calls.append(("stop",))
        self.moving = False

    def _twist(self, linear_velocity=None, angular_velocity=None):
        return SimpleNamespace(linear=np.array(linear_velocity), angular=np.array(angular_velocity))

    def _velocity(self, target, duration=None, relative_dynamics_factor=1.0, ee_frame=None):
        return SimpleNamespace(target=target, duration=duration)

    def modules(self):
        made = {"Robot": self._robot, "Twist": self._twist, "CartesianVelocityMotion": self._velocity}
        return {"franky": {"Duration": Duration, **made}}


class FakeBota(Fake):
    """A sensor at 1000 Hz that stamps in microseconds; every 50th frame is out of range, every 70th invalid."""

    configures = activates = True

    def _frames(self):
        for n in itertools.count():
            flags = {"invalid": int(n % 70 == 69), "overrange": int(n % 50 == 49), "throttled": int(n == 3)}
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


class WrenchStamped:
    """Of geometry_msgs."""


class Context:
    """Of rclpy."""


class FakeRos2(Fake):
    """A node whose executor calls back with one message for each turn."""

    def __init__(self):
        super().__init__()
        self.subscriptions = []
        self._n = itertools.count()

    def _subscribe(self, msg_type, topic, callback, qos_profile):
        assert msg_type is WrenchStamped
        assert qos_profile == "best effort"
        self.subscriptions.append((topic, callback))

    def _spin(self, timeout_sec=None):
        time.sleep(0.001)
        stamp = SimpleNamespace(sec=1_700_000_000, nanosec=2_000_000 * next(self._n))
        force, torque = SimpleNamespace(x=1.0, y=2.0, z=3.0), SimpleNamespace(x=0.1, y=0.2, z=0.3)
        wrench = SimpleNamespace(force=force, torque=torque)
        for _, callback in self.subscriptions:
            callback(SimpleNamespace(header=SimpleNamespace(stamp=stamp, frame_id="ft"), wrench=wrench))

    def _executor(self, *, context=None):
        assert isinstance(context, Context)
        shutdown = self.note("executor shutdown")
        return SimpleNamespace(add_node=lambda node: None, spin_once=self._spin, shutdown=shutdown)

    def _node(self, name, *, context):
        assert threading.current_thread() is not threading.main_thread(), "all in the source's own"
        return SimpleNamespace(create_subscription=self._subscribe, destroy_node=self.note("destroy_node"))

    def _init(self, *, args=None, context=None):
        self.calls.append(("init", type(context).__name__))

    def _shutdown(self, *, context=None):
        self.calls.append(("shutdown", type(context).__name__))

    def modules(self):
        calls = {"init": self._init, "shutdown": self._shutdown, "create_node": self._node}
        return {
            "rclpy": {"Context": Context, **calls},
            "rclpy.qos": {"qos_profile_sensor_data": "best effort"},
            "rclpy.executors": {"SingleThreadedExecutor": self._executor},
            "geometry_msgs": {},
            "geometry_msgs.msg": {"WrenchStamped": WrenchStamped},
        }
