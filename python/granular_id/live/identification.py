"""Pushes named while they happen: one answer per push, provisional ones on the way, and a loop over decisions."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from granular_id._checks import argument_error, whole_number
from granular_id._core import GranularIdError
from granular_id.features import FeatureSpec
from granular_id.identifier import N_CHECKPOINTS, Identifier
from granular_id.live.capture import Capture, CaptureState
from granular_id.live.limits import Limits
from granular_id.live.outcome import CaptureError, FailureReason, Push
from granular_id.live.push import Attempt, Pushes, Step
from granular_id.live.recorder import utc_stamp
from granular_id.live.robot import Robot
from granular_id.live.session import Session
from granular_id.live.setup import Setup, setup_of, starts_exactly
from granular_id.live.source import WrenchSource
from granular_id.live.stream import Stream, opened
from granular_id.live.trigger import Trigger
from granular_id.live.view import Views
from granular_id.recording import rest_zero

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from granular_id.identifier import Decision

__all__ = ["LiveIdentifier", "identify"]


class LiveIdentifier(Session):
    """Waits for a push, names the material while it lasts, and waits for the next one.

    A model that was trained on recordings tared by their rest (`Dataset.tare`) gets each push tared in the same way, by
    the rest before its motion, with the same bits; what is stored (`Push.recording`) is what was measured.

    Parameters
    ----------
    stream : Stream
        From `opened`; of the rate the model was trained at.
    model : Identifier or path-like
        Trained, or the file of a model.
    setup : Setup, optional
        Who moves and what starts a capture; default: as the source suggests, see `setup_of`.
    early : bool, default False
        End a push as soon as the model's early rule is met. The rule is looked at as often as when it was calibrated,
        160 times in a whole push: who looks more often finds more answers that are early and wrong.
    pre_s : float, optional
        Rest before the trigger that belongs to a recording. Default: what the model was trained with.
    views : Views, optional
        What shows it all.
    direction, speed_m_s
        Of the push, see `Robot.move_line`; the paper's 0.03 m/s.
    accept : str or sequence of str, default ()
        What may differ from the training though it is refused otherwise: "frame", "transform", "sign" or
        "units". It is then a warning.
    **limits
        What a push must be like, see `Limits`.

    Raises
    ------
    ValueError
        The model is for another rate, other axes or units, another frame or sign, does not know how much rest it was
        trained with, or was tared by more of it than a push begins with.

    Attributes
    ----------
    differences : tuple of str
        What else is not as in the training (sensor, filter, trigger ...), by name; each decision warns of it.
    session : str
        Of the recordings of its pushes (`Push.recording`): the time of day at which it was made.

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
        model: Identifier | str | os.PathLike[str],
        setup: Setup | None = None,
        *,
        early: bool = False,
        pre_s: float | None = None,
        views: Views | None = None,
        direction: Sequence[float] = (1.0, 0.0, 0.0),
        speed_m_s: float = 0.03,
        accept: str | Sequence[str] = (),
        **limits: Any,
    ) -> None:
        super().__init__(stream, model, Limits(**limits), views=views, accept=accept)
        setup = setup_of(stream.source) if setup is None else setup
        if not isinstance(setup, Setup):
            problem = f"must come from setup_of(stream.source, robot), got a {type(setup).__name__}"
            raise argument_error(TypeError, "setup", problem)
        self._early = early
        self._n_moments = 0  # of this push, at which the rule for early answers was calibrated
        # Most of the work on multi-band features is done for each answer, others have grown with the rows.
        self._grows = isinstance(self.model.spec, FeatureSpec)
        self._pushes = Pushes(
            stream,
            setup.robot,
            setup.trigger,
            self._limits,
            n_samples=self.model.n_samples,
            pre_s=_rest_of(self.model, pre_s),
            direction=direction,
            speed_m_s=speed_m_s,
        )
        capture = self._pushes.capture()
        facts: dict[str, Any] = {"trigger": getattr(capture.trigger, "name", None)}
        if starts_exactly(setup.robot):
            facts["robot"] = {"speed_m_s": speed_m_s}
        self._n_tare = self._compare(facts, capture.n_pre / capture.rate_hz)
        self._zero = np.zeros(len(stream.info.axes))

    def push(self, on_decision: Callable[[Decision], object] | None = None) -> Push:
        """Wait for a push and name its material.

        Parameters
        ----------
        on_decision : callable, optional
            Called with each new provisional decision: whenever rows of the push have come in, with multi-band features
            at most as often as the early rule is looked at.

        Returns
        -------
        Push
            Also where the capture failed: `Push.reason` says why.

        Raises
        ------
        CaptureError
            The robot could not be stopped, or may not move: after a limit, an error or three failures, see `resume`.
        """
        return self._push(on_decision)

    @property
    def why_none(self) -> str:
        """Why there was no answer, where the source came to its end without one."""
        return "the source came to its end before any push was answered"

    def resume(self) -> None:
        """Let the robot move again after a limit, an error or three failures, from where the tool stands now."""
        self._pushes.resume()

    def _push(
        self, on_decision: Callable[[Decision], object] | None = None, *, patient: bool = False
    ) -> Push:
        attempt = next(self._pushes)
        capture = attempt.capture
        self._begin()
        self._n_moments = 0
        decision: Decision | None = None
        with attempt:
            for step in attempt:
                n_moments = self._n_moments
                if (new := self._take(step, capture)) is not None:
                    decision = new
                    if on_decision is not None:
                        on_decision(new)
                    is_due = self._n_moments > n_moments and capture.reason is None
                    if self._early and new.sure and is_due:
                        attempt.answered = True
                        break
                if not capture.state.is_over and self._views.wants_snapshot():
                    self._show(capture.state.value, decision)
        return self._finished(attempt, decision, patient=patient)

    def _answers(self, n: int | None) -> Iterator[Push]:
        while n is None or self.n_answered < n:
            push = self._push(patient=n is None)
            if n is None and self._at_end(push):
                return
            waits = n is None and push.reason is FailureReason.NO_TRIGGER
            if push.reason is not None and push.reason.is_lasting and not waits:
                raise CaptureError(push.reason, push.text)
            yield push

    def _at_end(self, push: Push) -> bool:
        """Whether there was no push to name, because the source has no more rows."""
        return push.reason is FailureReason.SOURCE and self.stream.health().finished

    def _take(self, step: Step, capture: Capture) -> Decision | None:
        self._builder.rows(step.block)
        if not len(step.rows):
            return None
        rows = self._tared(step.rows, capture.n_pre)
        is_first = not self._answer.n_seen
        self._answer.push(rows)
        self._builder.captured(rows)
        # The first rows came in earlier blocks as well; putting all together takes the longer, the longer it lasts.
        if is_first or step.block.flags.any() or step.block.missing_before.any():
            self._warn_of(capture.rows.flags[-len(rows) :])
        self._warn_of_lag()
        moment = self._answer.n_seen * N_CHECKPOINTS // self.model.n_samples
        is_due, self._n_moments = moment > self._n_moments, moment
        return self._answer.decision() if is_due or self._grows or self._answer.is_complete else None

    def _tared(self, rows: NDArray[np.float64], n_pre: int) -> NDArray[np.float64]:
        """Take the rest off, as in the training: the first rows of a push hold all of it."""
        if not self._n_tare:
            return rows
        if not self._answer.n_seen:
            self._zero = rest_zero(rows[n_pre - self._n_tare : n_pre])
        return rows - self._zero

    def _finished(self, attempt: Attempt, decision: Decision | None, *, patient: bool) -> Push:
        capture, truth = attempt.capture, attempt.truth
        failed = capture.state is CaptureState.FAILED and not attempt.answered
        push = Push(decision, truth=truth, timing=capture.timing)
        push = Push(None, capture.reason, capture.text, truth) if failed else push
        at_end = self._at_end(push)
        self.n_pushes += not at_end
        self._count(push)
        # A replay that is over is no failure, and where nobody pushes there is nothing to say: there was no push.
        nobody = push.reason is FailureReason.NO_TRIGGER
        if not nobody and not at_end:
            self._builder.end_capture(push)
        if not (nobody and patient):
            self._show("ended" if at_end else "failed" if failed else "complete", push.decision, push.text)
        if capture.state is not CaptureState.COMPLETE or push.decision is None:
            return push
        name = f"push_{utc_stamp()}_{self.n_pushes}"
        facts = attempt.facts(truth) | {"answer": push.decision.to_dict()}
        return replace(push, recording=capture.recording(truth, session=self.session, name=name, meta=facts))


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
        Who moves and what starts a recording, see `granular_id.live.setup_of`.
    early : bool, default False
        Answer as soon as the model's early rule is met.
    on_failure : {"raise", "skip"}, default "raise"
        A push that could not be captured (a gap, saturation ...): raise CaptureError, or go on with the next.
        Always raised: a limit of force or torque that was passed, a source or robot that fails, three failures of a
        robot in a row, a signal (see `FailureReason.is_lasting`).
    **settings
        `pre_s`, `views`, `accept` and the limits of `LiveIdentifier`.

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
        raise GranularIdError(f"on_failure must be 'raise' or 'skip', got {on_failure!r}")
    n = None if n is None else whole_number("n", n)
    model = model if isinstance(model, Identifier) else Identifier.load(model)

    def answers() -> Iterator[Decision]:
        with opened(source) as stream, ExitStack() as stack:
            setup = setup_of(stream.source, robot, trigger)
            if isinstance(robot, str):  # else the robot is the caller's
                stack.callback(setup.close)
            for push in LiveIdentifier(stream, model, setup, early=early, **settings).pushes(n):
                if push.decision is not None:
                    yield push.decision
                elif push.reason is not None and on_failure == "raise":
                    raise CaptureError(push.reason, push.text)

    return answers()


def _rest_of(model: Identifier, pre_s: float | None) -> float:
    """Return the rest before the trigger: what the model was trained with."""
    rest_s = model.lead_s if pre_s is None else pre_s
    if rest_s is None:
        problem = (
            "must be given: the seconds of rest that each recording of the training begins with, which they do not "
            "state (recorded here, 0.25); or answer at each hop (--hop-s, in Python HopIdentifier)"
        )
        raise argument_error(GranularIdError, "pre_s", problem)
    if model.lead_s is not None and abs(rest_s - model.lead_s) > 0.5 / model.rate_hz:
        problem = f"is {rest_s:g}, but the model was trained with {model.lead_s:g} s of rest: leave it out"
        raise argument_error(GranularIdError, "pre_s", problem)
    return rest_s
