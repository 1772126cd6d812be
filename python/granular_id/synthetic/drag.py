"""Mean drag on the tool and its course along the push."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import finite_number, positive_number
from granular_id.synthetic.materials import Material

FloatArray = NDArray[np.float64]

GRAVITY_M_S2 = 9.81
# Broms' factor 3 for a pile in sand under lateral load: a wedge of three tool widths is mobilised. With
# the pressure's integral over depth, H^2/2, it gives the 1.5 of the formula.
WEDGE_WIDTHS = 3.0
# Three mobilised widths times the factor 2 of Rankine's passive cohesion term, 2 c sqrt(Kp).
COHESION_FACTOR = 6.0
# Depth layers that slip independently. Force chains end within a few tool widths of each other: 76 mm of
# a 17 mm tool is about four.
N_LAYERS = 4
# Load-bearing contacts: 60 % of the grains that fit on the front half of the submerged cylinder's surface.
CONTACT_FRACTION = 0.6
# Travel over which the heap and the back-flow build up, tool diameters: a surcharge forms over the first
# few tool widths, the hole behind the tool closes within about one.
HEAP_DIAMETERS = 2.0
BACK_FLOW_DIAMETERS = 1.0
# Reach of the end wall's influence, tool diameters (Rankine's passive wedge is about 2 widths long).
WALL_REACH_DIAMETERS = 1.3


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
        for field in fields(self):
            if field.name == "sensor_to_tool_m":
                finite_number(field.name, self.sensor_to_tool_m, least=0)
            else:
                positive_number(field.name, getattr(self, field.name))
        if self.depth_m > self.tool_length_m:
            raise ValueError(
                f"depth_m must not exceed tool_length_m = {self.tool_length_m:g}, got {self.depth_m:g}"
            )

    def travel_m(self, time_s: FloatArray) -> FloatArray:
        """Distance moved at times counted from the start of the motion (0 before it), m."""
        ramp_s = self.speed_m_s / self.acceleration_m_s2
        moving = np.maximum(time_s, 0.0)
        ramped = np.minimum(moving, ramp_s)
        return 0.5 * self.acceleration_m_s2 * ramped**2 + self.speed_m_s * (moving - ramped)

    def surface_to_sensor_m(self) -> float:
        """Height of the sensor's origin above the surface of the bed, m."""
        return self.sensor_to_tool_m + self.tool_length_m - self.depth_m


def _effective_diameter_m(material: Material, rig: Rig) -> float:
    # The tool cannot pass between grains: half a grain on either side moves with it (Albert 1999).
    return rig.tool_diameter_m + material.grain_diameter_m


def _friction_and_cohesion_n(material: Material, rig: Rig) -> tuple[float, float]:
    passive = math.tan(math.radians(45.0 + material.friction_angle_deg / 2.0)) ** 2
    width_m = _effective_diameter_m(material, rig)
    weight_n_m3 = material.bulk_density_kg_m3 * GRAVITY_M_S2
    friction_n = 0.5 * WEDGE_WIDTHS * passive * weight_n_m3 * width_m * rig.depth_m**2
    cohesion_n = COHESION_FACTOR * material.cohesion_pa * math.sqrt(passive) * width_m * rig.depth_m
    return friction_n, cohesion_n


def mean_drag_n(material: Material, rig: Rig | None = None) -> float:
    """Steady drag of a slow vertical cylinder, N.

    ``F0 = 1.5 Kp rho g De H^2 + 6 c sqrt(Kp) De H`` with ``Kp = tan^2(45 deg + phi/2)`` and ``De = D + d``:
    friction grows with the square of the depth, cohesion with the depth, and speed does not enter.

    Parameters
    ----------
    material : Material
    rig : Rig, optional
        Default: the paper's.

    Returns
    -------
    float
        Newton.

    Notes
    -----
    F ~ D H^2, independent of speed: R. Albert et al., "Slow drag in a granular medium", Phys. Rev. Lett. 82,
    205 (1999). The prefactor is that of passive earth pressure on a pile. Depth-proportional resistive
    stress in three dimensions: S. Agarwal, D. I. Goldman, K. Kamrin, "Mechanistic framework for
    reduced-order models in soft materials: application to three-dimensional granular intrusion", PNAS 120,
    e2214017120 (2023).

    Examples
    --------
    >>> from granular_id.synthetic import PAPER_MATERIALS, mean_drag_n
    >>> round(mean_drag_n(PAPER_MATERIALS[1]), 2)   # rice
    4.7
    """
    return sum(_friction_and_cohesion_n(material, rig or Rig()))


