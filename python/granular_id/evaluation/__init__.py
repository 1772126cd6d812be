"""Evaluation that can be believed: protocols, runner, controls, result, tables and files."""

from granular_id.evaluation.controls import Control
from granular_id.evaluation.outcome import Prediction, SpaceSummary
from granular_id.evaluation.report_data import (
    ReportData as ReportData,
    most_different as most_different,
    window_starts as window_starts,
)
from granular_id.evaluation.result import EvaluationResult
from granular_id.evaluation.runner import USUAL_SPACES as USUAL_SPACES, evaluate
from granular_id.evaluation.tables import (
    PAPER_NOTE as PAPER_NOTE,
    accuracy_table as accuracy_table,
    choice_tables as choice_tables,
    comparison_tables as comparison_tables,
    confusion_table as confusion_table,
    controls_table as controls_table,
    finding_lines as finding_lines,
    headline as headline,
    hold_out_tables as hold_out_tables,
    mistakes_table as mistakes_table,
    recall_table as recall_table,
    seconds_table as seconds_table,
    shows_paper as shows_paper,
)

__all__ = ["Control", "EvaluationResult", "Prediction", "SpaceSummary", "evaluate"]
