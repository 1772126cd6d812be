"""``granular-id-ros2``: a node of ROS 2. A wrench topic comes in, answers go out, a service arms.

Not run with ROS. Written against rclpy and tf2_ros of Humble and Jazzy (https://docs.ros.org/en/jazzy/p/rclpy/), tested
against a stand-in. docs/sensors/ros2.md says what goes over which topic.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from granular_id._core import WindowError
from granular_id.identifier import Identifier
from granular_id.live import (
    CaptureError,
    ForceTrigger,
    LiveIdentifier,
    Push,
    opened,
    setup_of,
    stop_on_signals,
)
from granular_id.live.rows import Rows
from granular_id.recording import Setup, setup_mismatch
from granular_id_contrib.ros2 import WAIT_S, Ros2Source, ros

__all__ = ["ArmedTrigger", "main"]

_REST_S, _ARM_S, _FOR_EVER_S = 0.25, 30.0, 1e6
_LATE_S, _DIAGNOSE_S = 0.02, 1.0


class ArmedTrigger(ForceTrigger):
    """A force trigger that fires only after `allow`, once, and within 30 s; the same one for every capture."""

    def __init__(self, threshold_n: float) -> None:
        super().__init__(threshold_n)
        self.is_busy = False
        self._from_s, self._until_s = 0.0, -np.inf

    @property
    def is_armed(self) -> bool:
        """Whether a push may begin."""
        return time.monotonic() < self._until_s

    def allow(self, rest: Rows) -> str | None:
        """Let the next change from the force of this rest be the push; where it is none, return why."""
        refusal = super().arm(rest)
        if refusal is None:
            self._from_s, self._until_s = rest.time_s[0], time.monotonic() + _ARM_S
        return refusal

    def arm(self, _rest: Rows, /) -> str | None:
        """Take any rows: `allow` looks whether they rest."""
        return None

    def refuse(self, _row: Rows, /) -> str | None:
        """Refuse nothing: whoever armed has stated that the next motion is the push."""
        return None

    def index(self, rows: Rows) -> int | None:
        """Find the first row of the push, where one is allowed; what moved before that rest is none."""
        n_before = int(np.searchsorted(rows.time_s, self._from_s))
        found = super().index(rows[n_before:]) if self.is_armed else None
        if found is None:
            return None
        self.is_busy, self._until_s = True, -np.inf
        return n_before + found


class _Node:
    """What the node publishes and serves, from the thread of its source; `live` comes last."""

    live: LiveIdentifier | None = None

    def __init__(self, source: Ros2Source, trigger: ArmedTrigger | None, rest_s: float) -> None:
        self._source, self._trigger, self._n_lost = source, trigger, 0
        self._n_rest = round(rest_s * source.info.rate_hz)
        self._msg, node = ros("diagnostic_msgs.msg"), source.node
        qos = ros("rclpy.qos")
        lasting = qos.QoSProfile(depth=1, durability=qos.DurabilityPolicy.TRANSIENT_LOCAL)
        self._answers = node.create_publisher(self._msg.DiagnosticArray, "~/answer", lasting)
        self._diagnostics = node.create_publisher(self._msg.DiagnosticArray, "/diagnostics", 10)
        node.create_timer(_DIAGNOSE_S, self._diagnose)
        if trigger is not None:
            node.create_service(ros("std_srvs.srv").Trigger, "~/arm", self._arm)

    def answer(self, push: Push) -> None:
        """Publish what came of a push."""
        if self._trigger is not None:
            self._trigger.is_busy = False
        decision, live = push.decision, self.live
        assert live is not None
        if decision is None:
            level, text = "ERROR", push.text
            values: dict[str, Any] = {"failure": "" if push.reason is None else push.reason.value}
        else:
            level, text = "WARN" if decision.unknown or decision.warnings else "OK", decision.sentence()
            values = decision.to_dict() | {"synthetic_model": live.model.synthetic}
        values |= self._stream(live) | {"push": live.n_pushes}
        self._publish(self._answers, level, "answer", text, values)

    def _stream(self, live: LiveIdentifier) -> dict[str, Any]:
        """Return how many samples never came, by their stamps, and how late the newest is."""
        return {"missing": live.stream.health().counters["missing"], "lag_s": live.stream.lag_s()}

    def _diagnose(self) -> None:
        if self.live is None:
            return
        values, armed = self._stream(self.live), self._trigger is None or self._trigger.is_armed
        n_before, self._n_lost = self._n_lost, values["missing"]
        level = "OK" if values["lag_s"] <= _LATE_S and self._n_lost == n_before else "WARN"
        self._publish(self._diagnostics, level, "stream", "armed" if armed else "waits for ~/arm", values)

    def _publish(self, publisher: Any, level: str, name: str, message: str, values: dict[str, Any]) -> None:
        node, pair = self._source.node, self._msg.KeyValue
        pairs = [
            pair(key=key, value=value if isinstance(value, str) else json.dumps(value))
            for key, value in values.items()
        ]
        status = self._msg.DiagnosticStatus(
            level=getattr(self._msg.DiagnosticStatus, level),
            name=f"{node.get_name()}: {name}",
            message=message,
            hardware_id=self._source.info.name,
            values=pairs,
        )
        array = self._msg.DiagnosticArray(status=[status])
        array.header.stamp = node.get_clock().now().to_msg()
        array.header.frame_id = self._source.info.frame or ""
        publisher.publish(array)

    def _arm(self, _request: Any, response: Any) -> Any:
        refusal = self._refusal()
        response.success = refusal is None
        response.message = refusal or "armed: the next motion is the push"
        return response

    def _refusal(self) -> str | None:
        """Arm where the newest rows rest, else say why not."""
        if self._trigger is None or self.live is None:
            return "the model is still being compared with the topic"
        if self._trigger.is_busy:
            return "a push is being captured"
        try:  # gaps are for the capture to judge
            window = self.live.stream.buffer.window(self._n_rest, fill="linear", max_gap=self._n_rest)
        except WindowError as error:
            return str(error)
        return self._trigger.allow(replace(Rows.none(), wrench=window.wrench, time_s=window.time_s))


def _frame_for(model: Identifier) -> Callable[[str], str | None]:
    """Return a function of the frame of messages: the one frame that the model knows, where that is another one."""

    def wanted(frame_id: str) -> str | None:
        trained = [
            one.trained
            for one in model.requirements.differences(Setup(frame=frame_id), {})
            if one.name == "frame"
        ]
        return trained[0][0] if trained and len(trained[0]) == 1 else None

    return wanted


def _run(options: argparse.Namespace) -> None:
    model, threshold_n = Identifier.load(options.model), options.threshold_n
    trigger = None if options.always else ArmedTrigger(threshold_n)
    frame_for = (lambda _: None) if "frame" in options.accept else _frame_for(model)
    source = Ros2Source(options.topic, model.rate_hz, frame_for=frame_for, ros_args=options.ros_args)
    node = _Node(source, trigger, max(_REST_S, options.pre_s or model.lead_s or 0.0))
    # Later than the source itself gives up: it knows why.
    with stop_on_signals(), opened(source, first_row_s=3 * WAIT_S) as stream:
        setup = setup_of(
            source, None, "force" if trigger is None else lambda: trigger, threshold_n=threshold_n
        )
        settings = {name: getattr(options, name) for name in ("accept", "max_gap", "pre_s")}
        node.live = live = LiveIdentifier(stream, model, setup, timeout_s=_FOR_EVER_S, **settings)
        for difference in live.differences:
            print(f"warning: {setup_mismatch(difference)}")
        if live.model.synthetic:
            print("warning: the model was trained on SYNTHETIC recordings: its answers mean nothing")
        print(f"{source.info.name}: ready", flush=True)
        try:
            for push in live.pushes():
                node.answer(push)
                print(push, flush=True)
                if live.n_answered == options.n:
                    break
        except CaptureError as error:
            node.answer(Push(None, error.reason, str(error)))
            raise
        finally:
            print(live.summary(), flush=True)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command until Ctrl-C, or until so many answers are given."""
    parser = argparse.ArgumentParser(
        prog="granular-id-ros2",
        description="Name the material of each push, as a node of ROS 2. It moves nothing: with the tool at rest, call "
        "the service ~/arm; where it answers with success, push. Options are those of `granular-id live`.",
    )
    add = parser.add_argument
    add("--topic", required=True, help="topic of geometry_msgs/WrenchStamped, at the rate of the model")
    add("--model", "-m", required=True)
    add("--always", action="store_true", help="take every push, without the service ~/arm")
    add("--threshold-n", type=float, default=0.5)
    add("--pre-s", type=float)
    add("--max-gap", type=int, default=0)
    add("--accept", action="append", default=[])
    add("--n", "-n", type=int)
    add("ros_args", nargs="*", metavar="ARGS", help="behind --, for ROS: -- -r __ns:=/left")
    try:
        _run(parser.parse_args(arguments))
    except (ValueError, TypeError, OSError, ImportError, CaptureError) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
