"""``report``: an evaluation as one file of HTML that needs nothing else."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np

from granular_id._files import PAGES, check_target, refuse_other_kind, whole_file
from granular_id._text import Table, counted, percent
from granular_id.evaluation import (
    PAPER_NOTE,
    SMALL_GAP,
    accuracy_table,
    choice_tables,
    comparison_tables,
    controls_table,
    mistakes_table,
    recall_table,
    seconds_table,
    shows_paper,
    unequal_sizes,
)
from granular_id.partitions import protocol_name
from granular_id.plotting import AXIS_LINES
from granular_id.recording import SEVERE_PREFIXES, StepReport
from granular_id.report.pictures import inline_svg, pictures

if TYPE_CHECKING:
    from granular_id.evaluation import EvaluationResult

_APART = {
    "held-out sessions": "different sessions",
    "blocks in time order": "different stretches of time",
    "halves in time order": "different halves in time",
}
_VERDICTS = {
    "lost": (
        "{points} points do not survive {apart}. Recordings made together resemble each other in more than their "
        "material, and random draws put them on both sides. For new recordings, count on the lower figure."
    ),
    "unsure": (
        "{points} points less with {apart}, which lies within the uncertainty of the figure for random draws: "
        "these recordings do not show a gap, and are too few to rule one out. For new recordings, count on the "
        "lower figure."
    ),
    "kept": (
        "Less than a point is lost between random draws and {apart}: these recordings give no sign that it is "
        "their session that is recognised instead of their material."
    ),
}


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
    template = _template()
    space = result.best_space(result.random)
    warnings, notes = split_notes(result)
    accuracies = accuracy_table(result)
    judged = result.strictest or result.protocols[0]
    return str(
        template.render(
            result=result,
            style=files(__package__).joinpath("style.css").read_text(encoding="utf-8"),
            gap=gap_of(result, space),
            space=space,
            warnings=warnings,
            notes=notes,
            figures=pictures(result, space),
            accuracies=replace(accuracies, notes=(PAPER_NOTE,) if shows_paper(result) else ()),
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


def _template() -> Any:
    try:
        from jinja2 import Environment, PackageLoader, StrictUndefined  # an extra
        from markupsafe import Markup  # comes with jinja2
    except ImportError as error:
        raise ImportError("a report needs jinja2: pip install 'granular-id[app]'") from error
    environment = Environment(
        loader=PackageLoader("granular_id.report", ""),
        autoescape=True,  # labels, names and notes are other people's text
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["is_words"] = lambda cell: cell[:1].isalpha()
    # matplotlib escapes what it writes.
    environment.filters["svg"] = lambda one, key: Markup(inline_svg(one.figure, key, one.alt))
    return environment.get_template("page.html")


def split_notes(result: EvaluationResult) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the warnings and the other notes, without the word that marks them."""
    marked = (note for note in result.notes if note.startswith(SEVERE_PREFIXES))
    others = (note for note in result.notes if not note.startswith(SEVERE_PREFIXES))
    return tuple(note.partition(": ")[2] for note in marked), tuple(others)


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


@dataclass(frozen=True)
class Side:
    """One of the two accuracies of a gap: of what protocol, and how sure."""

    protocol: str
    name: str
    accuracy: str
    spread: str


@dataclass(frozen=True)
class Gap:
    """The two accuracies that a reader must see together, and what they mean.

    `kind` is "lost" where accuracy is lost, "unsure" where chance explains it, "kept" where it is less than a point,
    "unknown" without a strict protocol beside random draws. `points` holds the difference and its unit.
    """

    kind: str
    headline: str
    sides: tuple[Side, ...]
    points: tuple[str, str]
    verdict: str
    remarks: tuple[str, ...]


def gap_of(result: EvaluationResult, space: str) -> Gap:
    """Put the gap of one space into words."""
    shown = [name for name in (result.random, result.strictest) if name is not None]
    sides = tuple(_side(result, space, name) for name in shown or result.protocols[:1])
    chosen: tuple[str, ...] = ()
    if (n_spaces := len(result.spaces)) > 1:
        how = "chosen by these same recordings: a little flattered by that"
        chosen = (f"the best of {n_spaces} feature spaces, {how}",)
    gap = result.gap(space)
    if gap is None:
        headline = f"{space} names {sides[0].accuracy} of recordings rightly ({sides[0].name})"
        return Gap("unknown", headline, sides, ("", ""), _one_sided(result, sides[0]), chosen)
    random, strict = sides
    apart = _APART.get(strict.name, strict.name)
    low, _ = result.interval(space, random.protocol)
    # Without an interval (all partitions alike) nothing excuses a gap.
    excused = result.mean_accuracy(space, strict.protocol) >= low
    kind = "kept" if gap < SMALL_GAP else "unsure" if excused else "lost"
    but = {"lost": "but only", "unsure": "and", "kept": "and still"}[kind]
    headline = (
        f"{space} names {random.accuracy} of recordings rightly when training and test are drawn at random, "
        f"{but} {strict.accuracy} when they come from {apart}"
    )
    verdict = _VERDICTS[kind].format(points=f"{100 * gap:.1f}", apart=apart)
    remarks = [*unequal_sizes(result)]
    best = result.best_space(strict.protocol)
    if best != space:
        accuracy = percent(result.mean_accuracy(best, strict.protocol))
        remarks.append(f"best with {strict.name}: {best}, {accuracy}")
    change = f"{-100 * gap:+.1f}".replace("-", "−")
    points = (change, "points") if change[1:] != "0.0" else ("no", "difference")
    return Gap(kind, headline, sides, points, verdict, (*remarks, *chosen))


def _side(result: EvaluationResult, space: str, protocol: str) -> Side:
    values = result.accuracies(space, protocol)
    low, high = result.interval(space, protocol)
    if np.isfinite(low):
        spread = f"95 % interval {100 * low:.1f} to {100 * high:.1f} %, {counted(len(values), 'partition')}"
    elif len(values) == 1:
        spread = "one partition"
    elif len(values) == 2:
        spread = " and ".join(f"{100 * value:.1f} %" for value in values.tolist())
    else:
        spread = f"the same in each of {counted(len(values), 'partition')}"
    name = protocol_name(protocol, result.partitions[protocol])
    return Side(protocol, name, percent(result.mean_accuracy(space, protocol)), spread)


def _one_sided(result: EvaluationResult, side: Side) -> str:
    if result.strictest is not None:
        return f"Only {side.name} ran: nothing shows how much random draws would flatter these recordings."
    return (
        f"Only {side.name} ran: no protocol held out a session or a stretch of time. Recordings made together "
        "resemble each other in more than their material, so take this figure as the upper end of what to expect."
    )
