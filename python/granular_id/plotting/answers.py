"""Answers over a long recording: the signal above, below it a row for each material."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from granular_id._core import GranularIdError
from granular_id._text import short
from granular_id.plotting import style
from granular_id.plotting.style import FAINT, INK
from granular_id.recording import AXES, Recording, unit_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from granular_id.identifier import Timeline

_NAMED, _MAY_BE, _UNKNOWN = "#0072B2", "#A9CBE2", "#D55E00"
_TRUTH: dict[str, Any] = {"marker": "<", "markersize": 6, "color": INK, "linestyle": ""}
_STRANGE: dict[str, Any] = {"facecolor": "white", "edgecolor": _UNKNOWN, "hatch": "////", "linewidth": 0.8}
_MOST_ROWS = 15
_MOST_PIECES = 1500  # a figure has no more columns
_MOST_GROUPS, _MOST_LINES = 2, 3


def plot_answers(
    timeline: Timeline, recording: Recording, *, path: str | os.PathLike[str] | None = None
) -> Figure:
    """Plot the answers over a recording: its signal above, below it a row for each material.

    Parameters
    ----------
    timeline : Timeline
        From `granular_id.Identifier.predict_over`.
    recording : Recording
        The one that it is about.
    path : path-like, optional
        As in `granular_id.plotting.plot_recordings`.

    Returns
    -------
    matplotlib.figure.Figure
        Up to three axes of each of the first two units (those of the training where the recording states none); of
        very many samples the extremes of short pieces. A dark bar is the answer, a light one another material that it
        may be. A hatched bar in the lowest row is an answer that it is like no known material; the light bar above it
        is the nearest. Of more than 15 materials those that are named most. The row of the recording's own label is
        marked with a triangle.

    Raises
    ------
    ImportError
        Without matplotlib, saying what to install.
    ValueError
        The recording has another length.

    Examples
    --------
    >>> import granular_id as gid
    >>> from granular_id.plotting import plot_answers
    >>> data = gid.synthesize(["rice", "fine sugar"], n_per_class=6, duration_s=0.5)
    >>> model = gid.Identifier.fit(data, "hfmh", estimate=False)
    >>> drive = gid.synthesize(["rice"], n_per_class=1, duration_s=3.2, seed=1)[0]
    >>> len(plot_answers(model.predict_over(drive, 0.1), drive).axes)
    3
    """
    lasts_s = recording.n_samples / (recording.rate_hz or 1.0)
    if abs(lasts_s - timeline.duration_s) > 1e-6:
        raise GranularIdError(
            f"recording lasts {lasts_s:g} s, the answers are about one of {timeline.duration_s:g} s: pass the one that "
            "predict_over was given"
        )
    groups = _groups(timeline, recording)
    names, hidden = _rows(timeline)
    heights = [1.1] * len(groups) + [0.5 + 0.24 * len(names)]
    figure = style.new_figure(9.0, 1.0 + sum(heights))
    *panels, answers = figure.subplots(
        len(heights), 1, sharex=True, squeeze=False, height_ratios=heights
    ).ravel()
    for panel, (unit, columns) in zip(panels, groups, strict=True):
        _draw_signal(panel, recording, columns, unit)
    _draw_answers(answers, timeline, names)
    answers.set_xlim(0.0, lasts_s)
    left_out = f" ({hidden} materials that are named least left out)" if hidden else ""
    style.name_axes(answers, f"time, s; each answer is about the {timeline.window_s:g} s before{left_out}")
    title = f"Answers over {short(timeline.name, 60) or 'a recording'}"
    style.heading(figure, ", ".join(filter(None, (title, timeline.synthetic))))
    _legend(figure, timeline, names)
    style.save(figure, path)
    return figure


def _groups(timeline: Timeline, recording: Recording) -> list[tuple[str, list[int]]]:
    """Choose the columns to draw, a panel a unit."""
    units = timeline.units or tuple(unit_of(axis, recording.meta) for axis in recording.axes)
    groups: dict[str, list[int]] = {}
    for column, unit in enumerate(units):
        groups.setdefault(unit, []).append(column)
    return [(unit, columns[:_MOST_LINES]) for unit, columns in list(groups.items())[:_MOST_GROUPS]]


def _rows(timeline: Timeline) -> tuple[list[str], int]:
    """Choose the materials to draw, and say how many are left out."""
    named = timeline.labels.tolist() + [name for few in timeline.candidates for name in few]
    often = sorted(timeline.classes, key=lambda name: -named.count(name))[:_MOST_ROWS]
    return [name for name in timeline.classes if name in often], len(timeline.classes) - len(often)


def _draw_signal(panel: Any, recording: Recording, columns: list[int], unit: str) -> None:
    rate_hz = recording.rate_hz or 1.0
    for place, column in enumerate(columns):
        axis = recording.axes[column]
        signal = recording.wrench[:, column]
        at, values = _outline(signal if axis in AXES else signal - np.median(signal))
        line = style.axis_line(axis, place) | {"linewidth": 0.8, "label": style.pretty(axis)}
        if len(at) < len(signal):
            line |= {"linewidth": 0.4, "linestyle": "-"}
        panel.plot(at / rate_hz, values, **line)
    style.curve_panel(panel)
    # A force is drawn as it is; gravity and offsets of other sensors would flatten what happens.
    is_wrench = recording.axes[columns[0]] in AXES
    style.name_axes(panel, up=unit if is_wrench else f"{unit}\nless median".strip())
    beside: dict[str, Any] = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5), "handlelength": 1.5}
    panel.legend(frameon=False, fontsize=8, labelcolor=INK, **beside)


def _outline(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return places and values of a curve; of a long one the smallest and largest value of each piece."""
    step = -(-len(values) // _MOST_PIECES)
    if step <= 2:
        return np.arange(len(values), dtype=np.float64), values
    pieces = np.append(values, np.full(-len(values) % step, values[-1])).reshape(-1, step)
    both = np.column_stack([pieces.min(axis=1), pieces.max(axis=1)]).ravel()
    return step * (np.arange(len(both)) // 2) + step * np.tile([0.25, 0.75], len(pieces)), both


def _draw_answers(panel: Any, timeline: Timeline, names: list[str]) -> None:
    n = len(timeline)
    unknown = np.zeros(n, np.bool_) if timeline.unknown is None else timeline.unknown
    edges = np.concatenate([[timeline.times_s[0] - timeline.window_s], timeline.times_s])
    labels = timeline.labels
    rows = [*names, *["like none of them"] * (timeline.unknown is not None)]
    for row, name in enumerate(names):
        is_it = labels == name
        may_be = np.array([name in few for few in timeline.candidates]) | (is_it & unknown)
        _bars(panel, row, edges, may_be & ~(is_it & ~unknown), _MAY_BE)
        _bars(panel, row, edges, is_it & ~unknown, _NAMED)
    if timeline.unknown is not None:
        _bars(panel, len(names), edges, unknown, **_STRANGE)
    style.row_names(panel, rows)
    style.quiet(panel, "left")
    style.grid(panel, "x")
    for edge in range(1, len(rows)):
        panel.axhline(edge - 0.5, color=FAINT, linewidth=0.3, zorder=0)
    if timeline.truth in names:
        place = names.index(timeline.truth)
        panel.plot([1.008], [place], clip_on=False, transform=panel.get_yaxis_transform(), **_TRUTH)


def _bars(
    panel: Any,
    row: int,
    edges: NDArray[np.float64],
    where: NDArray[np.bool_],
    facecolor: str,
    **look: Any,
) -> None:
    """Draw answers in a row as one bar."""
    steps = np.diff(np.concatenate([[False], where, [False]]).astype(np.int8))
    begins, ends = edges[np.flatnonzero(steps == 1)], edges[np.flatnonzero(steps == -1)]
    if len(begins):
        spans = np.column_stack([begins, ends - begins]).tolist()
        panel.broken_barh(spans, (row - 0.36, 0.72), **{"facecolor": facecolor, "linewidth": 0, **look})


def _legend(figure: Figure, timeline: Timeline, names: list[str]) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    unknown = timeline.unknown is not None and bool(timeline.unknown.any())
    handles: list[Any] = [Patch(color=_NAMED, label="answer")]
    if unknown or any(len(few) > 1 for few in timeline.candidates):
        handles.append(Patch(color=_MAY_BE, label="may be, or nearest"))
    if unknown:
        handles.append(Patch(**_STRANGE, label="like no known material"))
    if timeline.truth in names:
        handles.append(Line2D([], [], **_TRUTH, label="label of the recording"))
    style.legend(figure, "lower right", handles=handles, ncols=len(handles))
