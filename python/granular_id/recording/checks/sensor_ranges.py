"""How far the axes of a sensor reach: stated by the caller, or looked up by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from granular_id._checks import argument_error, finite_number
from granular_id._core import AXES

SensorRange = str | float | Sequence[float] | Mapping[str, float]

# Calibrated ranges of ATI Industrial Automation's sensors: Fx and Fy, Fz (N), Tx, Ty and Tz (N m). They are the
# nominal ones of each SI calibration; the certificate of a sensor comes first.
_ATI = {
    "Nano17 SI-12-0.12": (12, 17, 0.12),
    "Nano17 SI-25-0.25": (25, 35, 0.25),
    "Nano17 SI-50-0.5": (50, 70, 0.5),
    "Mini40 SI-20-1": (20, 60, 1),
    "Mini40 SI-40-2": (40, 120, 2),
    "Mini40 SI-80-4": (80, 240, 4),
    "Mini45 SI-145-5": (145, 290, 5),
    "Mini45 SI-290-10": (290, 580, 10),
    "Mini45 SI-580-20": (580, 1160, 20),
    "Gamma SI-32-2.5": (32, 100, 2.5),
    "Gamma SI-65-5": (65, 200, 5),
    "Gamma SI-130-10": (130, 400, 10),
    "Delta SI-165-15": (165, 495, 15),
    "Delta SI-330-30": (330, 990, 30),
    "Delta SI-660-60": (660, 1980, 60),
    "Axia80-M20 SI-200-8": (200, 360, 8),
    "Axia80-M20 SI-500-20": (500, 900, 20),
}

SENSOR_RANGES: dict[str, dict[str, float]] = {
    f"ATI {name}": dict(zip(AXES, (side, side, axial, *[torque] * 3), strict=True))
    for name, (side, axial, torque) in _ATI.items()
}
"""Largest readings of well-known sensors, axis by axis, N and N m; they hold for both signs."""


def resolve_range(value: SensorRange, axes: Sequence[str]) -> dict[str, float]:
    """Return the largest reading of each axis, as `Dataset.check` takes it."""
    if isinstance(value, str):
        ranges = SENSOR_RANGES[_known_name(value)]
        foreign = [axis for axis in axes if axis not in ranges]
        if foreign:
            problem = f"={value!r} has no axis {foreign[0]!r}; give numbers instead"
            raise argument_error(ValueError, "sensor_range", problem)
        return {axis: float(ranges[axis]) for axis in axes}
    if isinstance(value, Mapping):
        foreign = [str(axis) for axis in value if axis not in axes]
        if foreign:
            problem = f"names the axis {foreign[0]!r}; there are {', '.join(axes)}"
            raise argument_error(ValueError, "sensor_range", problem)
        numbers = dict(value)
    elif isinstance(value, (list, tuple, np.ndarray)):
        if len(value) != len(axes):
            problem = f"has {len(value)} numbers; wanted {len(axes)}: {', '.join(axes)}"
            raise argument_error(ValueError, "sensor_range", problem)
        numbers = dict(zip(axes, value, strict=True))
    else:
        numbers = dict.fromkeys(axes, finite_number("sensor_range", value))
    checked = {axis: finite_number("sensor_range", number) for axis, number in numbers.items()}
    wrong = next((f"{axis}: {number:g}" for axis, number in checked.items() if number <= 0), None)
    if wrong is not None:
        raise argument_error(ValueError, "sensor_range", f"must be positive, got {wrong}")
    return checked


def _known_name(name: str) -> str:
    """Find a sensor by the words of its name: case does not matter, "ATI" or the model may be left out."""
    wanted = name.lower().split()
    matches = [known for known in SENSOR_RANGES if wanted and set(wanted) <= set(known.lower().split())]
    if len(matches) == 1:
        return matches[0]
    which = "is the name of several sensors" if matches else "is no known sensor"
    choice = ", ".join(matches or SENSOR_RANGES)
    problem = f"={name!r} {which}; choose from {choice}, or give one number per axis"
    raise argument_error(ValueError, "sensor_range", problem)
