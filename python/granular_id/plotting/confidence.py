"""How sure a model may be: calibration, coverage of sets, novelty scores."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from granular_id._text import counted
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

    from granular_id.confidence import Confidence

_FIRST, _SECOND = AXIS_COLOURS[0], AXIS_COLOURS[2]  # blue and vermilion, of different lightness too
_N_BINS = 48
_LEGEND = 0.34  # share of the height of the panel of sets that its legend takes, above 100 %
_LINE = 0.2  # the same of one line, and of half a circle below it


def plot_confidence(confidence: Confidence, *, path: str | os.PathLike[str] | None = None) -> Figure:
    """Plot whether probabilities mean what they say, sets hold what they promise, and the unknown stands out.

    Parameters
    ----------
    confidence : granular_id.confidence.Confidence
    path : path-like, optional
        As in `granular_id.plotting.plot_mean_forces`.

    Returns
    -------
    matplotlib.figure.Figure
        Above: what the model is called. Left: accuracy against probability of the answer; the area of a circle is its
        share of the rows. Middle: coverage against the level asked for, on random partitions with the interval in
        which 95 % of them lie, and on the strictest ones. Right, with three materials or more: novelty scores of known
        and of left-out materials, 1 at the limit of each model; a bar of its own at the right end, named after where
        it begins, counts what lies beyond.

    Raises
    ------
    ImportError
        Without matplotlib, saying what to install.

    Examples
    --------
    >>> from sklearn.datasets import load_iris
    >>> from granular_id.confidence import assess
    >>> from granular_id import ECOCClassifier
    >>> from granular_id.plotting import plot_confidence
    >>> X, y = load_iris(return_X_y=True)
    >>> figure = plot_confidence(assess(X, ECOCClassifier(), y, n_seeds=3))
    >>> [panel.get_title() for panel in figure.axes]
    ['probabilities', 'sets of materials', 'unknown materials']
    """
    with_unknown = confidence.open_set is not None
    n_panels = 3 if with_unknown else 2
    figure = new_figure(0.6 + 3.1 * n_panels, 3.5)
    panels = figure.subplots(1, n_panels)
    _draw_reliability(panels[0], confidence)
    _draw_coverage(panels[1], confidence)
    if with_unknown:
        _draw_unknown(panels[2], confidence)
    for panel in panels:
        quiet(panel)
        panel.title.set_fontsize(10)
        panel.title.set_color(INK)
        panel.xaxis.label.set_fontsize(8)
        panel.yaxis.label.set_fontsize(8)
        if panel.get_legend_handles_labels()[0]:
            panel.legend(loc="upper left", edgecolor="none", framealpha=1.0, fontsize=7.5, labelcolor=INK)
    title = [confidence.name, *(["SYNTHETIC recordings"] if confidence.synthetic else [])]
    heading(figure, ", ".join(filter(None, title)), 10)
    save(figure, path)
    return figure


def _draw_reliability(panel: Any, confidence: Confidence) -> None:
    seen = confidence.reliability
    sizes = np.array([part.n for part in seen.bins]) / seen.n
    share_axis(panel)
    panel.set_ylim(0.0, 1.0 / (1.0 - _LINE))
    panel.set_yticks(*SHARE_TICKS)
    panel.plot([0, 1], [0, 1], color=INK, linewidth=0.8, linestyle="--", label="calibrated", zorder=1)
    grid(panel)
    panel.scatter(
        [part.confidence for part in seen.bins],
        [part.accuracy for part in seen.bins],
        s=20 + 300 * sizes,
        color=_FIRST,
        alpha=0.75,
        linewidths=0,
        clip_on=False,
        zorder=3,
    )
    low, high = seen.ece_interval
    panel.set_title("probabilities")
    panel.set_xlabel(
        f"probability of the answer, {seen.n} rows\n"
        f"error {100 * seen.ece:.1f} % ({100 * low:.1f} to {100 * high:.1f}), {seen.verdict}",
        color=INK,
    )
    panel.set_ylabel("share of right answers", color=INK)


def _draw_coverage(panel: Any, confidence: Confidence) -> None:
    rows = confidence.coverage.rows
    names = list(dict.fromkeys(row.held_out for row in rows))
    for name, colour, marker in zip(names, (_FIRST, _SECOND), ("o", "s"), strict=False):
        own = [row for row in rows if row.held_out == name]
        levels = [row.level for row in own]
        if own[0].random and len(own[0].coverage) > 2:
            spread = np.quantile([row.coverage for row in own], [0.025, 0.975], axis=1)
            panel.vlines(
                levels, *spread, color=colour, linewidth=4, alpha=0.3, label=f"{name}: 95 % of partitions"
            )
        panel.plot(levels, [row.mean for row in own], color=colour, marker=marker, linewidth=1.2, label=name)
    low = min(0.1 * np.floor(10 * min(min(row.coverage) for row in rows)), 0.7)
    panel.set_xlim(low, 1.0)
    panel.set_ylim(low, (1.0 - _LEGEND * low) / (1.0 - _LEGEND))
    panel.plot(
        [low, 1.0], [low, 1.0], color=INK, linewidth=0.8, linestyle="--", label="as asked for", zorder=1
    )
    ticks = np.arange(round(10 * low), 11) / 10
    ticks = ticks[:: 1 + len(ticks) // 7]
    panel.set_xticks(ticks, [f"{100 * tick:.0f} %" for tick in ticks])
    panel.set_yticks(ticks, [f"{100 * tick:.0f} %" for tick in ticks])
    grid(panel)
    panel.set_title("sets of materials")
    drawn = max(len(row.coverage) for row in rows if row.random)
    panel.set_xlabel(f"coverage asked for\n{counted(drawn, 'random partition')}", color=INK)
    panel.set_ylabel("sets that hold the truth", color=INK)


def _draw_unknown(panel: Any, confidence: Confidence) -> None:
    found = confidence.open_set
    assert found is not None  # the caller has looked
    known, unknown = found.novelty
    panel.set_title("unknown materials")
    if not (len(known) and len(unknown)):
        panel.set_axis_off()
        panel.text(0.5, 0.5, "too few recordings\nfor a limit:\nnothing is refused", ha="center", va="center")
        return
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
        f"novelty score, 1 at the limit\nAUROC {found.mean('auroc'):.3f}, "
        f"accepted {100 * found.mean('accepted'):.0f} %, refused {100 * found.mean('refused'):.0f} %",
        color=INK,
    )
    panel.set_ylabel("share of rows", color=INK)
