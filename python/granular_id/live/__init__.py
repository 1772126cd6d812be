"""From sensor packets to a named material while the tool moves.

A *source* (a sensor, recordings played again, a simulation) writes wrenches into a `WrenchBuffer`; a `Capture` waits
for the motion and takes the rows that belong to one push; a `Recorder` stores them, a `LiveIdentifier` names them
while they arrive; a view shows it. The names below are loaded when first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from granular_id._core import Block, Window, WindowError, WrenchBuffer, WrenchReader, host_ns
    from granular_id.live.answers import identify
    from granular_id.live.capture import Capture, CaptureError, CaptureState, FailureReason, Push
    from granular_id.live.identification import LiveIdentifier
    from granular_id.live.monitor import MonitorServer
    from granular_id.live.rdt import RdtSource
    from granular_id.live.recorder import Recorder
    from granular_id.live.replay import ReplaySource
    from granular_id.live.robot import CallbackRobot, ManualRobot, Motion, Pose, Robot, checked_move
    from granular_id.live.setup import setup_of
    from granular_id.live.sim import SimRobot, SimSource
    from granular_id.live.snapshot import Snapshot, SnapshotBuilder
    from granular_id.live.source import (
        Health,
        SourceInfo,
        ThreadedSource,
        WrenchSource,
        open_robot,
        open_source,
    )
    from granular_id.live.source_url import SourceUrl
    from granular_id.live.stopping import stop_on_signals
    from granular_id.live.stream import Stream, opened
    from granular_id.live.terminal import TerminalView
    from granular_id.live.trigger import ForceTrigger, ManualTrigger, MotionTrigger
    from granular_id.live.view import Views

_HOMES = {
    "_core": ("Block", "Window", "WindowError", "WrenchBuffer", "WrenchReader", "host_ns"),
    "live.answers": ("identify",),
    "live.capture": ("Capture", "CaptureError", "CaptureState", "FailureReason", "Push"),
    "live.identification": ("LiveIdentifier",),
    "live.monitor": ("MonitorServer",),
    "live.rdt": ("RdtSource",),
    "live.recorder": ("Recorder",),
    "live.replay": ("ReplaySource",),
    "live.robot": ("CallbackRobot", "ManualRobot", "Motion", "Pose", "Robot", "checked_move"),
    "live.setup": ("setup_of",),
    "live.sim": ("SimRobot", "SimSource"),
    "live.snapshot": ("Snapshot", "SnapshotBuilder"),
    "live.source": (
        "Health",
        "SourceInfo",
        "ThreadedSource",
        "WrenchSource",
        "open_robot",
        "open_source",
    ),
    "live.source_url": ("SourceUrl",),
    "live.stopping": ("stop_on_signals",),
    "live.stream": ("Stream", "opened"),
    "live.terminal": ("TerminalView",),
    "live.trigger": ("ForceTrigger", "ManualTrigger", "MotionTrigger"),
    "live.view": ("Views",),
}
_LAZY = {name: home for home, names in _HOMES.items() for name in names}

__all__ = [
    "Block",
    "CallbackRobot",
    "Capture",
    "CaptureError",
    "CaptureState",
    "FailureReason",
    "ForceTrigger",
    "Health",
    "LiveIdentifier",
    "ManualRobot",
    "ManualTrigger",
    "MonitorServer",
    "Motion",
    "MotionTrigger",
    "Pose",
    "Push",
    "RdtSource",
    "Recorder",
    "ReplaySource",
    "Robot",
    "SimRobot",
    "SimSource",
    "Snapshot",
    "SnapshotBuilder",
    "SourceInfo",
    "SourceUrl",
    "Stream",
    "TerminalView",
    "ThreadedSource",
    "Views",
    "Window",
    "WindowError",
    "WrenchBuffer",
    "WrenchReader",
    "WrenchSource",
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
