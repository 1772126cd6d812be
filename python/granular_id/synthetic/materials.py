"""What a granular material is to the model, and the eleven materials of the paper."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields

from granular_id._checks import finite_number
from granular_id._core import GranularIdError
from granular_id._text import known_label

# Below a micrometre grains stick by forces the model does not hold; above a decimetre it is no bed.
_RANGES = {
    "grain_diameter_m": (1e-6, 0.1),
    "aspect_ratio": (1.0, math.inf),
    "friction_angle_deg": (0.0, 60.0),
}
_POSITIVE = {"overshoot_at_diameters", "sharpness", "mobilisation_diameters"}


@dataclass(frozen=True)
class Material:
    """One granular material, as the drag model sees it.

    Lengths along the push are in tool diameters and the terms of the profile in units of the mean drag,
    so that one description serves any tool and depth.

    Parameters
    ----------
    name : str
        Class label.
    grain_diameter_m : float
        Volume-equivalent grain diameter d, m.
    aspect_ratio : float
        Longest over shortest grain axis (1 = round). Long grains slip over a longer distance.
    bulk_density_kg_m3 : float
        Density of the loosely poured bed, kg/m3. Zero leaves cohesion as the only resistance.
    friction_angle_deg : float
        Angle of internal friction, degrees, in [0, 60].
    cohesion_pa : float, default 0
        Apparent cohesion, Pa: moisture, fat, interlocking of powders.
    overshoot : float, default 0
        Height of the early peak of a dense packing above the steady drag, relative to it.
    overshoot_at_diameters : float, default 0.5
        Travel at which that peak stands, in tool diameters.
    heap : float, default 0.2
        Growth of drag from the heap that builds up in front of the tool, relative.
    wall : float, default 0.5
        Drag added at the moment of touching the container's end wall, relative.
    back_flow : float, default 0.1
        Negative offset that sets in as material flows back behind the tool, relative. The sensor is
        zeroed with the tool standing in the bed, so the load locked in by insertion counts as zero, and
        its loss reads as a negative force.
    shear_band_wave : float, default 0
        Amplitude of the periodic force of successive shear bands, relative.
    fluctuation : float, default 1
        kappa, size of the stick-slip relative to 1/sqrt(number of load-bearing contacts).
    sharpness : float, default 0.5
        How abrupt slips are: 1 = hard dry grains that let go within 9 ms; 0.2 = soft or powdery.
    mobilisation_diameters : float, default 0.1
        Travel over which the resistance builds up, in tool diameters.

    Examples
    --------
    >>> from granular_id.synthetic import Material
    >>> lentils = Material("lentils", grain_diameter_m=0.0045, aspect_ratio=1.8,
    ...                    bulk_density_kg_m3=800, friction_angle_deg=28)
    >>> lentils.cohesion_pa
    0.0
    """

    name: str
    grain_diameter_m: float
    aspect_ratio: float
    bulk_density_kg_m3: float
    friction_angle_deg: float
    cohesion_pa: float = 0.0
    overshoot: float = 0.0
    overshoot_at_diameters: float = 0.5
    heap: float = 0.2
    wall: float = 0.5
    back_flow: float = 0.1
    shear_band_wave: float = 0.0
    fluctuation: float = 1.0
    sharpness: float = 0.5
    mobilisation_diameters: float = 0.1

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.strip():
            raise GranularIdError(f"name must be a non-empty string, got {self.name!r}")
        for field in fields(self)[1:]:
            least, most = _RANGES.get(field.name, (0.0, math.inf))
            where, value = f"{field.name} of material {self.name!r}", getattr(self, field.name)
            finite_number(where, value, positive=field.name in _POSITIVE, least=least, most=most)
        if self.bulk_density_kg_m3 == 0 and self.cohesion_pa == 0:
            raise GranularIdError(
                f"material {self.name!r} needs bulk_density_kg_m3 or cohesion_pa, both are 0"
            )


def _paper_materials() -> tuple[Material, ...]:
    # Estimates for kitchen and household goods: density and friction in the range of handbook values, the
    # course along the push chosen after what such a bed does. Not fitted to any recording.
    rows = (
        # name               d mm  AR   kg/m3 phi   c    A    xo/D heap wall  back  wave kappa sharp xm/D
        ("dry peas",         6.5,  1.1,  760, 28,   0,   .35, .5,  .20, .6,   .10,  0,   .8,  .8,  .06),
        ("rice",             2.9,  3.2,  820, 33,   0,   1.6, .5,  .30, 1.4,  1.6,  0,   .55, 1.0, .08),
        ("wheat flour",      .08,  1.3,  550, 37.5, 110, .05, 1,   .55, .5,   .05,  .02, 1,   .2,  .50),
        ("clay granules",    7,    1.2,  350, 38,   0,   .60, .5,  .10, .3,   1.45, 0,   1.2, 1.1, .08),
        ("oat flakes",       4.5,  2.5,  400, 37,   5,   .05, 1,   .60, 1.3,  .20,  0,   .6,  .4,  .45),
        ("potting gravel",   5,    1.4, 1400, 37,   0,   .45, .5,  .20, .5,   1.25, 0,   .5,  .6,  .05),
        ("sunflower seeds",  6,    2.0,  410, 35,   0,   .15, .8,  .35, .7,   .30,  0,   1.1, .6,  .20),
        ("breadcrumbs",      1.5,  1.5,  410, 38,   10,  .45, .6,  .25, .5,   .10,  .01, 1,   .6,  .15),
        ("macaroni",         9,    2.5,  420, 35,   0,   .20, .8,  .40, 1.4,  .20,  0,   1.0, 1.0, .10),
        ("fine sugar",       .35,  1.2,  860, 36,   15,  .25, .5,  .40, .8,   .10,  .12, 1,   .3,  .06),
        ("cat litter",       3.5,  1.4,  500, 37,   0,   .55, .5,  .12, .35,  1.35, 0,   1,   1.0, .08),
    )  # fmt: skip
    return tuple(Material(str(name), float(d_mm) * 1e-3, *map(float, rest)) for name, d_mm, *rest in rows)


PAPER_MATERIALS: tuple[Material, ...] = _paper_materials()
"""The eleven materials of the paper, in its order, as plausible estimates (see `Material`)."""


def resolve_materials(materials: str | Material | Iterable[str | Material]) -> tuple[Material, ...]:
    """Return the materials, those named from `PAPER_MATERIALS`; refuse unknown names and those given twice."""
    wanted = [materials] if isinstance(materials, str | Material) else list(materials)
    if not wanted:
        raise GranularIdError("materials must name at least one material, got none")
    known = {material.name: material for material in PAPER_MATERIALS}
    resolved: dict[str, Material] = {}
    unknown = [each for each in wanted if isinstance(each, str) and known_label(each, known) not in known]
    if unknown:
        names = " or ".join(map(repr, unknown))
        raise GranularIdError(f"materials has no material {names}; known: {', '.join(known)}")
    for each in wanted:
        entry = known_label(each, known) if isinstance(each, str) else each
        if not isinstance(entry, str | Material):
            raise TypeError(f"materials must hold names or Material objects, got {entry!r}")
        material = known[entry] if isinstance(entry, str) else entry
        if material.name in resolved:
            raise GranularIdError(f"materials holds {material.name!r} twice")
        resolved[material.name] = material
    return tuple(resolved.values())
