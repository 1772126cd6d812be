"""``granular-id-ros2``: a node of ROS 2. A wrench topic comes in, answers go out, a service arms.

Not run with ROS. Written against rclpy and tf2_ros of Humble and Jazzy (https://docs.ros.org/en/jazzy/p/rclpy/), tested
against a stand-in. docs/sensors/ros2.md says what goes over which topic.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from granular_id.identifier import Identifier, setup_comparison
from granular_id.live import (
    CaptureError,
    FailureReason,
    ForceTrigger,
    LiveIdentifier,
    Push,
    Snapshot,
    Views,
    WindowError,
    opened,
    setup_of,
    stop_on_signals,
)
from granular_id.live.rows import Rows
from granular_id.recording import Setup, setup_mismatch
from granular_id_contrib.ros2 import WAIT_S, Ros2Source, ros

__all__ = ["ArmedTrigger", "Ros2Node", "main", "ros2_node"]

_REST_S, _FOR_EVER_S = 0.25, 1e6

_LOSSES = ("missing", "missed")
"""Counters: samples that never came, by their stamps; samples that came and were read too late."""


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
    """What a node publishes and serves; made by `ros2_node`, which sets `live`."""

    live: LiveIdentifier

    def __init__(self, source: Ros2Source, trigger: ArmedTrigger | None, rest_s: float) -> None:
        self.source, self._trigger, self._rest_s = source, trigger, rest_s
        self._node = node = source.node
        self.is_ready = False
        self._said, self._next_s = "", -np.inf
        self._msg, qos = ros("diagnostic_msgs.msg"), ros("rclpy.qos")
        kept = qos.QoSProfile(depth=1, durability=qos.DurabilityPolicy.TRANSIENT_LOCAL)
        self._answers = node.create_publisher(self._msg.DiagnosticArray, "~/answer", kept)
        self._diagnostics = node.create_publisher(self._msg.DiagnosticArray, "/diagnostics", 10)
        if trigger is not None:
            node.create_service(ros("std_srvs.srv").Trigger, "~/arm", self._arm)

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

    def show(self, snapshot: Snapshot) -> None:
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
    ros_args : sequence of str
        See `Ros2Source`.
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
        Nobody publishes; another type, rate or frame; another set-up than the model's.
    """
    trigger = None if always else ArmedTrigger(threshold_n, arm_s)
    rest_s = max(_REST_S, limits.get("pre_s") or model.lead_s or 0.0)
    frame_for = (lambda _: None) if "frame" in accept else _frame_for(model)
    source = Ros2Source(topic, model.rate_hz, frame_for=frame_for, ros_args=ros_args)
    try:
        node = Ros2Node(source, trigger, rest_s)
        # Later than the source itself gives up: it knows why.
        with opened(source, first_row_s=3 * WAIT_S) as stream, Views([node]) as views:
            chosen = "force" if trigger is None else lambda: trigger
            setup = setup_of(source, None, chosen, threshold_n=threshold_n)
            settings: dict[str, Any] = {"timeout_s": _FOR_EVER_S, "accept": accept, "views": views} | limits
            node.live = LiveIdentifier(stream, model, setup, **settings)
            node.is_ready = True
            yield node
    finally:
        source.stop()


def _frame_for(model: Identifier) -> Callable[[str], str | None]:
    """Return what tells the one frame that a model knows, where it is another one than that of messages."""
    compared = setup_comparison(model.core)

    def wanted(frame_id: str) -> str | None:
        trained = [one.trained for one in compared(Setup(frame=frame_id), {}) if one.name == "frame"]
        return trained[0][0] if trained and len(trained[0]) == 1 else None

    return wanted


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command until Ctrl-C, or until so many answers are given."""
    options = vars(_parser().parse_args(arguments))
    n, path, topic = options.pop("n"), options.pop("model"), options.pop("topic")
    try:
        model = Identifier.load(path)
        with stop_on_signals(), ros2_node(model, topic, **options) as node:
            _show_answers(node, n)
    except (ValueError, TypeError, OSError, ImportError, CaptureError) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)


def _show_answers(node: Ros2Node, n: int | None) -> None:
    live = node.live
    warnings = [setup_mismatch(difference) for difference in live.differences]
    if live.model.synthetic:
        warnings.append(
            "the model was trained on SYNTHETIC recordings: its answers about real materials mean nothing"
        )
    if node.source.info.frame is None:
        warnings.append("messages name no frame: it is not compared with that of the training")
    for warning in warnings:
        print(f"warning: {warning}")
    print(f"{node.source.info.name}: ready", flush=True)
    try:
        for push in node.pushes():
            print(push, flush=True)
            if live.n_answered == n:
                break
    finally:
        print(live.summary(), flush=True)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="granular-id-ros2",
        description="Name the material of each push, as a node of ROS 2. It moves nothing: with the tool at rest, call "
        "the service ~/arm; where it answers with success, push.",
    )
    add = parser.add_argument
    add("--topic", required=True, help="topic of geometry_msgs/WrenchStamped: /ft_sensor/wrench")
    add(
        "--model",
        "-m",
        required=True,
        help="model file, from `granular-id train`; its rate is that of the topic",
    )
    add("--always", action="store_true", help="take every push, without the service ~/arm")
    add("--arm-s", type=float, default=30.0, help="so long after ~/arm may the push begin (30)")
    add("--threshold-n", type=float, default=0.5, help="change of force that is a motion, newton (0.5)")
    add("--pre-s", type=float, help="rest before the motion; needed where the model does not know it")
    add("--max-gap", type=int, default=0, help="missing samples in a row that are filled in, flagged (0)")
    add(
        "--accept",
        action="append",
        default=[],
        help="set-up that may differ: frame, transform, sign or units",
    )
    add("--n", "-n", type=int, help="stop after so many answers")
    add("ros_args", nargs="*", metavar="ARGS", help="behind --, for ROS: -- -r __ns:=/left")
    return parser


if __name__ == "__main__":
    main()
