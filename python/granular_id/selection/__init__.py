"""Choosing a feature space, block weights and C, by cross-validation inside cross-validation."""

from granular_id.selection.candidates import DEFAULT_SPACES
from granular_id.selection.nested import select
from granular_id.selection.result import Selection

__all__ = ["DEFAULT_SPACES", "Selection", "select"]
