"""A whole evaluation as plain text."""

from __future__ import annotations

from typing import TYPE_CHECKING

from granular_id.evaluation.choice_tables import choice_tables
from granular_id.evaluation.tables import accuracy_table, comparison_tables, controls_table, seconds_table

if TYPE_CHECKING:
    from granular_id.evaluation.result import EvaluationResult

__all__ = ["plain_text"]


def plain_text(result: EvaluationResult) -> str:
    """Accuracies with gaps and notes, controls, comparisons, what was chosen, then seconds."""
    controls = (controls_table(result),) if result.controls else ()
    parts = (
        accuracy_table(result),
        *controls,
        *comparison_tables(result),
        *choice_tables(result),
        seconds_table(result),
    )
    return "\n\n".join(map(str, parts))
