"""The tool, its bed and its motion: everything that is the same whatever the material."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from granular_id.synthetic import _checks

__all__ = ["Rig"]


@dataclass(frozen=True)
class Rig:
    """A vertical cylinder, almost submerged, pushed sideways through a container.

    The defaults are the paper's: a cylinder 17 mm wide and 80 mm long at 0.03 m/s.

    Frame: x along the push, z along the tool away from the sensor flange (down), y completes the
    right-handed set; origin at the sensor. Sign: what the tool exerts on the material, so that Fx is
    positive while pushing.

    Parameters
    ----------
    tool_diameter_m : float, default 0.017
        D.
    tool_length_m : float, default 0.080
        Length of the cylinder.
    depth_m : float, default 0.076
        H, submerged length; at most `tool_length_m`.
    speed_m_s : float, default 0.03
        Speed of the push.
    acceleration_m_s2 : float, default 1.0
        The robot's ramp to that speed: 30 ms at the default, short against every feature of the drag.
    wall_distance_m : float, default 0.100
        From the start of the push to the container's end wall. The push must end before it.
    sensor_to_tool_m : float, default 0.040
        From the sensor's reference plane to the top of the cylinder: mounting plate and holder.
    """

    tool_diameter_m: float = 0.017
    tool_length_m: float = 0.080
    depth_m: float = 0.076
    speed_m_s: float = 0.03
    acceleration_m_s2: float = 1.0
    wall_distance_m: float = 0.100
    sensor_to_tool_m: float = 0.040

    def __post_init__(self) -> None:
        for field in (
            "tool_diameter_m",
            "tool_length_m",
            "depth_m",
            "speed_m_s",
            "acceleration_m_s2",
            "wall_distance_m",
        ):
            _checks.positive(field, getattr(self, field))
        _checks.non_negative("sensor_to_tool_m", self.sensor_to_tool_m)
        if self.depth_m > self.tool_length_m:
            raise ValueError(
                f"depth_m must not exceed tool_length_m = {self.tool_length_m:g}, got {self.depth_m:g}"
            )

    def travel_m(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance moved at times counted from the start of the motion (0 before it), m."""
        ramp_s = self.speed_m_s / self.acceleration_m_s2
        moving = np.maximum(time_s, 0.0)
        ramped = np.minimum(moving, ramp_s)
        return 0.5 * self.acceleration_m_s2 * ramped**2 + self.speed_m_s * (moving - ramped)

    def surface_to_sensor_m(self) -> float:
        """Height of the sensor's origin above the surface of the bed, m."""
        return self.sensor_to_tool_m + self.tool_length_m - self.depth_m