def froude_number(material: Material, rig: Rig | None = None) -> float:
    """Speed over the speed at which inertia begins to matter; the model holds well below 1.

    ``Fr = 2 v sqrt(2 D / g) / (D + d)``: drag is independent of speed up to about 1 (S. Kumar, K. A. Reddy,
    S. Takada, H. Hayakawa, "Scaling law of the drag force in dense granular media", arXiv 1712.09057, 2017).

    Examples
    --------
    >>> from granular_id.synthetic import PAPER_MATERIALS, froude_number
    >>> froude_number(PAPER_MATERIALS[1]) < 0.2
    True
    """
    rig = rig or Rig()
    crossing_s = math.sqrt(2.0 * rig.tool_diameter_m / GRAVITY_M_S2)
    return 2.0 * rig.speed_m_s * crossing_s / _effective_diameter_m(material, rig)


def contact_count(material: Material, rig: Rig | None = None) -> float:
    """Load-bearing contacts on the tool, ``Nc = 0.6 (pi/2) D H / d^2``, at least 1.

    Fluctuations of the drag are averages over that many force chains, hence their relative size
    ``1/sqrt(Nc)``, proportional to d (I. Albert et al., "Stick-slip fluctuations in granular drag",
    Phys. Rev. E 64, 031307, 2001).
    """
    rig = rig or Rig()
    front_m2 = 0.5 * math.pi * rig.tool_diameter_m * rig.depth_m
    return max(1.0, CONTACT_FRACTION * front_m2 / material.grain_diameter_m**2)


def layers(material: Material, rig: Rig) -> tuple[FloatArray, FloatArray]:
    """Share of the mean drag and lever arm (m, to the sensor's origin) of each depth layer.

    Frictional pressure grows with depth, cohesion does not, so the shares run between a triangle
    and a rectangle. The lever arm is where a layer's own resultant acts.
    """
    friction_n, cohesion_n = _friction_and_cohesion_n(material, rig)
    edges = np.linspace(0.0, 1.0, N_LAYERS + 1)
    top, bottom = edges[:-1], edges[1:]
    force_n = friction_n * (bottom**2 - top**2) + cohesion_n * (bottom - top)
    moment = friction_n * (bottom**3 - top**3) * (2.0 / 3.0) + cohesion_n * (bottom**2 - top**2) * 0.5
    centre_m = rig.depth_m * moment / force_n
    return force_n / force_n.sum(), rig.surface_to_sensor_m() + centre_m


def drag_profile(material: Material, travel_m: FloatArray, rig: Rig) -> tuple[FloatArray, FloatArray]:
    """Course of the drag along the push, in units of the mean drag.

    Parameters
    ----------
    material : Material
    travel_m : ndarray, shape (n,)
        Distance moved, m; 0 while at rest.
    rig : Rig

    Returns
    -------
    drag : ndarray, shape (n,)
        Load borne by the grains, never negative: mobilisation ``1 - exp(-X/xm)``, overshoot of a dense
        packing ``A (X/xo) exp(1 - X/xo)``, heap, and the rise ``a exp(-(Xw - X)/1.3)`` towards the wall.
    measured : ndarray, shape (n,)
        The same with the negative offset of the back-flow, as a sensor sees it that was zeroed in the bed.

    Notes
    -----
    Dense packings overshoot and then oscillate, loose ones do not: N. Gravish, P. B. Umbanhowar,
    D. I. Goldman, "Force and flow transition in plowed granular media", Phys. Rev. Lett. 105, 128301 (2010).
    """
    x = travel_m / rig.tool_diameter_m
    wall_at = rig.wall_distance_m / rig.tool_diameter_m
    mobilised = 1.0 - np.exp(-x / material.mobilisation_diameters)
    early = x / material.overshoot_at_diameters
    peak = material.overshoot * early * np.exp(1.0 - early)
    heap = material.heap * (1.0 - np.exp(-x / HEAP_DIAMETERS))
    wall = material.wall * np.exp(-(wall_at - x) / WALL_REACH_DIAMETERS)
    drag = mobilised * (1.0 + peak + heap + wall)
    back_flow = material.back_flow * (1.0 - np.exp(-x / BACK_FLOW_DIAMETERS))
    return drag, drag - back_flow
