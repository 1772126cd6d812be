"""Answers that go on: every so many seconds one about the newest samples, without pushes."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence

from granular_id._checks import argument_error, finite_number, whole_number
from granular_id._text import counted
from granular_id.identifier import Identifier
from granular_id.live.capture import wrong_rate
from granular_id.live.clock import WAIT_S
from granular_id.live.limits import Limits
from granular_id.live.outcome import CaptureError, FailureReason, Push
from granular_id.live.rows import HoppingWindows, Rows
from granular_id.live.session import Session
from granular_id.live.stream import Stream, left_out
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
            raise argument_error(ValueError, "hop_s", problem)
        super().__init__(stream, model, limits, views=views, accept=accept, hop_s=n_hop / stream.info.rate_hz)
        self._n_hop, self._n_lost, self._failed = n_hop, 0, ""
        self._window_s = self.model.n_samples / self.model.rate_hz
        self._compare({}, None)

    def pushes(self, n: int | None = None) -> Iterator[Push]:
        """Answer at one hop after another.

        Parameters
        ----------
        n : int, optional
            Number of answers; default: on and on, until the source comes to its end.

        Yields
        ------
        Push
            With its `Push.time_s`; also where the rate was another.

        Raises
        ------
        CaptureError
            Nobody delivers, or the source ended before `n` answers.
        TypeError, ValueError
            `n` is no whole number of at least 1.
        """
        return self._at_hops(None if n is None else whole_number("n", n))

    def _at_hops(self, n: int | None) -> Iterator[Push]:
        windows = HoppingWindows(self.model.n_samples, self._n_hop, self._limits.max_gap)
        reader, clock = self.stream.buffer.reader(from_oldest=True), self.stream.clock
        silent_s, n_lost = _SILENT_S + self.stream.pause_s, self._n_lost
        newest: Push | None = None
        heard_ns, finished = clock.now_ns(), False
        while n is None or self.n_answered < n:
            clock.wait(reader, WAIT_S)
            health = self.stream.health()  # before the rows: what it wrote last was read then
            block = reader.read()
            if len(block):
                heard_ns = clock.now_ns()
            elif health.error is not None:
                raise CaptureError(FailureReason.SOURCE, f"the source died: {health.error}")
            elif health.finished:
                finished = True
                break
            elif clock.now_ns() - heard_ns > 1e9 * silent_s:
                said = f"{self.stream.info.name} delivered nothing for {silent_s:g} s"
                raise CaptureError(FailureReason.NO_ROWS, said + left_out(health.counters))
            self._builder.rows(block)
            for window in windows.feed(block):
                newest = self._answered(window, newest)
                yield newest
                if self.n_answered == n:
                    break
            self._n_lost = n_lost + windows.n_lost
            if newest is not None and windows.begins_anew:
                newest = None
            if self._views.wants_snapshot():
                self._show_hop("answering", newest)
        self._show_hop("ended" if finished else "answering", newest)
        if finished and n is not None:
            said = f"the source came to its end after {counted(self.n_answered, 'answer')}"
            raise CaptureError(FailureReason.SOURCE, said if self.n_answered else self.why_none)
        if finished and self._n_lost and not self.n_pushes:
            yield Push(None, FailureReason.GAP, self.lost)

    def _show_hop(self, state: str, newest: Push | None) -> None:
        if state == "ended":
            self._show(state, None if newest is None else newest.decision)
        elif newest is None:
            first = f"the first answer comes after {self._window_s:g} s of signal"
            self._show("arming", None, "; ".join(filter(None, (first, self.lost))))
        else:
            self._show("failed" if newest.decision is None else state, newest.decision, newest.text)

    @property
    def lost(self) -> str:
        """How often a window began anew because rows were lost, and what that means where no answer came."""
        if not self._n_lost:
            return ""
        needs = f"; a window needs {self._window_s:g} s without loss (max_gap)"
        return f"rows were lost {counted(self._n_lost, 'time')}{'' if self.n_pushes else needs}"

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
