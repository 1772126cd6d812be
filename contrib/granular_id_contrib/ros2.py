"""A ``geometry_msgs/WrenchStamped`` topic of ROS 2 through ``rclpy``.

Not run on hardware. Written against rclpy of Humble and Jazzy: https://docs.ros.org/en/jazzy/p/rclpy/
"""

from __future__ import annotations

import threading
from typing import Any

from granular_id.live import SourceInfo, SourceUrl, ThreadedSource, WrenchSink
from granular_id_contrib import NOT_RUN
from granular_id_contrib.polling import library

__all__ = ["Ros2Source", "open_url"]

_PACKAGE = "rclpy"
_HOW = "it comes with ROS 2; source the setup file of your installation"
_SPIN_S = 0.05


class Ros2Source(ThreadedSource):
    """A wrench topic; times are those of its headers.

    Parameters
    ----------
    topic : str
    rate_hz : float
        A topic does not tell its rate: state it. A capture compares it with the stamps.

    Notes
    -----
    Stamps are made by the driver's host, as a rule when the sample arrived there: they jitter, and a driver that
    stamps late samples close together makes gaps and duplicates of them, which are counted.
    """

    def __init__(self, topic: str, rate_hz: float) -> None:
        self._rclpy = library("rclpy", _PACKAGE, _HOW)
        self._qos = library("rclpy.qos", _PACKAGE, _HOW).qos_profile_sensor_data
        self._executors = library("rclpy.executors", _PACKAGE, _HOW)
        self._message = library("geometry_msgs.msg", "geometry_msgs", _HOW).WrenchStamped
        self._topic = topic
        super().__init__(
            SourceInfo(
                f"ROS 2 topic {topic}",
                rate_hz,
                device_clock=True,
                meta={"status": NOT_RUN, "driver": _PACKAGE, "topic": topic},
            )
        )

    def deliver(self, buffer: WrenchSink, stopping: threading.Event) -> None:
        """Write every message as it comes, in a context of its own."""

        def take(message: Any) -> None:
            force, torque = message.wrench.force, message.wrench.torque
            stamp = message.header.stamp
            wrench = [force.x, force.y, force.z, torque.x, torque.y, torque.z]
            buffer.push(wrench, stamp.sec + 1e-9 * stamp.nanosec)

        context = self._rclpy.Context()
        self._rclpy.init(context=context)
        try:
            node = self._rclpy.create_node("granular_id", context=context)
            node.create_subscription(self._message, self._topic, take, self._qos)
            executor = self._executors.SingleThreadedExecutor(context=context)
            executor.add_node(node)
            while not stopping.is_set():
                executor.spin_once(timeout_sec=_SPIN_S)
            executor.shutdown()
            node.destroy_node()
        finally:
            self._rclpy.shutdown(context=context)


def open_url(url: SourceUrl) -> Ros2Source:
    """Make the source of ``ros2://TOPIC?rate_hz=500``."""
    url.allow("rate_hz")
    if "rate_hz" not in url.options:
        raise ValueError(f"url {url.text!r} needs the rate of the topic: ?rate_hz=500")
    topic = "/" + (url.host + url.path).strip("/")
    if topic == "/":
        raise ValueError(f"url {url.text!r} has no topic; wanted ros2://ft_sensor/wrench?rate_hz=500")
    return Ros2Source(topic, url.number("rate_hz", 500.0))
