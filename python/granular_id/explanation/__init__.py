"""What decides between two materials: blocks, bands, axes and times, exactly accounted for."""

from granular_id.explanation.columns import Columns
from granular_id.explanation.difference import explain, explain_held_out as explain_held_out
from granular_id.explanation.result import Explanation

__all__ = ["Columns", "Explanation", "explain"]
