"""Moved: `granular_id.select` and `granular_id.Selection`. This name goes with version 0.3."""

from warnings import warn

from granular_id.evaluation import DEFAULT_SPACES, Selection, select

__all__ = ["DEFAULT_SPACES", "Selection", "select"]

warn("granular_id.selection has moved: use granular_id.select", DeprecationWarning, stacklevel=2)
