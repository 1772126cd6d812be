"""The figures of a report, each with the words that stand in for it."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from granular_id._files import made_folder
from granular_id._text import percent
from granular_id.evaluation import shows_paper
from granular_id.plotting import (
    INK,
    Curves,
    as_percent,
    blocks_with_weight,
    curves_in,
    draw_confusion,
    draw_hfmh,
    draw_mean_forces,
    draw_residual,
    draw_weights,
    new_figure,
    plot_accuracy,
    plot_confusion,
    plot_gap,
    plot_hfmh,
    plot_mean_forces,
    plot_recall,
    plot_residual,
    plot_weights,
)
from granular_id.report.svg import inline_svg
from granular_id.splits import PROTOCOLS, protocol_name

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from granular_id.evaluation import EvaluationResult, Portrait
_WIDEST = 480
"""Pixels of a column on a wide screen: no figure is scrolled there."""


@dataclass(frozen=True)
class Picture:
    """One figure of the page.

    Attributes
    ----------
    group : str
        Which section shows it.
    title : str
        What stands above it; empty where the figure says so itself.
    figure : matplotlib.figure.Figure
    alt : str
        What it shows, for those who cannot see it.
    narrowest : int
        Pixels below which the figure is scrolled instead of shrunk.
    """

    group: str
    title: str
    figure: Figure
    alt: str
    narrowest: int

    def svg(self, key: str) -> str:
        """Draw it as an ``<svg>`` element whose ids begin with `key`."""
        return inline_svg(self.figure, key, self.alt)


def pictures(result: EvaluationResult, space: str, portrait: Portrait | None) -> list[Picture]:
    """Draw everything, in the order of the page.

    Parameters
    ----------
    result : EvaluationResult
    space : str
        Whose gap, confusion and recall are shown.
    portrait : Portrait or None
        None: the figures of the recordings are left out.
    """
    drawn = [*_of_results(result, space)]
    if portrait is not None:
        drawn += [*_of_forces(portrait), *_of_high_pass(portrait), *_of_weights(portrait)]
    return drawn


def _of_results(result: EvaluationResult, space: str) -> Iterator[Picture]:
    accuracies = "; ".join(
        f"{protocol_name(protocol, partitions)} {percent(result.mean_accuracy(space, protocol))}"
        for protocol, partitions in result.partitions.items()
    )
    yield _picture("gap", "", plot_gap(result, space), f"Accuracy of {space}: {accuracies}", 0.62)
    figure = plot_accuracy(result, paper=shows_paper(result))
    alt = f"Mean accuracy of {len(result.spaces)} feature spaces with 95 % intervals; numbers in the table"
    yield _picture("accuracy", "", figure, alt, 0.75)
    for protocol, partitions in result.partitions.items():
        if protocol not in {result.random, result.strictest, result.protocols[0]}:
            continue
        name = protocol_name(protocol, partitions)
        shares = as_percent(result.confusion(space, protocol).astype(float))
        side = 1.3 + 0.34 * len(result.labels)
        figure = new_figure(side + 0.5, side)
        draw_confusion(figure.subplots(), shares, result.labels)
        alt = f"Confusion matrix of {space}, {name}, in per cent of each true class"
        yield _picture("confusion", name, figure, alt, 0.64)
    alt = "Recall of each class under each protocol; numbers in the table"
    yield _picture("recall", "", plot_recall(result, space), alt, 0.75)


def _of_forces(portrait: Portrait) -> Iterator[Picture]:
    columns = {axis: portrait.axes.index(axis) for axis in ("fx", "fz")}
    curves = curves_in(portrait, columns)
    low = min(float((own.mean[axis] - own.sd[axis]).min()) for own in curves for axis in columns)
    high = max(float((own.mean[axis] + own.sd[axis]).max()) for own in curves for axis in columns)
    room = 0.04 * (high - low or 1.0)
    for own in curves:
        figure = new_figure(2.3, 1.55)
        panel = figure.subplots()
        draw_mean_forces(panel, own)
        panel.set_ylim(low - room, high + room)
        panel.set_ylabel("N", fontsize=8, color=INK)
        panel.set_xlabel("s", fontsize=8, color=INK, labelpad=1)
        yield _picture("forces", "", figure, _range_of(own), 0.5)


def _range_of(curves: Curves) -> str:
    ranges = ", ".join(
        f"{axis.capitalize()} from {mean.min():.2g} to {mean.max():.2g} N"
        for axis, mean in curves.mean.items()
    )
    return f"{curves.label}: mean and standard deviation over time, {ranges}"


def _of_high_pass(portrait: Portrait) -> Iterator[Picture]:
    if portrait.high_pass is None:
        return
    for group, draw, what in (
        ("residual", draw_residual, "root mean square of the high-passed signal over time"),
        ("hfmh", draw_hfmh, "mean histogram of the high-passed signal"),
    ):
        for number, axis in enumerate(portrait.axes):
            figure = new_figure(3.7, 0.8 + 0.16 * max(3, len(portrait.labels)))
            draw(figure.subplots(), portrait, number)
            alt = f"{axis.capitalize()}: {what}, one row a material"
            yield _picture(group, axis.capitalize(), figure, alt, 0.75)


def _of_weights(portrait: Portrait) -> Iterator[Picture]:
    for block in blocks_with_weight(portrait):
        figure = new_figure(4.4, 0.5 + 0.52 * len(block.axes))
        draw_weights(figure.subplots(len(block.axes), 1, squeeze=False)[:, 0], block)
        shares = ", ".join(
            f"{axis.capitalize()} {100 * share:.1f} %"
            for axis, share in zip(block.axes, block.shares.tolist(), strict=True)
        )
        share = 100 * float(block.shares.sum())
        title = f"{block.name}: {share:.0f} % of the influence"
        yield _picture("weights", title, figure, f"Influence in {block.name} by axis: {shares}", 0.75)


def _picture(group: str, title: str, figure: Figure, alt: str, shrinks: float) -> Picture:
    """Make a picture; it may shrink to this share of its width before it is scrolled."""
    width = 96 * figure.get_figwidth()
    return Picture(group, title, figure, alt, min(round(shrinks * width), _WIDEST))


# ``figures``: the figures of a report as files.

FIGURES = (
    *("accuracy", "gap", "recall", *(f"confusion_{protocol}" for protocol in PROTOCOLS)),
    *("mean_forces", "residual", "hfmh", "weights"),
)
"""Names of all figures that there may be, without their endings."""


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
        Whose gap, confusion and recall are shown; default: the best under random draws.

    Returns
    -------
    list of Path
        What was written: accuracy, gap, recall, ``confusion_PROTOCOL`` and, as far as the result knows the
        recordings (`EvaluationResult.portrait`), mean_forces, residual, hfmh and weights.

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
    >>> result = evaluate(data, "hfmh", "paper", n_partitions=3, train_per_class=4, test_per_class=2)
    >>> written = figures(result, tempfile.mkdtemp(), "svg")
    >>> [path.name for path in written[:3]]
    ['accuracy.svg', 'gap.svg', 'recall.svg']
    """
    endings = [formats] if isinstance(formats, str) else list(formats)
    if not endings:
        raise ValueError("formats must name at least one ending, such as png, got none")
    chosen = result.space(space).name if space is not None else result.best_space(result.random)
    written = []
    with made_folder(folder) as place:
        for name, plot in _plots(result, chosen).items():
            for ending in endings:
                path = place / f"{name}.{ending.removeprefix('.')}"
                plot(path)
                written.append(path)
    return written


