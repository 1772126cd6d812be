"""How well materials are distinguished on recordings held out, and what could have been known without touching.

`evaluate` gives an `EvaluationResult`.
"""

from granular_id.evaluation.confidence import ConfidenceStudy, confidence_study
from granular_id.evaluation.differences import Gap, Pair, matched_draws as matched_draws
from granular_id.evaluation.evaluating import USUAL_SPACES as USUAL_SPACES, evaluate
from granular_id.evaluation.leakage import Baseline
from granular_id.evaluation.report_data import (
    ReportData as ReportData,
    most_different as most_different,
    window_starts as window_starts,
)
from granular_id.evaluation.result import (
    PAPER_NOTE as PAPER_NOTE,
    EvaluationResult,
    Prediction,
    accuracy_table as accuracy_table,
    choice_tables as choice_tables,
    comparison_tables as comparison_tables,
    confusion_table as confusion_table,
    fold_table as fold_table,
    gap_lines as gap_lines,
    headline as headline,
    mistakes_table as mistakes_table,
    recall_table as recall_table,
    remarks as remarks,
    seconds_table as seconds_table,
    shows_paper as shows_paper,
    spoiled_lines as spoiled_lines,
)

__all__ = [
    "Baseline",
    "ConfidenceStudy",
    "EvaluationResult",
    "Gap",
    "Pair",
    "Prediction",
    "confidence_study",
    "evaluate",
]
