"""What decides between two materials: instants, axes and bins, exactly accounted for."""

from granular_id.explanation.difference import explain
from granular_id.explanation.regions import Region
from granular_id.explanation.result import ExplainedBlock, Explanation

__all__ = ["ExplainedBlock", "Explanation", "Region", "explain"]
