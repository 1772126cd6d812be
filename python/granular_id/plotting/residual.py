"""What is left above the cut-off over time, per material and axis."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from granular_id.plotting.heat import axis_unit, draw_heat, plot_six, shared_limits
from granular_id.plotting.style import INK

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from granular_id.evaluation.portrait import HighPass, Portrait

__all__ = ["draw_residual", "high_pass_of", "plot_residual"]


# The first of forty windows may hold the filter's response to an offset: it must not take all the colours.
_SHARE = 0.97


def plot_residual(portrait: Portrait, *, path: str | os.PathLike[str] | None = None) -> Figure:
    """Plot the root mean square of the high-passed signal over time, one panel an axis, one row a material.

    Parameters
    ----------
    portrait : granular_id.evaluation.portrait.Portrait
        For instance ``result.portrait``.
    path : path-like, optional
        As in `granular_id.plotting.plot_mean_forces`.

    Returns
    -------
    matplotlib.figure.Figure
        Colours on a log scale, of its own for each axis; the three highest values in a hundred share the last.

    Raises
    ------
    ImportError
        Without matplotlib, saying what to install.
    ValueError
        For a portrait without high-pass: the sampling rate was too low for the cut-off.

    Examples
    --------
    >>> from granular_id import RawHFMH, synthesize
    >>> from granular_id.evaluation.portrait import portrait
    >>> seen = portrait(synthesize(["rice", "fine sugar"], n_per_class=3), {"raw+hfmh": RawHFMH()})
    >>> figure = plot_residual(seen)
    >>> [panel.get_title() for panel in figure.axes if panel.get_title()][:2]
    ['$F_x$', '$F_y$']
    """
    part = high_pass_of(portrait)
    synthetic = "synthetic recordings, " if portrait.n_synthetic else ""
    title = f"Signal above {part.settings['cutoff_hz']:g} Hz: {synthetic}root mean square over time"
    return plot_six(
        lambda panel, axis: draw_residual(panel, portrait, axis),
        portrait.axes,
        len(portrait.labels),
        title,
        path,
    )


def draw_residual(panel: Any, portrait: Portrait, axis: int) -> None:
    """Draw the heat map of one axis, by its number."""
    part = high_pass_of(portrait)
    values = part.residual[:, axis]
    draw_heat(
        panel,
        values,
        across=(0.0, portrait.n_samples / portrait.rate_hz),
        labels=portrait.labels,
        limits=shared_limits(values, share=_SHARE),
        key=f"RMS, {axis_unit(portrait.axes[axis])}",
    )
    panel.set_xlabel("time, s", fontsize=8, color=INK)


def high_pass_of(portrait: Portrait) -> HighPass:
    """Return the high-pass part, or say why there is none."""
    if portrait.high_pass is None:
        raise ValueError(
            f"portrait has no high-pass: its {portrait.rate_hz:g} Hz are too low for the cut-off of the filter"
        )
    return portrait.high_pass
