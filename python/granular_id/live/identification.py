"""Pushes named while they happen: one answer per push, provisional ones on the way."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from granular_id.identifier import Identifier, StreamingIdentifier
from granular_id.live.capture import Capture
from granular_id.live.capture_state import CaptureError, CaptureState, FailureReason
from granular_id.live.drive import Step, drive, motion_duration_s
from granular_id.live.robot import Robot, checked_move
from granular_id.live.setup import Setup, setup_of
from granular_id.live.snapshot_builder import SnapshotBuilder
from granular_id.live.source import WrenchSource
from granular_id.live.stream import Stream, opened
from granular_id.live.trigger import Trigger
from granular_id.live.view import Views
from granular_id.recording import SampleFlag

if TYPE_CHECKING:
    from granular_id.identifier.decision import Decision

__all__ = ["LiveIdentifier", "Push", "identify"]

_PRE_S = 0.25


@dataclass(frozen=True)
class Push:
    """What came of one push.

    Attributes
    ----------
    decision : Decision or None
        The answer; None where the capture failed before there was one.
    reason : FailureReason or None
        Why the capture failed, if it did; `text` says it in words.
    text : str
    truth : str or None
        The material, where the source knows it: simulations and recordings played again.
    """

    decision: Decision | None
    reason: FailureReason | None
    text: str
    truth: str | None

    @property
    def is_right(self) -> bool | None:
        """Whether the answer is the truth; None where either is missing."""
        return None if self.decision is None or self.truth is None else self.decision.label == self.truth


class LiveIdentifier:
    """Waits for a push, names the material while it lasts, and waits for the next one.

    Parameters
    ----------
    stream : Stream
        From `opened`; of the rate the model was trained at.
    model : Identifier
    setup : Setup, optional
        Who moves and what starts a capture; default: as the source suggests, see `setup_of`.
    early : bool, default False
        End a push as soon as the answer can no longer change or the model's early rule is met.
    pre_s : float, optional
        Rest before the trigger that belongs to a recording. Default: what the model was trained with.
    views : Views, optional
        What shows it all.
    direction, speed_m_s
        Of the push, see `Robot.move_line`; the paper's 0.03 m/s.
    **limits
        `max_gap`, `allow_saturated`, `rate_tolerance`, `max_lag_s`, `lag_patience_s`, `timeout_s` of `Capture`.

    Raises
    ------
    ValueError
        The model is for another rate or other axes, or does not know how much rest it was trained with.

    Examples
    --------
    >>> import granular_id as gid
    >>> from granular_id.live import LiveIdentifier, opened
    >>> data = gid.synthesize(["rice", "fine sugar"], n_per_class=8, duration_s=1)
    >>> model = gid.Identifier.fit(data, "hfmh", estimate=False)
    >>> with opened("sim:rice?seed=3&speed=20") as stream:
    ...     push = LiveIdentifier(stream, model, pre_s=0.2).push()
    >>> push.decision.label, push.truth
    ('rice', 'rice')
    """

    def __init__(
        self,
        stream: Stream,
        model: Identifier,
        setup: Setup | None = None,
        *,
        early: bool = False,
        pre_s: float | None = None,
        views: Views | None = None,
        direction: Sequence[float] = (1.0, 0.0, 0.0),
        speed_m_s: float = 0.03,
        **limits: Any,
    ) -> None:
        refuse_other_stream(model, stream)
        rest_s = model.lead_s if pre_s is None else pre_s
        if rest_s is None:
            raise ValueError(
                "pre_s must be given: the recordings that the model was trained on do not say how much rest they "
                f"begin with (recorded here, it is {_PRE_S:g} s)"
            )
        self.stream, self.model = stream, model
        self.n_pushes = self.n_answered = self.n_right = 0
        self.knows_truth = False
        self._setup = setup_of(stream.source) if setup is None else setup
        self._rest_s = rest_s
        self._early, self._limits = early, limits
        self._move: dict[str, Any] = {"direction": direction, "speed_m_s": speed_m_s}
        self._views = Views([]) if views is None else views
        self._reader = stream.buffer.reader(from_oldest=True)
        self._answer = StreamingIdentifier(model)
        info = stream.info
        self._builder = SnapshotBuilder(
            info.rate_hz,
            model.spec,
            model.classes,
            n_samples=model.n_samples,
            source=info.name,
            synthetic=info.synthetic,
        )
        # Refused before anything moves.
        checked_move(direction, speed_m_s, motion_duration_s(self.new_capture()))

    def new_capture(self) -> Capture:
        """Return the capture of the next push; nothing is read yet."""
        info = self.stream.info
        return Capture(
            info.rate_hz,
            n_samples=self.model.n_samples,
            pre_s=self._rest_s,
            trigger=self._setup.trigger(),
            info=info,
            utc_at_zero_s=self.stream.utc_at_zero_s,
            **self._limits,
        )

    def push(self, on_decision: Callable[[Decision], object] | None = None) -> Push:
        """Wait for a push and name its material.

        Parameters
        ----------
        on_decision : callable, optional
            Called with the provisional decision whenever rows of the push have come in.

        Returns
        -------
        Push
            Also where the capture failed: `Push.reason` says why.
        """
        capture, warned = self.new_capture(), set[str]()
        self._answer.reset()
        self._builder.begin_capture()
        decision: Decision | None = None
        steps = drive(self.stream, capture, robot=self._setup.robot, reader=self._reader, **self._move)
        with closing(steps):
            for step in steps:
                decision = self._take(step, capture, warned) or decision
                if len(step.rows) and decision is not None and on_decision is not None:
                    on_decision(decision)
                if self._early and decision is not None and (decision.sure or decision.settled):
                    break
                if not capture.state.is_over and self._views.wants_snapshot():
                    self._show(capture, decision)
        return self._finished(capture, decision)

    def _take(self, step: Step, capture: Capture, warned: set[str]) -> Decision | None:
        self._builder.rows(step.block)
        if not len(step.rows):
            return None
        self._answer.push(step.rows)
        self._builder.captured(step.rows)
        for warning in _warnings(capture, step, self.stream.lag_s()):
            if warning not in warned:
                warned.add(warning)
                self._answer.warn(warning)
        return self._answer.decision()

    def _finished(self, capture: Capture, decision: Decision | None) -> Push:
        truth = getattr(self.stream.source, "truth", None)
        answered_early = self._early and decision is not None and capture.reason is FailureReason.INTERRUPTED
        failed = capture.state is CaptureState.FAILED and not answered_early
        push = Push(
            None if failed else decision,
            capture.reason if failed else None,
            capture.text if failed else "",
            truth,
        )
        self.n_pushes += 1
        if push.decision is not None:
            self.n_answered += 1
            self.knows_truth |= truth is not None
            self.n_right += bool(push.is_right)
        self._show(capture, push.decision, hint=push.text, state="failed" if failed else "complete")
        return push

    def _show(
        self, capture: Capture, decision: Decision | None, *, hint: str = "", state: str | None = None
    ) -> None:
        self._views.publish(
            self._builder.build(
                capture.state.value if state is None else state,
                decision,
                hint=hint,
                lag_s=self.stream.lag_s(),
                counters=self.stream.health().counters,
                n_captures=self.n_answered,
                n_correct=self.n_right if self.knows_truth else None,
            )
        )


def identify(
    source: str | WrenchSource,
    model: Identifier | str | os.PathLike[str],
    *,
    n: int | None = None,
    robot: str | Robot | None = "auto",
    trigger: str | Callable[[], Trigger] = "auto",
    early: bool = False,
    on_failure: str = "raise",
    **settings: Any,
) -> Iterator[Decision]:
    """Name the material of one push after another, live.

    Parameters
    ----------
    source : str or WrenchSource
        ``"rdt://192.168.1.1"``, ``"sim:unknown"`` ..., see `granular_id.live.open_source`.
    model : Identifier or path-like
        Trained, or the file of a model.
    n : int, optional
        Number of answers; default: on and on, until the source comes to its end.
    robot, trigger
        Who moves and what starts a capture, see `granular_id.live.setup_of`.
    early : bool, default False
        Answer as soon as the answer can no longer change or the model is sure enough.
    on_failure : {"raise", "skip"}, default "raise"
        A push that could not be captured (a gap, saturation ...): raise CaptureError, or go on with the next.
        A source or robot that fails is always raised.
    **settings
        `pre_s`, `views` and the limits of `LiveIdentifier`.

    Yields
    ------
    Decision
        Final, or an early one.

    Raises
    ------
    CaptureError
        See `on_failure`.
    ValueError, TypeError, OSError, ImportError
        From opening source or model, or where these do not fit each other.

    Examples
    --------
    >>> import granular_id as gid
    >>> data = gid.synthesize(["rice", "fine sugar"], n_per_class=8, duration_s=1)
    >>> model = gid.Identifier.fit(data, "hfmh", estimate=False)
    >>> for decision in gid.identify("sim:rice?seed=3&speed=20", model, n=1, pre_s=0.2):
    ...     print(decision.label, decision.final)
    rice True
    """
    if on_failure not in ("raise", "skip"):
        raise ValueError(f"on_failure must be 'raise' or 'skip', got {on_failure!r}")
    if n is not None and (isinstance(n, bool) or not isinstance(n, int) or n < 1):
        raise ValueError(f"n must be a whole number of at least 1, or None, got {n!r}")
    trained = model if isinstance(model, Identifier) else Identifier.load(model)
    return _answers(source, trained, n, (robot, trigger), early, on_failure, settings)


def _answers(
    source: str | WrenchSource,
    model: Identifier,
    n: int | None,
    mover: tuple[str | Robot | None, str | Callable[[], Trigger]],
    early: bool,
    on_failure: str,
    settings: dict[str, Any],
) -> Iterator[Decision]:
    with opened(source) as stream:
        live = LiveIdentifier(stream, model, setup_of(stream.source, *mover), early=early, **settings)
        while n is None or live.n_answered < n:
            push = live.push()
            if push.decision is not None:
                yield push.decision
                continue
            if push.reason is FailureReason.SOURCE and n is None and stream.health().finished:
                return
            if push.reason is not None and (on_failure == "raise" or push.reason.is_lasting):
                raise CaptureError(push.reason, push.text)


def refuse_other_stream(model: Identifier, stream: Stream) -> None:
    """Refuse a model that was trained at another rate, or on other axes, than a stream has."""
    rate_hz = stream.info.rate_hz
    if abs(rate_hz / model.rate_hz - 1) > 1e-3:
        raise ValueError(
            f"the model is for {model.rate_hz:g} Hz, {stream.info.name} delivers {rate_hz:g} Hz: train one at that "
            "rate, or set the sensor's"
        )
    if len(model.axes) != 6:
        raise ValueError(f"the model is for the axes {' '.join(model.axes)}; live sources have six")


def _warnings(capture: Capture, step: Step, lag_s: float) -> Iterator[str]:
    flags = capture.rows.flags[-len(step.rows) :]
    if (flags & SampleFlag.GAP_FILLED).any():
        yield "gap"
    if (flags & SampleFlag.SATURATED).any():
        yield "saturation"
    if lag_s > capture.max_lag_s:
        yield "lag"
