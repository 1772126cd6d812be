"""A ``geometry_msgs/WrenchStamped`` topic of ROS 2 through ``rclpy``.

Not run with ROS. Written against rclpy and tf2_ros of Humble and Jazzy: https://docs.ros.org/en/jazzy/p/rclpy/
"""

from __future__ import annotations

import platform
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import numpy as np

from granular_id.live import SourceInfo, SourceUrl, ThreadedSource, WrenchBuffer
from granular_id.recording import transform
from granular_id_contrib import NOT_RUN, library

__all__ = ["Ros2Source", "StampLine", "open_url", "ros"]

_TYPE = "geometry_msgs/msg/WrenchStamped"

# Messages that ROS holds while Python is late: 1 s at 500 Hz.
_DEPTH = 500
# How long to wait for a message at a time; how often to look whether topic and frames are as they should be.
_SPIN_S, _LOOK_S = 0.05, 0.5

WAIT_S = 4.0
"""How long the first message, and then tf, may take: a stream waits for 5 s and does not know the reason."""

# So many stamps tell the rate, grossly: one further off than the line through the stamps can follow would lose rows.
_N_STAMPS, _LAG, _RATE_OFF = 1000, 50, 0.003
# So much of its distance from a stamp does the line through the stamps follow: clocks drift by less in a period.
_FOLLOWED = 1 / 128
# Frames that are further from where they were are not fixed to each other: 1 mm; 1 - |q . q'| of 1 mrad.
_MOVED_M, _TURNED = 1e-3, 1e-7


def ros(module: str) -> Any:
    """Import a module of ROS, or say how to get it."""
    python = platform.python_version()
    how = f"first `source /opt/ros/DISTRO/setup.bash`, and use the Python of that ROS (this is {python})"
    return library(module, how)


