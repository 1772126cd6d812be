"""Sensors and robots of several makers, each through its own library, loaded only when requested.

None of them has been run on hardware: `NOT_RUN` stands in each source's ``info.meta["status"]`` and goes into every
recording, until somebody has and says so.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

__all__ = ["NOT_RUN", "library"]

NOT_RUN = "written against the library's documented interface, not run on hardware"


def library(module: str, how: str) -> Any:
    """Import the library of a sensor or robot; an ImportError says how to get it."""
    try:
        return import_module(module)
    except ImportError as error:
        raise ImportError(f"{module.partition('.')[0]} is needed for this sensor or robot: {how}") from error