def _plots(result: EvaluationResult, space: str) -> dict[str, Callable[[Path], Any]]:
    mark = ", SYNTHETIC recordings" if result.synthetic else ""
    plots: dict[str, Callable[[Path], Any]] = {
        "accuracy": lambda path: plot_accuracy(result, paper=shows_paper(result), path=path),
        "gap": lambda path: plot_gap(result, space, path=path),
        "recall": lambda path: plot_recall(result, space, path=path),
    }
    for protocol, partitions in result.partitions.items():
        title = f"{space}, {protocol_name(protocol, partitions)}{mark}"
        plots[f"confusion_{protocol}"] = partial(
            _plot_confusion, result.confusion(space, protocol), result.labels, title
        )
    portrait = result.portrait
    if portrait is not None:
        plots["mean_forces"] = lambda path: plot_mean_forces(portrait, path=path)
        if portrait.high_pass is not None:
            plots["residual"] = lambda path: plot_residual(portrait, path=path)
            plots["hfmh"] = lambda path: plot_hfmh(portrait, path=path)
        if portrait.weights:
            plots["weights"] = lambda path: plot_weights(portrait, path=path)
    return plots


def _plot_confusion(counts: NDArray[np.int64], labels: Sequence[str], title: str, path: Path) -> None:
    plot_confusion(counts, labels, title=title, path=path)
