"""Moved: `granular_id.testing.FakeNetft`. This name goes with version 0.3."""

from importlib import import_module
from typing import Any
from warnings import warn

_NAMES = ("FakeNetft",)


def __getattr__(name: str) -> Any:
    if name not in _NAMES:
        raise AttributeError(f"module 'granular_id.live.fake_netft' has no attribute {name!r}")
    warn(
        "granular_id.live.fake_netft has moved: use granular_id.testing.FakeNetft",
        DeprecationWarning,
        stacklevel=2,
    )
    return getattr(import_module("granular_id.testing"), name)


if __name__ == "__main__":
    import_module("granular_id.testing.fake_netft").main()
