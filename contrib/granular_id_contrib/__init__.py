"""Sensors and robots of several makers, each through its own library, loaded only when asked for.

None of them has been run on hardware: `NOT_RUN` stands in each source's ``info.meta["status"]`` and goes into every
recording, until somebody has and says so.
"""

__all__ = ["NOT_RUN"]

NOT_RUN = "written against the library's documented interface, not run on hardware"
