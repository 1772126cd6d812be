"""Figures of an evaluation: accuracy with the gap, recall, confusion, accuracy over time."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_id._text import fixed, short, whole_percent
from granular_id.plotting.style import (
    FAINT,
    INK,
    SHARE_TICKS,
    chance_line,
    grid,
    heading,
    legend,
    new_figure,
    note,
    quiet,
    save,
    share_rows,
    synthetic_mark,
)
from granular_id.recording import AXIS_COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from granular_id.evaluation import EvaluationResult
    from granular_id.identifier import OverTime

_PAPER = "the paper, on its own recordings"
_STRICT, _AT_RANDOM, _GAP = "#D55E00", "#0072B2", "#E69F00"  # Okabe and Ito; marks differ, too


def plot_accuracy(
    result: EvaluationResult, *, paper: bool = False, path: str | os.PathLike[str] | None = None
) -> Figure:
    """Plot the balanced accuracy of each feature space and baseline: held out, at random, and the gap between.

    Parameters
    ----------
    result : EvaluationResult
    paper : bool, default False
        Mark the accuracies that the paper reports for its own recordings, where a space has one.
    path : path-like, optional
        As in `granular_id.plotting.plot_mean_forces`.

    Returns
    -------
    matplotlib.figure.Figure
        One row a space, the headline's on top; baselines in brackets. A square is the accuracy on what was held out,
        its line the 95 % interval over sessions where there is one; a circle the accuracy of as many recordings at
        random, the shaded line between them the gap. The dashed line is chance.

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
    figure = new_figure(4.7, 1.0 + 0.32 * len(rows))
    panel = figure.subplots()
    for row, (_, strict, interval, at_random) in enumerate(rows):
        panel.plot(
            [strict, at_random], [row, row], color=_GAP, linewidth=7, alpha=0.35, solid_capstyle="butt"
        )
        panel.plot(interval, [row, row], color=_STRICT, linewidth=2)
        note(panel, f"{100 * strict:.1f}", (1.0, row), (4, 0), va="center", fontsize=8, annotation_clip=False)
    places = range(len(rows))
    marks: dict[str, Any] = {"linestyle": "none", "markersize": 7, "clip_on": False}
    panel.plot(
        [row[3] for row in rows], places, marker="o", color=_AT_RANDOM, label="as many at random", **marks
    )
    panel.plot([row[1] for row in rows], places, marker="s", color=_STRICT, label=result.folds.name, **marks)
    if paper:
        known = [result.paper_accuracies.get(name, np.nan) for name in result.spaces]
        style: dict[str, Any] = {"linestyle": "none", "marker": "|", "markersize": 11, "markeredgewidth": 1.6}
        panel.plot(known, range(len(known)), color=INK, label=_PAPER, **style)
    chance_line(panel, result.chance, "chance")
    share_rows(panel, [row[0] for row in rows])
    panel.set_xlabel("balanced accuracy", fontsize=9, color=INK)
    legend(figure, "upper left", ncols=2)
    save(figure, path)
    return figure


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
        As in `granular_id.plotting.plot_mean_forces`.

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
    figure = new_figure(4.7, 0.9 + 0.22 * len(recall))
    panel = figure.subplots()
    for row, share in enumerate(recall.tolist()):
        panel.plot([0, share], [row, row], color=FAINT, linewidth=2, zorder=1)
    panel.plot(
        recall, range(len(recall)), linestyle="none", marker="s", markersize=6, color=_STRICT, clip_on=False
    )
    chance_line(panel, result.chance, "chance")
    share_rows(panel, result.labels)
    panel.set_xlabel(f"recall, {result.folds.name}", fontsize=9, color=INK)
    legend(figure, "upper left", ncols=3)
    save(figure, path)
    return figure


_CELL = "#0072B2"

_WHITE_ABOVE = 78.0
"""Per cent from which on white stands out from a cell on white paper better than ink does."""


def plot_confusion(
    matrix: ArrayLike,
    labels: Sequence[str],
    *,
    title: str | None = None,
    path: str | os.PathLike[str] | None = None,
) -> Figure:
    """Plot a confusion matrix as a heat map, each row as per cent of its true class.

    Parameters
    ----------
    matrix : array_like, shape (k, k)
        Counts; row = true class, column = predicted class.
    labels : sequence of str, length k
        Names of the classes in the matrix's order.
    title : str, optional
    path : path-like, optional
        As in `plot_mean_forces`.

    Returns
    -------
    matplotlib.figure.Figure
        A class without any recording keeps an empty row.

    Raises
    ------
    ImportError
        Without matplotlib, saying what to install.
    ValueError
        For a matrix that is not square, holds negative or non-finite counts, or does not match the labels.

    Examples
    --------
    >>> from granular_id.plotting import plot_confusion
    >>> figure = plot_confusion([[9, 1], [0, 10]], ["peas", "rice"])
    >>> [text.get_text() for text in figure.axes[0].texts]
    ['90', '10', '100']
    """
    counts = _checked_counts(matrix, labels)
    percent = as_percent(counts)
    k = len(labels)
    side = 1.8 + 0.5 * k
    figure = new_figure(side + 0.8, side)
    draw_confusion(figure.subplots(), percent, labels)
    above = "" if title is None else f"{title}\n"
    heading(figure.axes[0], f"{above}per cent of each true class", 10)
    save(figure, path)
    return figure


