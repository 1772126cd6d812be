"""A source at work: opened, its rows in a buffer, and stopped whatever happens."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace

from granular_id._checks import argument_error, positive_number
from granular_id._core import WrenchBuffer
from granular_id._text import counted, verb
from granular_id.live.clock import CLOCK, WAIT_S, Clock
from granular_id.live.outcome import FailureReason, Fault
from granular_id.live.source import Health, SourceInfo, WrenchSource, open_source

__all__ = ["Stream", "checked_stream", "left_out", "opened"]

_POLL_S = 0.05

_MOST_S = 600.0
"""Device time that a buffer holds at most, unless more is requested: that of fast simulations would fill the memory."""


class Stream:
    """A started source and the buffer it writes into; made by `opened`."""

    def __init__(self, source: WrenchSource, buffer: WrenchBuffer, clock: Clock = CLOCK) -> None:
        self.source, self.buffer, self.clock = source, buffer, clock
        self._opened_utc_s = time.time()

    @property
    def info(self) -> SourceInfo:
        """What the source measures."""
        return self.source.info

    @property
    def replays(self) -> bool:
        """Whether its rows are of recordings: those that came in before a push is requested count, too."""
        return bool(getattr(self.source, "replays", False))

    def truth_at(self, time_s: float | None) -> str | None:
        """Material of the row of that device time, or else of the latest push, where the source knows it."""
        known: Callable[[float], str | None] | None = getattr(self.source, "truth_at", None)
        latest: str | None = getattr(self.source, "truth", None)
        return latest if known is None or time_s is None else known(time_s)

    @property
    def pause_s(self) -> float:
        """How long the source is silent of its own accord, by the host's clock: recordings played one by one."""
        pause_s: float = getattr(self.source, "pause_s", 0.0)
        return pause_s / self.info.speed

    def health(self) -> Health:
        """How the source is, with the counts of the buffer beside its own."""
        health = self.source.health()
        return replace(health, counters={**self.buffer.stats(), **health.counters})

    def fault(self, quiet_s: float, most_s: float) -> Fault | None:
        """Return why no more rows will come, `quiet_s` after the last one; silence may last `most_s` and a pause."""
        health, silent_s = self.health(), most_s + self.pause_s
        if health.error is not None:
            return Fault(FailureReason.SOURCE, f"the source died: {health.error}")
        if health.finished and quiet_s > 2 * WAIT_S:  # so that what it wrote last was read
            return Fault(FailureReason.SOURCE, "the source came to its end")
        if quiet_s > silent_s:
            text = f"{self.info.name} delivered nothing for {silent_s:g} s{left_out(health.counters)}"
            return Fault(FailureReason.NO_ROWS, text)
        return None

    @property
    def utc_at_zero_s(self) -> float | None:
        """Time of day at device time 0, where device time runs at a speed of its own; None: as rows come in."""
        return None if self.info.speed == 1 else self._opened_utc_s

    def lag_s(self) -> float:
        """How late the newest row is; 0 where device time runs at a speed of its own and says nothing of it."""
        return self.buffer.lag_s(self.clock.now_ns()) if self.info.speed == 1 else 0.0


@contextmanager
def opened(
    source: str | WrenchSource, seconds: float = 30.0, *, first_row_s: float = 5.0
) -> Iterator[Stream]:
    """Start a source for the length of a block.

    Parameters
    ----------
    source : str or WrenchSource
        A URL (see `open_source`) or a source that is not started yet.
    seconds : float, default 30
        Length of the buffer, by the host's clock: so far back can a reader fall. At most 600 s of device time where
        that runs faster.
    first_row_s : float, default 5
        How long the first row may take.

    Yields
    ------
    Stream
        Its first row is there.

    Raises
    ------
    TimeoutError
        No row came.
    ConnectionError
        The source died, or came to its end, before its first row; says why.
    ValueError, ImportError, OSError
        As `open_source`.

    Examples
    --------
    >>> from granular_id.live import opened
    >>> with opened("sim:rice?seed=1") as stream:
    ...     stream.info.rate_hz, stream.health().running
    (500.0, True)
    """
    # Before the source is opened: it may hold a connection from then on.
    seconds, first_row_s = positive_number("seconds", seconds), positive_number("first_row_s", first_row_s)
    chosen = open_source(source) if isinstance(source, str) else source
    if not isinstance(chosen, WrenchSource):
        raise TypeError(
            f"source must be a URL or have info, start, stop and health, got {type(source).__name__}"
        )
    info = chosen.info
    try:
        buffer = WrenchBuffer(
            min(seconds * info.speed, max(seconds, _MOST_S)),
            rate_hz=info.rate_hz,
            tick_hz=info.tick_hz,
            n_axes=len(info.axes),
        )
        first = buffer.reader(from_oldest=True)
        chosen.start(buffer)
        deadline_s = time.monotonic() + first_row_s
        while not first.wait(_POLL_S):
            health = chosen.health()
            if health.error is not None:
                raise ConnectionError(f"{info.name}: {health.error}")
            if health.finished and not first.wait(0.0):
                raise ConnectionError(f"{info.name} came to its end before its first row")
            if time.monotonic() > deadline_s:
                came = left_out(buffer.stats())
                raise TimeoutError(f"{info.name} delivered nothing within {first_row_s:g} s{came}")
        yield Stream(chosen, buffer)
    finally:
        chosen.stop()


def left_out(counters: Mapping[str, int]) -> str:
    """Say that rows came which could not be taken, for the end of a message; empty where there were none."""
    n = counters.get("non_finite", 0)
    return f"; {counted(n, 'row')} with NaN or infinity {verb(n, 'was', 'were')} left out" if n else ""


def checked_stream(stream: object) -> None:
    """Refuse what is no started source."""
    if not hasattr(stream, "buffer"):
        problem = f"must be an opened source (with opened(...) as stream), got {stream!r:.60}"
        raise argument_error(TypeError, "stream", problem)
