"""Accuracy and early answers against seconds of signal seen."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from granular_id._words import fixed
from granular_id.plotting.style import AXIS_COLOURS, FAINT, INK, new_figure, quiet, save

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from granular_id.identifier import OverTime

__all__ = ["plot_over_time"]

_ACCURACY, _ANSWERED, _WRONG = AXIS_COLOURS[0], AXIS_COLOURS[1], AXIS_COLOURS[2]


def plot_over_time(course: OverTime, *, path: str | os.PathLike[str] | None = None) -> Figure:
    """Plot how accurate provisional answers are, and how many recordings are answered early, against time.

    Parameters
    ----------
    course : granular_id.identifier.OverTime
        From `granular_id.identifier.accuracy_over_time`.
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
    >>> from granular_id.identifier import accuracy_over_time
    >>> data = synthesize(["rice", "fine sugar"], n_per_class=10, duration_s=0.5)
    >>> plot_over_time(accuracy_over_time(data, target_error=0.1)).axes[0].get_xlabel()
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
        panel.annotate(
            f"mean {fixed(course.mean_seconds, 2)} s",
            (course.mean_seconds, 0.5),
            xytext=(-4, 0),
            textcoords="offset points",
            ha="right",
            fontsize=8,
            color=INK,
        )
    panel.plot(seconds, course.accuracy, color=_ACCURACY, linewidth=1.8, label="provisional answers right")
    panel.axhline(course.chance, color=INK, linewidth=0.8, linestyle="--", label="chance")
    panel.annotate(
        f"{100 * course.accuracy[-1]:.1f} %",
        (seconds[-1], course.accuracy[-1]),
        xytext=(-3, 5),
        textcoords="offset points",
        ha="right",
        fontsize=9,
        fontweight="bold",
        color=INK,
    )
    panel.set_xlim(0.0, seconds[-1])
    panel.set_ylim(0.0, 1.08)
    panel.set_yticks([0.0, 0.25, 0.5, 0.75, 1.0], ["0 %", "25 %", "50 %", "75 %", "100 %"])
    panel.grid(axis="y", color=FAINT, linewidth=0.4)
    panel.set_axisbelow(True)
    quiet(panel)
    panel.set_xlabel("signal seen, s", fontsize=9, color=INK)
    mark = ", SYNTHETIC recordings" if course.synthetic else ""
    panel.set_title(
        f"{course.held_out}: {course.n_answers} answers{mark}", fontsize=9, color=INK, parse_math=False
    )
    figure.legend(loc="outside lower center", ncols=4, frameon=False, fontsize=8, labelcolor=INK)
    save(figure, path)
    return figure


def _fill(panel: Any, seconds: Any, shares: Any, colour: str, name: str, alpha: float = 0.3) -> None:
    panel.fill_between(seconds, shares, step="post", color=colour, alpha=alpha, linewidth=0, label=name)
