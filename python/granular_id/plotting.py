"""Figures: mean forces per material, confusion matrix.

matplotlib is loaded on first use (``pip install 'granular-id[app]'``), and only its ``Figure`` objects: no
backend is chosen, no window opened and no global state touched, so plotting is safe in scripts,
notebooks, servers and threads alike.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_id._core import AXES, UNITS
from granular_id._files import whole_file
from granular_id._percent import whole_percent
from granular_id.recording import Dataset

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["plot_confusion", "plot_mean_forces"]

# Okabe & Ito's colours, told apart with any colour vision; one per axis, in the order of AXES.
_AXIS_COLOURS = ("#0072B2", "#009E73", "#D55E00", "#56B4E9", "#CC79A7", "#E69F00")
# Dashes as well as colours: the lines must stay apart in black and white.
_AXIS_DASHES = ("-", ":", "--", ":", "-", "--")
_INK, _FAINT = "#333333", "#BBBBBB"


def plot_mean_forces(
    dataset: Dataset, *, axes: Sequence[str] = ("fx", "fz"), path: str | os.PathLike[str] | None = None
) -> Figure:
    """Plot the mean and spread over time of each material, one panel a material.

    Parameters
    ----------
    dataset : Dataset
        Recordings of equal length and rate, with labels.
    axes : sequence of str, default ("fx", "fz")
        Which of fx fy fz (N) or of tx ty tz (N m); not both kinds, their units differ.
    path : path-like, optional
        Where to save; the ending chooses the format (png, svg, pdf). Written under a temporary name and
        renamed, so that a reader never sees half a file.

    Returns
    -------
    matplotlib.figure.Figure
        Lines are means over the recordings, bands one standard deviation to either side. All panels share
        their scales. The title says "synthetic" when recordings are.

    Raises
    ------
    ImportError
        Without matplotlib, saying what to install.
    ValueError
        For unknown, repeated or mixed axes, recordings of unequal length or without labels.

    Examples
    --------
    >>> from granular_id.plotting import plot_mean_forces
    >>> from granular_id.synthetic import synthesize
    >>> figure = plot_mean_forces(synthesize(["rice", "fine sugar"], n_per_class=3))
    >>> [panel.get_title() for panel in figure.axes]
    ['rice', 'fine sugar']
    """
    figure_class = _figure_class()
    columns, unit = _chosen_axes(axes)
    X, y = dataset.X, dataset.y
    time_s = np.arange(X.shape[1]) / dataset.rate_hz
    # In the order in which materials first appear: the user's own order, not the alphabet's.
    labels = list(dict.fromkeys(y.tolist()))

    n_columns = min(4, len(labels))
    n_rows = math.ceil(len(labels) / n_columns)
    figure = figure_class(figsize=(1.2 + 2.5 * n_columns, 1.4 + 1.9 * n_rows), layout="constrained")
    panels = figure.subplots(n_rows, n_columns, sharex=True, sharey=True, squeeze=False).ravel()
    handles: list[Any] = []
    for label, panel in zip(labels, panels, strict=False):
        recordings = X[y == label]
        handles = []
        for axis, column in columns.items():
            colour, dash = _AXIS_COLOURS[column], _AXIS_DASHES[column]
            mean, spread = recordings[:, :, column].mean(axis=0), recordings[:, :, column].std(axis=0)
            panel.fill_between(time_s, mean - spread, mean + spread, color=colour, alpha=0.25, linewidth=0)
            style = {"color": colour, "linestyle": dash, "linewidth": 1.3}
            (line,) = panel.plot(time_s, mean, label=_pretty(axis), **style)
            handles.append(line)
        panel.axhline(0.0, color=_FAINT, linewidth=0.8, zorder=0)
        panel.set_title(label, fontsize=10, color=_INK)
        panel.margins(x=0)
        _quiet(panel)
    for unused in panels[len(labels) :]:
        unused.remove()
    # The lowest panel of each column carries the time axis, also where the last row is not full.
    for index, panel in enumerate(panels[: len(labels)]):
        panel.tick_params(labelbottom=index + n_columns >= len(labels))
    quantity = "force" if unit == "N" else "torque"
    figure.supxlabel("time, s", fontsize=10, color=_INK)
    figure.supylabel(f"{quantity}, {unit}", fontsize=10, color=_INK)
    figure.suptitle(_title(dataset, quantity), fontsize=11, color=_INK)
    figure.legend(handles=handles, loc="outside lower right", ncols=len(handles), frameon=False, fontsize=9)
    _save(figure, path)
    return figure


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
    figure_class = _figure_class()
    counts = _checked_counts(matrix, labels)
    totals = counts.sum(axis=1, keepdims=True)
    percent = 100.0 * np.divide(counts, totals, out=np.zeros_like(counts), where=totals > 0)

    k = len(labels)
    side = 1.8 + 0.5 * k
    figure = figure_class(figsize=(side + 0.8, side), layout="constrained")
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
            color="white" if value > 55 else _INK,
        )
    panel.set_xticks(range(k), labels, rotation=45, ha="right", rotation_mode="anchor", fontsize=9)
    panel.set_yticks(range(k), labels, fontsize=9)
    panel.set_xticks(np.arange(k + 1) - 0.5, minor=True)
    panel.set_yticks(np.arange(k + 1) - 0.5, minor=True)
    panel.grid(which="minor", color="white", linewidth=1.5)
    panel.tick_params(which="both", length=0, colors=_INK)
    for spine in panel.spines.values():
        spine.set_visible(False)
    panel.set_xlabel("predicted", color=_INK)
    panel.set_ylabel("true", color=_INK)
    heading = "" if title is None else f"{title}\n"
    panel.set_title(f"{heading}per cent of each true class", fontsize=10, color=_INK)
    _save(figure, path)
    return figure


def _figure_class() -> type[Figure]:
    try:
        from matplotlib.figure import Figure  # noqa: PLC0415  # an extra: only those who plot need it
    except ImportError as error:
        raise ImportError("plotting needs matplotlib: pip install 'granular-id[app]'") from error
    return Figure


def _chosen_axes(axes: Sequence[str]) -> tuple[dict[str, int], str]:
    wanted = [axes] if isinstance(axes, str) else list(axes)
    unknown = [axis for axis in wanted if axis not in AXES]
    if unknown or not wanted:
        what = f"{unknown[0]!r}" if unknown else "nothing"
        raise ValueError(f"axes must name some of {', '.join(AXES)}, got {what}")
    if len(set(wanted)) < len(wanted):
        raise ValueError(f"axes names an axis twice: {', '.join(wanted)}")
    columns = {axis: AXES.index(axis) for axis in wanted}
    units = {UNITS[column] for column in columns.values()}
    if len(units) > 1:
        raise ValueError(f"axes mixes forces (N) and torques (N m), got {', '.join(wanted)}")
    return columns, units.pop()


def _checked_counts(matrix: ArrayLike, labels: Sequence[str]) -> NDArray[np.float64]:
    counts = np.asarray(matrix, dtype=np.float64)
    if counts.ndim != 2 or counts.shape[0] != counts.shape[1] or counts.size == 0:
        raise ValueError(f"matrix must be square, got shape {counts.shape}")
    if len(labels) != counts.shape[0]:
        raise ValueError(f"labels must name the {counts.shape[0]} classes of matrix, got {len(labels)}")
    if not np.all(np.isfinite(counts)) or np.any(counts < 0):
        raise ValueError("matrix must hold finite counts that are not negative")
    return counts


def _title(dataset: Dataset, quantity: str) -> str:
    synthetic = sum(bool(recording.meta.get("synthetic")) for recording in dataset)
    if synthetic == 0:
        kind = ""
    elif synthetic == len(dataset):
        kind = "Synthetic recordings: "
    else:
        kind = f"{synthetic} of {len(dataset)} recordings synthetic: "
    text = f"{kind}{quantity} per material, mean \N{PLUS-MINUS SIGN} standard deviation"
    return text[0].upper() + text[1:]


def _pretty(axis: str) -> str:
    return f"${axis[0].upper()}_{axis[1]}$"


def _quiet(panel: Any) -> None:
    panel.tick_params(labelsize=8, colors=_INK)
    for side in ("top", "right"):
        panel.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        panel.spines[side].set_color(_FAINT)


def _save(figure: Figure, path: str | os.PathLike[str] | None) -> None:
    if path is None:
        return
    target = Path(path)
    form = target.suffix.removeprefix(".").lower()
    supported = figure.canvas.get_supported_filetypes()
    if form not in supported:
        raise ValueError(f"path must end in one of {', '.join(sorted(supported))}, got {str(target)!r}")
    with whole_file(target) as draft:
        figure.savefig(draft, format=form, dpi=150)
