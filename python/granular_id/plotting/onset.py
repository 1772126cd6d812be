"""Where the motion begins, recording by recording: what was found, what was stated, what is missing."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import whole_number
from granular_id._text import fixed, short
from granular_id.plotting.recordings import axes_of_one_unit
from granular_id.plotting.style import (
    INK,
    axis_line,
    evenly,
    heading,
    legend,
    new_figure,
    pretty,
    quiet,
    save,
    with_unit,
)
from granular_id.recording import (
    FALSE_ALARM_RATE,
    ONSET_STEP,
    REST_S,
    Dataset,
    Onset,
    Recording,
    onsets_of,
    unit_of,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Right column: seconds shown before and after the onset.
_BEFORE_S, _AFTER_S = 0.15, 0.2
_WIDTH = 0.9
_REST_COLOUR = "#DDE6EE"
_MISSING_COLOUR = "#B03A00"


class _Mark(NamedTuple):
    """How an onset is drawn: told apart by shape and dashes as well as colour."""

    text: str
    colour: str
    dashes: str
    marker: str


_MARKS = {
    "found": _Mark("onset found", INK, "-", "v"),
    "overruled": _Mark("onset stated", "#D55E00", "--", "D"),
    "kept": _Mark("onset recorded", "#0072B2", "-.", "s"),
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
        one with a diamond one that you stated, a dash-dotted one with a square one that was recorded. The small
        circle is the sample with which the change became certain. Where none was found, the panel says why.

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
    settings = {name: step.parameters[name] for name in ("rest_s", "false_alarm_rate")}
    rows = {row["name"]: row for row in step.rows}
    places = _places(dataset, rows, n)
    shown = [dataset[int(i)] for i in places]
    judged = [onsets_of([r], **settings)[0] if r.is_uniform else None for r in shown]
    figure = new_figure(9.5, 1.1 + 1.05 * len(shown))
    panels = figure.subplots(len(shown), 2, squeeze=False, sharex="col", width_ratios=[1.6, 1.0])
    for row, recording, onset in zip(panels, shown, judged, strict=True):
        how = rows.get(recording.name, {}).get("how", "kept")
        _draw_row(row, recording, onset, _MARKS.get(how, _MARKS["kept"]), settings["rest_s"])
    panels[0, 0].set_xlim(0.0, max(r.duration_s for r in shown) or 1.0)
    zero = (
        "onset"
        if all(r.trigger_index is not None for r in shown)
        else "onset or, without one, the end of rest"
    )
    for panel, origin in zip(panels[-1], ("first sample", zero), strict=True):
        panel.set_xlabel(f"time from the {origin}, s", fontsize=9, color=INK)
    unit = unit_of(_drawn(shown[0])[0], shown[0].meta)
    figure.supylabel(with_unit("relative to rest", unit), fontsize=9, color=INK)
    heading(figure, _title(shown, len(dataset), settings))
    kinds = {rows.get(r.name, {}).get("how", "kept") for r in shown if r.trigger_index is not None}
    key = _key(shown, kinds)
    legend(figure, "lower center", handles=key, ncols=len(key))
    save(figure, path)
    return figure


def _places(dataset: Dataset, rows: Mapping[str, Mapping[str, Any]], n: int) -> NDArray[np.intp]:
    """Choose recordings: those that need a look, up to half, and the others evenly."""
    told = np.array([rows.get(name, {}).get("how") in ("not found", "overruled") for name in dataset.names])
    first, rest = np.flatnonzero(told), np.flatnonzero(~told)
    first = first[evenly(len(first), max(n - len(rest), (n + 1) // 2))]
    rest = rest[evenly(len(rest), n - len(first))]
    return np.sort(np.concatenate([first, rest]))


def _drawn(recording: Recording) -> list[str]:
    """Return the axes to draw: the forces of a wrench, of others those that share a unit with the first."""
    return axes_of_one_unit(recording)


def _draw_row(panels: Any, recording: Recording, onset: Onset | None, mark: _Mark, rest_s: float) -> None:
    times, index = recording.times(), recording.trigger_index
    at_rest = max(1, int(np.searchsorted(times, rest_s)))
    axes = _drawn(recording)
    columns = [recording.axes.index(axis) for axis in axes]
    signal = recording.wrench[:, columns] - recording.wrench[:at_rest, columns].mean(axis=0)
    band = 4 * float(signal[:at_rest].std(axis=0).max())
    zero_s = rest_s if index is None else float(times[index])
    near = (times >= zero_s - _BEFORE_S) & (times <= zero_s + _AFTER_S)
    for panel, origin_s, chosen in ((panels[0], 0.0, slice(None)), (panels[1], zero_s, near)):
        panel.axvspan(-origin_s, rest_s - origin_s, color=_REST_COLOUR, linewidth=0, zorder=0)
        panel.axhspan(-band, band, color=_REST_COLOUR, linewidth=0, zorder=0)
        for place, axis in enumerate(axes):
            panel.plot(
                times[chosen] - origin_s, signal[chosen, place], linewidth=_WIDTH, **axis_line(axis, place)
            )
        if index is not None:
            line = {"color": mark.colour, "linestyle": mark.dashes, "linewidth": 1.2, "zorder": 3}
            panel.axvline(times[index] - origin_s, **line)
            foot = {"transform": panel.get_xaxis_transform(), "clip_on": False, "zorder": 5}
            panel.plot(times[index] - origin_s, 1.0, mark.marker, color=mark.colour, ms=5, **foot)
        quiet(panel)
        panel.locator_params(axis="y", nbins=3)
    panels[1].set_xlim(-_BEFORE_S, _AFTER_S)
    # Onsets lie early as a rule: on the right the name keeps clear of the mark.
    title, colour, side = short(recording.name, 60), INK, "right"
    if index is None:
        why = onset.why if onset is not None and onset.why else "none, as stated"
        title, colour, side = f"{title}, no onset:\n{why}", _MISSING_COLOUR, "left"
    # A name with $ in it is a name, no mathematics.
    panels[0].set_title(title, fontsize=8, color=colour, loc=side, pad=2, parse_math=False)
    if onset is not None and onset.detected_index is not None:
        seen = onset.detected_index
        strongest = signal[seen, np.abs(signal[seen]).argmax()]
        style = {"mec": INK, "mfc": "white", "ms": 4, "zorder": 4}
        if near[seen]:
            panels[1].plot(times[seen] - zero_s, strongest, "o", **style)
    if index is not None:
        panels[1].set_title(f"{fixed(times[index], 3)} s", fontsize=8, color=mark.colour, loc="right", pad=2)


def _key(shown: list[Recording], kinds: set[str]) -> list[Any]:
    from matplotlib.lines import Line2D  # an extra
    from matplotlib.patches import Patch

    lines = [
        Line2D([], [], label=pretty(axis), linewidth=_WIDTH, **axis_line(axis, place))
        for place, axis in enumerate(_drawn(shown[0]))
    ]
    marks = [
        Line2D([], [], color=m.colour, ls=m.dashes, marker=m.marker, ms=5, label=m.text)
        for how, m in _MARKS.items()
        if how in kinds
    ]
    certain = Line2D([], [], linestyle="", marker="o", mec=INK, mfc="white", ms=4, label="certain from here")
    return [*lines, Patch(color=_REST_COLOUR, label="rest, \N{PLUS-MINUS SIGN}4 s.d."), *marks, certain]


def _title(shown: list[Recording], total: int, settings: Mapping[str, float]) -> str:
    kind = "synthetic recordings" if all(r.is_synthetic for r in shown) else "recordings"
    if kind == "recordings" and any(r.is_synthetic for r in shown):
        kind = "recordings (some synthetic)"
    return (
        f"Onsets of {len(shown)} of {total} {kind}: rest {settings['rest_s']:g} s, false-alarm rate "
        f"{settings['false_alarm_rate']:g}"
    )
