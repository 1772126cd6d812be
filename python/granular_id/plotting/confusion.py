"""A confusion matrix as a heat map."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_id._percent import whole_percent
from granular_id.plotting.style import INK, new_figure, save

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["plot_confusion"]


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
    totals = counts.sum(axis=1, keepdims=True)
    percent = 100.0 * np.divide(counts, totals, out=np.zeros_like(counts), where=totals > 0)

    k = len(labels)
    side = 1.8 + 0.5 * k
    figure = new_figure(side + 0.8, side)
    panel = figure.subplots()
    # Light to dark in one hue: order survives any colour vision and a grey print.
    panel.imshow(percent, cmap="Blues", vmin=0.0, vmax=100.0)
    for row, column in np.argwhere(counts > 0):
        value = percent[row, column]
        panel.text(
            column,
            row,
            whole_percent(value),
            ha="center",
            va="center",
            fontsize=9,
            color="white" if value > 55 else INK,
        )
    panel.set_xticks(range(k), labels, rotation=45, ha="right", rotation_mode="anchor", fontsize=9)
    panel.set_yticks(range(k), labels, fontsize=9)
    panel.set_xticks(np.arange(k + 1) - 0.5, minor=True)
    panel.set_yticks(np.arange(k + 1) - 0.5, minor=True)
    panel.grid(which="minor", color="white", linewidth=1.5)
    panel.tick_params(which="both", length=0, colors=INK)
    for spine in panel.spines.values():
        spine.set_visible(False)
    panel.set_xlabel("predicted", color=INK)
    panel.set_ylabel("true", color=INK)
    heading = "" if title is None else f"{title}\n"
    panel.set_title(f"{heading}per cent of each true class", fontsize=10, color=INK)
    save(figure, path)
    return figure


def _checked_counts(matrix: ArrayLike, labels: Sequence[str]) -> NDArray[np.float64]:
    counts = np.asarray(matrix, dtype=np.float64)
    if counts.ndim != 2 or counts.shape[0] != counts.shape[1] or counts.size == 0:
        raise ValueError(f"matrix must be square, got shape {counts.shape}")
    if len(labels) != counts.shape[0]:
        raise ValueError(f"labels must name the {counts.shape[0]} classes of matrix, got {len(labels)}")
    if not np.all(np.isfinite(counts)) or np.any(counts < 0):
        raise ValueError("matrix must hold finite counts that are not negative")
    return counts
