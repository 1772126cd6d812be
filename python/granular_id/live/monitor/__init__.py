"""The monitor: a page on this machine that shows a session while it runs."""

from granular_id.live.monitor.server import MonitorServer

__all__ = ["MonitorServer"]
