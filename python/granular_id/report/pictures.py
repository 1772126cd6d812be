"""The figures of a report: inside the page, each with the words that stand in for it, and as files."""

from __future__ import annotations

import io
import os
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from html import escape
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any

from granular_id._files import made_folder
from granular_id._text import percent
from granular_id.evaluation import EvaluationResult, ReportData, shows_paper
from granular_id.plotting import (
    FAINT,
    INK,
    as_percent,
    axis_line,
    curves_in,
    draw_confusion,
    draw_hfmh,
    draw_mean_forces,
    new_figure,
    plot_accuracy,
    plot_confusion,
    plot_hfmh,
    plot_mean_forces,
    plot_recall,
    quantity_of,
    telling_curves,
)
from granular_id.recording import AXES, AXIS_COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURES = ("accuracy", "recall", "confusion", "mean_forces", "hfmh")
"""Names of all figures, without their endings."""


def figures(
    result: EvaluationResult,
    folder: str | os.PathLike[str],
    formats: str | Sequence[str] = ("png", "svg"),
    *,
    space: str | None = None,
) -> list[Path]:
    """Write the figures of a report as files.

    Parameters
    ----------
    result : EvaluationResult
    folder : path-like
        Made where it is missing. Files of the same names are replaced.
    formats : str or sequence of str
        Endings that matplotlib knows: png, svg, pdf, ...
    space : str, optional
        Whose confusion and recall are shown; default: the headline's.

    Returns
    -------
    list of Path
        What was written: accuracy, recall, confusion, mean_forces and hfmh.

    Raises
    ------
    ImportError
        Without matplotlib, saying what to install.
    ValueError
        For an unknown format or space.
    OSError
        A file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from granular_id import evaluate, synthesize
    >>> data = synthesize(["rice", "fine sugar"], n_per_class=6, duration_s=0.5)
    >>> result = evaluate(data, "hfmh", paper=(3, 4, 2), progress=False)
    >>> written = figures(result, tempfile.mkdtemp(), "svg")
    >>> [path.name for path in written[:3]]
    ['accuracy.svg', 'recall.svg', 'confusion.svg']
    """
    endings = [formats] if isinstance(formats, str) else list(formats)
    if not endings:
        raise ValueError("formats must name at least one ending, such as png, got none")
    result.of(space)  # refuses a space that was not evaluated
    written = []
    with made_folder(folder) as place:
        for name, plot in _plots(result, space).items():
            for ending in endings:
                path = place / f"{name}.{ending.removeprefix('.')}"
                plot(path=path)
                written.append(path)
    return written


def _plots(result: EvaluationResult, space: str | None) -> dict[str, Callable[..., Figure]]:
    """Name each figure, with the function that draws it into ``path=``."""
    mark = ", SYNTHETIC recordings" if result.synthetic else ""
    title = f"{space or result.spaces[0]}, {result.folds.name}{mark}"
    return {
        "accuracy": partial(plot_accuracy, result, paper=shows_paper(result)),
        "recall": partial(plot_recall, result, space),
        "confusion": partial(plot_confusion, result.confusion(space), result.labels, title=title),
        "mean_forces": partial(plot_mean_forces, result.report_data),
        "hfmh": partial(plot_hfmh, result.report_data),
    }


# The figures of the page.

_WIDEST = 480  # pixels of a column on a wide screen: no figure is scrolled there

# Colours of a figure that are variables of the page, so that a dark page stays readable.
_VARIABLES = {INK.lower(): "ink", FAINT.lower(): "faint"} | {
    colour.lower(): f"okabe-{number}" for number, colour in enumerate(AXIS_COLOURS)
}
_COLOUR = re.compile(rf"(?<=: )({'|'.join(_VARIABLES)})(?=[;\"])")
_DASHES = {"-": "", "--": "6 4", ":": "2 3"}  # of matplotlib, as SVG writes them
_NO_METADATA = dict.fromkeys(("Creator", "Date", "Format", "Type"))
_settings_lock = Lock()  # matplotlib's settings are global: one drawing at a time changes them


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


