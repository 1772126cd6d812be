"""Figures of recordings: as they are stored, their means and histograms by material, and where the motion begins."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import whole_number
from granular_id._core import AXES, GranularIdError
from granular_id._text import fixed, short
from granular_id.evaluation import most_different
from granular_id.plotting import style
from granular_id.plotting.style import INK
from granular_id.recording import ONSET_STEP, Dataset, Recording, common_units, unit_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from granular_id.evaluation import ReportData

Floats = NDArray[np.float64]

_FLAG_COLOUR = "#CC3311"
_NO_LABEL = "no label"
_MOST_LINES = 6  # of one recording
_MOST_MEANS = 2  # with their bands


# Recordings of each material, a panel a material.


def plot_recordings(
    dataset: Dataset,
    *,
    axes: Sequence[str] | None = None,
    n: int = 5,
    path: str | os.PathLike[str] | None = None,
) -> Figure:
    """Plot some recordings of each material over time, as they are: of any length and rate, also irregular.

    Parameters
    ----------
    dataset : Dataset
        Need not be resampled or aligned.
    axes : sequence of str, optional
        Axes to draw, all of one unit; by default the forces or, where recordings have other axes, those that share a
        unit with the first, at most six.
    n : int, default 5
        Recordings per material, spread evenly over the material's recordings.
    path : path-like, optional
        Where to save; the ending chooses the format: png, svg or pdf. Written under a temporary name and renamed, so
        that a reader never sees half a file.

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
    units = tuple(unit_of(axis, dataset[0].meta) for axis in dataset.axes)
    columns = chosen_columns(axes or axes_of_one_unit(dataset[0]), dataset.axes, units)
    groups: dict[str, list[Recording]] = {}
    for recording in dataset:
        groups.setdefault(recording.label or _NO_LABEL, []).append(recording)
    figure, panels = _material_panels(len(groups))
    for (label, group), panel in zip(groups.items(), panels, strict=True):
        shown = [group[i] for i in evenly(len(group), n)]
        _draw_recordings(panel, shown, columns)
        style.heading(panel, f"{short(label)} ({len(shown)} of {len(group)})", 10)
    names = [dataset.axes[column] for column in columns]
    what = "Synthetic recordings" if dataset.is_synthetic else "Recordings"
    _name_panels(
        figure,
        names,
        title=f"{what} as they are stored",
        across="time from the first sample, s",
        up=quantity_of(names, units[columns[0]]),
    )
    style.save(figure, path)
    return figure


def _draw_recordings(panel: Any, recordings: Sequence[Recording], columns: Sequence[int]) -> None:
    foot = panel.get_xaxis_transform()
    for recording in recordings:
        time_s = recording.times()
        for place, column in enumerate(columns):
            line = style.axis_line(recording.axes[column], place)
            panel.plot(time_s, recording.wrench[:, column], linewidth=0.7, alpha=0.7, **line)
        if recording.flags is not None:
            at = time_s[recording.flags > 0]
            panel.plot(at, np.full(len(at), 0.02), "|", color=_FLAG_COLOUR, markersize=4, transform=foot)
        if recording.trigger_index is not None:
            panel.plot(time_s[recording.trigger_index], 0.98, "v", color=INK, markersize=3, transform=foot)
    style.curve_panel(panel)


def plot_mean_forces(
    dataset: Dataset,
    *,
    axes: Sequence[str] | None = None,
    path: str | os.PathLike[str] | None = None,
) -> Figure:
    """Plot the mean and spread over time of each material, one panel a material.

    Parameters
    ----------
    dataset : Dataset
        Recordings of equal length and rate, with labels.
    axes : sequence of str, optional
        Axes to draw, all of one unit. Default: fx and fz of a wrench; of other axes two of one unit, the one in which
        the materials differ most over their own spread, and the next of its unit.
    path : path-like, optional
        As in `plot_recordings`.

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
    >>> from granular_id import synthesize
    >>> figure = plot_mean_forces(synthesize(["rice", "fine sugar"], n_per_class=3))
    >>> [panel.get_title() for panel in figure.axes]
    ['rice', 'fine sugar']
    """
    means = means_of(dataset, axes)
    figure, panels = _material_panels(len(means.labels))
    for number, panel in enumerate(panels):
        draw_means(panel, means, number)
    quantity = quantity_of(means.axes, means.unit)
    what, _, _ = quantity.partition(",")
    synthetic = sum(recording.is_synthetic for recording in dataset)
    some = f"{synthetic} of {len(dataset)} recordings synthetic: "
    kind = {0: "", len(dataset): "Synthetic recordings: "}.get(synthetic, some)
    if not kind and what in ("force", "torque", "signal"):  # names of axes stay as they are
        what = what.capitalize()
    title = f"{kind}{what} per material, mean \N{PLUS-MINUS SIGN} standard deviation"
    _name_panels(figure, means.axes, title=title, across="time, s", up=quantity)
    style.save(figure, path)
    return figure


