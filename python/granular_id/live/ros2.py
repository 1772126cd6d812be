"""A node of ROS 2: a wrench topic comes in, answers go out, a service arms.

Not run with ROS. Written against rclpy and tf2_ros of Humble and Jazzy (https://docs.ros.org/en/jazzy/p/rclpy/), tested
against a stand-in. docs/sensors/ros2.md says what goes over which topic.
"""

from __future__ import annotations

import json
import platform
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from importlib import import_module
from typing import Any

import numpy as np

from granular_id._core import WindowError
from granular_id.identifier import Identifier, setup_comparison
from granular_id.live.capture import CaptureError, FailureReason, Push
from granular_id.live.identification import LiveIdentifier
from granular_id.live.rows import Rows
from granular_id.live.setup import Setup, setup_of
from granular_id.live.snapshot import Snapshot
from granular_id.live.source import SourceInfo, ThreadedSource, WrenchSink
from granular_id.live.stream import opened
from granular_id.live.trigger import ForceTrigger
from granular_id.live.view import Views
from granular_id.recording import Setup as RecordedSetup, transform

__all__ = ["ArmedTrigger", "Ros2Node", "Ros2Source", "ros2_node"]

_TYPE = "geometry_msgs/msg/WrenchStamped"

_SPIN_S, _LOOK_S = 0.05, 0.5
"""How long to wait for a message at a time; how often to look whether topic and frames are as they should be."""

# A rate further off than the line through the stamps can follow would lose rows, or double them.
_N_STAMPS, _LAG, _RATE_OFF = 1000, 50, 0.003
"""So many stamps tell the rate, grossly: a capture measures it to a thousandth."""

_FOLLOWED = 1 / 128
"""So much of its distance from a stamp does the line through the stamps follow: clocks drift by less in a period."""

_MOVED_M, _TURNED = 1e-3, 1e-7
"""Frames that are further from where they were are not fixed to each other: 1 mm; 1 - |q . q'| of 1 mrad."""

_REST_S, _FOR_EVER_S = 0.25, 1e6

_LOSSES = ("missing", "missed")
"""Counters: samples that never came, by their stamps; samples that came and were read too late."""


def _ros(module: str) -> Any:
    """Import a module of ROS, or say how to get it."""
    try:
        return import_module(module)
    except ImportError as error:
        raise ImportError(
            f"{module.partition('.')[0]} is needed, which comes with ROS 2: first `source /opt/ros/DISTRO/setup.bash`, "
            f"and use the Python of that ROS (this is {platform.python_version()}): {error}"
        ) from error


