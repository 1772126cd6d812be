"""Answers that go on: every so many seconds one about the newest samples, without pushes."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence

from granular_id._checks import argument_error, finite_number
from granular_id._core import GranularIdError
from granular_id._text import counted
from granular_id.identifier import Identifier
from granular_id.live.capture import wrong_rate
from granular_id.live.clock import WAIT_S
from granular_id.live.limits import Limits
from granular_id.live.outcome import CaptureError, FailureReason, Push
from granular_id.live.rows import HoppingWindows, Rows
from granular_id.live.session import Session
from granular_id.live.stream import Stream
from granular_id.live.view import Views

__all__ = ["HopIdentifier"]

_SILENT_S = 5.0
"""A source that delivers nothing for so long has failed; pauses of its own come on top."""


class HopIdentifier(Session):
    """Answers every so many seconds about the newest samples, as `Identifier.predict_over` does.

    Nobody waits for a trigger and no robot moves: for recordings of a robot that drives, and models of windows of them.
    Samples that are missing or overwritten, or of another recording, begin the window anew; one at another rate gets no
    answer.

    Parameters
    ----------
    stream : Stream
        From `opened`; of the rate the model was trained at.
    model : Identifier or path-like
        Trained, or the file of a model.
    hop_s : float
        From one answer to the next.
    views : Views, optional
        What shows it all.
    accept : str or sequence of str, default ()
        What may differ from the training though it is refused otherwise: "frame", "transform", "sign" or "units".
    max_gap, rate_tolerance, max_lag_s
        See `Limits`.

    Raises
    ------
    ValueError
        As `LiveIdentifier`, or `hop_s` is less than a sample.

    Examples
    --------
    >>> import granular_id as gid
    >>> from granular_id.live import HopIdentifier, ReplaySource, opened
    >>> data = gid.synthesize(["rice", "fine sugar"], n_per_class=8, duration_s=1)
    >>> model = gid.Identifier.fit(data.windows(0.5), "hfmh", estimate=False)
    >>> with opened(ReplaySource(data[:1], speed=20.0)) as stream:
    ...     [push.decision.label for push in HopIdentifier(stream, model, 0.25).pushes()]
    ['rice', 'rice', 'rice']
    """

    def __init__(
        self,
        stream: Stream,
        model: Identifier | str | os.PathLike[str],
        hop_s: float,
        *,
        views: Views | None = None,
        accept: str | Sequence[str] = (),
        max_gap: int = 0,
        rate_tolerance: float = 1e-3,
        max_lag_s: float = 0.02,
    ) -> None:
        limits = Limits(max_gap=max_gap, rate_tolerance=rate_tolerance, max_lag_s=max_lag_s)
        n_hop = round(finite_number("hop_s", hop_s, positive=True) * stream.info.rate_hz)
        if n_hop < 1:
            problem = f"={hop_s:g} is less than a sample: at least {1 / stream.info.rate_hz:g}"
            raise argument_error(GranularIdError, "hop_s", problem)
        super().__init__(stream, model, limits, views=views, accept=accept, hop_s=n_hop / stream.info.rate_hz)
        self._failed = ""
        self._window_s = self.model.n_samples / self.model.rate_hz
        self._windows = HoppingWindows(self.model.n_samples, n_hop, limits.max_gap)
        self._compare({}, None)

    def _answers(self, n: int | None) -> Iterator[Push]:
        windows = self._windows
        windows.restart()
        reader, clock = self.stream.buffer.reader(from_oldest=True), self.stream.clock
        newest: Push | None = None
        heard_ns, ended = clock.now_ns(), False
        while not ended and (n is None or self.n_answered < n):
            clock.wait(reader, WAIT_S)
            block = reader.read()
            if len(block):
                heard_ns = clock.now_ns()
            elif fault := self.stream.fault(1e-9 * (clock.now_ns() - heard_ns), _SILENT_S):
                ended = fault.reason is FailureReason.SOURCE and self.stream.health().error is None
                if not ended:
                    raise CaptureError(*fault)
            self._builder.rows(block)
            for window in windows.feed(block):
                newest = self._answered(window, newest)
                yield newest
                if self.n_answered == n:
                    break
            if newest is not None and windows.begins_anew:
                newest = None
            if ended or self._views.wants_snapshot():
                self._show_hop(newest, ended=ended)
        if not ended:
            self._show_hop(newest, ended=False)
        elif n is not None:
            text = f"the source came to its end after {counted(self.n_answered, 'answer')}"
            raise CaptureError(FailureReason.SOURCE, text if self.n_answered else self.why_none)
        elif windows.n_lost and not self.n_pushes:
            yield Push(None, FailureReason.GAP, self.lost)

    def _show_hop(self, newest: Push | None, *, ended: bool) -> None:
        if ended:
            self._show("ended", None if newest is None else newest.decision)
        elif newest is None:
            first = f"the first answer comes after {self._window_s:g} s of signal"
            self._show("arming", None, "; ".join(filter(None, (first, self.lost))))
        else:
            self._show("failed" if newest.decision is None else "answering", newest.decision, newest.text)

    def summary(self) -> str:
        """Sum up all answers so far in one line, and how often rows were lost."""
        return "; ".join(filter(None, (super().summary(), self.lost)))

    @property
    def lost(self) -> str:
        """How often a window began anew because rows were lost, and what that means where no answer came."""
        if not (n_lost := self._windows.n_lost):
            return ""
        needs = f"; a window needs {self._window_s:g} s without loss (max_gap)"
        return f"rows were lost {counted(n_lost, 'time')}{'' if self.n_pushes else needs}"

    @property
    def why_none(self) -> str:
        """Why there was no answer, where the source came to its end without one."""
        if why := self._failed or self.lost:
            return f"the source came to its end without an answer: {why}"
        return f"the source came to its end before {self._window_s:g} s of signal were there in one piece"

    def _answered(self, window: Rows, before: Push | None) -> Push:
        """Name the material of a window: the answer that its rows get alone."""
        time_s = float(window.time_s[-1])
        truth = self.stream.truth_at(time_s)
        self.n_pushes += 1
        self._failed = wrong_rate(window, self.stream.info, self._limits)
        if self._failed:
            push = Push(None, FailureReason.RATE, self._failed, truth, time_s)
        else:
            self._begin()
            self._warn_of_lag()
            self._warn_of(window.flags)
            self._answer.push(window.wrench)
            self._builder.captured(window.wrench)
            push = Push(self._answer.decision(), truth=truth, time_s=time_s)
            self._count(push)
        if before is None or _name(before) != _name(push):
            self._builder.end_capture(push)  # the history has changes only
        return push


def _name(push: Push) -> object:
    if push.decision is None:
        return push.reason
    return None if push.decision.unknown else push.decision.label
