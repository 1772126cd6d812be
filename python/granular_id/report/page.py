"""``report.write``: an evaluation as one file of HTML that needs nothing else."""

from __future__ import annotations

import json
import os
import re
from dataclasses import replace
from importlib.resources import files
from typing import Any

from granular_id._files import PAGES, check_target, refuse_other_kind, whole_file
from granular_id._text import install
from granular_id.evaluation import (
    PAPER_NOTE,
    EvaluationResult,
    accuracy_table,
    choice_tables,
    comparison_tables,
    fold_table,
    gap_lines,
    headline,
    mistakes_table,
    recall_table,
    seconds_table,
    shows_paper,
    spoiled_lines,
)
from granular_id.plotting import axis_line, means_of, plain, quantity_of
from granular_id.recording import AXIS_COLOURS, SEVERE_PREFIXES, StepReport, text_table
from granular_id.report.pictures import inline_svg, pictures

_DASHES = {"-": "", "--": "6 4", ":": "2 3"}  # of matplotlib, as SVG writes them


def write(result: EvaluationResult, path: str | os.PathLike[str]) -> None:
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
    >>> result = evaluate(data, "hfmh", progress=False)
    >>> path = pathlib.Path(tempfile.mkdtemp(), "report.html")
    >>> write(result, path)
    >>> "SYNTHETIC" in path.read_text(encoding="utf-8")
    True
    """
    refuse_other_kind(path, PAGES)
    target = check_target(path)
    text = html(result)
    with whole_file(target) as draft:
        draft.write_text(text, encoding="utf-8", newline="\n")


def html(result: EvaluationResult) -> str:
    """Return the page that `write` writes."""
    template = _template()
    warnings, notes = split_notes(result)
    means = means_of(result.report_data)
    accepted = (finding for finding in result.findings if finding not in result.spoiling)
    accuracies = accuracy_table(result)
    return str(
        template.render(
            result=result,
            style=files("granular_id").joinpath("_style.css").read_text(encoding="utf-8"),
            headline=headline(result),
            gap=gap_lines(result),
            warnings=(*(f"{one.code}, accepted: {one.message}" for one in accepted), *warnings),
            notes=notes,
            spoiled=spoiled_lines(result),
            figures=list(pictures(result, means)),
            accuracies=replace(
                accuracies,
                notes=tuple(dict.fromkeys((*accuracies.notes, *[PAPER_NOTE] * shows_paper(result)))),
            ),
            folds=fold_table(result),
            comparisons=comparison_tables(result),
            choices=choice_tables(result),
            mistakes=mistakes_table(result),
            recalls=recall_table(result),
            seconds=seconds_table(result),
            summary="\n".join(text_table(result.data["summary"]["rows"])),
            history=[str(StepReport(**step)) for step in result.data["history"]],
            settings=json.dumps(result.settings, ensure_ascii=False, indent=2),
            report_data=result.report_data,
            quantity=quantity_of(means.axes, means.unit),
            lines=[_line(axis, place) for place, axis in enumerate(means.axes)],
        )
    )


def _template() -> Any:
    try:
        from jinja2 import Environment, PackageLoader, StrictUndefined  # an extra
        from markupsafe import Markup  # comes with jinja2
    except ImportError as error:
        raise ImportError(f"a report needs jinja2: {install('app')}") from error
    environment = Environment(
        loader=PackageLoader("granular_id.report", ""),
        autoescape=True,  # labels, names and notes are other people's text
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["is_words"] = lambda cell: re.match(r"[<>+-]?\d|-?$", cell) is None
    # matplotlib escapes what it writes.
    environment.filters["svg"] = lambda one, key: Markup(inline_svg(one.figure, key, one.alt))
    return environment.get_template("page.html")


def _line(axis: str, place: int) -> tuple[str, int, str]:
    """Return the name of an axis, the number of its colour, and its dashes as SVG writes them."""
    line = axis_line(axis, place)
    return plain(axis), AXIS_COLOURS.index(line["color"]), _DASHES[line["linestyle"]]


def split_notes(result: EvaluationResult) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the warnings and the other notes, without the word that marks them."""
    marked = (note for note in result.notes if note.startswith(SEVERE_PREFIXES))
    others = (note for note in result.notes if not note.startswith(SEVERE_PREFIXES))
    return tuple(note.partition(": ")[2] for note in marked), tuple(others)
