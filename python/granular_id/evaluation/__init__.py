"""Evaluation that can be believed: protocols, runner, controls, result, tables and files."""

from granular_id.evaluation.candidates import DEFAULT_SPACES as DEFAULT_SPACES
from granular_id.evaluation.checkpoint import RUN as RUN
from granular_id.evaluation.controls import Control
from granular_id.evaluation.gap import gap_of as gap_of
from granular_id.evaluation.outcome import Prediction, SpaceSummary
from granular_id.evaluation.report_data import (
    HighPass as HighPass,
    ReportData as ReportData,
    most_different as most_different,
)
from granular_id.evaluation.result import EvaluationResult
from granular_id.evaluation.runner import USUAL_SPACES as USUAL_SPACES, evaluate
from granular_id.evaluation.selection import Selection, Training as Training, select
from granular_id.evaluation.tables import (
    PAPER_NOTE as PAPER_NOTE,
    accuracy_table as accuracy_table,
    choice_tables as choice_tables,
    comparison_tables as comparison_tables,
    confusion_table as confusion_table,
    controls_table as controls_table,
    finding_lines as finding_lines,
    hold_out_tables as hold_out_tables,
    mistakes_table as mistakes_table,
    recall_table as recall_table,
    seconds_table as seconds_table,
    shows_paper as shows_paper,
)
from granular_id.evaluation.weights import WeightBlock as WeightBlock, window_starts as window_starts
from granular_id.spaces import in_paper_order as in_paper_order

__all__ = ["Control", "EvaluationResult", "Prediction", "Selection", "SpaceSummary", "evaluate", "select"]
