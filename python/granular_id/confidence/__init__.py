"""How sure a model may be: calibrated probabilities, sets with a stated coverage, refusal of unknown materials.

What trains is loaded when first used: whoever reads the rules of a model does not wait for scikit-learn.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from granular_id.confidence.conformal import ConformalRule, conformal_rule
from granular_id.confidence.unknown import UnknownRule, unknown_rule

if TYPE_CHECKING:
    from granular_id.confidence.assessment import Confidence, assess
    from granular_id.confidence.calibration import Reliability
    from granular_id.confidence.coverage import CoverageResult
    from granular_id.confidence.held_out import HeldOutScores, Scores as Scores, held_out_scores
    from granular_id.confidence.open_set import OpenSetResult

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
    "held_out_scores",
    "unknown_rule",
]

_LAZY = {
    "Confidence": "assessment",
    "CoverageResult": "coverage",
    "HeldOutScores": "held_out",
    "OpenSetResult": "open_set",
    "Reliability": "calibration",
    "Scores": "held_out",
    "assess": "assessment",
    "held_out_scores": "held_out",
}


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module 'granular_id.confidence' has no attribute {name!r}")
    value = getattr(import_module(f"granular_id.confidence.{_LAZY[name]}"), name)
    globals()[name] = value
    return value