class Ros2Source(ThreadedSource):
    """A ``geometry_msgs/WrenchStamped`` topic; device time is that of the headers.

    Its thread spins the node; whatever else belongs to the node is made before `start`.

    Parameters
    ----------
    node : rclpy.node.Node
    topic : str
    rate_hz : float
        A topic does not tell its rate; stamps of another one end the source.
    frame_for : callable, optional
        Given the ``frame_id``, returns the frame to turn the wrench into by tf, which must be fixed to it; None: it
        stays as it is. Default: it stays.
    depth : int, default 500
        Messages that ROS keeps while Python is late: 1 s at 500 Hz.
    reliable : bool, default False
        Ask again for messages that were lost. Default: best effort, which fits every publisher.
    wait_s : float, default 5
        How long the first message, and tf, may take.
    """

    def __init__(
        self,
        node: Any,
        topic: str,
        rate_hz: float,
        *,
        frame_for: Callable[[str], str | None] = lambda _: None,
        depth: int = 500,
        reliable: bool = False,
        wait_s: float = 5.0,
    ) -> None:
        self._node, self._frame_for, self._wait_s = node, frame_for, wait_s
        self._sink: WrenchSink | None = None
        self._frame_id: str | None = None  # of the messages
        self._target: str | None = None  # that they are turned into
        self._tf: Any = None
        self._pose: tuple[Any, Any] | None = None
        self._stamps_s: list[float] = []
        self._line = StampLine(rate_hz)
        self._since_s = 0.0  # on the host: what is waited for
        self._qos = _ros("rclpy.qos")
        kind = self._qos.ReliabilityPolicy
        self._profile = self._qos.QoSProfile(
            history=self._qos.HistoryPolicy.KEEP_LAST,
            depth=depth,
            reliability=kind.RELIABLE if reliable else kind.BEST_EFFORT,
        )
        message = _ros("geometry_msgs.msg").WrenchStamped
        self._topic = node.create_subscription(message, topic, self._take, self._profile).topic_name
        meta = {"status": "not run on hardware", "driver": "rclpy", "topic": self._topic}
        super().__init__(SourceInfo(f"ROS 2 topic {self._topic}", rate_hz, device_clock=True, meta=meta))

    def deliver(self, buffer: WrenchSink, stopping: threading.Event) -> None:
        """Spin the node, and look now and then whether topic and frames are as they should be."""
        self._sink = buffer
        executor = _ros("rclpy.executors").SingleThreadedExecutor(context=self._node.context)
        executor.add_node(self._node)
        self._since_s = looked_s = time.monotonic()
        try:
            while not stopping.is_set():
                executor.spin_once(timeout_sec=_SPIN_S)
                now_s = time.monotonic()
                if now_s - looked_s >= _LOOK_S:
                    looked_s, is_late = now_s, now_s - self._since_s > self._wait_s
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
        if self._sink is None or (self._target is not None and self._pose is None):
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
            self._tf = _ros("tf2_ros").Buffer()
            self._listener = _ros("tf2_ros").TransformListener(self._tf, self._node)

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
                f"it comes at {1 / step_s:.4g} Hz by its stamps, the model is for {rate_hz:g} Hz: set the rate of the "
                "driver, or train a model at that rate"
            )

    def _refuse_silence(self, is_late: bool) -> None:
        """Say why no message has come, at once where waiting is of no use."""
        publishers = self._node.get_publishers_info_by_topic(self._topic)
        types = sorted({one.topic_type for one in publishers})
        if types and _TYPE not in types:
            raise TypeError(f"it is of the type {' and '.join(types)}, wanted {_TYPE}")
        found = [self._qos.qos_check_compatible(one.qos_profile, self._profile) for one in publishers]
        if found and all(compatible == self._qos.QoSCompatibility.ERROR for compatible, _ in found):
            raise ConnectionError(
                f"its publisher offers another quality of service ({found[0][1].strip(' ;')}): leave out --reliable, "
                "or let the driver publish reliably"
            )
        if is_late:
            problem = "its publisher says nothing" if found else "nobody publishes it: see `ros2 topic list`"
            raise TimeoutError(f"{problem} (waited {self._wait_s:g} s)")

    def _look_up(self, is_late: bool) -> None:
        """Ask tf where the frame of the messages is in the wanted one; it must stay there."""
        latest = _ros("rclpy.time").Time()
        try:
            found = self._tf.lookup_transform(self._target, self._frame_id, latest).transform
        except _ros("tf2_ros").TransformException as error:
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
    """Counts rows by stamps that jitter by less than half a period: a row has the time of the line through them.

    A stamp further than half a period after the next instant says how many rows are missing; one as far before it is
    that of the row before; beyond 1.5 periods before, and a second after, the line begins anew.
    """

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


class ArmedTrigger(ForceTrigger):
    """A force trigger that fires only after `allow`, once, and within `arm_s`; the same one for every capture."""

    def __init__(self, threshold_n: float, arm_s: float) -> None:
        super().__init__(threshold_n)
        self.is_busy = False
        self._arm_s, self._until_s, self._from_s = arm_s, -np.inf, 0.0

    @property
    def is_armed(self) -> bool:
        """Whether a push may begin."""
        return time.monotonic() < self._until_s

    def allow(self, rest: Rows) -> str | None:
        """Let the next change from the force of this rest be the push; where it is none, return why."""
        refusal = super().arm(rest)
        if refusal is None:
            self._from_s, self._until_s = rest.time_s[0], time.monotonic() + self._arm_s
        return refusal

    def arm(self, _rest: Rows, /) -> str | None:
        """Take any rows: `allow` looks whether they rest."""
        return None

    def index(self, rows: Rows) -> int | None:
        """Find the first row of the push, where one is allowed; what moved before that rest is none."""
        n_before = int(np.searchsorted(rows.time_s, self._from_s))
        found = super().index(rows[n_before:]) if self.is_armed else None
        if found is None:
            return None
        self.is_busy, self._until_s = True, -np.inf
        return n_before + found


