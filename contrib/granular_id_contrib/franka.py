"""Franka arms (Panda, FR3) through ``franky-control``: the force they estimate, and straight pushes.

Not run on hardware. Written against franky-control 2.0: https://timschneider42.github.io/franky/
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from scipy.spatial.transform import Rotation

from granular_id.live import Pose, SourceInfo, SourceUrl, checked_move
from granular_id_contrib import NOT_RUN
from granular_id_contrib.polling import PolledMotion, PollingSource, PushStart, library

__all__ = ["FrankaRobot", "FrankaSource", "open_url"]

_PACKAGE = "franky-control"
_RATE_HZ = 1000.0


class FrankaSource(PollingSource):
    """The external force that the arm estimates from its joint torques.

    Parameters
    ----------
    robot : str or franky.Robot
        Address of the arm, or the connection that also moves it: an arm takes one only.

    Notes
    -----
    An estimate, filtered within the arm, and zero near singular poses: coarser than a wrist sensor. Time is the
    arm's own, in milliseconds.
    """

    def __init__(self, robot: Any) -> None:
        franky = library("franky", _PACKAGE)
        self._arm = franky.Robot(robot) if isinstance(robot, str) else robot
        super().__init__(
            SourceInfo(
                f"Franka {self._arm.fci_hostname}",
                _RATE_HZ,
                tick_hz=1000.0,
                device_clock=True,
                frame="stiffness frame K of the arm",
                sign="force of the arm on the environment",
                compensated=True,
                meta={"status": NOT_RUN, "driver": _PACKAGE, "estimated_from": "joint torques"},
            )
        )

    def robot(self) -> FrankaRobot:
        """Return the robot on the same connection."""
        return FrankaRobot(self._arm, shares_clock=True)

    def newest(self) -> tuple[float, Any, int]:
        """Return the newest state."""
        state = self._arm.state
        return state.time.to_sec(), state.K_F_ext_hat_K, 0


class FrankaRobot:
    """A Franka arm that pushes at a constant speed of its tool.

    Parameters
    ----------
    robot : str or franky.Robot
        Address of the arm, or the connection that `FrankaSource` reads too.
    shares_clock : bool, default False
        The samples are this arm's own (`FrankaSource.robot` says so): the start of a motion is then told by its
        clock, else by the host's.
    """

    def __init__(self, robot: Any, *, shares_clock: bool = False) -> None:
        self._shares_clock = shares_clock
        self._start = PushStart()
        self._franky = library("franky", _PACKAGE)
        self._arm = self._franky.Robot(robot) if isinstance(robot, str) else robot

    def tcp_pose(self) -> Pose:
        """Return where the end effector is."""
        pose = self._arm.current_pose.end_effector_pose
        x, y, z = (float(value) for value in pose.translation)
        rx, ry, rz = (float(value) for value in Rotation.from_quat(pose.quaternion).as_rotvec())
        return (x, y, z, rx, ry, rz)

    def move_line(self, direction: Sequence[float], speed_m_s: float, duration_s: float) -> PolledMotion:
        """Move straight on in the base frame; the speed is held for `duration_s` once it is reached.

        Raises
        ------
        RuntimeError
            The tool was not brought back after the last push.
        """
        ahead, speed_m_s, duration_s = checked_move(direction, speed_m_s, duration_s)
        pose = self.tcp_pose()
        self._start.check(pose, ahead)
        franky = self._franky
        twist = franky.Twist([speed_m_s * part for part in ahead], [0.0, 0.0, 0.0])
        push = franky.CartesianVelocityMotion(twist, franky.Duration(round(1000 * duration_s)))
        report = {
            "robot": "franka",
            "start": list(pose),
            "speed_m_s": speed_m_s,
            "duration_s": duration_s,
        }
        start_time_s = self._arm.state.time.to_sec() if self._shares_clock else None
        self._arm.move(push, asynchronous=True)
        # Joining without waiting tells whether the motion has ended, and raises what ended it.
        return PolledMotion(start_time_s, lambda: self._arm.join_motion(timeout=0.0), report, error_ends=True)

    def stop(self) -> None:
        """Brake."""
        self._arm.stop()


def open_url(url: SourceUrl) -> FrankaSource:
    """Make the source of ``franka://HOST``."""
    url.allow()
    return FrankaSource(url.need_host())


def open_robot(url: SourceUrl) -> FrankaRobot:
    """Connect to the arm of ``franka://HOST``."""
    url.allow()
    return FrankaRobot(url.need_host())
