"""Evaluation that can be believed: protocols, runner, controls, result, tables and files."""

from granular_id.evaluation.candidates import DEFAULT_SPACES, refuse_own_classifiers
from granular_id.evaluation.checkpoint import RUN, OtherEvaluationError
from granular_id.evaluation.controls import Control
from granular_id.evaluation.outcome import Prediction, SpaceSummary
from granular_id.evaluation.report_data import HighPass, Portrait, WeightBlock, window_starts
from granular_id.evaluation.result import EvaluationResult
from granular_id.evaluation.runner import evaluate
from granular_id.evaluation.scoring import in_paper_order
from granular_id.evaluation.selection import Selection, select
from granular_id.evaluation.tables import (
    PAPER_NOTE,
    SMALL_GAP,
    accuracy_table,
    choice_tables,
    comparison_tables,
    confusion_table,
    controls_table,
    gap_lines,
    mistakes_table,
    recall_table,
    seconds_table,
    shows_paper,
)

__all__ = [
    "DEFAULT_SPACES",
    "PAPER_NOTE",
    "RUN",
    "SMALL_GAP",
    "Control",
    "EvaluationResult",
    "HighPass",
    "OtherEvaluationError",
    "Portrait",
    "Prediction",
    "Selection",
    "SpaceSummary",
    "WeightBlock",
    "accuracy_table",
    "choice_tables",
    "comparison_tables",
    "confusion_table",
    "controls_table",
    "evaluate",
    "gap_lines",
    "in_paper_order",
    "mistakes_table",
    "recall_table",
    "refuse_own_classifiers",
    "seconds_table",
    "select",
    "shows_paper",
    "window_starts",
]
