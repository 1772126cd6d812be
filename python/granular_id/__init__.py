"""Names the granular material under a robot's tool from a 6-axis force-torque signal."""

from granular_id._core import __version__

__all__ = ["__version__"]
