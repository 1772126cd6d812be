"""The figures of a report, each with the words that stand in for it."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from html import escape
from threading import Lock
from typing import TYPE_CHECKING, Any

from granular_id._text import percent
from granular_id.evaluation import EvaluationResult
from granular_id.plotting import (
    FAINT,
    INK,
    Means,
    draw_means,
    name_axes,
    new_figure,
    plain,
    plot_accuracy,
    plot_confusion,
    plot_hfmh,
    plot_recall,
)
from granular_id.recording import AXIS_COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_WIDEST = 480  # pixels of a column on a wide screen: no figure is scrolled there

# Colours of a figure that are variables of the page, so that a dark page stays readable.
_VARIABLES = {INK.lower(): "ink", FAINT.lower(): "faint"} | {
    colour.lower(): f"okabe-{number}" for number, colour in enumerate(AXIS_COLOURS)
}
_COLOUR = re.compile(rf"(?<=: )({'|'.join(_VARIABLES)})(?=[;\"])")
_NO_METADATA = dict.fromkeys(("Creator", "Date", "Format", "Type"))
_settings_lock = Lock()  # matplotlib's settings are global: one drawing at a time changes them


@dataclass(frozen=True)
class Picture:
    """One figure of the page: the section that shows it, and what it shows in words."""

    group: str
    figure: Figure
    alt: str
    shrinks: float  # to this share of its width

    @property
    def narrowest(self) -> int:
        """Pixels: on a screen that would make it narrower it is scrolled instead of shrunk."""
        return min(round(self.shrinks * 96 * self.figure.get_figwidth()), _WIDEST)


def pictures(result: EvaluationResult, means: Means) -> Iterator[Picture]:
    """Draw all figures in the order of the page: accuracy, confusion and recall, then the recordings."""
    name, report_data = result.folds.name, result.report_data
    accuracies = "; ".join(f"{one} {percent(held.accuracy)}" for one, held in result.held.items())
    alt = f"Balanced accuracy with {name}: {accuracies}"
    yield Picture("accuracy", plot_accuracy(result), alt, 0.75)
    alt = f"Confusion matrix of {result.spaces[0]}, {name}, in per cent of each true material"
    yield Picture("confusion", plot_confusion(result), alt, 0.64)
    yield Picture("recall", plot_recall(result), "Recall of each material; numbers in the table", 0.75)
    yield from _of_means(means)
    for axis in report_data.axes:
        alt = f"{plain(axis)}: mean histogram of the high-passed signal, one row a material"
        yield Picture("hfmh", plot_hfmh(report_data, axis), alt, 0.75)


def _of_means(means: Means) -> Iterator[Picture]:
    low, high = float((means.mean - means.sd).min()), float((means.mean + means.sd).max())
    room = 0.04 * (high - low or 1.0)
    for number, label in enumerate(means.labels):
        figure = new_figure(2.3, 1.55)
        panel = figure.subplots()
        draw_means(panel, means, number)
        panel.set_ylim(low - room, high + room)
        name_axes(panel, "s", means.unit, 8)
        ranges = ", ".join(
            f"{plain(axis)} from {mean.min():.2g} to {mean.max():.2g} {means.unit}".rstrip()
            for axis, mean in zip(means.axes, means.mean[number], strict=True)
        )
        yield Picture("means", figure, f"{label}: mean and standard deviation over time, {ranges}", 0.5)


def inline_svg(figure: Figure, key: str, alt: str) -> str:
    """Return the figure as one ``<svg>`` of a page of HTML, where no other has the id `key`; `alt` says what it shows.

    Text stays text: it can be searched, takes the page's font, and is smaller than outlines.
    """
    import matplotlib as mpl  # an extra
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    for patch in (figure.patch, *(panel.patch for panel in figure.axes)):
        patch.set_visible(False)  # the page shows through
    settings: Any = {"svg.fonttype": "none", "svg.hashsalt": key, "font.sans-serif": ["DejaVu Sans"]}
    stream = io.StringIO()
    with _settings_lock, mpl.rc_context(settings), warnings.catch_warnings():
        # The page's fonts draw the letters; what matplotlib's own font lacks does not matter.
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        # Not savefig: it draws every figure twice, the first time for the layout alone.
        canvas: Any = FigureCanvasSVG(figure)
        canvas.print_svg(stream, metadata=_NO_METADATA)
    # Before the drawing stand the head of a file and a style that would hold for the whole page.
    _, _, drawing = stream.getvalue().partition("</defs>")
    drawing = re.sub(r'<g id="[^"]*"', "<g", drawing)  # every figure counts its groups from 1
    drawing = _COLOUR.sub(lambda match: f"var(--{_VARIABLES[match[0]]})", drawing)
    width, height = figure.get_size_inches()
    return (
        f'<svg class="plot" id="{key}" role="img" aria-label="{escape(alt)}" viewBox="0 0 {72 * width:.6g} '
        f'{72 * height:.6g}" width="{96 * width:.0f}" height="{96 * height:.0f}">{drawing}'
    )
