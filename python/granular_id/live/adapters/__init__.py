"""Sensors and robots of others, each through its maker's or its community's own library.

Thin, loaded only when asked for, and none of them has been run on hardware by us: `NOT_RUN` stands in each
source's ``info.meta["status"]`` and goes into every recording, until somebody has and says so.
"""

from __future__ import annotations

__all__ = ["NOT_RUN"]

NOT_RUN = "written against the library's documented interface, not run on hardware"
