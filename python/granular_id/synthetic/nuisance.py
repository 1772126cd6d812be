"""What differs between two pushes through the same material: fill, packing, mounting, zero point."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import finite_number
from granular_id.synthetic.drag import Rig
from granular_id.synthetic.materials import Material

FloatArray = NDArray[np.float64]

# Draws beyond this many standard deviations are cut: a bed a centimetre too deep would be seen and redone.
CUT_SD = 2.5
# Response to one per cent of packing fraction: friction angle (deg) and overshoot (factor, logarithm).
# Dense beds dilate: angle and peak grow together (Gravish 2010).
ANGLE_PER_PERCENT = 0.8
OVERSHOOT_PER_PERCENT = 0.12


@dataclass(frozen=True)
class Conditions:
    """State of bed, mounting and sensor in one push; the default is nominal everywhere.

    Parameters
    ----------
    depth_offset_m : float
        Fill height against the rig's `depth_m`; the tool's length is the limit.
    packing_percent : float
        Packing fraction against the nominal one, per cent: density, friction angle and overshoot follow.
    overshoot_log, heap_log, back_flow_log : float
        Logarithms of factors on these terms of the profile.
    wall_offset_m : float
        Where the push starts: distance to the wall against the rig's.
    lift_ratio : float
        Fz over Fx.
    lateral_ratio : float
        Mean Fy over Fx, from an uneven bed.
    off_axis_x_m, off_axis_y_m : float
        Eccentricity of the tool against the sensor's axis, m.
    roll_rad, pitch_rad, yaw_rad : float
        Tilt of the sensor against the frame of the push.
    gain_log : float
        Logarithm of the sensor's gain error.
    tare : tuple of 6 float
        Zero-point error per axis, N and N m.
    drift_per_s : tuple of 6 float
        Drift per axis, N/s and N m/s.
    """

    depth_offset_m: float = 0.0
    packing_percent: float = 0.0
    overshoot_log: float = 0.0
    heap_log: float = 0.0
    back_flow_log: float = 0.0
    wall_offset_m: float = 0.0
    lift_ratio: float = 0.55
    lateral_ratio: float = 0.0
    off_axis_x_m: float = 0.0
    off_axis_y_m: float = 0.0
    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0
    gain_log: float = 0.0
    tare: tuple[float, ...] = (0.0,) * 6
    drift_per_s: tuple[float, ...] = (0.0,) * 6

    def material(self, nominal: Material) -> Material:
        """Return the material in this state of packing."""
        angle = nominal.friction_angle_deg + ANGLE_PER_PERCENT * self.packing_percent
        overshoot_log = self.overshoot_log + OVERSHOOT_PER_PERCENT * self.packing_percent
        return replace(
            nominal,
            bulk_density_kg_m3=nominal.bulk_density_kg_m3 * (1.0 + self.packing_percent / 100.0),
            friction_angle_deg=min(max(angle, 0.0), 60.0),
            overshoot=nominal.overshoot * math.exp(overshoot_log),
            heap=nominal.heap * math.exp(self.heap_log),
            back_flow=nominal.back_flow * math.exp(self.back_flow_log),
        )

    def rig(self, nominal: Rig) -> Rig:
        """Return the rig with this fill height and starting point."""
        return replace(
            nominal,
            depth_m=min(nominal.depth_m + self.depth_offset_m, nominal.tool_length_m),
            wall_distance_m=nominal.wall_distance_m + self.wall_offset_m,
        )

    def rotation(self) -> FloatArray:
        """Return the rotation from the frame of the push to the sensor's, shape (3, 3)."""
        cr, sr = math.cos(self.roll_rad), math.sin(self.roll_rad)
        cp, sp = math.cos(self.pitch_rad), math.sin(self.pitch_rad)
        cy, sy = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        about_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
        about_y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
        about_z = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
        rotation: FloatArray = about_z @ about_y @ about_x
        return rotation


