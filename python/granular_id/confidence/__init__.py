"""How sure a model may be: calibrated probabilities, sets with a stated coverage, refusal of unknown materials."""

from granular_id.confidence.assessment import Confidence, assess, count_trainings as count_trainings
from granular_id.confidence.calibration import Reliability, reliability
from granular_id.confidence.conformal import ConformalRule, conformal_rule
from granular_id.confidence.coverage import CoverageResult, coverage_study
from granular_id.confidence.held_out import HeldOutScores, Scores as Scores, held_out_scores
from granular_id.confidence.open_set import OpenSetResult, leave_one_material_out
from granular_id.confidence.unknown import UnknownRule, unknown_rule

__all__ = [
    "Confidence",
    "ConformalRule",
    "CoverageResult",
    "HeldOutScores",
    "OpenSetResult",
    "Reliability",
    "UnknownRule",
    "assess",
    "conformal_rule",
    "coverage_study",
    "held_out_scores",
    "leave_one_material_out",
    "reliability",
    "unknown_rule",
]
