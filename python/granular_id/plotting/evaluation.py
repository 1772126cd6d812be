"""Figures of an evaluation: accuracy with the gap, recall, confusion, accuracy over time."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from granular_id._text import fixed, short, whole_percent
from granular_id.evaluation import shows_paper
from granular_id.plotting import style
from granular_id.plotting.style import FAINT, INK
from granular_id.recording import AXIS_COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from granular_id.evaluation import EvaluationResult
    from granular_id.identifier import OverTime

_PAPER = "the paper, on its own recordings"
_STRICT, _AT_RANDOM, _GAP = "#D55E00", "#0072B2", "#E69F00"  # Okabe and Ito; marks differ, too


def plot_accuracy(result: EvaluationResult, *, path: str | os.PathLike[str] | None = None) -> Figure:
    """Plot the balanced accuracy of each feature space and baseline: held out, at random, and the gap between.

    Parameters
    ----------
    result : EvaluationResult
    path : path-like, optional
        As in `granular_id.plotting.plot_recordings`.

    Returns
    -------
    matplotlib.figure.Figure
        One row a space, the headline's on top; baselines in brackets. A square is the accuracy on what was held out,
        its line the 95 % interval over sessions where there is one; a circle the accuracy of as many recordings at
        random, the shaded line between them the gap. The dashed line is chance. Of the materials of the paper, strokes
        are the accuracies that it reports for its own recordings.

    Raises
    ------
    ImportError
        Without matplotlib, saying what to install.

    Examples
    --------
    >>> from granular_id import evaluate, synthesize
    >>> data = synthesize(["rice", "fine sugar"], n_per_class=6, duration_s=0.5)
    >>> result = evaluate(data, ["raw", "hfmh"], paper=(3, 4, 2), baselines=False, progress=False)
    >>> [label.get_text() for label in plot_accuracy(result).axes[0].get_yticklabels()]
    ['raw', 'hfmh']
    """
    rows = [
        (name, held.accuracy, held.interval, float(np.mean(result.at_random.get(name, np.nan))))
        for name, held in result.held.items()
    ]
    rows += [
        (f"({one.name})", one.held.accuracy, (np.nan, np.nan), one.at_random)
        for one in result.baselines
        if one.held is not None
    ]
    names, strict, intervals, at_random = zip(*rows, strict=True)
    places = range(len(rows))
    figure = style.new_figure(4.7, 1.0 + 0.32 * len(rows))
    panel = figure.subplots()
    panel.hlines(places, strict, at_random, color=_GAP, linewidth=7, alpha=0.35)
    panel.hlines(places, *zip(*intervals, strict=True), color=_STRICT, linewidth=2)
    for place, share in enumerate(strict):
        style.note(panel, f"{100 * share:.1f}", (1.0, place), (4, 0), va="center", annotation_clip=False)
    for shares, marker, colour, name in (
        (at_random, "o", _AT_RANDOM, "as many at random"),
        (strict, "s", _STRICT, result.folds.name),
    ):
        panel.plot(shares, places, marker, color=colour, label=name, markersize=7, clip_on=False)
    if shows_paper(result):
        known = [result.paper_accuracies.get(name, np.nan) for name in result.spaces]
        places = range(len(known))
        panel.plot(known, places, "|", color=INK, label=_PAPER, markersize=11, markeredgewidth=1.6)
    _finish_shares(panel, result, names, "balanced accuracy")
    style.save(figure, path)
    return figure


def _finish_shares(panel: Any, result: EvaluationResult, names: Sequence[str], what: str) -> None:
    """Make a panel one of shares with named rows, a line at chance, and a legend above."""
    panel.axvline(result.chance, color=INK, linewidth=0.8, linestyle="--", label="chance")
    style.share_axis(panel)
    style.row_names(panel, names)
    style.quiet(panel, "left")
    style.grid(panel, "x")
    style.name_axes(panel, what + style.synthetic_mark(result.synthetic))
    style.legend(panel.figure, "upper left", ncols=2)


def plot_recall(
    result: EvaluationResult, space: str | None = None, *, path: str | os.PathLike[str] | None = None
) -> Figure:
    """Plot the recall of each material: the share of its held-out recordings that was named right.

    Parameters
    ----------
    result : EvaluationResult
    space : str, optional
        Default: the headline's.
    path : path-like, optional
        As in `granular_id.plotting.plot_recordings`.

    Returns
    -------
    matplotlib.figure.Figure
        One row a material; without a mark where it was not tested.

    Raises
    ------
    ImportError
        Without matplotlib, saying what to install.
    ValueError
        For a space that was not evaluated.

    Examples
    --------
    >>> from granular_id import evaluate, synthesize
    >>> data = synthesize(["rice", "fine sugar"], n_per_class=6, duration_s=0.5)
    >>> result = evaluate(data, "hfmh", baselines=False, progress=False)
    >>> [label.get_text() for label in plot_recall(result).axes[0].get_yticklabels()]
    ['fine sugar', 'rice']
    """
    recall = result.recall(space)
    places = range(len(recall))
    figure = style.new_figure(4.7, 0.9 + 0.22 * len(recall))
    panel = figure.subplots()
    panel.hlines(places, 0.0, recall, color=FAINT, linewidth=2, zorder=1)
    panel.plot(recall, places, "s", markersize=6, color=_STRICT, clip_on=False)
    _finish_shares(panel, result, result.labels, f"recall, {result.folds.name}")
    style.save(figure, path)
    return figure


_CELL = "#0072B2"

_WHITE_ABOVE = 0.78
"""Share from which on white stands out from a cell on white paper better than ink does."""


def plot_confusion(
    result: EvaluationResult, space: str | None = None, *, path: str | os.PathLike[str] | None = None
) -> Figure:
    """Plot which materials are taken for which, in per cent of the recordings of each true material.

    Parameters
    ----------
    result : EvaluationResult
    space : str, optional
        Default: the headline's.
    path : path-like, optional
        As in `granular_id.plotting.plot_recordings`.

    Returns
    -------
    matplotlib.figure.Figure
        One row a true material, one column a predicted one; a material that was not tested keeps an empty row.

    Raises
    ------
    ImportError
        Without matplotlib, saying what to install.
    ValueError
        For a space that was not evaluated.

    Examples
    --------
    >>> from granular_id import evaluate, synthesize
    >>> data = synthesize(["rice", "fine sugar"], n_per_class=6, duration_s=0.5)
    >>> result = evaluate(data, "hfmh", baselines=False, progress=False)
    >>> [label.get_text() for label in plot_confusion(result).axes[0].get_xticklabels()]
    ['fine sugar', 'rice']
    """
    counts = result.confusion(space)
    k = len(counts)
    names = [short(label) for label in result.labels]
    figure = style.new_figure(1.8 + 0.34 * k, 1.7 + 0.34 * k)
    panel = figure.subplots()
    for (row, column), count in np.ndenumerate(counts):
        if count:
            _draw_cell(panel, row, column, float(count / counts[row].sum()))
    # A label with $ in it is a label, no mathematics.
    turned: dict[str, Any] = {"rotation": 45, "ha": "right", "rotation_mode": "anchor"}
    panel.set_xticks(range(k), names, fontsize=9, parse_math=False, **turned)
    panel.set_yticks(range(k), names, fontsize=9, parse_math=False)
    panel.set_xticks(np.arange(k + 1) - 0.5, minor=True)
    panel.set_yticks(np.arange(k + 1) - 0.5, minor=True)
    panel.grid(which="minor", color=FAINT, linewidth=0.4, alpha=0.6)
    panel.tick_params(which="both", length=0, colors=INK)
    panel.spines[:].set_visible(False)
    panel.set_xlim(-0.5, k - 0.5)
    panel.set_ylim(k - 0.5, -0.5)
    panel.set_aspect("equal")
    style.name_axes(panel, "predicted", "true, per cent of each")
    mark = "\nSYNTHETIC recordings" if result.synthetic else ""
    style.heading(figure, f"{space or result.spaces[0]}, {result.folds.name}{mark}", 9)
    style.save(figure, path)
    return figure


def _draw_cell(panel: Any, row: int, column: int, share: float) -> None:
    """Draw a square, faint to full in one hue: order survives any colour vision, a grey print and a dark page."""
    from matplotlib.patches import Rectangle  # an extra

    corner = (column - 0.47, row - 0.47)
    panel.add_patch(Rectangle(corner, 0.94, 0.94, color=_CELL, alpha=0.08 + 0.92 * share, linewidth=0))
    colour = "white" if share > _WHITE_ABOVE else INK
    centred: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 9}
    panel.text(column, row, whole_percent(100 * share), color=colour, **centred)


_ACCURACY, _ANSWERED, _WRONG = AXIS_COLOURS[0], AXIS_COLOURS[1], AXIS_COLOURS[2]


def plot_over_time(course: OverTime, *, path: str | os.PathLike[str] | None = None) -> Figure:
    """Plot how accurate provisional answers are, and how many recordings are answered early, against time.

    Parameters
    ----------
    course : granular_id.identifier.OverTime
        `Identifier.over_time_` of a model that was just fitted.
    path : path-like, optional
        As in `granular_id.plotting.plot_recordings`.

    Returns
    -------
    matplotlib.figure.Figure
        The full line is the share of provisional answers that are right, its end that of whole recordings; the
        dashed line is chance. The filled curve is the share of recordings that the early rule has answered by then,
        its dark part what of that is wrong.

    Raises
    ------
    ImportError
        Without matplotlib, saying what to install.

    Examples
    --------
    >>> from granular_id import synthesize
    >>> from granular_id import Identifier
    >>> data = synthesize(["rice", "fine sugar"], n_per_class=10, duration_s=0.5)
    >>> plot_over_time(Identifier.fit(data, target_error=0.1).over_time_).axes[0].get_xlabel()
    'signal seen, s'
    """
    figure = style.new_figure(5.6, 3.4)
    panel = figure.subplots()
    seconds = course.seconds
    if course.answered[-1] > 0:
        answered = np.asarray(course.answered)
        wrong = np.where(answered > 0, answered * np.asarray(course.error), 0.0)
        for shares, colour, alpha, name in (
            (answered, _ANSWERED, 0.3, "answered early"),
            (wrong, _WRONG, 0.9, "of these wrong"),
        ):
            look: dict[str, Any] = {"color": colour, "alpha": alpha, "linewidth": 0, "label": name}
            panel.fill_between(seconds, shares, step="post", **look)
        panel.axvline(course.mean_seconds, color=_ANSWERED, linewidth=1.0, linestyle=":")
        mean = f"mean {fixed(course.mean_seconds, 2)} s"
        style.note(panel, mean, (course.mean_seconds, 0.5), (-4, 0), ha="right")
    panel.plot(seconds, course.accuracy, color=_ACCURACY, linewidth=1.8, label="provisional answers right")
    panel.axhline(course.chance, color=INK, linewidth=0.8, linestyle="--", label="chance")
    end = seconds[-1], course.accuracy[-1]
    style.note(panel, f"{100 * end[1]:.1f} %", end, (-3, 5), ha="right", fontsize=9, fontweight="bold")
    panel.set_xlim(0.0, seconds[-1])
    panel.set_ylim(0.0, 1.08)
    panel.set_yticks(*style.SHARE_TICKS)
    style.grid(panel, "y")
    style.quiet(panel)
    style.name_axes(panel, "signal seen, s")
    mark = style.synthetic_mark(course.synthetic)
    style.heading(panel, f"{course.held_out}: {course.n_answers} answers{mark}", 9)
    style.legend(figure, "lower center", ncols=4)
    style.save(figure, path)
    return figure
