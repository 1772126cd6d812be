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

    def modules(self):
        fake = self

        class RTDEReceiveInterface:
            def __init__(
                self,
                hostname,
                frequency=-1.0,
                variables=(),
                verbose=False,
                use_upper_range_registers=False,
                rt_priority=0,
            ):
                assert isinstance(hostname, str)
                fake.calls.append(("receive", hostname, frequency))

            def isConnected(self):  # noqa: N802
                return fake.connected

            def getTimestamp(self):  # noqa: N802
                return fake.now_s()

            def getActualTCPForce(self):  # noqa: N802
                return [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]

            def getActualTCPPose(self):  # noqa: N802
                return [0.4, -0.1, 0.2, 0.0, 3.1, 0.0]

            def disconnect(self):
                fake.calls.append(("receive disconnect",))

        class RTDEControlInterface:
            def __init__(self, hostname, frequency=-1.0, flags=1, ur_cap_port=50002, rt_priority=0):
                fake.calls.append(("control", hostname))

            def moveL(self, pose, speed=0.25, acceleration=1.2, asynchronous=False):  # noqa: N802
                fake.calls.append(("moveL", [float(p) for p in pose], speed, acceleration, asynchronous))
                fake.moving = not fake.refuse
                return not fake.refuse

            def getAsyncOperationProgressEx(self):  # noqa: N802
                return SimpleNamespace(isAsyncOperationRunning=lambda: fake.moving)

            def stopL(self, a=10.0, asynchronous=False):  # noqa: N802
                fake.calls.append(("stopL", a))
                fake.moving = False

            def stopScript(self):  # noqa: N802
                fake.calls.append(("stopScript",))

            def disconnect(self):
                fake.calls.append(("control disconnect",))

        return {
            "rtde_receive": module("rtde_receive", RTDEReceiveInterface=RTDEReceiveInterface),
            "rtde_control": module("rtde_control", RTDEControlInterface=RTDEControlInterface),
        }


class FakeFranka:
    """An arm with a clock of 1 ms."""

    def __init__(self):
        self.calls = []
        self.moving = False
        self.raises = None
        self._start_s = time.monotonic()

    def modules(self):
        fake = self

        class Duration:
            def __init__(self, milliseconds=0):
                assert isinstance(milliseconds, int)
                self._ms = milliseconds

            def to_sec(self):
                return self._ms / 1000

            def to_msec(self):
                return self._ms

        class Twist:
            def __init__(self, linear_velocity=None, angular_velocity=None):
                self.linear = np.asarray(linear_velocity, dtype=float)
                self.angular = np.asarray(angular_velocity, dtype=float)

        class CartesianVelocityMotion:
            def __init__(self, target, duration=None, relative_dynamics_factor=1.0, ee_frame=None):
                self.target, self.duration = target, duration

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

        return {
            "franky": module(
                "franky",
                Robot=Robot,
                Twist=Twist,
                Duration=Duration,
                CartesianVelocityMotion=CartesianVelocityMotion,
            )
        }


class FakeBota:
    """A sensor at 1000 Hz that stamps in microseconds; every 50th frame is out of range, every 70th invalid."""

    def __init__(self, configures=True, activates=True):
        self.calls = []
        self.configures, self.activates = configures, activates

    def modules(self):
        fake = self

        class BotaDriver:
            def __init__(self, config):
                fake.calls.append(("config", config))
                self._frames = itertools.count()

            def configure(self):
                return fake.configures

            def activate(self):
                fake.calls.append(("activate",))
                return fake.activates

            def deactivate(self):
                fake.calls.append(("deactivate",))
                return True

            def shutdown(self):
                fake.calls.append(("shutdown",))
                return True

            def get_expected_timestep_us(self):
                return 1000

            def get_driver_version_string(self):
                return "V1.1.16"

            def read_frame_blocking(self):
                time.sleep(0.0005)
                n = next(self._frames)
                status = SimpleNamespace(
                    invalid=int(n % 70 == 69), overrange=int(n % 50 == 49), throttled=int(n == 3)
                )
                return SimpleNamespace(
                    force=[1.0, 2.0, float(n)],
                    torque=[0.1, 0.2, 0.3],
                    timestamp=5_000_000 + 1000 * n,
                    status=status,
                )

        return {"bota_driver": module("bota_driver", BotaDriver=BotaDriver)}


class FakeRos2:
    """A node whose executor calls back with one message for each turn."""

    def __init__(self):
        self.calls = []
        self.subscriptions = []

    def modules(self):
        fake = self

        class WrenchStamped:
            pass

        class Context:
            pass

        class Node:
            def create_subscription(self, msg_type, topic, callback, qos_profile):
                assert msg_type is WrenchStamped
                assert qos_profile == "best effort"
                fake.subscriptions.append((topic, callback))

            def destroy_node(self):
                fake.calls.append(("destroy_node", threading.current_thread().name))

        class SingleThreadedExecutor:
            def __init__(self, *, context=None):
                assert isinstance(context, Context)
                self._n = 0

            def add_node(self, node):
                assert isinstance(node, Node)

            def spin_once(self, timeout_sec=None):
                time.sleep(0.001)
                message = SimpleNamespace(
                    header=SimpleNamespace(
                        stamp=SimpleNamespace(sec=1_700_000_000, nanosec=2_000_000 * self._n), frame_id="ft"
                    ),
                    wrench=SimpleNamespace(
                        force=SimpleNamespace(x=1.0, y=2.0, z=3.0),
                        torque=SimpleNamespace(x=0.1, y=0.2, z=0.3),
                    ),
                )
                self._n += 1
                for _, callback in fake.subscriptions:
                    callback(message)

            def shutdown(self):
                fake.calls.append(("executor shutdown",))

        def init(*, args=None, context=None):
            fake.calls.append(("init", type(context).__name__))

        def shutdown(*, context=None):
            fake.calls.append(("shutdown", type(context).__name__))

        rclpy = module(
            "rclpy",
            Context=Context,
            init=init,
            shutdown=shutdown,
            create_node=lambda name, *, context: Node(),
        )
        return {
            "rclpy": rclpy,
            "rclpy.qos": module("rclpy.qos", qos_profile_sensor_data="best effort"),
            "rclpy.executors": module("rclpy.executors", SingleThreadedExecutor=SingleThreadedExecutor),
            "geometry_msgs": module("geometry_msgs"),
            "geometry_msgs.msg": module("geometry_msgs.msg", WrenchStamped=WrenchStamped),
        }
