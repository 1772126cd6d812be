"""Results on a terminal: the same figures as the plain-text tables, with colour and wrapping."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from rich import box
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from granular_id.evaluation.choice_tables import choice_tables
from granular_id.evaluation.tables import (
    PAPER_NOTE,
    Table,
    accuracy_table,
    comparison_tables,
    confusion_table,
    controls_table,
    mistakes_table,
    seconds_table,
)

if TYPE_CHECKING:
    from granular_id.evaluation import EvaluationResult

__all__ = ["print_result", "print_table"]


def print_result(console: Console, result: EvaluationResult, space: str | None, *, brief: bool) -> None:
    """Print accuracies with gaps and notes; unless `brief` controls, comparison, choices, confusion and seconds too.

    Parameters
    ----------
    console : Console
    result : EvaluationResult
    space : str or None
        Whose confusion matrix; None: the best of the strictest protocol that ran.
    brief : bool
        The table of accuracies only, without gaps and notes.
    """
    accuracies = accuracy_table(result)
    if brief:
        footnotes = tuple(note for note in accuracies.notes if note == PAPER_NOTE)
        print_table(console, replace(accuracies, notes=footnotes), strong=result.synthetic)
        return
    print_table(console, accuracies, strong=result.synthetic)
    if result.controls:
        print_table(console, controls_table(result))
    for table in (*comparison_tables(result)[:1], *choice_tables(result)):
        print_table(console, table)
    # The matrix of the protocol that flatters least; the report and the figures have all of them.
    protocol = result.strictest or result.protocols[0]
    chosen = space or result.best_space(protocol)
    matrix = confusion_table(result, chosen, protocol)
    fits = _width(matrix) <= console.width
    print_table(console, matrix if fits else mistakes_table(result, chosen, protocol), tight=fits)
    print_table(console, seconds_table(result))


def print_table(console: Console, table: Table, *, strong: bool = False, tight: bool = False) -> None:
    """Print one table with its title above and its notes below."""
    console.print()
    console.print(Text(table.title, style="bold yellow" if strong else "bold"))
    if table.rows:
        drawn = RichTable(
            box=box.SIMPLE_HEAD,
            show_edge=False,
            pad_edge=False,
            padding=(0, 0) if tight else (0, 0, 0, 1),
            header_style="bold",
        )
        for i, name in enumerate(table.header):
            drawn.add_column(Text(name), justify="right" if i else "left", no_wrap=tight)
        for row in table.rows:
            drawn.add_row(*(Text(cell) for cell in row))
        console.print(drawn)
    for note in table.notes:
        console.print(Text(note), highlight=False)


def _width(table: Table) -> int:
    rows = (table.header, *table.rows)
    return sum(max(len(row[i]) for row in rows) + 1 for i in range(len(table.header))) - 1
