"""How sure a model may be: calibration, coverage of sets, novelty scores."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from granular_id.plotting import style
from granular_id.plotting.style import INK
from granular_id.recording import AXIS_COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from granular_id.evaluation import ConfidenceStudy

_FIRST, _SECOND = AXIS_COLOURS[0], AXIS_COLOURS[2]  # blue and vermilion, of different lightness too
_N_BINS = 48
_WANTED: dict[str, Any] = {"color": INK, "linewidth": 0.8, "linestyle": "--", "zorder": 1}


def plot_confidence(study: ConfidenceStudy, *, path: str | os.PathLike[str] | None = None) -> Figure:
    """Plot whether probabilities mean what they say, sets hold what they promise, and the unknown stands out.

    Parameters
    ----------
    study : granular_id.ConfidenceStudy
    path : path-like, optional
        As in `granular_id.plotting.plot_recordings`.

    Returns
    -------
    matplotlib.figure.Figure
        Above: the feature space and what was held out. Left: share of right answers against their probability; the area
        of a circle is its share of the recordings. Middle: how often candidates hold the right material, against how
        often they should, in the mean over sessions and in the worst. Right, with three materials or more: novelty
        scores of known and of left-out materials, 1 at the limit; the last bar, named after where it begins, counts all
        that lies beyond.

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
    figure = style.new_figure(0.6 + 3.1 * n_panels, 3.6)
    panels = figure.subplots(1, n_panels)
    _draw_reliability(panels[0], study)
    _draw_coverage(panels[1], study)
    if study.unknown:
        _draw_unknown(panels[2], study)
    for panel in panels:
        style.quiet(panel)
    style.heading(figure, f"{study.space}, {study.held_out}{style.synthetic_mark(study.synthetic)}", 10)
    style.legend(figure, "lower center", ncols=7)
    style.save(figure, path)
    return figure


def _draw_reliability(panel: Any, study: ConfidenceStudy) -> None:
    seen = study.reliability
    bins = np.array([(part.probability, part.accuracy, part.n / study.n_rows) for part in seen.bins])
    style.share_axis(panel)
    panel.set_ylim(0.0, 1.0)
    panel.set_yticks(*style.SHARE_TICKS)
    panel.plot([0, 1], [0, 1], label="as it should be", **_WANTED)
    style.grid(panel)
    dots: dict[str, Any] = {"color": _FIRST, "alpha": 0.75, "linewidths": 0, "clip_on": False, "zorder": 3}
    panel.scatter(bins[:, 0], bins[:, 1], s=20 + 300 * bins[:, 2], **dots)
    style.heading(panel, "probabilities", 10)
    across = f"probability of the answer, {study.n_rows} recordings\n"
    across += f"stated minus right {100 * seen.too_sure:+.1f} points\n{seen.summary}"
    style.name_axes(panel, across, "share of right answers", 8)


def _draw_coverage(panel: Any, study: ConfidenceStudy) -> None:
    levels = [one.level for one in study.coverage]
    means = [one.mean for one in study.coverage]
    worst = [one.worst for one in study.coverage]
    what = "mean over sessions" if study.n_sessions else "held out"
    panel.plot(levels, means, color=_FIRST, marker="o", linewidth=1.2, clip_on=False, label=what)
    if study.n_sessions:
        panel.plot(levels, worst, color=_SECOND, marker="s", linewidth=1.2, label="worst session")
    low = min(0.1 * np.floor(10 * min(*levels, *worst)), 0.7)
    panel.plot([low, 1.0], [low, 1.0], **_WANTED)
    panel.set_xlim(low, 1.0)
    panel.set_ylim(low, 1.0)
    ticks = np.arange(round(10 * low), 11) / 10
    ticks = ticks[:: 1 + len(ticks) // 7]
    for set_ticks in (panel.set_xticks, panel.set_yticks):
        set_ticks(ticks, [f"{100 * tick:.0f} %" for tick in ticks])
    style.grid(panel)
    style.heading(panel, "candidates", 10)
    style.name_axes(panel, "share requested", "candidates that hold the right one", 8)


def _draw_unknown(panel: Any, study: ConfidenceStudy) -> None:
    known, unknown = study.novelty
    low = float(min(known.min(), unknown.min()))
    high = float(np.ceil(2 * max(2.0, np.quantile(unknown, 0.9), np.quantile(known, 0.99))) / 2)
    width = (high - low) / _N_BINS
    edges = low + width * np.arange(_N_BINS + 2)  # the last for all that is larger
    for values, colour, name, look in (
        (known, _FIRST, "known", {"alpha": 0.45, "histtype": "stepfilled"}),
        (unknown, _SECOND, "left out", {"histtype": "step", "linewidth": 1.6}),
    ):
        weights = np.full(len(values), 1 / len(values))
        shown = np.minimum(values, high + width / 2)
        panel.hist(shown, bins=edges, weights=weights, color=colour, label=name, **look)
    panel.axvline(1.0, color=INK, linewidth=0.9, linestyle=":", label="limit")
    panel.set_xlim(low, edges[-1])
    ticks = [tick for tick in panel.get_xticks() if low <= tick <= high - 0.12 * (high - low)]
    beyond = f"\N{GREATER-THAN OR EQUAL TO} {high:g}"
    panel.set_xticks([*ticks, high], [*(f"{tick:g}" for tick in ticks), beyond])
    panel.yaxis.set_major_formatter(lambda share, _: f"{100 * share:.0f} %")
    style.heading(panel, "unknown materials", 10)
    auroc, refused = (np.mean([getattr(one, name) for one in study.unknown]) for name in ("auroc", "refused"))
    across = f"novelty score, 1 at the limit\nAUROC {auroc:.3f}, refused {100 * refused:.0f} %"
    style.name_axes(panel, across, "share of recordings", 8)