@dataclass(frozen=True)
class Nuisance:
    """Standard deviations of what varies, each split into recording, fill and session.

    A *fill* is one material poured in one session. Each field is ``(per recording, per fill, per session)``.

    Parameters
    ----------
    depth_m : fill height; together about 3 mm, read off a scale on the container.
    packing_percent : packing fraction; pouring and levelling by hand repeat to about one per cent.
    overshoot_log, heap_log, back_flow_log : shape of the profile, logarithm of a factor.
    wall_m : starting point of the push.
    lift_ratio, lateral_ratio : direction of the mean force.
    off_axis_m : eccentricity of the mounted tool.
    tilt_deg : tilt of the sensor, each of roll, pitch and yaw.
    gain_log : gain error of the calibration.
    tare_n, tare_n_m : zero-point error of each force and torque axis.
    drift_n_s, drift_n_m_s : drift of each force and torque axis.

    Examples
    --------
    >>> from granular_id.synthetic import Nuisance
    >>> Nuisance().scaled(0).tare_n
    (0.0, 0.0, 0.0)
    """

    depth_m: tuple[float, float, float] = (0.0020, 0.0020, 0.0010)
    packing_percent: tuple[float, float, float] = (1.0, 0.8, 0.5)
    overshoot_log: tuple[float, float, float] = (0.20, 0.12, 0.0)
    heap_log: tuple[float, float, float] = (0.15, 0.10, 0.0)
    back_flow_log: tuple[float, float, float] = (0.06, 0.05, 0.0)
    wall_m: tuple[float, float, float] = (0.0008, 0.0005, 0.0005)
    lift_ratio: tuple[float, float, float] = (0.02, 0.02, 0.01)
    lateral_ratio: tuple[float, float, float] = (0.03, 0.02, 0.01)
    off_axis_m: tuple[float, float, float] = (0.0, 0.0, 0.0005)
    tilt_deg: tuple[float, float, float] = (0.1, 0.0, 0.6)
    gain_log: tuple[float, float, float] = (0.0, 0.0, 0.01)
    tare_n: tuple[float, float, float] = (0.05, 0.0, 0.10)
    tare_n_m: tuple[float, float, float] = (0.002, 0.0, 0.005)
    drift_n_s: tuple[float, float, float] = (0.004, 0.0, 0.004)
    drift_n_m_s: tuple[float, float, float] = (0.0001, 0.0, 0.0001)

    def __post_init__(self) -> None:
        for field in fields(self):
            levels = getattr(self, field.name)
            if not isinstance(levels, tuple) or len(levels) != 3:
                raise ValueError(
                    f"{field.name} must be (per recording, per fill, per session), got {levels!r:.60}"
                )
            for level in levels:
                finite_number(field.name, level, least=0)

    def scaled(self, factor: float) -> Nuisance:
        """Return the same nuisance with every level times `factor`; 0 switches it off."""
        factor = finite_number("factor", factor, least=0)
        return Nuisance(**{f.name: tuple(factor * s for s in getattr(self, f.name)) for f in fields(self)})

    def draw(self, *rngs: np.random.Generator) -> Conditions:
        """Draw the conditions of one push from the generators of recording, fill and session, in this order.

        The same generators give the same draws in units of the levels, whatever the levels are.
        """
        names = [field.name for field in fields(self)]
        draws = np.stack([rng.standard_normal((len(names), 6)) for rng in rngs])
        levels = np.array([getattr(self, name) for name in names])
        total = np.einsum("nk,knj->nj", levels, np.clip(draws, -CUT_SD, CUT_SD))
        drawn = dict(zip(names, total.tolist(), strict=True))
        roll_deg, pitch_deg, yaw_deg = drawn["tilt_deg"][:3]
        return Conditions(
            depth_offset_m=drawn["depth_m"][0],
            packing_percent=drawn["packing_percent"][0],
            overshoot_log=drawn["overshoot_log"][0],
            heap_log=drawn["heap_log"][0],
            back_flow_log=drawn["back_flow_log"][0],
            wall_offset_m=drawn["wall_m"][0],
            lift_ratio=Conditions.lift_ratio + drawn["lift_ratio"][0],
            lateral_ratio=drawn["lateral_ratio"][0],
            off_axis_x_m=drawn["off_axis_m"][0],
            off_axis_y_m=drawn["off_axis_m"][1],
            roll_rad=math.radians(roll_deg),
            pitch_rad=math.radians(pitch_deg),
            yaw_rad=math.radians(yaw_deg),
            gain_log=drawn["gain_log"][0],
            tare=(*drawn["tare_n"][:3], *drawn["tare_n_m"][3:]),
            drift_per_s=(*drawn["drift_n_s"][:3], *drawn["drift_n_m_s"][3:]),
        )