class Means(NamedTuple):
    """Mean and standard deviation over time, (K, C, P), of K materials on C axes of one unit."""

    labels: tuple[str, ...]
    axes: tuple[str, ...]
    unit: str
    time_s: Floats
    mean: Floats
    sd: Floats


def means_of(data: Dataset | ReportData, axes: Sequence[str] | None = None) -> Means:
    """Return the curves of each material, of recordings in the order in which materials first appear."""
    if isinstance(data, Dataset):
        X, y, units = data.X, data.y, tuple(common_units(data))
        labels, time_s = tuple(dict.fromkeys(y.tolist())), np.arange(X.shape[1]) / data.rate_hz
        mean, sd = (np.stack([what(X[y == one], axis=0).T for one in labels]) for what in (np.mean, np.std))
    else:
        labels, units, time_s, mean, sd = data.labels, data.units, data.time_s, data.mean, data.sd
    if axes is not None:
        columns = chosen_columns(axes, data.axes, units)
    elif {"fx", "fz"} <= set(data.axes):
        columns = [place for place, axis in enumerate(data.axes) if axis in ("fx", "fz")]
    else:
        ranked = most_different(mean, sd)
        columns = sorted([place for place in ranked if units[place] == units[ranked[0]]][:_MOST_MEANS])
    names = tuple(data.axes[column] for column in columns)
    return Means(labels, names, units[columns[0]], time_s, mean[:, columns], sd[:, columns])


def draw_means(panel: Any, means: Means, number: int) -> None:
    """Draw the curves of one material, by its number."""
    for place, (axis, mean, sd) in enumerate(
        zip(means.axes, means.mean[number], means.sd[number], strict=True)
    ):
        line = style.axis_line(axis, place)
        panel.fill_between(means.time_s, mean - sd, mean + sd, color=line["color"], alpha=0.25, linewidth=0)
        panel.plot(means.time_s, mean, linewidth=1.3, **line)
    style.curve_panel(panel)
    style.heading(panel, short(means.labels[number]), 10)


def axes_of_one_unit(recording: Recording) -> list[str]:
    """Return the first axes that share a unit: the forces of a wrench."""
    unit = unit_of(recording.axes[0], recording.meta)
    return [axis for axis in recording.axes if unit_of(axis, recording.meta) == unit][:_MOST_LINES]


def chosen_columns(axes: str | Sequence[str], have: Sequence[str], units: Sequence[str]) -> list[int]:
    """Return the columns of axes to draw in one panel, or refuse those that are not there or of several units."""
    wanted = (axes,) if isinstance(axes, str) else tuple(axes)
    if not wanted or not set(wanted) <= set(have) or len(set(wanted)) < len(wanted):
        raise GranularIdError(
            f"axes must name some of {', '.join(have)}, each once, got {', '.join(wanted) or 'nothing'}"
        )
    columns = [have.index(axis) for axis in wanted]
    mixed = sorted({units[column] for column in columns})
    if len(mixed) > 1:
        named = ", ".join(unit or "not known" for unit in mixed)
        raise GranularIdError(f"axes mixes units ({named}), got {', '.join(wanted)}: choose axes of one unit")
    return columns


def quantity_of(axes: Iterable[str], unit: str) -> str:
    """Say what is drawn, with its unit: force or torque of a wrench, a single axis by its name, else the signal."""
    names = list(axes)
    if set(names) <= set(AXES) and unit in ("N", "N m"):
        return f"{'force' if unit == 'N' else 'torque'}, {unit}"
    return style.with_unit(names[0] if len(names) == 1 else "signal", unit)


def evenly(total: int, n: int) -> NDArray[np.intp]:
    """Choose `n` of `total` places, or all where there are fewer, evenly from the first to the last."""
    chosen: NDArray[np.intp] = np.unique(
        np.linspace(0, max(total - 1, 0), min(n, total)).round().astype(np.intp)
    )
    return chosen