class Ros2Source(ThreadedSource):
    """A wrench topic, read by a node of its own; device time is that of the headers.

    The thread of the source spins `node`; whatever else belongs to the node is made before `start`.

    Parameters
    ----------
    topic : str
    rate_hz : float
        A topic does not tell its rate; stamps of another one end the source.
    frame_for : callable, optional
        Given the ``frame_id``, returns the frame to turn the wrench into by tf, which must be fixed to it; None: it
        stays as it is. Default: it stays.
    ros_args : sequence of str
        As after ``--ros-args``: ``["-r", "__ns:=/left"]``.

    Attributes
    ----------
    node : rclpy.node.Node

    Raises
    ------
    ImportError, ValueError
        ROS 2 is not there; the node cannot be made: an odd name of a topic, or arguments that ROS does not take.

    Notes
    -----
    Messages are taken best effort, which fits every publisher. Stamps may jitter by less than half a period.
    """

    def __init__(
        self,
        topic: str,
        rate_hz: float,
        *,
        frame_for: Callable[[str], str | None] = lambda _: None,
        ros_args: Sequence[str] = (),
    ) -> None:
        self._frame_for = frame_for
        self._sink: WrenchBuffer  # from the start on: no message is taken before
        self._frame_id: str | None = None  # of the messages
        self._target: str | None = None  # that they are turned into
        self._tf: Any = None
        self._pose: tuple[Any, Any] | None = None
        self._stamps_s: list[float] = []
        self._line = StampLine(rate_hz)
        self._since_s = 0.0  # on the host: what is waited for
        rclpy, qos, message = ros("rclpy"), ros("rclpy.qos"), ros("geometry_msgs.msg").WrenchStamped
        self._opened = ExitStack()
        try:
            context = rclpy.Context()  # one of its own: rclpy leaves the signals to the caller then
            rclpy.init(args=["--ros-args", *ros_args] if ros_args else [], context=context)
            self._opened.callback(rclpy.shutdown, context=context)
            self.node = rclpy.create_node("granular_id", context=context)
            self._opened.callback(self.node.destroy_node)
            profile = qos.QoSProfile(depth=_DEPTH, reliability=qos.ReliabilityPolicy.BEST_EFFORT)
            self._topic = self.node.create_subscription(message, topic, self._take, profile).topic_name
        except Exception as error:  # rclpy has a class of its own for each
            self._opened.close()
            raise ValueError(f"ROS 2 did not start: {' '.join(str(error).split())}") from error
        meta = {"status": NOT_RUN, "driver": "rclpy", "topic": self._topic}
        super().__init__(SourceInfo(f"ROS 2 topic {self._topic}", rate_hz, device_clock=True, meta=meta))

    def stop(self) -> None:
        """End the thread and the node."""
        super().stop()
        self._opened.close()

    def deliver(self, buffer: WrenchBuffer, stopping: threading.Event) -> None:
        """Spin the node, and look now and then whether topic and frames are as they should be."""
        self._sink = buffer
        executor = ros("rclpy.executors").SingleThreadedExecutor(context=self.node.context)
        executor.add_node(self.node)
        self._since_s = looked_s = time.monotonic()
        try:
            while not stopping.is_set():
                executor.spin_once(timeout_sec=_SPIN_S)
                now_s = time.monotonic()
                if now_s - looked_s >= _LOOK_S:
                    looked_s, is_late = now_s, now_s - self._since_s > WAIT_S
                    if self._frame_id is None:
                        self._refuse_silence(is_late)
                    elif self._target is not None:
                        self._look_up(is_late)
        finally:
            executor.shutdown()

    def _take(self, message: Any) -> None:
        frame_id, stamp = message.header.frame_id, message.header.stamp
        if frame_id != self._frame_id:
            self._begin(frame_id)
        if self._target is not None and self._pose is None:
            return  # tf is still to come
        force, torque = message.wrench.force, message.wrench.torque
        wrench = np.array([force.x, force.y, force.z, torque.x, torque.y, torque.z])
        if self._pose is not None:
            wrench = transform(wrench, *self._pose)
        time_s = stamp.sec + 1e-9 * stamp.nanosec
        if len(self._stamps_s) < _N_STAMPS:
            self._check_rate(time_s)
        self._sink.push(wrench, self._line.at(time_s))

    def _begin(self, frame_id: str) -> None:
        """Take note of the frame; where another one is wanted, listen to tf."""
        if self._frame_id is not None:
            both = f"{self._frame_id!r} and {frame_id!r}"
            raise ValueError(f"its messages have the frames {both}: has the topic two publishers?")
        self._frame_id, self._since_s = frame_id, time.monotonic()
        self._target = self._frame_for(frame_id) if frame_id else None
        self._info = replace(self._info, frame=self._target or frame_id or None)
        if self._target is not None:
            self._tf = ros("tf2_ros").Buffer()
            self._listener = ros("tf2_ros").TransformListener(self._tf, self.node)

    def _check_rate(self, time_s: float) -> None:
        self._stamps_s.append(time_s)
        if len(self._stamps_s) < _N_STAMPS:
            return
        stamps_s, rate_hz = np.array(self._stamps_s), self._info.rate_hz
        step_s = float(np.median(stamps_s[_LAG:] - stamps_s[:-_LAG])) / _LAG
        if step_s <= 0:
            raise ValueError("the stamps of its headers stand still: let the driver fill header.stamp")
        if abs(step_s * rate_hz - 1) > _RATE_OFF:
            raise ValueError(
                f"it comes at {1 / step_s:.4g} Hz by its stamps, wanted {rate_hz:g} Hz: set the rate of the driver, or "
                "take a model of that rate"
            )

    def _refuse_silence(self, is_late: bool) -> None:
        """Say why no message has come, at once where waiting is of no use."""
        publishers = self.node.get_publishers_info_by_topic(self._topic)
        types = sorted({one.topic_type for one in publishers})
        if types and _TYPE not in types:
            raise TypeError(f"it is of the type {' and '.join(types)}, wanted {_TYPE}")
        if is_late:
            problem = "its publisher says nothing" if types else "nobody publishes it: see `ros2 topic list`"
            raise TimeoutError(f"{problem} (waited {WAIT_S:g} s)")

    def _look_up(self, is_late: bool) -> None:
        """Ask tf where the frame of the messages is in the wanted one; it must stay there."""
        latest = ros("rclpy.time").Time()
        try:
            found = self._tf.lookup_transform(self._target, self._frame_id, latest).transform
        except ros("tf2_ros").TransformException as error:
            if self._pose is None and is_late:
                raise ConnectionError(
                    f"it is in the frame {self._frame_id!r}, the model is for {self._target!r}, and tf has no "
                    f"transform between them ({error}): publish it, or where it is the same frame, add --accept frame"
                ) from error
            return
        q, p = found.rotation, found.translation
        turn, shift = np.array([q.x, q.y, q.z, q.w]), np.array([p.x, p.y, p.z])
        if self._pose is None:
            tf = {"from": self._frame_id, "rotation_xyzw": turn.tolist(), "translation_m": shift.tolist()}
            self._info = replace(self._info, meta={**self._info.meta, "tf": tf})
            self._pose = turn, shift
        elif 1 - abs(turn @ self._pose[0]) > _TURNED or np.linalg.norm(shift - self._pose[1]) > _MOVED_M:
            both = f"{self._frame_id!r} and {self._target!r}"
            raise ValueError(
                f"the frames {both} move against each other: train with one that is fixed to the sensor"
            )


class StampLine:
    """Counts rows by stamps that jitter by less than half a period: a row has the time of the line through them."""

    def __init__(self, rate_hz: float) -> None:
        self._rate_hz = rate_hz
        self._time_s, self._n = -np.inf, 0

    def at(self, stamp_s: float) -> float:
        """Return the device time of the next row."""
        due_s = self._time_s + 1 / self._rate_hz
        late = (stamp_s - due_s) * self._rate_hz
        if not -1.5 < late < self._rate_hz:
            self._time_s, self._n = stamp_s, 0
        elif late > -(sure := 0.5 + 1 / (self._n + 1)):  # the line is not known well at first
            due_s += round(late) / self._rate_hz if late > sure else 0
            self._n += 1
            self._time_s = due_s + max(_FOLLOWED, 1 / (self._n + 1)) * (stamp_s - due_s)
        return self._time_s


def open_url(url: SourceUrl) -> Ros2Source:
    """Make the source of ``ros2://TOPIC?rate_hz=500``."""
    url.allow("rate_hz")
    topic, rate_hz = (url.host + url.path).strip("/"), url.number("rate_hz", None)
    for name, given in (("rate of the topic", rate_hz), ("topic", topic)):
        if not given:
            raise ValueError(f"there is no {name}; wanted ros2://ft_sensor/wrench?rate_hz=500")
    return Ros2Source("/" + topic, rate_hz)
