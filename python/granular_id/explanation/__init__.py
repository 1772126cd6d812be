"""What decides between two materials: instants, axes, bins and bands, exactly accounted for."""

from granular_id.explanation.bands import BandExplanation
from granular_id.explanation.difference import explain
from granular_id.explanation.findings import Finding
from granular_id.explanation.regions import Region
from granular_id.explanation.result import ExplainedBlock, Explanation

__all__ = ["BandExplanation", "ExplainedBlock", "Explanation", "Finding", "Region", "explain"]
