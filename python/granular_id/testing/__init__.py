"""What stands in for hardware: a sensor box on this machine, with faults on demand."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from granular_id.testing.fake_netft import FakeNetft, Faults, Injected

__all__ = ["FakeNetft", "Faults", "Injected"]


def __getattr__(name: str) -> Any:  # loaded when used: the box is also a command
    if name not in __all__:
        raise AttributeError(f"module 'granular_id.testing' has no attribute {name!r}")
    from granular_id.testing import fake_netft

    return getattr(fake_netft, name)
