"""How sure a model may be: calibration, coverage of sets, novelty scores."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from granular_id.plotting.style import (
    INK,
    SHARE_TICKS,
    grid,
    heading,
    new_figure,
    quiet,
    save,
    share_axis,
)
from granular_id.recording import AXIS_COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from granular_id.evaluation import ConfidenceStudy

_FIRST, _SECOND = AXIS_COLOURS[0], AXIS_COLOURS[2]  # blue and vermilion, of different lightness too
_N_BINS = 48
_LEGEND = 0.34  # share of the height of the panel of sets that its legend takes, above 100 %
_LINE = 0.2  # the same of one line, and of half a circle below it


def plot_confidence(study: ConfidenceStudy, *, path: str | os.PathLike[str] | None = None) -> Figure:
    """Plot whether probabilities mean what they say, sets hold what they promise, and the unknown stands out.

    Parameters
    ----------
    study : granular_id.ConfidenceStudy
    path : path-like, optional
        As in `granular_id.plotting.plot_mean_forces`.

    Returns
    -------
    matplotlib.figure.Figure
        Above: the feature space and what was held out. Left: share of right answers against their probability; the area
        of a circle is its share of the recordings. Middle: how often candidates hold the right material, against how
        often they should, in the mean over sessions and in the worst. Right, with three materials or more: novelty
        scores of known and of left-out materials, 1 at the limit; a bar of its own at the right end, named after where
        it begins, counts what lies beyond.

    Raises
    ------
    ImportError
        Without matplotlib, saying what to install.

    Examples
    --------
    >>> from granular_id import synthesize
    >>> from granular_id.evaluation import confidence_study
    >>> from granular_id.plotting import plot_confidence
    >>> data = synthesize(["rice", "fine sugar", "oat flakes"], n_per_class=8, sessions=4, duration_s=0.5)
    >>> figure = plot_confidence(confidence_study(data))
    >>> [panel.get_title() for panel in figure.axes]
    ['probabilities', 'candidates', 'unknown materials']
    """
    n_panels = 3 if study.unknown else 2
    figure = new_figure(0.6 + 3.1 * n_panels, 3.5)
    panels = figure.subplots(1, n_panels)
    _draw_reliability(panels[0], study)
    _draw_coverage(panels[1], study)
    if study.unknown:
        _draw_unknown(panels[2], study)
    for panel in panels:
        quiet(panel)
        panel.title.set_fontsize(10)
        panel.title.set_color(INK)
        panel.xaxis.label.set_fontsize(8)
        panel.yaxis.label.set_fontsize(8)
        if panel.get_legend_handles_labels()[0]:
            panel.legend(loc="upper left", edgecolor="none", framealpha=1.0, fontsize=7.5, labelcolor=INK)
    mark = ", SYNTHETIC recordings" if study.synthetic else ""
    heading(figure, f"{study.space}, {study.held_out}{mark}", 10)
    save(figure, path)
    return figure


def _draw_reliability(panel: Any, study: ConfidenceStudy) -> None:
    seen = study.reliability
    sizes = np.array([part.n for part in seen.bins]) / study.n_rows
    share_axis(panel)
    panel.set_ylim(0.0, 1.0 / (1.0 - _LINE))
    panel.set_yticks(*SHARE_TICKS)
    panel.plot([0, 1], [0, 1], color=INK, linewidth=0.8, linestyle="--", label="calibrated", zorder=1)
    grid(panel)
    panel.scatter(
        [part.probability for part in seen.bins],
        [part.accuracy for part in seen.bins],
        s=20 + 300 * sizes,
        color=_FIRST,
        alpha=0.75,
        linewidths=0,
        clip_on=False,
        zorder=3,
    )
    panel.set_title("probabilities")
    panel.set_xlabel(
        f"probability of the answer, {study.n_rows} recordings\ntoo sure by {100 * seen.too_sure:+.1f} points\n"
        f"{seen.summary}",
        color=INK,
    )
    panel.set_ylabel("share of right answers", color=INK)


def _draw_coverage(panel: Any, study: ConfidenceStudy) -> None:
    levels = [one.level for one in study.coverage]
    means = [one.mean for one in study.coverage]
    worst = [one.worst for one in study.coverage]
    what = "mean over sessions" if study.n_sessions else "held out"
    panel.plot(levels, means, color=_FIRST, marker="o", linewidth=1.2, label=what)
    if study.n_sessions:
        panel.plot(levels, worst, color=_SECOND, marker="s", linewidth=1.2, label="worst session")
    low = min(0.1 * np.floor(10 * min(*levels, *worst)), 0.7)
    panel.set_xlim(low, 1.0)
    panel.set_ylim(low, (1.0 - _LEGEND * low) / (1.0 - _LEGEND))
    panel.plot(
        [low, 1.0], [low, 1.0], color=INK, linewidth=0.8, linestyle="--", label="as asked for", zorder=1
    )
    ticks = np.arange(round(10 * low), 11) / 10
    ticks = ticks[:: 1 + len(ticks) // 7]
    for set_ticks in (panel.set_xticks, panel.set_yticks):
        set_ticks(ticks, [f"{100 * tick:.0f} %" for tick in ticks])
    grid(panel)
    panel.set_title("candidates")
    panel.set_xlabel("share asked for", color=INK)
    panel.set_ylabel("candidates that hold the right one", color=INK)


def _draw_unknown(panel: Any, study: ConfidenceStudy) -> None:
    known, unknown = study.novelty
    panel.set_title("unknown materials")
    low = float(min(known.min(), unknown.min()))
    high = float(np.ceil(2 * max(2.0, np.quantile(unknown, 0.9), np.quantile(known, 0.99))) / 2)
    edges = np.linspace(low, high, _N_BINS + 1)
    beyond = max(known.max(), unknown.max()) > high
    if beyond:  # a gap, and a bar for all that is larger
        edges = np.append(edges, high + (high - low) * np.array([1.0, 3.0]) / _N_BINS)
    last = float(edges[-2:].mean())
    for values, colour, name, style in (
        (known, _FIRST, "known", {"alpha": 0.45, "histtype": "stepfilled"}),
        (unknown, _SECOND, "left out", {"histtype": "step", "linewidth": 1.6}),
    ):
        weights = np.full(len(values), 1 / len(values))
        shown = np.where(values > high, last, values)
        panel.hist(shown, bins=edges, weights=weights, color=colour, label=name, **style)
    panel.axvline(1.0, color=INK, linewidth=0.9, linestyle="--", label="limit")
    panel.set_xlim(low, edges[-1])
    if beyond:
        ticks = [tick for tick in panel.get_xticks() if low <= tick <= high - 0.12 * (high - low)]
        panel.set_xticks(
            [*ticks, last], [*(f"{tick:g}".replace("-", "\N{MINUS SIGN}") for tick in ticks), f"> {high:g}"]
        )
    panel.set_ylim(0.0, 1.3 * panel.get_ylim()[1])
    panel.yaxis.set_major_formatter(lambda share, _: f"{100 * share:.0f} %")
    panel.set_xlabel(
        f"novelty score, 1 at the limit\nAUROC {np.mean([one.auroc for one in study.unknown]):.3f}, "
        f"refused {100 * np.mean([one.refused for one in study.unknown]):.0f} %",
        color=INK,
    )
    panel.set_ylabel("share of recordings", color=INK)