@dataclass(frozen=True)
class Picture:
    """One figure of the page: the section that shows it, what stands above it, and what it shows in words."""

    group: str
    title: str
    figure: Figure
    alt: str
    shrinks: float  # to this share of its width

    @property
    def narrowest(self) -> int:
        """Pixels: on a screen that would make it narrower it is scrolled instead of shrunk."""
        return min(round(self.shrinks * 96 * self.figure.get_figwidth()), _WIDEST)


def pictures(result: EvaluationResult) -> list[Picture]:
    """Draw all figures in the order of the page: accuracy, confusion and recall, then the recordings."""
    return [*_of_results(result), *_of_means(result.report_data), *_of_high_pass(result.report_data)]


def _of_results(result: EvaluationResult) -> Iterator[Picture]:
    name, space = result.folds.name, result.spaces[0]
    accuracies = "; ".join(f"{one} {percent(held.accuracy)}" for one, held in result.held.items())
    figure = plot_accuracy(result, paper=shows_paper(result))
    yield Picture("accuracy", "", figure, f"Balanced accuracy with {name}: {accuracies}", 0.75)
    shares = as_percent(result.confusion().astype(float))
    side = 1.3 + 0.34 * len(result.labels)
    figure = new_figure(side + 0.5, side)
    draw_confusion(figure.subplots(), shares, result.labels)
    alt = f"Confusion matrix of {space}, {name}, in per cent of each true material"
    yield Picture("confusion", "", figure, alt, 0.64)
    yield Picture("recall", "", plot_recall(result), "Recall of each material; numbers in the table", 0.75)


@dataclass(frozen=True)
class MeanLines:
    """What the curves of the means are, for the words beside them."""

    quantity: str  # with its unit
    lines: tuple[tuple[str, str, int, str], ...]  # name, index, colour number and dashes of SVG of each axis
    left_out: str


def mean_lines(report_data: ReportData) -> MeanLines:
    """Say which axes the curves of the means show."""
    curves, unit = _mean_curves(report_data)
    lines = []
    for place, axis in enumerate(curves[0].mean):
        style = axis_line(axis, place)
        name, index = (axis[0].upper(), axis[1]) if axis in AXES else (axis, "")
        lines.append((name, index, AXIS_COLOURS.index(style["color"]), _DASHES[style["linestyle"]]))
    few = len(report_data.axes)
    left_out = ""
    if report_data.n_axes > few:
        left_out = f"{few} of {report_data.n_axes} axes, those in which the materials differ most"
    return MeanLines(quantity_of(curves[0].mean, unit), tuple(lines), left_out)


def _mean_curves(report_data: ReportData) -> tuple[list[Any], str]:
    return telling_curves(
        curves_in(report_data, report_data.axes),
        dict(zip(report_data.axes, report_data.units, strict=True)),
    )


def _of_means(report_data: ReportData) -> Iterator[Picture]:
    curves, unit = _mean_curves(report_data)
    axes = list(curves[0].mean)
    low = min(float((own.mean[axis] - own.sd[axis]).min()) for own in curves for axis in axes)
    high = max(float((own.mean[axis] + own.sd[axis]).max()) for own in curves for axis in axes)
    room = 0.04 * (high - low or 1.0)
    for own in curves:
        figure = new_figure(2.3, 1.55)
        panel = figure.subplots()
        draw_mean_forces(panel, own)
        panel.set_ylim(low - room, high + room)
        panel.set_ylabel(unit, fontsize=8, color=INK)
        panel.set_xlabel("s", fontsize=8, color=INK, labelpad=1)
        ranges = ", ".join(
            f"{_titled(axis)} from {mean.min():.2g} to {mean.max():.2g} {unit}".rstrip()
            for axis, mean in own.mean.items()
        )
        alt = f"{own.label}: mean and standard deviation over time, {ranges}"
        yield Picture("means", "", figure, alt, 0.5)


def _titled(axis: str) -> str:
    return axis.capitalize() if axis in AXES else axis


def _of_high_pass(report_data: ReportData) -> Iterator[Picture]:
    for number, axis in enumerate(report_data.axes):
        figure = new_figure(3.7, 0.8 + 0.16 * max(3, len(report_data.labels)))
        draw_hfmh(figure.subplots(), report_data, number)
        alt = f"{_titled(axis)}: mean histogram of the high-passed signal, one row a material"
        yield Picture("hfmh", _titled(axis), figure, alt, 0.75)