def _material_panels(n: int) -> tuple[Figure, list[Any]]:
    """Make a figure of `n` small panels that share their scales, up to four in a row."""
    n_columns = min(4, n)
    n_rows = math.ceil(n / n_columns)
    figure = style.new_figure(
        max(1.2 + 2.5 * n_columns, 7.0), 1.4 + 1.9 * n_rows
    )  # room for label and legend
    panels = figure.subplots(n_rows, n_columns, sharex=True, sharey=True, squeeze=False).ravel()
    for unused in panels[n:]:
        unused.remove()
    # The lowest panel of each column carries the time axis, also where the last row is not full.
    for index, panel in enumerate(panels[:n]):
        panel.tick_params(labelbottom=index + n_columns >= n)
    return figure, list(panels[:n])


def _name_panels(figure: Figure, axes: Sequence[str], *, title: str, across: str, up: str) -> None:
    """Write what all panels show, and which line is which axis."""
    figure.supxlabel(across, fontsize=10, color=INK)
    figure.supylabel(up, fontsize=10, color=INK)
    style.heading(figure, title)
    few = len(axes) <= 3  # more would run into the label
    side, across_legend = ("lower right", len(axes)) if few else ("right upper", 1)
    style.legend(figure, side, size=9, handles=style.axis_keys(axes, 1.3), ncols=across_legend)


# Histograms of what lies above the cut-off.


def plot_hfmh(report_data: ReportData, axis: str, *, path: str | os.PathLike[str] | None = None) -> Figure:
    """Plot the mean histogram of one high-passed axis, one row a material.

    Parameters
    ----------
    report_data : ReportData
        Summary of the data set that an evaluation keeps: ``result.report_data``.
    axis : str
        One of ``report_data.axes``.
    path : path-like, optional
        As in `plot_recordings`.

    Returns
    -------
    matplotlib.figure.Figure
        Colours on a log scale. Axes of one unit and the same bins share colours and bins, so that one that says
        nothing looks like it; bins that stay empty on all of them, in all materials, are cut off at both ends.

    Raises
    ------
    ImportError
        Without matplotlib, saying what to install.
    ValueError
        For an axis that is not among them.

    Examples
    --------
    >>> from granular_id import evaluate, synthesize
    >>> data = synthesize(["rice", "fine sugar"], n_per_class=4, sessions=2)
    >>> result = evaluate(data, "raw+hfmh", baselines=False, progress=False)
    >>> plot_hfmh(result.report_data, "fx").axes[0].get_title()
    'Fx above 23 Hz, SYNTHETIC recordings'
    """
    part, labels, units = report_data.hfmh, report_data.labels, report_data.units
    (own,) = chosen_columns(axis, report_data.axes, units)
    bins = part.bin_range.tolist()
    alike = [k for k, unit in enumerate(units) if unit == units[own] and bins[k] == bins[own]]
    n_bins = part.counts.shape[2]
    edges = np.linspace(part.bin_range[own, 0], part.bin_range[own, 1], n_bins + 1)
    used = np.flatnonzero(part.counts[:, alike].any(axis=(0, 1)))
    first, last = (int(used[0]), int(used[-1]) + 1) if used.size else (0, n_bins)
    low, high = shared_limits(part.counts[:, alike])

    figure = style.new_figure(3.7, 1.0 + 0.16 * max(3, len(labels)))
    from matplotlib.colors import LogNorm  # an extra, which is there

    panel = figure.subplots()
    image = panel.imshow(
        np.ma.masked_less_equal(part.counts[:, own, first:last], 0.0),  # what is zero stays empty
        cmap="cividis",  # dark to light in an order that survives any colour vision and a grey print
        norm=LogNorm(low, high),
        aspect="auto",
        interpolation="none",  # one pixel a value in an SVG, which stays small
        extent=(float(edges[first]), float(edges[last]), len(labels) - 0.5, -0.5),
    )
    style.row_names(panel, labels)
    panel.tick_params(labelsize=7.5, colors=INK)
    panel.spines[:].set_visible(False)
    panel.locator_params(axis="x", nbins=5)
    style.name_axes(panel, style.with_unit("bin", units[own]), size=8)
    mark = style.synthetic_mark(report_data.n_synthetic)
    style.heading(panel, f"{style.plain(axis)} above {part.cutoff_hz:g} Hz{mark}", 9)
    bar: Any = figure.colorbar(image, ax=panel, pad=0.02, aspect=25)
    bar.solids.set_rasterized(True)  # else a path for each of 256 colours
    bar.outline.set_visible(False)
    bar.set_label("samples in a bin", fontsize=8, color=INK)
    ticks, texts = style.log_ticks(low, high, most=6)
    bar.set_ticks(ticks, labels=texts)
    bar.ax.tick_params(labelsize=7.5, colors=INK, length=2)
    bar.ax.minorticks_off()
    style.save(figure, path)
    return figure


