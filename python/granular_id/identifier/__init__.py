"""A trained model that names materials: from whole recordings, and while samples arrive.

The names below are loaded when first used: a robot that only identifies does not wait for the training.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from granular_id.identifier.held_out import OverTime, accuracy_over_time
    from granular_id.identifier.identifier import Identifier
    from granular_id.identifier.streaming import Decision, StreamingIdentifier

__all__ = ["Decision", "Identifier", "OverTime", "StreamingIdentifier", "accuracy_over_time"]

_MODULES = {
    "Decision": "decision",
    "Identifier": "identifier",
    "OverTime": "over_time",
    "StreamingIdentifier": "streaming",
    "accuracy_over_time": "over_time",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'granular_id.identifier' has no attribute {name!r}")
    value = getattr(import_module(f"granular_id.identifier.{_MODULES[name]}"), name)
    globals()[name] = value
    return value
