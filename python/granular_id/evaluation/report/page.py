"""``report``: one file of HTML that needs nothing else."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from granular_id._files import PAGES, check_target, refuse_other_kind, whole_file
from granular_id.evaluation.choice_tables import choice_tables
from granular_id.evaluation.protocol_names import protocol_name
from granular_id.evaluation.report.pictures import Picture, pictures
from granular_id.evaluation.report.words import gap_of, split_notes
from granular_id.evaluation.tables import (
    PAPER_NOTE,
    Table,
    accuracy_table,
    comparison_tables,
    controls_table,
    mistakes_table,
    recall_table,
    seconds_table,
    shows_paper,
)
from granular_id.plotting.mean_forces import AXIS_LINES
from granular_id.recording import StepReport

if TYPE_CHECKING:
    from granular_id.evaluation.result import EvaluationResult

__all__ = ["html", "report"]


def report(result: EvaluationResult, path: str | os.PathLike[str]) -> None:
    """Write an evaluation as one page of HTML.

    The page is whole or absent, fetches nothing, runs no script, and reads well on a wide screen, on a phone, in
    the dark and on paper.

    Parameters
    ----------
    result : EvaluationResult
    path : path-like
        File to write, for instance ``"report.html"``; an existing one is replaced.

    Raises
    ------
    ImportError
        Without matplotlib or jinja2, saying what to install.
    ValueError
        The path ends like another kind of file.
    OSError
        The file cannot be written; this is found out before anything is drawn.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> from granular_id import evaluate, synthesize
    >>> data = synthesize(["rice", "fine sugar"], n_per_class=6, duration_s=0.5)
    >>> result = evaluate(data, "hfmh", "paper", n_partitions=3, train_per_class=4, test_per_class=2)
    >>> path = pathlib.Path(tempfile.mkdtemp(), "report.html")
    >>> report(result, path)
    >>> "SYNTHETIC" in path.read_text(encoding="utf-8")
    True
    """
    refuse_other_kind(path, PAGES)
    target = check_target(path)
    text = html(result)
    with whole_file(target) as draft:
        draft.write_text(text, encoding="utf-8", newline="\n")


def html(result: EvaluationResult) -> str:
    """Return the page that `report` writes."""
    environment = _environment()
    space = result.best_space(result.random)
    warnings, notes = split_notes(result)
    accuracies = accuracy_table(result)
    judged = result.strictest or result.protocols[0]
    return str(
        environment.get_template("page.html").render(
            result=result,
            style=files(__package__).joinpath("style.css").read_text(encoding="utf-8"),
            gap=gap_of(result, space),
            space=space,
            warnings=warnings,
            notes=notes,
            figures=_grouped(pictures(result, space, result.portrait)),
            accuracies=Table(
                "", accuracies.header, accuracies.rows, (PAPER_NOTE,) if shows_paper(result) else ()
            ),
            controls=controls_table(result, space),
            comparisons=[_in_words(table, result) for table in comparison_tables(result, space)],
            choices=choice_tables(result),
            mistakes=_in_words(mistakes_table(result, space, judged), result),
            recalls=recall_table(result, space),
            seconds=seconds_table(result),
            summary=_summary(result.data["summary"]["rows"]),
            history=[str(StepReport(**step)) for step in result.data["history"]],
            settings=json.dumps(result.settings, ensure_ascii=False, indent=2),
            portrait=result.portrait,
            axis_lines=AXIS_LINES,
        )
    )


def _environment() -> Any:
    try:
        from jinja2 import Environment, PackageLoader, StrictUndefined  # noqa: PLC0415  # an extra
        from markupsafe import Markup  # noqa: PLC0415  # comes with jinja2
    except ImportError as error:
        raise ImportError("a report needs jinja2: pip install 'granular-id[app]'") from error
    environment = Environment(
        loader=PackageLoader("granular_id.evaluation.report", ""),
        autoescape=True,  # labels, names and notes are other people's text
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["is_words"] = lambda cell: cell[:1].isalpha()
    environment.filters["svg"] = lambda picture, key: Markup(picture.svg(key))  # escaped by the XML writer
    return environment


def _grouped(drawn: Sequence[Picture]) -> dict[str, list[Picture]]:
    groups: dict[str, list[Picture]] = {}
    for picture in drawn:
        groups.setdefault(picture.group, []).append(picture)
    return groups


def _in_words(table: Table, result: EvaluationResult) -> Table:
    """Call the protocol in a title what the page calls it."""
    title = table.title
    for protocol, partitions in result.partitions.items():
        title = title.replace(f"{protocol} protocol", protocol_name(protocol, partitions))
    return replace(table, title=title)


def _summary(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Lay out the summary of the recordings; columns that say nothing are left out."""
    columns = [key for key in rows[0] if any(row[key] for row in rows)]
    cells = tuple(tuple(_cell(row[key]) for key in columns) for row in rows)
    return Table("", tuple(map(_heading, columns)), cells)


def _heading(key: str) -> str:
    """Turn the name of a figure into a heading: ``largest_gap_s`` is ``largest gap, s``."""
    for ending, unit in (("_hz", ", Hz"), ("_s", ", s")):
        if key.endswith(ending):
            return key.removesuffix(ending).replace("_", " ") + unit
    return key.replace("_", " ")


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