def shared_limits(values: Floats) -> tuple[float, float]:
    """Limits of the colours: the largest value, and at most four decades below it."""
    top = float(values.max())
    if top <= 0:
        return 0.1, 1.0
    smallest = float(values[values > 0].min())
    return max(min(smallest, 0.5 * top), top * 1e-4), top


# Onsets of the motion.

_BEFORE_S, _AFTER_S = 0.15, 0.2  # what the right column shows
_REST_COLOUR = "#DDE6EE"
_MISSING_COLOUR = "#B03A00"
# Words, colour, dashes and marker of an onset, by how it came about.
_MARKS = {
    "found": ("onset found", INK, "-", "v"),
    "overruled": ("onset stated", "#D55E00", "--", "D"),
    "recorded": ("onset recorded", "#0072B2", "-.", "s"),
}


def plot_onsets(dataset: Dataset, *, n: int = 10, path: str | os.PathLike[str] | None = None) -> Figure:
    """Plot where the motion begins: each recording as a whole and, on the right, around its onset.

    Parameters
    ----------
    dataset : Dataset
        With the onsets of :meth:`Dataset.find_onsets`, which is called where it was not.
    n : int, default 10
        Recordings to draw, spread evenly over the data set; up to half of them are ones without an onset or with
        one that you stated, where there are such.
    path : path-like, optional
        As in `plot_recordings`.

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
        dataset = dataset.find_onsets()
    step = next(step for step in reversed(dataset.history) if step.step == ONSET_STEP)
    rest_s, false_alarm_rate = (step.parameters[name] for name in ("rest_s", "false_alarm_rate"))
    rows = {row["name"]: row for row in step.rows}
    found = [rows.get(name, {"how": "recorded"}) for name in dataset.names]
    places = _places(np.array([row["how"] in ("not found", "overruled") for row in found]), n)
    shown = [dataset[place] for place in places]
    figure = style.new_figure(9.5, 1.1 + 1.05 * len(shown))
    panels = figure.subplots(len(shown), 2, squeeze=False, sharex="col", width_ratios=[1.6, 1.0])
    for panel, place in zip(panels, places, strict=True):
        _draw_onset(panel, dataset[place], found[place], rest_s)
    panels[0, 0].set_xlim(0.0, max(one.duration_s for one in shown) or 1.0)
    every = all(one.trigger_index is not None for one in shown)
    style.name_axes(panels[-1, 0], "time from the first sample, s")
    style.name_axes(
        panels[-1, 1], f"time from the onset{'' if every else ' or, without one, the end of rest'}, s"
    )
    axes = axes_of_one_unit(shown[0])
    figure.supylabel(
        style.with_unit("relative to rest", unit_of(axes[0], shown[0].meta)), fontsize=9, color=INK
    )
    kind = "SYNTHETIC recordings" if any(one.is_synthetic for one in shown) else "recordings"
    of = f"Onsets of {len(shown)} of {len(dataset)} {kind}"
    style.heading(figure, f"{of}: rest {rest_s:g} s, false-alarm rate {false_alarm_rate:g}")
    key = _onset_key(axes, {found[place]["how"] for place in places})
    style.legend(figure, "lower center", handles=key, ncols=len(key))
    style.save(figure, path)
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
    _, colour, dashes, marker = _MARKS.get(found["how"], _MARKS["recorded"])
    for panel, origin_s, part in ((panels[0], 0.0, slice(None)), (panels[1], zero_s, near)):
        panel.axvspan(-origin_s, rest_s - origin_s, color=_REST_COLOUR, linewidth=0, zorder=0)
        panel.axhspan(-band, band, color=_REST_COLOUR, linewidth=0, zorder=0)
        for place, axis in enumerate(axes):
            panel.plot(
                times[part] - origin_s, signal[part, place], linewidth=0.9, **style.axis_line(axis, place)
            )
        if index is not None:
            at = times[index] - origin_s
            panel.axvline(at, color=colour, linestyle=dashes, linewidth=1.2, zorder=3)
            top = panel.get_xaxis_transform()
            panel.plot(at, 1.0, marker, color=colour, ms=5, transform=top, clip_on=False, zorder=5)
        style.quiet(panel)
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

    marks = [
        Line2D([], [], color=colour, ls=dashes, marker=marker, ms=5, label=text)
        for how, (text, colour, dashes, marker) in _MARKS.items()
        if how in kinds
    ]
    rest = Patch(color=_REST_COLOUR, label="rest, \N{PLUS-MINUS SIGN}4 s.d.")
    return [*style.axis_keys(axes, 0.9), rest, *marks]
