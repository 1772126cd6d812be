"""How sure a model may be: calibrated probabilities, sets with a stated coverage, refusal of unknown materials.

The names below are loaded when first used: a robot that only applies a stored rule does not wait for scikit-learn.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from granular_id.confidence.assess import Confidence, assess, count_trainings
    from granular_id.confidence.calibration import Reliability, reliability
    from granular_id.confidence.conformal import ConformalRule, conformal_rule
    from granular_id.confidence.coverage import CoverageResult, coverage_study
    from granular_id.confidence.held_out import HeldOutScores, Scores, held_out_scores
    from granular_id.confidence.open_set import OpenSetResult, leave_one_material_out
    from granular_id.confidence.unknown import UnknownRule, unknown_rule


__all__ = [
    "Confidence",
    "ConformalRule",
    "CoverageResult",
    "HeldOutScores",
    "OpenSetResult",
    "Reliability",
    "Scores",
    "UnknownRule",
    "assess",
    "conformal_rule",
    "count_trainings",
    "coverage_study",
    "held_out_scores",
    "leave_one_material_out",
    "reliability",
    "unknown_rule",
]

_MODULES = {
    "Confidence": "assess",
    "ConformalRule": "conformal",
    "CoverageResult": "coverage",
    "HeldOutScores": "held_out",
    "OpenSetResult": "open_set",
    "Reliability": "calibration",
    "Scores": "held_out",
    "UnknownRule": "unknown",
    "assess": "assess",
    "conformal_rule": "conformal",
    "count_trainings": "assess",
    "coverage_study": "coverage",
    "held_out_scores": "held_out",
    "leave_one_material_out": "open_set",
    "reliability": "calibration",
    "unknown_rule": "unknown",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'granular_id.confidence' has no attribute {name!r}")
    value = getattr(import_module(f"granular_id.confidence.{_MODULES[name]}"), name)
    globals()[name] = value
    return value
