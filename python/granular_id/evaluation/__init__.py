"""Evaluation that can be believed: partitions, runner, result, tables and files."""

from granular_id.evaluation.result import EvaluationResult, Prediction, SpaceSummary
from granular_id.evaluation.runner import evaluate

__all__ = ["EvaluationResult", "Prediction", "SpaceSummary", "evaluate"]