class Ros2Node:
    """What a node publishes and serves; made by `ros2_node`, which sets `source` and `live`."""

    source: Ros2Source
    live: LiveIdentifier

    def __init__(self, node: Any, trigger: ArmedTrigger | None, rest_s: float) -> None:
        self._node, self._trigger, self._rest_s = node, trigger, rest_s
        self.is_ready = False
        self._said, self._next_s = "", -np.inf
        self._msg, qos = _ros("diagnostic_msgs.msg"), _ros("rclpy.qos")
        kept = qos.QoSProfile(
            depth=1,
            reliability=qos.ReliabilityPolicy.RELIABLE,
            durability=qos.DurabilityPolicy.TRANSIENT_LOCAL,
        )
        self._answers = node.create_publisher(self._msg.DiagnosticArray, "~/answer", kept)
        self._diagnostics = node.create_publisher(self._msg.DiagnosticArray, "/diagnostics", 10)
        if trigger is not None:
            node.create_service(_ros("std_srvs.srv").Trigger, "~/arm", self._arm)

    def pushes(self) -> Iterator[Push]:
        """Publish and yield what came of each push; `CaptureError` is published, too."""
        try:
            for push in self.live.pushes():
                if self._trigger is not None:
                    self._trigger.is_busy = False
                if push.reason is not FailureReason.NO_TRIGGER:
                    self._answer(push)
                    yield push
        except CaptureError as error:
            self._answer(Push(None, error.reason, str(error)))
            raise

    def _answer(self, push: Push) -> None:
        decision, live = push.decision, self.live
        if decision is None:
            level, said = "ERROR", push.text
            values: dict[str, Any] = {"failure": "" if push.reason is None else push.reason.value}
        else:
            level, said = "WARN" if decision.unknown or decision.warnings else "OK", decision.sentence()
            values = decision.to_dict() | {"synthetic_model": live.model.synthetic}
        counts = live.stream.health().counters
        values |= {name: counts.get(name, 0) for name in _LOSSES}
        values |= {"lag_s": live.stream.lag_s(), "push": live.n_pushes}
        self._send(self._answers, level, "answer", said, values)

    def publish(self, snapshot: Snapshot) -> None:
        """Publish how the stream is, on each change and once a second: the node is a view."""
        armed, now_s = self._trigger is None or self._trigger.is_armed, time.monotonic()
        said = snapshot.state if armed or snapshot.state != "armed" else "waits for ~/arm"
        if said == self._said and now_s < self._next_s:
            return
        self._said, self._next_s = said, now_s + 1.0
        well = snapshot.lag_s <= snapshot.max_lag_s and not snapshot.lost
        values = {"armed": armed, "lag_s": snapshot.lag_s}
        values |= {name: snapshot.counters.get(name, 0) for name in _LOSSES}
        self._send(self._diagnostics, "OK" if well else "WARN", "stream", said, values)

    def close(self) -> None:
        """Leave the rest to `ros2_node`."""

    def _send(self, publisher: Any, level: str, name: str, message: str, values: dict[str, Any]) -> None:
        status = self._msg.DiagnosticStatus(
            level=getattr(self._msg.DiagnosticStatus, level),
            name=f"{self._node.get_name()}: {name}",
            message=message,
            hardware_id=self.source.info.name,
            values=[
                self._msg.KeyValue(key=key, value=value if isinstance(value, str) else json.dumps(value))
                for key, value in values.items()
            ],
        )
        array = self._msg.DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        array.header.frame_id = self.source.info.frame or ""
        publisher.publish(array)

    def _arm(self, _request: Any, response: Any) -> Any:
        refusal = self._refusal()
        response.success = refusal is None
        response.message = refusal or "armed: the next motion is the push"
        return response

    def _refusal(self) -> str | None:
        """Arm where the newest rows rest, else say why not."""
        if self._trigger is None or not self.is_ready:
            return "the model is still being compared with the topic"
        if self._trigger.is_busy:
            return "a push is being captured"
        try:
            buffer: Any = self.live.stream.buffer
            n = round(self._rest_s * self.source.info.rate_hz)
            window = buffer.window(n, fill="linear", max_gap=n)  # gaps are for the capture to judge
        except WindowError as error:
            return str(error)
        return self._trigger.allow(replace(Rows.none(), wrench=window.wrench, time_s=window.time_s))


