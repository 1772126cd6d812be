"""Stand-ins for the libraries of sensors and robots: the part of their interface that the adapters use.

Signatures and behaviour as documented by ur-rtde 1.6.5, franky-control 2.0.0, bota-driver 1.1.16 and rclpy (Jazzy).
"""

from __future__ import annotations

import itertools
import threading
import time
from types import ModuleType, SimpleNamespace

import numpy as np


def module(name, **content):
    made = ModuleType(name)
    vars(made).update(content)
    return made


class FakeUR:
    """A controller with a clock of 2 ms: both of ur-rtde's modules look at it."""

    def __init__(self, refuse=False):
        self.calls = []
        self.connected = True
        self.refuse = refuse
        self.moving = False
        self.restarted_s = None
        self._start_s = time.monotonic()

    def now_s(self):
        base = 100.0 if self.restarted_s is None else self.restarted_s
        return base + 0.002 * int((time.monotonic() - self._start_s) / 0.002)

    def _receive(self, hostname, frequency=-1.0):
        assert isinstance(hostname, str)
        self.calls.append(("receive", hostname, frequency))
        return SimpleNamespace(
            isConnected=lambda: self.connected,
            getTimestamp=self.now_s,
            getActualTCPForce=lambda: [1.0, 2.0, 3.0, 0.1, 0.2, 0.3],
            getActualTCPPose=lambda: [0.4, -0.1, 0.2, 0.0, 3.1, 0.0],
            disconnect=lambda: self.calls.append(("receive disconnect",)),
        )

    def _control(self, hostname, frequency=-1.0):
        self.calls.append(("control", hostname))
        return SimpleNamespace(
            moveL=self._move,
            getAsyncOperationProgressEx=lambda: SimpleNamespace(isAsyncOperationRunning=lambda: self.moving),
            stopL=self._stop,
            stopScript=lambda: self.calls.append(("stopScript",)),
            disconnect=lambda: self.calls.append(("control disconnect",)),
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
            "rtde_receive": module("rtde_receive", RTDEReceiveInterface=self._receive),
            "rtde_control": module("rtde_control", RTDEControlInterface=self._control),
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


class FakeFranka:
    """An arm with a clock of 1 ms."""

    def __init__(self):
        self.calls = []
        self.moving = False
        self.raises = None
        self._start_s = time.monotonic()

    def modules(self):
        fake = self

        class Robot:
            def __init__(self, fci_hostname, relative_dynamics_factor=1.0):
                self.fci_hostname = fci_hostname
                fake.calls.append(("connect", fci_hostname))

            @property
            def state(self):
                ms = int(1000 * (time.monotonic() - fake._start_s))
                return SimpleNamespace(time=Duration(ms), K_F_ext_hat_K=np.array([4.0, 0, 0, 0, 0, 0.5]))

            @property
            def current_pose(self):
                quarter = np.array([0, 0, np.sqrt(0.5), np.sqrt(0.5)])
                pose = SimpleNamespace(translation=np.array([0.3, 0.0, 0.5]), quaternion=quarter)
                return SimpleNamespace(end_effector_pose=pose)

            def move(self, motion, asynchronous=False, limit_rate=False, cutoff_frequency=100.0):
                fake.calls.append(("move", motion, asynchronous))
                fake.moving = True

            def join_motion(self, timeout=None):
                assert timeout == 0
                if fake.raises is not None:
                    raise fake.raises
                return not fake.moving

            def stop(self):
                fake.calls.append(("stop",))
                fake.moving = False

        def twist(linear_velocity=None, angular_velocity=None):
            return SimpleNamespace(linear=np.array(linear_velocity), angular=np.array(angular_velocity))

        def velocity_motion(target, duration=None, relative_dynamics_factor=1.0, ee_frame=None):
            return SimpleNamespace(target=target, duration=duration)

        content = {"Twist": twist, "Duration": Duration, "CartesianVelocityMotion": velocity_motion}
        return {"franky": module("franky", Robot=Robot, **content)}


class FakeBota:
    """A sensor at 1000 Hz that stamps in microseconds; every 50th frame is out of range, every 70th invalid."""

    def __init__(self, configures=True, activates=True):
        self.calls = []
        self.configures, self.activates = configures, activates
        self._frames = itertools.count()

    def _called(self, name, answer=True):
        self.calls.append((name,))
        return answer

    def _frame(self):
        time.sleep(0.0005)
        n = next(self._frames)
        status = SimpleNamespace(
            invalid=int(n % 70 == 69), overrange=int(n % 50 == 49), throttled=int(n == 3)
        )
        stamp_us = 5_000_000 + 1000 * n
        return SimpleNamespace(
            force=[1.0, 2.0, float(n)], torque=[0.1, 0.2, 0.3], timestamp=stamp_us, status=status
        )

    def _driver(self, config):
        self.calls.append(("config", config))
        return SimpleNamespace(
            configure=lambda: self.configures,
            activate=lambda: self._called("activate", self.activates),
            deactivate=lambda: self._called("deactivate"),
            shutdown=lambda: self._called("shutdown"),
            get_expected_timestep_us=lambda: 1000,
            get_driver_version_string=lambda: "V1.1.16",
            read_frame_blocking=self._frame,
        )

    def modules(self):
        return {"bota_driver": module("bota_driver", BotaDriver=self._driver)}


class WrenchStamped:
    """Of geometry_msgs."""


class Context:
    """Of rclpy."""


class FakeRos2:
    """A node whose executor calls back with one message for each turn."""

    def __init__(self):
        self.calls = []
        self.subscriptions = []
        self._n = itertools.count()

    def _subscribe(self, msg_type, topic, callback, qos_profile):
        assert msg_type is WrenchStamped
        assert qos_profile == "best effort"
        self.subscriptions.append((topic, callback))

    def _spin(self, timeout_sec=None):
        time.sleep(0.001)
        stamp = SimpleNamespace(sec=1_700_000_000, nanosec=2_000_000 * next(self._n))
        wrench = SimpleNamespace(
            force=SimpleNamespace(x=1.0, y=2.0, z=3.0), torque=SimpleNamespace(x=0.1, y=0.2, z=0.3)
        )
        for _, callback in self.subscriptions:
            callback(SimpleNamespace(header=SimpleNamespace(stamp=stamp, frame_id="ft"), wrench=wrench))

    def _executor(self, *, context=None):
        assert isinstance(context, Context)
        return SimpleNamespace(
            add_node=lambda node: None,
            spin_once=self._spin,
            shutdown=lambda: self.calls.append(("executor shutdown",)),
        )

    def _node(self, name, *, context):
        return SimpleNamespace(
            create_subscription=self._subscribe,
            destroy_node=lambda: self.calls.append(("destroy_node", threading.current_thread().name)),
        )

    def modules(self):
        def init(*, args=None, context=None):
            self.calls.append(("init", type(context).__name__))

        def shutdown(*, context=None):
            self.calls.append(("shutdown", type(context).__name__))

        return {
            "rclpy": module("rclpy", Context=Context, init=init, shutdown=shutdown, create_node=self._node),
            "rclpy.qos": module("rclpy.qos", qos_profile_sensor_data="best effort"),
            "rclpy.executors": module("rclpy.executors", SingleThreadedExecutor=self._executor),
            "geometry_msgs": module("geometry_msgs"),
            "geometry_msgs.msg": module("geometry_msgs.msg", WrenchStamped=WrenchStamped),
        }
