"""Recordings played again, as if the sensor were there."""

from __future__ import annotations

import math
import threading
from bisect import bisect_right

import numpy as np

from granular_id._checks import finite_number, positive_number
from granular_id._core import host_ns
from granular_id._text import counted
from granular_id.io import load
from granular_id.live.source import SourceInfo, ThreadedSource, WrenchSink
from granular_id.live.source_url import SourceUrl
from granular_id.live.trigger import ForceTrigger, TimeTrigger, Trigger
from granular_id.recording import AXES, Dataset, common_units, setups_in, values_in

__all__ = ["ReplaySource", "common_rate", "open_url"]

_PERIOD_S = 0.004


class ReplaySource(ThreadedSource):
    """Plays the recordings of a data set, one after another, with a silence between them.

    Parameters
    ----------
    recordings : Dataset
        All of one rate.
    speed : float, default 1
        Device seconds per second.
    pause_s : float, default 1
        Device time between two recordings in which no sample comes.

    Attributes
    ----------
    setups : tuple of granular_id.recording.Setup
        Those of the recordings, each once.
    pause_s : float
        The silence, in whole samples: at least one.

    Raises
    ------
    ValueError
        Recordings are irregular or of different rates (resample them first), or differ in their units.

    Examples
    --------
    >>> import granular_id as gid
    >>> from granular_id.live import ReplaySource
    >>> ReplaySource(gid.synthesize(["rice"], n_per_class=2)).info.synthetic
    True
    """

    def __init__(self, recordings: Dataset, *, speed: float = 1.0, pause_s: float = 1.0) -> None:
        rate_hz = common_rate(recordings)
        speed = positive_number("speed", speed)
        # Whole samples, so that every sample stands where it would in one long recording.
        pause = max(1, round(finite_number("pause_s", pause_s, least=0) * rate_hz))
        self.pause_s = pause / rate_hz
        self._recordings = list(recordings)
        lengths = [recording.n_samples for recording in self._recordings]
        self._starts = [0, *np.cumsum(np.asarray(lengths) + pause).tolist()][:-1]
        # What all that know it agree in; `setups` has each.
        self.setups = tuple(dict.fromkeys(setups_in(recordings)))
        known = {name: values[0] for name, values in values_in(self.setups).items() if len(values) == 1}
        super().__init__(
            SourceInfo(
                f"replay of {counted(len(recordings))}",
                rate_hz,
                device_clock=True,
                frame=known.pop("frame", None),
                sign=known.pop("sign", None),
                serial=known.pop("serial", None),
                synthetic=recordings.is_synthetic,
                speed=speed,
                meta={
                    "labels": sorted({str(r.label) for r in self._recordings if r.label}),
                    "sensor": None,  # not known, unless the recordings say it
                    **known,
                },
                axes=recordings.axes,
                units=tuple(common_units(recordings)),
            )
        )
        self._tick = 0

    @property
    def truth(self) -> str | None:
        """Label of the recording that is played, or was played last."""
        return self._label_at(self._tick - 1)

    def truth_at(self, time_s: float) -> str | None:
        """Return the label of the recording that a sample is of, by its device time."""
        return self._label_at(round(time_s * self.info.rate_hz))

    def _label_at(self, tick: int) -> str | None:
        return self._recordings[max(bisect_right(self._starts, tick) - 1, 0)].label

    def trigger(self) -> Trigger:
        """Return a trigger that fires where the recordings say that the motion began; by force where they do not."""
        times_s = [
            (start + recording.trigger_index) / self.info.rate_hz
            for start, recording in zip(self._starts, self._recordings, strict=True)
            if recording.trigger_index is not None
        ]
        if len(times_s) == len(self._recordings):
            return TimeTrigger(times_s)
        if self.info.axes[:3] != AXES[:3]:
            raise ValueError(
                "the recordings do not say when a push began, and there are no forces to tell it by: a live answer "
                "without pushes, at each hop, needs hop_s"
            )
        return ForceTrigger()

    def deliver(self, buffer: WrenchSink, stopping: threading.Event) -> None:
        """Write samples as they fall due."""
        start_ns = host_ns()
        rate_hz = self.info.rate_hz
        for start, recording in zip(self._starts, self._recordings, strict=True):
            if start:
                buffer.new_epoch()  # silence, not a loss
            sent = 0
            while sent < recording.n_samples:
                due = math.floor(1e-9 * (host_ns() - start_ns) * self.info.speed * rate_hz) + 1 - start
                end = min(max(due, sent), recording.n_samples)
                if end > sent:
                    flags = None if recording.flags is None else recording.flags[sent:end]
                    times_s = np.arange(start + sent, start + end) / rate_hz
                    self._tick = start + end
                    buffer.push_block(recording.wrench[sent:end], times_s, flags=flags)
                    sent = end
                if stopping.wait(_PERIOD_S):
                    return


def common_rate(recordings: Dataset) -> float:
    """Return the rate of recordings that can be played one after another, or say why these cannot."""
    rates = {recording.rate_hz for recording in recordings}
    if None in rates or len(rates) > 1:
        what = "are irregular" if None in rates else f"have the rates {sorted(map(str, rates))}"
        raise ValueError(
            f"recordings {what}; resample them first: .resample(rate_hz), or granular-id data convert with --rate-hz; "
            "of stamps that only jitter replay:PATH?rate_hz=50 states the rate"
        )
    return float(next(iter(rates)))  # type: ignore[arg-type]


def open_url(url: SourceUrl) -> ReplaySource:
    """Make the source of ``replay:PATH``.

    Options: ``speed``, ``pause_s``, and ``axes``, ``units`` and ``rate_hz`` of `granular_id.load`.
    """
    url.allow("speed", "pause_s", "axes", "units", "rate_hz")
    speed, pause_s = url.number("speed", 1.0), url.number("pause_s", 1.0, positive=False)
    rate_hz = url.number("rate_hz", 1.0) if "rate_hz" in url.options else None
    try:
        data = load(url.path, axes=url.words("axes"), units=url.words("units"), rate_hz=rate_hz)
        return ReplaySource(data, speed=speed, pause_s=pause_s)
    except ValueError as error:
        raise ValueError(f"url {url.text!r}: {error}") from error