@contextmanager
def ros2_node(
    model: Identifier,
    topic: str,
    *,
    always: bool = False,
    threshold_n: float = 0.5,
    arm_s: float = 30.0,
    depth: int = 500,
    reliable: bool = False,
    wait_s: float = 5.0,
    ros_args: Sequence[str] = (),
    accept: Sequence[str] = (),
    **limits: Any,
) -> Iterator[Ros2Node]:
    """Run a node that names pushes, for the length of a block.

    Parameters
    ----------
    model : Identifier
        Its rate is that of the topic. Where it knows one frame, messages of another one are turned into it by tf.
    topic : str
        Of ``geometry_msgs/WrenchStamped``.
    always : bool, default False
        Take every push, as `LiveIdentifier` does. Default: the one after each call of the service ``~/arm``.
    threshold_n : float, default 0.5
        Change of force that is a motion, N.
    arm_s : float, default 30
        So long after the call may the push begin.
    depth, reliable, wait_s
        See `Ros2Source`.
    ros_args : sequence of str
        As after ``--ros-args``: ``["-r", "__ns:=/left"]``.
    accept, **limits
        See `LiveIdentifier`; with "frame" nothing is turned.

    Yields
    ------
    Ros2Node

    Raises
    ------
    ImportError
        ROS 2 is not there; says how to source it.
    ConnectionError, ValueError
        Nobody publishes; another type, quality of service, rate or frame; another set-up than the model's.
    """
    rclpy = _ros("rclpy")
    context = rclpy.Context()  # one of its own: rclpy leaves the signals to us then
    trigger = None if always else ArmedTrigger(threshold_n, arm_s)
    rest_s = max(_REST_S, limits.get("pre_s") or model.lead_s or 0.0)
    frame_for = (lambda _: None) if "frame" in accept else _frame_for(model)
    with ExitStack() as stack:
        try:
            rclpy.init(args=["--ros-args", *ros_args] if ros_args else [], context=context)
            stack.callback(rclpy.shutdown, context=context)
            node = rclpy.create_node("granular_id", context=context)
            stack.callback(node.destroy_node)
            at_work = Ros2Node(node, trigger, rest_s)
            at_work.source = source = Ros2Source(
                node, topic, model.rate_hz, frame_for=frame_for, depth=depth, reliable=reliable, wait_s=wait_s
            )
        except ImportError:
            raise
        except Exception as error:  # an odd name of a topic, arguments: rclpy has a class of its own for each
            raise ValueError(f"ROS 2 did not start: {error}") from error
        # Later than the source itself gives up: it knows why.
        stream = stack.enter_context(opened(source, first_row_s=2 * wait_s + 5.0))
        views = stack.enter_context(Views([at_work], max_hz=10))
        setup = setup_of(source, None, "force", threshold_n=threshold_n)
        if trigger is not None:
            setup = Setup(None, lambda: trigger)
        settings: dict[str, Any] = {"timeout_s": _FOR_EVER_S, "accept": accept, "views": views} | limits
        at_work.live = LiveIdentifier(stream, model, setup, **settings)
        at_work.is_ready = True
        yield at_work


def _frame_for(model: Identifier) -> Callable[[str], str | None]:
    """Return what tells the one frame that a model knows, where it is another one than that of messages."""
    compared = setup_comparison(model.core)

    def wanted(frame_id: str) -> str | None:
        trained = [one.trained for one in compared(RecordedSetup(frame=frame_id), {}) if one.name == "frame"]
        return trained[0][0] if trained and len(trained[0]) == 1 else None

    return wanted
