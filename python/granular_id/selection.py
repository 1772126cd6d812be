"""Moved: `granular_id.select` and `granular_id.Selection`. This name goes with version 0.3."""

from importlib import import_module
from typing import Any
from warnings import warn

_NAMES = ("DEFAULT_SPACES", "Selection", "select")


def __getattr__(name: str) -> Any:
    if name not in _NAMES:
        raise AttributeError(f"module 'granular_id.selection' has no attribute {name!r}")
    warn("granular_id.selection has moved: use granular_id.select", DeprecationWarning, stacklevel=2)
    return getattr(import_module("granular_id.evaluation"), name)
