"""A confusion matrix as a heat map."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_id._percent import whole_percent
from granular_id.plotting.style import FAINT, INK, new_figure, save, short

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["as_percent", "draw_confusion", "plot_confusion"]

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
    heading = "" if title is None else f"{title}\n"
    figure.axes[0].set_title(
        f"{heading}per cent of each true class", fontsize=10, color=INK, parse_math=False
    )
    save(figure, path)
    return figure


def draw_confusion(panel: Any, percent: NDArray[np.float64], labels: Sequence[str]) -> None:
    """Draw a matrix of per cent (K, K) with the numbers in its cells."""
    from matplotlib.patches import Rectangle  # noqa: PLC0415  # an extra

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
    for spine in panel.spines.values():
        spine.set_visible(False)
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
