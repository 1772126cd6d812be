"""Moved: `granular_id.BestClassifier`. This name goes with version 0.3."""

from warnings import warn

from granular_id.spaces import BestClassifier, Choice

__all__ = ["BestClassifier", "Choice"]

warn("granular_id.best has moved: use granular_id.BestClassifier", DeprecationWarning, stacklevel=2)