def draw_confusion(panel: Any, percent: NDArray[np.float64], labels: Sequence[str]) -> None:
    """Draw a matrix of per cent (K, K) with the numbers in its cells."""
    from matplotlib.patches import Rectangle  # an extra

    for row, column in np.argwhere(percent > 0):
        value = float(percent[row, column])
        # Faint to full in one hue: order survives any colour vision, a grey print and a dark page.
        corner = (column - 0.47, row - 0.47)
        panel.add_patch(
            Rectangle(corner, 0.94, 0.94, color=_CELL, alpha=0.08 + 0.92 * value / 100, linewidth=0)
        )
        panel.text(
            column,
            row,
            whole_percent(value),
            ha="center",
            va="center",
            fontsize=9,
            color="white" if value > _WHITE_ABOVE else INK,
        )
    k = len(labels)
    names = [short(label) for label in labels]
    # A label with $ in it is a label, no mathematics.
    panel.set_xticks(
        range(k), names, rotation=45, ha="right", rotation_mode="anchor", fontsize=9, parse_math=False
    )
    panel.set_yticks(range(k), names, fontsize=9, parse_math=False)
    panel.set_xticks(np.arange(k + 1) - 0.5, minor=True)
    panel.set_yticks(np.arange(k + 1) - 0.5, minor=True)
    panel.grid(which="minor", color=FAINT, linewidth=0.4, alpha=0.6)
    panel.tick_params(which="both", length=0, colors=INK)
    panel.spines[:].set_visible(False)
    panel.set_xlim(-0.5, k - 0.5)
    panel.set_ylim(k - 0.5, -0.5)
    panel.set_aspect("equal")
    panel.set_xlabel("predicted", color=INK)
    panel.set_ylabel("true", color=INK)


def as_percent(counts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return each row as per cent of its sum; a row without counts stays zero."""
    totals = counts.sum(axis=1, keepdims=True)
    percent = np.zeros(counts.shape)
    np.divide(100.0 * counts, totals, out=percent, where=totals > 0)
    return percent


def _checked_counts(matrix: ArrayLike, labels: Sequence[str]) -> NDArray[np.float64]:
    counts = np.asarray(matrix, dtype=np.float64)
    if counts.ndim != 2 or counts.shape[0] != counts.shape[1] or counts.size == 0:
        raise ValueError(f"matrix must be square, got shape {counts.shape}")
    if len(labels) != counts.shape[0]:
        raise ValueError(f"labels must name the {counts.shape[0]} classes of matrix, got {len(labels)}")
    if not np.all(np.isfinite(counts)) or np.any(counts < 0):
        raise ValueError("matrix must hold finite counts that are not negative")
    return counts


_ACCURACY, _ANSWERED, _WRONG = AXIS_COLOURS[0], AXIS_COLOURS[1], AXIS_COLOURS[2]


def plot_over_time(course: OverTime, *, path: str | os.PathLike[str] | None = None) -> Figure:
    """Plot how accurate provisional answers are, and how many recordings are answered early, against time.

    Parameters
    ----------
    course : granular_id.identifier.OverTime
        `Identifier.over_time_` of a model that was just fitted.
    path : path-like, optional
        As in `granular_id.plotting.plot_mean_forces`.

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
    figure = new_figure(5.6, 3.4)
    panel = figure.subplots()
    seconds = course.seconds
    if course.answered[-1] > 0:
        _fill(panel, seconds, course.answered, _ANSWERED, "answered early")
        wrong = [
            share * error if share > 0 else 0.0
            for share, error in zip(course.answered, course.error, strict=True)
        ]
        _fill(panel, seconds, wrong, _WRONG, "of these wrong", alpha=0.9)
        panel.axvline(course.mean_seconds, color=_ANSWERED, linewidth=1.0, linestyle=":")
        note(
            panel, f"mean {fixed(course.mean_seconds, 2)} s", (course.mean_seconds, 0.5), (-4, 0), ha="right"
        )
    panel.plot(seconds, course.accuracy, color=_ACCURACY, linewidth=1.8, label="provisional answers right")
    panel.axhline(course.chance, color=INK, linewidth=0.8, linestyle="--", label="chance")
    end = course.accuracy[-1]
    note(panel, f"{100 * end:.1f} %", (seconds[-1], end), (-3, 5), ha="right", fontsize=9, fontweight="bold")
    panel.set_xlim(0.0, seconds[-1])
    panel.set_ylim(0.0, 1.08)
    panel.set_yticks(*SHARE_TICKS)
    grid(panel, "y")
    quiet(panel)
    panel.set_xlabel("signal seen, s", fontsize=9, color=INK)
    heading(panel, f"{course.held_out}: {course.n_answers} answers{synthetic_mark(course.synthetic)}", 9)
    legend(figure, "lower center", ncols=4)
    save(figure, path)
    return figure


def _fill(panel: Any, seconds: Any, shares: Any, colour: str, name: str, alpha: float = 0.3) -> None:
    panel.fill_between(seconds, shares, step="post", color=colour, alpha=alpha, linewidth=0, label=name)
