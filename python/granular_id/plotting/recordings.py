"""Figures of recordings one by one: as they are stored, and where the motion begins in each."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import whole_number
from granular_id._text import fixed, short
from granular_id.plotting.style import (
    INK,
    axis_line,
    curve_panel,
    evenly,
    heading,
    legend,
    legend_of_axes,
    material_panels,
    new_figure,
    pretty,
    quantity_of,
    quiet,
    save,
    with_unit,
)
from granular_id.recording import (
    FALSE_ALARM_RATE,
    ONSET_STEP,
    REST_S,
    Dataset,
    Recording,
    unit_of,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_FLAG_COLOUR = "#CC3311"
_NO_LABEL = "no label"
_MOST_LINES = 6  # of one recording


def plot_recordings(
    dataset: Dataset,
    path: str | os.PathLike[str] | None = None,
    *,
    axes: Sequence[str] | None = None,
    n: int = 5,
) -> Figure:
    """Plot some recordings of each material over time, as they are: of any length and rate, also irregular.

    Parameters
    ----------
    dataset : Dataset
        Need not be resampled or aligned.
    path : path-like, optional
        Where to save; the ending chooses the format (png, svg, pdf). Whole or not at all.
    axes : sequence of str, optional
        Axes to draw, all of one unit; by default the forces or, where recordings have other axes, those that share a
        unit with the first, at most six.
    n : int, default 5
        Recordings per material, spread evenly over the material's recordings.

    Returns
    -------
    matplotlib.figure.Figure
        One panel a material, in the order in which they first appear. Red marks at the foot of a panel stand where
        a sample carries a flag (filled gap, saturation, bad status, repaired time). Triggers are small triangles.

    Raises
    ------
    ImportError
        Without matplotlib, saying what to install.
    TypeError, ValueError
        An axis that recordings do not have, or axes of different units; `n` below 1.

    Examples
    --------
    >>> from granular_id.plotting import plot_recordings
    >>> from granular_id import synthesize
    >>> figure = plot_recordings(synthesize(["rice", "fine sugar"], n_per_class=3))
    >>> [panel.get_title() for panel in figure.axes]
    ['rice (3 of 3)', 'fine sugar (3 of 3)']
    """
    whole_number("n", n)
    have = dataset.axes
    if axes is None:
        axes = axes_of_one_unit(dataset[0])
    units = [unit_of(axis, dataset[0].meta) for axis in have]
    wanted, unit = chosen_axes(axes, have, units)
    groups: dict[str, list[Recording]] = {}
    for recording in dataset:
        groups.setdefault(recording.label or _NO_LABEL, []).append(recording)
    figure, panels = material_panels(len(groups))
    handles: list[Any] = []
    for (label, group), panel in zip(groups.items(), panels, strict=True):
        shown = [group[i] for i in evenly(len(group), n)]
        handles = _draw(panel, shown, list(wanted))
        heading(panel, f"{short(label)} ({len(shown)} of {len(group)})", 10)
    figure.supxlabel("time from the first sample, s", fontsize=10, color=INK)
    figure.supylabel(quantity_of(wanted, unit), fontsize=10, color=INK)
    what = "Synthetic recordings" if dataset.is_synthetic else "Recordings"
    heading(figure, f"{what} as they are stored")
    legend_of_axes(figure, handles)
    save(figure, path)
    return figure


def axes_of_one_unit(recording: Recording) -> list[str]:
    """Return the first axes that share a unit: the forces of a wrench."""
    unit = unit_of(recording.axes[0], recording.meta)
    return [axis for axis in recording.axes if unit_of(axis, recording.meta) == unit][:_MOST_LINES]


def chosen_axes(
    axes: str | Sequence[str], have: Sequence[str], units: Sequence[str]
) -> tuple[dict[str, int], str]:
    """Return the columns of the axes to draw, and the unit that they share."""
    wanted = (axes,) if isinstance(axes, str) else tuple(axes)
    if not wanted or not set(wanted) <= set(have) or len(set(wanted)) < len(wanted):
        raise ValueError(
            f"axes must name some of {', '.join(have)}, each once, got {', '.join(wanted) or 'nothing'}"
        )
    columns = {axis: have.index(axis) for axis in wanted}
    mixed = sorted({units[column] for column in columns.values()})
    if len(mixed) > 1:
        named = ", ".join(unit or "not known" for unit in mixed)
        raise ValueError(f"axes mixes units ({named}), got {', '.join(wanted)}: choose axes of one unit")
    return columns, mixed[0]


def _draw(panel: Any, recordings: Sequence[Recording], axes: Sequence[str]) -> list[Any]:
    """Draw the recordings of one material; return one line per axis for a legend."""
    first_lines: list[Any] = []
    for recording in recordings:
        time_s = recording.times()
        for k, axis in enumerate(axes):
            style = {**axis_line(axis, k), "linewidth": 0.7, "alpha": 0.7}
            column = recording.wrench[:, recording.axes.index(axis)]
            lines = panel.plot(time_s, column, label=pretty(axis), **style)
            if len(first_lines) < len(axes):
                first_lines += lines
        if recording.flags is not None:
            at = time_s[recording.flags > 0]
            foot = panel.get_xaxis_transform()
            panel.plot(at, np.full(len(at), 0.02), "|", color=_FLAG_COLOUR, markersize=4, transform=foot)
        if recording.trigger_index is not None:
            top = panel.get_xaxis_transform()
            panel.plot(time_s[recording.trigger_index], 0.98, "v", color=INK, markersize=3, transform=top)
    curve_panel(panel)
    return first_lines


# Right column of onsets: seconds shown before and after.
_BEFORE_S, _AFTER_S = 0.15, 0.2
_REST_COLOUR = "#DDE6EE"
_MISSING_COLOUR = "#B03A00"
# Words, colour, dashes and marker of an onset, by how it came about.
_MARKS = {
    "found": ("onset found", INK, "-", "v"),
    "overruled": ("onset stated", "#D55E00", "--", "D"),
    "kept": ("onset recorded", "#0072B2", "-.", "s"),
}


def plot_onsets(
    dataset: Dataset,
    path: str | os.PathLike[str] | None = None,
    *,
    n: int = 10,
    rest_s: float = REST_S,
    false_alarm_rate: float = FALSE_ALARM_RATE,
) -> Figure:
    """Plot the onsets of some recordings, one row each: all of it on the left, around the onset on the right.

    Parameters
    ----------
    dataset : Dataset
        After :meth:`Dataset.find_onsets`; otherwise that is called first with the settings below.
    path : path-like, optional
        Where to save; the ending chooses the format (png, svg, pdf). Whole or not at all.
    n : int, default 10
        Recordings to show, spread evenly over the data set; up to half of them are ones without an onset or with
        one that you stated, where there are such.
    rest_s, false_alarm_rate : float
        As in :meth:`Dataset.find_onsets`, for a data set on which it was not called.

    Returns
    -------
    matplotlib.figure.Figure
        Forces relative to their level at rest; time on the right counts from the onset (from the end of the rest
        where there is none). Shaded: the time taken for rest, and as a band four standard
        deviations of the noisiest axis to either side. A line with a triangle is an onset that was found, a dashed
        one with a diamond one that you stated, a dash-dotted one with a square one that was recorded. Where none was
        found, the panel says why.

    Raises
    ------
    ImportError
        Without matplotlib, saying what to install.
    TypeError, ValueError
        `n` below 1, and what :meth:`Dataset.find_onsets` raises.

    Examples
    --------
    >>> from granular_id.plotting import plot_onsets
    >>> from granular_id import synthesize
    >>> figure = plot_onsets(synthesize(["rice", "fine sugar"], n_per_class=3), n=4)
    >>> len(figure.axes)
    8
    """
    whole_number("n", n)
    if not any(step.step == ONSET_STEP for step in dataset.history):
        dataset = dataset.find_onsets(rest_s=rest_s, false_alarm_rate=false_alarm_rate)
    step = next(step for step in reversed(dataset.history) if step.step == ONSET_STEP)
    rest_s, false_alarm_rate = (step.parameters[name] for name in ("rest_s", "false_alarm_rate"))
    rows = {row["name"]: row for row in step.rows}
    found = [rows.get(name, {"how": "kept"}) for name in dataset.names]
    places = _places(np.array([row["how"] in ("not found", "overruled") for row in found]), n)
    shown = [dataset[place] for place in places]
    figure = new_figure(9.5, 1.1 + 1.05 * len(shown))
    panels = figure.subplots(len(shown), 2, squeeze=False, sharex="col", width_ratios=[1.6, 1.0])
    for panel, place in zip(panels, places, strict=True):
        _draw_onset(panel, dataset[place], found[place], rest_s)
    panels[0, 0].set_xlim(0.0, max(one.duration_s for one in shown) or 1.0)
    every = all(one.trigger_index is not None for one in shown)
    zero = "onset" if every else "onset or, without one, the end of rest"
    for panel, origin in zip(panels[-1], ("first sample", zero), strict=True):
        panel.set_xlabel(f"time from the {origin}, s", fontsize=9, color=INK)
    axes = axes_of_one_unit(shown[0])
    figure.supylabel(with_unit("relative to rest", unit_of(axes[0], shown[0].meta)), fontsize=9, color=INK)
    synthetic = sum(one.is_synthetic for one in shown)
    kind = "recordings" if synthetic in (0, len(shown)) else "recordings (some synthetic)"
    kind = f"synthetic {kind}" if synthetic == len(shown) else kind
    heading(
        figure,
        f"Onsets of {len(shown)} of {len(dataset)} {kind}: rest {rest_s:g} s, "
        f"false-alarm rate {false_alarm_rate:g}",
    )
    key = _onset_key(axes, {found[place]["how"] for place in places})
    legend(figure, "lower center", handles=key, ncols=len(key))
    save(figure, path)
    return figure


def _places(first: NDArray[np.bool_], n: int) -> list[int]:
    """Choose `n` recordings: those that need a look, up to half, and the others evenly."""
    look, rest = np.flatnonzero(first), np.flatnonzero(~first)
    look = look[evenly(len(look), max(n - len(rest), (n + 1) // 2))]
    rest = rest[evenly(len(rest), n - len(look))]
    chosen: list[int] = np.sort(np.concatenate([look, rest])).tolist()
    return chosen


def _draw_onset(panels: Any, recording: Recording, found: Mapping[str, Any], rest_s: float) -> None:
    times, index = recording.times(), recording.trigger_index
    at_rest = max(1, int(np.searchsorted(times, rest_s)))
    axes = axes_of_one_unit(recording)
    columns = [recording.axes.index(axis) for axis in axes]
    signal = recording.wrench[:, columns] - recording.wrench[:at_rest, columns].mean(axis=0)
    band = 4 * float(signal[:at_rest].std(axis=0).max())
    zero_s = rest_s if index is None else float(times[index])
    near = (times >= zero_s - _BEFORE_S) & (times <= zero_s + _AFTER_S)
    _, colour, dashes, marker = _MARKS.get(found["how"], _MARKS["kept"])
    for panel, origin_s, part in ((panels[0], 0.0, slice(None)), (panels[1], zero_s, near)):
        panel.axvspan(-origin_s, rest_s - origin_s, color=_REST_COLOUR, linewidth=0, zorder=0)
        panel.axhspan(-band, band, color=_REST_COLOUR, linewidth=0, zorder=0)
        for place, axis in enumerate(axes):
            panel.plot(times[part] - origin_s, signal[part, place], linewidth=0.9, **axis_line(axis, place))
        if index is not None:
            at = times[index] - origin_s
            panel.axvline(at, color=colour, linestyle=dashes, linewidth=1.2, zorder=3)
            top = panel.get_xaxis_transform()
            panel.plot(at, 1.0, marker, color=colour, ms=5, transform=top, clip_on=False, zorder=5)
        quiet(panel)
        panel.locator_params(axis="y", nbins=3)
    panels[1].set_xlim(-_BEFORE_S, _AFTER_S)
    # A name with $ in it is a name, no mathematics. Onsets lie early: on the right it keeps clear of the mark.
    title = {"fontsize": 8, "pad": 2, "parse_math": False}
    name = short(recording.name, 60)
    if index is None:
        why = f"{name}, no onset:\n{found.get('why') or 'none, as stated'}"
        panels[0].set_title(why, color=_MISSING_COLOUR, loc="left", **title)
    else:
        panels[0].set_title(name, color=INK, loc="right", **title)
        panels[1].set_title(f"{fixed(times[index], 3)} s", color=colour, loc="right", **title)


def _onset_key(axes: Sequence[str], kinds: set[str]) -> list[Any]:
    from matplotlib.lines import Line2D  # an extra
    from matplotlib.patches import Patch

    lines = [
        Line2D([], [], label=pretty(axis), linewidth=0.9, **axis_line(axis, place))
        for place, axis in enumerate(axes)
    ]
    marks = [
        Line2D([], [], color=colour, ls=dashes, marker=marker, ms=5, label=text)
        for how, (text, colour, dashes, marker) in _MARKS.items()
        if how in kinds
    ]
    return [*lines, Patch(color=_REST_COLOUR, label="rest, \N{PLUS-MINUS SIGN}4 s.d."), *marks]
