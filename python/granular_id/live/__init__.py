"""From sensor packets to a named material while the tool moves.

A *source* (a sensor, recordings played again, a simulation) writes wrenches into a `WrenchBuffer`; a loop over pushes
waits for the motion and takes the rows that belong to it, while a supervisor owns the arm; a `Recorder` stores the
push, a `LiveIdentifier` names it while it lasts; views show it. The names below are loaded when first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from granular_id._core import WrenchBuffer, host_ns
    from granular_id.live.hops import HopIdentifier
    from granular_id.live.identification import LiveIdentifier, identify
    from granular_id.live.limits import Limits
    from granular_id.live.monitor import MonitorServer
    from granular_id.live.outcome import CaptureError, FailureReason, Push
    from granular_id.live.rdt import RdtSource
    from granular_id.live.recorder import Recorded, Recorder
    from granular_id.live.replay import ReplaySource
    from granular_id.live.robot import CallbackRobot, ManualRobot, Motion, Robot, checked_move
    from granular_id.live.setup import setup_of
    from granular_id.live.signals import stop_on_signals
    from granular_id.live.sim import SimRobot, SimSource
    from granular_id.live.source import Health, SourceInfo, SourceUrl, ThreadedSource, open_robot, open_source
    from granular_id.live.stream import opened
    from granular_id.live.terminal import TerminalView
    from granular_id.live.trigger import ForceTrigger, ManualTrigger, MotionTrigger
    from granular_id.live.view import Views

_HOMES = {
    "_core": ("WrenchBuffer", "host_ns"),
    "live.hops": ("HopIdentifier",),
    "live.identification": ("LiveIdentifier", "identify"),
    "live.limits": ("Limits",),
    "live.monitor": ("MonitorServer",),
    "live.outcome": ("CaptureError", "FailureReason", "Push"),
    "live.rdt": ("RdtSource",),
    "live.recorder": ("Recorded", "Recorder"),
    "live.replay": ("ReplaySource",),
    "live.robot": ("CallbackRobot", "ManualRobot", "Motion", "Robot", "checked_move"),
    "live.setup": ("setup_of",),
    "live.signals": ("stop_on_signals",),
    "live.sim": ("SimRobot", "SimSource"),
    "live.source": ("Health", "SourceInfo", "SourceUrl", "ThreadedSource", "open_robot", "open_source"),
    "live.stream": ("opened",),
    "live.terminal": ("TerminalView",),
    "live.trigger": ("ForceTrigger", "ManualTrigger", "MotionTrigger"),
    "live.view": ("Views",),
}
_LAZY = {name: home for home, names in _HOMES.items() for name in names}

__all__ = [
    "CallbackRobot",
    "CaptureError",
    "FailureReason",
    "ForceTrigger",
    "Health",
    "HopIdentifier",
    "Limits",
    "LiveIdentifier",
    "ManualRobot",
    "ManualTrigger",
    "MonitorServer",
    "Motion",
    "MotionTrigger",
    "Push",
    "RdtSource",
    "Recorded",
    "Recorder",
    "ReplaySource",
    "Robot",
    "SimRobot",
    "SimSource",
    "SourceInfo",
    "SourceUrl",
    "TerminalView",
    "ThreadedSource",
    "Views",
    "WrenchBuffer",
    "checked_move",
    "host_ns",
    "identify",
    "open_robot",
    "open_source",
    "opened",
    "setup_of",
    "stop_on_signals",
]


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module 'granular_id.live' has no attribute {name!r}")
    value = getattr(import_module(f"granular_id.{_LAZY[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})
