"""What a view shows: the state of a session at one instant, as plain numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from granular_id._core import AXES, UNITS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from granular_id.identifier import Decision
    from granular_id.live.push import Push

__all__ = ["Outcome", "Snapshot"]

_WAITING = frozenset(("idle", "arming", "armed", "ended"))
"""States in which no push is under way."""


def _no_rows() -> NDArray[np.float64]:
    return np.empty((0, len(AXES)))


def _no_numbers() -> NDArray[np.float64]:
    return np.empty(0)


def _no_axis_values() -> NDArray[np.float64]:
    return np.full(len(AXES), math.nan)


def _no_history() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return np.empty(0), np.empty((0, 0))


@dataclass(frozen=True, eq=False)
class Outcome:
    """One line of the history of a session.

    Parameters
    ----------
    number : int
        Of the outcome, counted from 1 since the session began.
    utc_s : float
        When the push was over, by the clock of this machine.
    push : Push
        Its answer, or why there is none.
    """

    number: int
    utc_s: float
    push: Push


@dataclass(frozen=True, eq=False)
class Snapshot:
    """One instant of a session. Made by a `SnapshotBuilder`; nothing in it changes afterwards.

    Forces are in N, torques in N m, times in seconds of the device. C is the number of axes.

    Parameters
    ----------
    state : str
        State of the capture in lower case: idle, arming, armed, triggered, complete or failed; ended after the
        last row of a replay.
    time_s : float or None
        Device time of the newest row; None before the first.
    hint : str
        What the person is to do, or why a capture failed.
    source : str
        Where the rows come from.
    synthetic : bool
        Do they come from a model instead of a sensor? Every view says so.
    rate_hz, cutoff_hz : float
        Sampling rate, and the cut-off of the high-pass.
    n_samples : int
        Length of a capture.
    latest : ndarray, shape (C,)
        Newest row; NaN before the first.
    row_age_s : ndarray, shape (m,)
        Seconds from the newest row back to each row of `wrench`, oldest first.
    wrench, residual : ndarray, shape (m, C)
        The last seconds and what the high-pass leaves of them. Long spans are thinned to the extremes of short
        pieces, so no peak is lost; instants that never arrived are NaN.
    fresh_time_s, fresh_wrench, fresh_residual : ndarray, shapes (k,), (k, C), (k, C)
        Rows since the snapshot before, one per instant, not thinned: for views that keep everything.
    fresh_lost : int
        Rows since the snapshot before that are no longer in the builder's memory.
    bin_edges : ndarray, shape (C, n_bins + 1)
        Edges of the histogram's bins.
    counts : ndarray of int64, shape (C, n_bins)
        Histogram of the residual since the capture began.
    classes : tuple of str
        Materials the model knows, in its order.
    ranking_history : pair of ndarray, shapes (h,), (h, K)
        Seconds of signal, and the mean loss of each of `classes` then.
    decision : Decision or None
        The latest answer of this capture.
    history : tuple of Outcome
        What came of the last pushes, the oldest first; its last number counts all of the session.
    lag_s, max_lag_s : float
        Age of the newest row when it was looked at (NaN: unknown), and from where on that is an alarm.
    counters : mapping of str to int
        What arrived and what did not, see ``WrenchBuffer.stats``; ``missed`` are rows read too late.
    warnings : tuple of str
        To be shown as they are.
    n_captures : int
        Captures finished so far.
    n_correct : int or None
        How many of them were named rightly; None where the truth is unknown.

    Raises
    ------
    ValueError
        Arrays whose shapes do not fit together.

    Examples
    --------
    >>> from granular_id.live.snapshot import Snapshot
    >>> Snapshot("armed", counters={"missing": 2, "missed": 1}).lost
    3
    """

    state: str
    time_s: float | None = None
    hint: str = ""
    source: str = ""
    synthetic: bool = False
    rate_hz: float = 500.0
    cutoff_hz: float = 23.0
    n_samples: int = 1600
    axes: tuple[str, ...] = AXES
    units: tuple[str, ...] = UNITS
    latest: NDArray[np.float64] = field(default_factory=_no_axis_values)
    row_age_s: NDArray[np.float64] = field(default_factory=_no_numbers)
    wrench: NDArray[np.float64] = field(default_factory=_no_rows)
    residual: NDArray[np.float64] = field(default_factory=_no_rows)
    fresh_time_s: NDArray[np.float64] = field(default_factory=_no_numbers)
    fresh_wrench: NDArray[np.float64] = field(default_factory=_no_rows)
    fresh_residual: NDArray[np.float64] = field(default_factory=_no_rows)
    fresh_lost: int = 0
    bin_edges: NDArray[np.float64] = field(default_factory=lambda: np.tile([-1.5, 1.5], (len(AXES), 1)))
    counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros((len(AXES), 1), np.int64))
    classes: tuple[str, ...] = ()
    ranking_history: tuple[NDArray[np.float64], NDArray[np.float64]] = field(default_factory=_no_history)
    decision: Decision | None = None
    history: tuple[Outcome, ...] = ()
    lag_s: float = math.nan
    max_lag_s: float = 0.02
    counters: Mapping[str, int] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    n_captures: int = 0
    n_correct: int | None = None

    def __post_init__(self) -> None:
        m, k, n_axes = len(self.row_age_s), len(self.fresh_time_s), len(self.axes)
        times, losses = self.ranking_history
        wanted: dict[str, tuple[Any, tuple[int, ...]]] = {
            "units": (self.units, (n_axes,)),
            "latest": (self.latest, (n_axes,)),
            "wrench": (self.wrench, (m, n_axes)),
            "residual": (self.residual, (m, n_axes)),
            "fresh_wrench": (self.fresh_wrench, (k, n_axes)),
            "fresh_residual": (self.fresh_residual, (k, n_axes)),
            "bin_edges": (self.bin_edges, (n_axes, self.counts.shape[-1] + 1)),
            "counts": (self.counts, (n_axes, self.counts.shape[-1])),
        }
        if len(times):
            wanted["losses of ranking_history"] = (losses, (len(times), len(self.classes)))
        for name, (value, shape) in wanted.items():
            got = np.shape(value)
            if got != shape:
                raise ValueError(f"{name} has shape {got}, wanted {shape} for {n_axes} axes")

    @property
    def held(self) -> Outcome | None:
        """What views go on showing: the last outcome, until the next push is triggered."""
        return self.history[-1] if self.history and self.state in _WAITING else None

    @property
    def lost(self) -> int:
        """Rows that never arrived, and rows that were overwritten before they were read."""
        return self.counters.get("missing", 0) + self.counters.get("missed", 0)

    @property
    def lagging(self) -> bool:
        """Whether the newest row is older than it may be."""
        return self.lag_s > self.max_lag_s

    @property
    def capture_s(self) -> float:
        """Seconds that a whole capture takes."""
        return self.n_samples / self.rate_hz
