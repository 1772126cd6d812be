"""Moved: `granular_id.BestClassifier`. This name goes with version 0.3."""

from importlib import import_module
from typing import Any
from warnings import warn

_NAMES = ("BestClassifier", "Choice")


def __getattr__(name: str) -> Any:
    if name not in _NAMES:
        raise AttributeError(f"module 'granular_id.best' has no attribute {name!r}")
    warn("granular_id.best has moved: use granular_id.BestClassifier", DeprecationWarning, stacklevel=2)
    return getattr(import_module("granular_id.spaces"), name)
