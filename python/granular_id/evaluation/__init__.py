"""Evaluation that can be believed: protocols, runner, controls, result, tables and files."""

from granular_id.evaluation.controls import Control
from granular_id.evaluation.result import EvaluationResult, Prediction, SpaceSummary
from granular_id.evaluation.runner import evaluate

__all__ = ["Control", "EvaluationResult", "Prediction", "SpaceSummary", "evaluate"]
