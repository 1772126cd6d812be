"""Who moves the tool, and what starts a capture: chosen by name, or as the source suggests."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass

from granular_id._checks import argument_error
from granular_id._core import GranularIdError
from granular_id.live.robot import ManualRobot, Robot, checked_robot
from granular_id.live.source import WrenchSource, open_robot
from granular_id.live.trigger import ForceTrigger, ManualTrigger, MotionTrigger, Trigger

__all__ = ["ROBOTS", "TRIGGERS", "Setup", "setup_of", "starts_exactly"]

ROBOTS, TRIGGERS = ("auto", "none", "manual", "source"), ("auto", "motion", "force", "manual")
_CLOSE_S = 2.0


@dataclass(frozen=True)
class Setup:
    """Who moves (None: somebody else, and the trigger notices), and what makes the trigger of each capture."""

    robot: Robot | None
    trigger: Callable[[], Trigger]

    def close(self) -> None:
        """End the connection to the robot, where it has one; a driver that hangs is left behind."""
        close = getattr(self.robot, "close", None)
        if close is not None:
            thread = threading.Thread(target=close, name="granular_id close", daemon=True)
            thread.start()
            thread.join(_CLOSE_S)


def setup_of(
    source: WrenchSource,
    robot: str | Robot | None = "auto",
    trigger: str | Callable[[], Trigger] = "auto",
    *,
    threshold_n: float = 0.5,
) -> Setup:
    """Choose robot and trigger for a source.

    Parameters
    ----------
    source : WrenchSource
    robot : {"auto", "none", "manual", "source"}, Robot or None, default "auto"
        "auto": the simulated robot of a simulated sensor, nobody for other sources: no machine moves unasked.
        "source": the robot that the source is part of. "manual": a person who is prompted to push. A URL: see
        `open_robot`.
    trigger : {"auto", "motion", "force", "manual"} or callable, default "auto"
        "motion": where the robot's motion begins. "force": where the force leaves its level at rest. "manual": a
        `ManualTrigger`, which somebody must fire. "auto": what the source knows of itself (recordings played again
        say where their motion begins), else the motion of a robot, else the force.
    threshold_n : float, default 0.5
        Of "force", see `ForceTrigger`. With "motion" the force must rest within four times of it before the robot
        moves, see `MotionTrigger`.

    Returns
    -------
    Setup

    Raises
    ------
    TypeError, ValueError
        An unknown name, no robot, or the motion of a robot that is not there or is a person.

    Examples
    --------
    >>> from granular_id.live import SimSource, setup_of
    >>> setup_of(SimSource("rice", seed=1)).trigger().name
    'motion'
    >>> setup_of(SimSource("rice", seed=1), robot=None).trigger().name
    'force'
    """
    if not hasattr(source, "info"):
        problem = f"must be an opened source (stream.source), got {source!r:.60}"
        raise argument_error(TypeError, "source", problem)
    mover = _robot_of(source, robot)
    if callable(trigger):
        return Setup(mover, trigger)
    if trigger not in TRIGGERS:
        raise argument_error(
            GranularIdError, "trigger", f"must be one of {', '.join(TRIGGERS)}, got {trigger!r}"
        )
    ForceTrigger(threshold_n)  # refused now, not when the first push begins
    exact = starts_exactly(mover)
    if trigger == "motion" and not exact:
        who = "there is no robot" if mover is None else "a person's motion has no exact start"
        raise argument_error(
            GranularIdError, "trigger", f"='motion' needs a robot: {who}; use trigger='force'"
        )
    if trigger == "auto" and mover is None and hasattr(source, "trigger"):
        return Setup(None, source.trigger)
    if trigger == "manual":
        return Setup(mover, ManualTrigger)
    if trigger == "motion" or (trigger == "auto" and exact):
        return Setup(mover, lambda: MotionTrigger(4 * threshold_n))
    return Setup(mover, lambda: ForceTrigger(threshold_n))


def starts_exactly(robot: Robot | None) -> bool:
    """Whether the start of a motion is known well enough to be the trigger: a person's is not."""
    return robot is not None and not isinstance(robot, ManualRobot)


def _robot_of(source: WrenchSource, robot: str | Robot | None) -> Robot | None:
    if robot is None or robot == "none":
        return None
    own: Callable[[], Robot] | None = getattr(source, "robot", None)
    if robot == "auto":
        return own() if own is not None and source.info.synthetic else None
    if robot == "source":
        if own is None:
            text = f"='source' asks for the robot of the source, and {source.info.name} has none"
            raise argument_error(GranularIdError, "robot", text)
        return own()
    if robot == "manual":
        return ManualRobot()
    if not isinstance(robot, str):
        return checked_robot(robot)
    if ":" in robot:
        return open_robot(robot)
    wanted = f"must be one of {', '.join(ROBOTS)}, the URL of a robot or a Robot, got {robot!r}"
    raise argument_error(GranularIdError, "robot", wanted)
