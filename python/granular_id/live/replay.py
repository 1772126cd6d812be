"""Recordings played again, as if the sensor were there."""

from __future__ import annotations

import threading
from bisect import bisect_right

import numpy as np

from granular_id._checks import finite_number
from granular_id._core import GranularIdError, WrenchBuffer
from granular_id._text import counted
from granular_id.io import load
from granular_id.live.source import Pace, SourceInfo, SourceUrl, ThreadedSource
from granular_id.live.trigger import ForceTrigger, TimeTrigger, Trigger
from granular_id.recording import AXES, Dataset, common_units, setups_in, values_in

__all__ = ["ReplaySource", "open_url"]


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
        Recordings are irregular, or differ in their rates, axes or units.

    Examples
    --------
    >>> import granular_id as gid
    >>> from granular_id.live import ReplaySource
    >>> ReplaySource(gid.synthesize(["rice"], n_per_class=2)).info.synthetic
    True
    """

    replays = True

    def __init__(self, recordings: Dataset, *, speed: float = 1.0, pause_s: float = 1.0) -> None:
        rate_hz = recordings.rate_hz
        # Whole samples, so that every sample stands where it would in one long recording.
        pause = max(1, round(finite_number("pause_s", pause_s, least=0) * rate_hz))
        self.pause_s = pause / rate_hz
        self._recordings = list(recordings)
        lengths = [recording.n_samples for recording in self._recordings]
        self._starts = [0, *np.cumsum(np.asarray(lengths) + pause).tolist()][:-1]
        # What all that know it agree in; `setups` has each.
        self.setups = tuple(dict.fromkeys(setups_in(recordings)))
        known = {name: values[0] for name, values in values_in(self.setups).items() if len(values) == 1}
        labels = sorted({str(r.label) for r in self._recordings if r.label})
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
                meta={"labels": labels, "sensor": None, **known},  # not this source, but the one they name
                axes=recordings.axes,
                units=tuple(common_units(recordings)),
                repeats=True,
            )
        )

    def truth_at(self, time_s: float) -> str | None:
        """Return the label of the recording that a sample is of, by its device time."""
        tick = round(time_s * self.info.rate_hz)
        return self._recordings[bisect_right(self._starts, tick) - 1].label

    def trigger(self) -> Trigger:
        """Return a trigger that fires where the recordings say that the motion began; by force where they do not."""
        starts = zip(self._starts, self._recordings, strict=True)
        ticks = [start + r.trigger_index for start, r in starts if r.trigger_index is not None]
        if len(ticks) == len(self._recordings):
            return TimeTrigger([tick / self.info.rate_hz for tick in ticks])
        if self.info.axes[:3] != AXES[:3]:
            raise GranularIdError(
                "the recordings do not say when a push began, and there are no forces to tell it by: a live answer "
                "without pushes, at each hop, needs hop_s"
            )
        return ForceTrigger()

    def deliver(self, buffer: WrenchBuffer, stopping: threading.Event) -> None:
        """Write samples as they fall due."""
        pace = Pace(self.info)
        for start, recording in zip(self._starts, self._recordings, strict=True):
            if start:
                buffer.new_epoch()  # silence, not a loss
            sent = 0
            while sent < recording.n_samples:
                if (n := pace.due(start + sent)) > 0:
                    end = min(sent + n, recording.n_samples)
                    flags = None if recording.flags is None else recording.flags[sent:end]
                    times_s = np.arange(start + sent, start + end) / self.info.rate_hz
                    buffer.push_block(recording.wrench[sent:end], times_s, flags=flags)
                    sent = end
                if stopping.wait(pace.period_s):
                    return


def open_url(url: SourceUrl) -> ReplaySource:
    """Make the source of ``replay:PATH``; ``axes``, ``units`` and ``rate_hz`` are those of `granular_id.load`."""
    url.allow("speed", "pause_s", "axes", "units", "rate_hz")
    speed, pause_s = url.number("speed", 1.0), url.number("pause_s", 1.0)
    rate_hz = url.number("rate_hz", None)
    data = load(url.path, axes=url.words("axes"), units=url.words("units"), rate_hz=rate_hz)
    return ReplaySource(data, speed=speed, pause_s=pause_s)
