"""What stands in for hardware: a sensor box on this machine, with faults on demand."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from granular_id.testing.fake_netft import FakeNetft
    from granular_id.testing.faults import Faults, Injected

__all__ = ["FakeNetft", "Faults", "Injected"]

_HOMES = {"FakeNetft": "fake_netft", "Faults": "faults", "Injected": "faults"}


def __getattr__(name: str) -> Any:  # loaded when used: the box is also a command
    if name not in _HOMES:
        raise AttributeError(f"module 'granular_id.testing' has no attribute {name!r}")
    return getattr(import_module(f"granular_id.testing.{_HOMES[name]}"), name)
