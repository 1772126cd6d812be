"""What adapters share: finding a library, and asking a driver for its newest sample."""

from __future__ import annotations

import threading
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any

import numpy as np

from granular_id.live import ThreadedSource, WrenchSink, host_ns

__all__ = ["PolledMotion", "PollingSource", "PushStart", "library"]

_PER_SAMPLE = 4
"""How often a driver is asked per sample: it only knows its newest one, and none may pass unseen."""


_AHEAD_M = 0.01
"""So far ahead of the last push's start may the next one begin: arms, and people who guide them, are not exact."""


def library(module: str, package: str, how: str | None = None) -> Any:
    """Import the library of a sensor or robot, or say how to get it (with pip, unless `how` says otherwise).

    Raises
    ------
    ImportError
        It is not there.
    """
    try:
        return import_module(module)
    except ImportError as error:
        how = how or f"pip install {package}"
        raise ImportError(f"{package} is needed for this sensor or robot: {how}") from error


class PushStart:
    """Remembers where an arm's pushes begin.

    One after another, each from where the last one ended, they would drive the tool on and on: into the wall of the
    container, or to the end of the arm's reach.
    """

    def __init__(self) -> None:
        self._place: tuple[float, ...] | None = None

    def check(self, place: Sequence[float], ahead: Sequence[float]) -> None:
        """Refuse a push that begins ahead of the last one.

        Parameters
        ----------
        place : sequence of 3 float
            Where the tool is, m.
        ahead : sequence of 3 float
            Direction of the push, of length 1.

        Raises
        ------
        RuntimeError
            The tool was not brought back.
        """
        x, y, z = (float(value) for value in place[:3])
        if self._place is not None:
            ahead_m = sum((n - b) * a for n, b, a in zip((x, y, z), self._place, ahead, strict=True))
            if ahead_m > _AHEAD_M:
                raise RuntimeError(
                    f"the tool stands {1e3 * ahead_m:.0f} mm ahead of where the last push began: bring it back first"
                )
            if ahead_m > 0:
                return  # many short pushes that were stopped must not creep either
        self._place = (x, y, z)


class PollingSource(ThreadedSource):
    """A source whose driver only tells its newest sample: asked several times per period, kept when it is new."""

    @abstractmethod
    def newest(self) -> tuple[float, Any, int] | None:
        """Return device time (s), wrench (6,) and flags of the newest sample; None where there is none yet."""

    def deliver(self, buffer: WrenchSink, stopping: threading.Event) -> None:
        """Ask, and write what is new."""
        last_s: float | None = None
        pause_s = 1.0 / (_PER_SAMPLE * self.info.rate_hz)
        while not stopping.wait(pause_s):
            sample = self.newest()
            if sample is None or sample[0] == last_s:
                continue
            time_s, wrench, flags = sample
            if last_s is not None and time_s < last_s:
                buffer.new_epoch()  # its controller was started anew
            last_s = time_s
            buffer.push(np.asarray(wrench, dtype=np.float64), time_s, flags=flags)


class PolledMotion:
    """A motion that runs in a controller, which tells on request whether it has ended.

    Parameters
    ----------
    start_time_s : float or None
        The controller's time at the command, where the samples bear it too.
    has_ended : callable
        Asked until it says True; what it raises is the motion's error.
    report : mapping
        See `Motion.report`.
    error_ends : bool
        Whether what `has_ended` raises has ended the motion; else nobody knows, and it counts as going on.
    """

    def __init__(
        self,
        start_time_s: float | None,
        has_ended: Callable[[], bool],
        report: Mapping[str, Any],
        *,
        error_ends: bool,
    ) -> None:
        self.start_time_s = start_time_s
        self.start_host_ns = host_ns()
        self.error: str | None = None
        self._has_ended = has_ended
        self._report = dict(report)
        self._error_ends = error_ends
        self._done = False

    def finished(self) -> bool:
        """Tell whether the controller has ended the motion."""
        if not self._done:
            try:
                self._done = bool(self._has_ended())
            except Exception as error:  # whatever the robot's library raises
                self._done, self.error = self._error_ends, f"{type(error).__name__}: {error}"
        return self._done

    def report(self) -> Mapping[str, Any]:
        """Return what was commanded."""
        return self._report
