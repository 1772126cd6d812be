"""``granular-id ros2``: pushes of a robot under ROS 2 named by a node."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import typer

from granular_id._files import check_source
from granular_id.cli.errors import in_options
from granular_id.cli.interrupts import leave_lost_terminal, stopping_the_robot
from granular_id.cli.options import at_least, command, option, positive
from granular_id.cli.outputs import show, warn_of_setups
from granular_id.cli.recordings import ACCEPT, Difference

TOPIC, PUSH, MODEL = "Topic", "Push", "Model"


@dataclass(kw_only=True)
class Subscribing:
    """A topic, and how it is listened to."""

    topic: str = option(
        TOPIC, "Topic of geometry_msgs/WrenchStamped: /ft_sensor/wrench.", "--topic", default=...
    )
    depth: int = option(TOPIC, "Messages that ROS keeps while this program is late.", default=500)
    reliable: bool = option(
        TOPIC, "Ask again for lost messages; needs a driver that offers it.", "--reliable", default=False
    )
    wait_s: float = option(TOPIC, "How long the first message, and tf, may take.", default=5.0)

    def __post_init__(self) -> None:
        if not self.topic.strip():
            raise ValueError("--topic must name a topic, such as /ft_sensor/wrench, got ''")
        at_least("--depth", self.depth, 1)
        positive("--wait-s", self.wait_s)


@dataclass(kw_only=True)
class Pushing:
    """What a push is."""

    always: bool = option(PUSH, "Take every push, without the service ~/arm.", "--always", default=False)
    arm_s: float = option(PUSH, "So long after ~/arm may the push begin.", default=30.0)
    threshold_n: float = option(PUSH, "Change of force that is a motion, newton.", default=0.5)
    pre_s: float | None = option(PUSH, "Rest before the motion; needed where the model does not know it.")
    max_gap: int = option(
        PUSH, "Missing samples in a row that are filled in, flagged; more: no answer.", default=0
    )

    def __post_init__(self) -> None:
        for name in ("arm_s", "threshold_n", "pre_s"):
            positive(f"--{name.replace('_', '-')}", getattr(self, name))
        at_least("--max-gap", self.max_gap, 0)


@command
@stopping_the_robot()
def ros2(
    subscribing: Subscribing,
    pushing: Pushing,
    *,
    model: Path = option(MODEL, "Model file, from `granular-id train`.", "--model", "-m", default=...),
    accept: list[Difference] | None = option(MODEL, ACCEPT),
    n: int | None = option(MODEL, "Stop after so many answers.", "--n", "-n"),
    ros_args: list[str] | None = typer.Argument(
        None, metavar="[-- ARGS]", help="For ROS, as after --ros-args.", show_default=False
    ),
) -> None:
    """Name the material of each push as a node of ROS 2, by a wrench topic.

    Not run with ROS yet: written against rclpy of Humble and Jazzy, tested against a stand-in.

    The node `granular_id` publishes each answer on `~/answer` (diagnostic_msgs/DiagnosticArray; the last one stays for
    who comes later), and once a second on `/diagnostics` whether it is armed, lag and losses. It moves nothing: with
    the tool at rest, call the service `~/arm` (std_srvs/Trigger); where it answers with success, push.

    The rate of the topic is that of the model. Messages in another frame than that of the training are turned into
    it by tf, where the two are fixed to each other; otherwise they are refused, unless `--accept frame` says that
    it may be. It goes on until Ctrl-C. Behind `--` stand arguments for ROS: `-- -r __ns:=/left -p use_sim_time:=true`.

    Examples:

    `granular-id ros2 --topic /ft_sensor/wrench --model kitchen.safetensors`
    `granular-id ros2 --topic /ft_sensor/wrench --model kitchen.safetensors --always --max-gap 2`
    """
    at_least("--n", n, 1)
    check_source(model)

    from granular_id.identifier import Identifier
    from granular_id.live.capture import CaptureError
    from granular_id.live.ros2 import ros2_node

    identifier = Identifier.load(model)
    if identifier.synthetic:
        show(
            "warning: the model was trained on SYNTHETIC recordings; its answers about real materials mean nothing",
            "bold yellow",
        )
    options = vars(subscribing) | vars(pushing) | {"accept": [one.value for one in accept or []]}
    with ros2_node(identifier, ros_args=ros_args or [], **options) as node:
        warn_of_setups(node.live.differences)
        if node.source.info.frame is None:
            show(
                "warning: messages name no frame: it is not compared with that of the training", "bold yellow"
            )
        show(f"{node.source.info.name}: {'push' if pushing.always else 'call ~/arm, then push'}")
        try:
            for push in node.pushes():
                show(in_options(str(push)))
                if node.live.n_answered == n:
                    break
        except CaptureError as error:
            raise ValueError(str(error)) from error
        except (KeyboardInterrupt, SystemExit):  # how it ends: with its summary
            leave_lost_terminal()
            raise
        finally:
            show(in_options(node.live.summary()))
