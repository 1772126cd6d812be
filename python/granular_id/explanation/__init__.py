"""What decides between two materials: instants, axes, bins and bands, exactly accounted for."""

from granular_id.explanation.bands import BandExplanation, Finding, coupled_bands as coupled_bands
from granular_id.explanation.difference import explain, explain_held_out as explain_held_out
from granular_id.explanation.result import ExplainedBlock, Explanation, Region

__all__ = ["BandExplanation", "ExplainedBlock", "Explanation", "Finding", "Region", "explain"]
