"""``Measured``: the recordings that are checked, with what several checks need of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from granular_id._checks import FloatArray
from granular_id.recording.checks.report import Finding, Severity
from granular_id.recording.clock import MAX_GAP_S
from granular_id.recording.recording import Recording, places_of
from granular_id.recording.steps import recordings_cut

FALSE_ALARM_RATE = 0.01
"""Chance that a statistical check speaks up in a sound data set."""


class Measured:
    """Recordings, and what several checks look at; each figure is made when first used."""

    def __init__(self, recordings: Sequence[Recording], session_hint: str = "") -> None:
        self.recordings = recordings
        self.session_hint = session_hint  # where reading them found sessions that are not read

    @cached_property
    def labels(self) -> dict[str, list[int]]:
        """Places of the recordings of each label, labels in order of first appearance."""
        places = places_of(r.label for r in self.recordings)
        return {label: group for label, group in places.items() if label is not None}

    @cached_property
    def witnesses(self) -> dict[str, list[int]]:
        """Places of the recordings of each label with several; of windows, which are no two, the first of each."""
        first = set(np.unique(recordings_cut(self.recordings), return_index=True)[1].tolist())
        groups = {label: sorted(first.intersection(group)) for label, group in self.labels.items()}
        return {label: group for label, group in groups.items() if len(group) > 1}

    @cached_property
    def paces(self) -> list[Pace]:
        """How the samples of each recording follow each other."""
        return [_pace(r) for r in self.recordings]

    @cached_property
    def labels_of_one_session(self) -> list[str]:
        """Labels that cannot be separated from their session; none where all of them share one session."""
        sessions = {
            label: frozenset({self.recordings[i].session for i in group} - {None})
            for label, group in self.labels.items()
        }
        alone = [label for label, its in sessions.items() if len(its) == 1]
        return alone if len({sessions[label] for label in alone}) > 1 else []

    def axes_among(self, columns: Mapping[int, Iterable[int]]) -> list[str]:
        """Return the names of these columns of the recordings at these places, sorted, each once."""
        return sorted({self.recordings[i].axes[column] for i, its in columns.items() for column in its})

    def finding(
        self, severity: Severity, code: str, message: str, places: Iterable[int] = (), **values: Any
    ) -> Finding:
        """Make a finding about the recordings at these places; about the whole set when none is given."""
        indices = tuple(map(int, places))
        return Finding(
            severity, code, message, tuple(self.recordings[i].name for i in indices), indices, values
        )


def by_axis(recording: Recording) -> FloatArray:
    """Return the samples with those of an axis side by side: statistics along time take a third of the time."""
    return np.asfortranarray(recording.wrench)


# How the samples follow each other.

GAP_STEPS = 5.0  # a gap is longer than this many of the recording's long steps (their 95 % quantile)


class Pace(NamedTuple):
    """Steps between neighbouring samples; all 0 for a single sample."""

    median_s: float
    mean_s: float
    spread: float  # 90 % less 10 % quantile, relative to the median
    longest_s: float
    limit_s: float  # the longest step that does not count as a gap


def _pace(recording: Recording) -> Pace:
    if recording.n_samples < 2:
        return Pace(0.0, 0.0, 0.0, 0.0, 0.0)
    if recording.rate_hz is not None:
        step = 1 / recording.rate_hz
        return Pace(step, step, 0.0, step, step)
    steps = np.diff(recording.times())
    low, median, high, long = (float(q) for q in np.quantile(steps, (0.1, 0.5, 0.9, 0.95)))
    limit = min(GAP_STEPS * long, max(MAX_GAP_S, GAP_STEPS * median))
    return Pace(median, float(steps.mean()), (high - low) / median, float(steps.max()), limit)
