"""Pushes named while they happen: one answer per push, provisional ones on the way."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from granular_id._checks import argument_error, finite_number, whole_number
from granular_id._text import counted
from granular_id.features import FeatureSpec
from granular_id.identifier import N_CHECKPOINTS, Identifier, StreamingIdentifier, setup_comparison
from granular_id.live.capture import CaptureError, CaptureState, FailureReason, Push, meta_of
from granular_id.live.drive import (
    LIMITS,
    Step,
    capture_from,
    check_limits,
    drive,
    limits_matter,
    motion_duration_s,
    push_facts,
    step_warnings,
    truth_of,
    was_cut_short,
)
from granular_id.live.priority import warn_if_refused
from granular_id.live.recorder import utc_stamp
from granular_id.live.robot import Motion, checked_move
from granular_id.live.rows import HoppingWindows, Rows
from granular_id.live.setup import Setup, setup_of, starts_exactly
from granular_id.live.snapshot import SnapshotBuilder
from granular_id.live.stream import Stream, checked_stream, left_out
from granular_id.live.trigger import ManualTrigger
from granular_id.live.view import Views
from granular_id.live.wrench import live_tare
from granular_id.recording import Recording, SampleFlag, Setup as RecordedSetup, refuse_or_list, rest_zero

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from granular_id.identifier import Decision
    from granular_id.live.capture import Capture

__all__ = ["LiveIdentifier", "refuse_with_hop", "trained_model"]

_PRE_S = 0.25

_WAIT_S, _SILENT_S = 0.02, 5.0
"""How long to wait for a row at a time; a source that delivers nothing for so long has failed."""

_DIRECTION, _SPEED_M_S = (1.0, 0.0, 0.0), 0.03
_OF_WINDOWS = ("max_gap", "rate_tolerance", "max_lag_s")

_VIEWS_WAIT = "with limits of force, views wait while the robot moves"

_SYNTHETIC_MODEL = (
    "the model was trained on SYNTHETIC recordings: its answers say nothing about real materials"
)


class LiveIdentifier:
    """Waits for a push, names the material while it lasts, and waits for the next one.

    A model that was trained on recordings tared by their rest (`Dataset.tare`) gets each push tared in the same way, by
    the rest before its motion, with the same bits; what is kept (`Push.recording`) is what was measured.

    Use it within `granular_id.live.stop_on_signals`, so that the robot is also stopped on SIGTERM and SIGHUP.

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
    hop_s : float, optional
        Answer every so many seconds about the newest samples, as `Identifier.predict_over` does, instead of once a
        push: nobody waits for a trigger and no robot moves. Samples that are missing or overwritten, or of another
        recording, begin the window anew; one at another rate gets no answer. For models of windows.
    views : Views, optional
        What shows it all.
    direction, speed_m_s
        Of the push, see `Robot.move_line`; the paper's 0.03 m/s.
    accept : str or sequence of str, default ()
        What may differ from the training though it is refused otherwise: "frame", "transform", "sign" or
        "units". It is then a warning.
    **limits
        `max_gap`, `allow_saturated`, `rate_tolerance`, `max_lag_s`, `lag_patience_s`, `timeout_s`, `max_force_n`,
        `max_torque_n_m` of `Capture`; with `hop_s` `max_gap`, `rate_tolerance` and `max_lag_s`.

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
        hop_s: float | None = None,
        views: Views | None = None,
        direction: Sequence[float] = _DIRECTION,
        speed_m_s: float = _SPEED_M_S,
        accept: str | Sequence[str] = (),
        **limits: Any,
    ) -> None:
        check_limits(limits)
        model = trained_model(model)
        _refuse_other_stream(model, stream)
        self._n_hop = 0
        if hop_s is not None:
            refuse_with_hop(
                early=early,
                pre_s=pre_s is not None,
                setup=setup is not None,
                direction=not np.array_equal(direction, _DIRECTION),
                speed_m_s=speed_m_s != _SPEED_M_S,
                **{name: limits.get(name) is not None for name in LIMITS if name not in _OF_WINDOWS},
            )
            self._n_hop, setup = _hop_of(hop_s, model.rate_hz), Setup(None, ManualTrigger)
        rest_s = 0.0 if hop_s is not None else model.lead_s if pre_s is None else pre_s
        if rest_s is None:
            problem = (
                "must be given: the seconds of rest that each recording of the training begins with, which they do not "
                f"state (recorded here, {_PRE_S:g}); or answer at each hop with hop_s"
            )
            raise argument_error(ValueError, "pre_s", problem)
        if pre_s is not None and model.lead_s is not None and abs(pre_s - model.lead_s) > 0.5 / model.rate_hz:
            problem = f"is {pre_s:g}, but the model was trained with {model.lead_s:g} s of rest: leave it out"
            raise argument_error(ValueError, "pre_s", problem)
        self.stream, self.model, self.session = stream, model, utc_stamp()
        self.n_pushes = self.n_answered = self.n_right = self.n_unknown = 0
        self.knows_truth = False
        self._setup = setup_of(stream.source) if setup is None else setup
        self._rest_s = rest_s
        self._early, self._limits = early, limits
        self._move: dict[str, Any] = {"direction": direction, "speed_m_s": speed_m_s}
        self._views = Views([]) if views is None else views
        self._reader = stream.buffer.reader(from_oldest=True)
        self._answer = StreamingIdentifier(model)
        self._n_looks = self._n_moments = self._n_lost = 0
        self._failed = ""
        self._back_first = False
        # Most of the work on multi-band features is done for each answer, others have grown with the rows.
        self._grows = isinstance(model.spec, FeatureSpec)
        info = stream.info
        facts: dict[str, Any] = {}
        self._limiting = capture = self.new_capture()  # checks the limits
        max_lag_s = capture.max_lag_s
        if limits_matter(stream, self._setup.robot, capture):
            warn_if_refused()
        if not self._n_hop:
            facts = {"trigger": getattr(capture.trigger, "name", None)}
            # Refused before anything moves.
            checked_move(direction, speed_m_s, motion_duration_s(capture))
            if starts_exactly(self._setup.robot):
                facts["robot"] = {"speed_m_s": speed_m_s}
        meta = meta_of(info, facts)
        compared, now = setup_comparison(model.core), RecordedSetup.of(meta)
        # Recordings that are played again may be of several set-ups.
        each = [now.completed(one) for one in getattr(stream.source, "setups", ())] or [now]
        self._n_tare, each = live_tare(model, each, None if self._n_hop else capture.n_pre / capture.rate_hz)
        self._zero = np.zeros(len(info.axes))
        found = dict.fromkeys(difference for one in each for difference in compared(one, meta))
        self.differences = refuse_or_list(found, accept, f"{info.name} has ")
        synthetic = (_SYNTHETIC_MODEL,) if model.synthetic and not info.synthetic else ()
        self._always = (*synthetic, *self.differences)
        self._builder = SnapshotBuilder(
            info.rate_hz,
            model.spec if isinstance(model.spec, FeatureSpec) else None,
            model.classes,
            n_samples=model.n_samples,
            source=info.name,
            synthetic=info.synthetic,
            max_lag_s=max_lag_s,
            axes=info.axes,
            # Nobody states what the samples are in: they were taken for those of the training.
            units=tuple(now or of for now, of in zip(info.units, model.units, strict=True)),
            hop_s=self._n_hop / info.rate_hz if self._n_hop else None,
        )
        self._max_lag_s = max_lag_s

    def new_capture(self) -> Capture:
        """Return the capture of the next push; nothing is read yet."""
        return capture_from(
            self.stream,
            self._setup.trigger(),
            n_samples=self.model.n_samples,
            pre_s=self._rest_s,
            **self._limits,
        )

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
            The robot could not be stopped: no push begins before its motion has ended (see `drive`).
        """
        return self._push(on_decision)

    def _push(
        self, on_decision: Callable[[Decision], object] | None = None, *, patient: bool = False
    ) -> Push:
        capture = self.new_capture()
        self._answer.reset()
        for difference in self.differences:
            self._answer.warn(difference)
        self._n_looks = self._n_moments = 0
        self._builder.begin_capture()
        decision: Decision | None = None
        motion: Motion | None = None
        answered_early = False
        watched = limits_matter(self.stream, self._setup.robot, capture)
        back_first, self._back_first = self._back_first, False
        steps = drive(
            self.stream,
            capture,
            robot=self._setup.robot,
            reader=self._reader,
            back_first=back_first,
            **self._move,
        )
        with closing(steps):
            for step in steps:
                motion = step.motion
                new = self._take(step, capture)
                if new is not None and on_decision is not None:
                    on_decision(new)
                decision = new or decision
                if self._early and decision is not None and self._is_answer(decision):
                    answered_early = True
                    break
                waits = watched and (motion is not None or capture.state is CaptureState.ARMED)
                if not (waits or capture.state.is_over) and self._views.wants_snapshot():
                    self._show(capture.state.value, decision, _VIEWS_WAIT * watched)
        self._back_first = answered_early or was_cut_short(capture, motion)
        push = self._finished(capture, decision, answered_early=answered_early, patient=patient)
        return replace(push, recording=self._recording(capture, push, motion))

    def pushes(self, n: int | None = None) -> Iterator[Push]:
        """Name the material of one push after another, or with `hop_s` at one hop after another.

        Parameters
        ----------
        n : int, optional
            Number of answers; default: on and on, until the source comes to its end, however long nobody pushes.

        Yields
        ------
        Push
            Those that could not be captured too. An answer at a hop has its `Push.time_s`.

        Raises
        ------
        CaptureError
            A failure after which no push may follow by itself: a limit of force or torque was passed; the robot
            refused, failed or could not be stopped; nobody delivers or, with `n`, moves; a signal ended it (see
            `granular_id.live.stop_on_signals`); the end of a source before `n` answers.
        TypeError, ValueError
            `n` is no whole number of at least 1.
        """
        n = None if n is None else whole_number("n", n)
        return self._at_hops(n) if self._n_hop else self._one_by_one(n)

    def _one_by_one(self, n: int | None) -> Iterator[Push]:
        while n is None or self.n_answered < n:
            push = self._push(patient=n is None)
            if n is None and self._at_end(push):
                return
            waits = n is None and push.reason is FailureReason.NO_TRIGGER
            if push.reason is not None and push.reason.is_lasting and not waits:
                raise CaptureError(push.reason, push.text)
            yield push

    def _at_hops(self, n: int | None) -> Iterator[Push]:
        windows = HoppingWindows(self.model.n_samples, self._n_hop, self._limits.get("max_gap", 0))
        silent_s, n_lost = _SILENT_S + self.stream.pause_s, self._n_lost
        newest: Push | None = None
        heard_s, finished = time.monotonic(), False
        while n is None or self.n_answered < n:
            self._reader.wait(_WAIT_S)
            health = self.stream.health()  # before the rows: what it wrote last was read then
            block = self._reader.read()
            if len(block):
                heard_s = time.monotonic()
            elif health.error is not None:
                raise CaptureError(FailureReason.SOURCE, f"the source died: {health.error}")
            elif health.finished:
                finished = True
                break
            elif time.monotonic() - heard_s > silent_s:
                said = f"{self.stream.info.name} delivered nothing for {silent_s:g} s"
                raise CaptureError(FailureReason.NO_ROWS, said + left_out(health.counters))
            self._builder.rows(block)
            late = ("lag",) if self.stream.lag_s() > self._max_lag_s else ()
            for window in windows.feed(block):
                newest = self._answered(window, late, newest)
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
            yield Push(None, FailureReason.GAP, self._lost)

    def _show_hop(self, state: str, newest: Push | None) -> None:
        if state == "ended":
            self._show(state, None if newest is None else newest.decision)
        elif newest is None:
            first = f"the first answer comes after {self._window_s:g} s of signal"
            self._show("arming", None, "; ".join(filter(None, (first, self._lost))))
        else:
            self._show("failed" if newest.decision is None else state, newest.decision, newest.text)

    @property
    def _window_s(self) -> float:
        return self.model.n_samples / self.model.rate_hz

    @property
    def _lost(self) -> str:
        """How often a window began anew because rows were lost, and what that means where no answer came."""
        if not self._n_lost:
            return ""
        needs = f"; a window needs {self._window_s:g} s without loss (max_gap)"
        return f"rows were lost {counted(self._n_lost, 'time')}{'' if self.n_pushes else needs}"

    @property
    def why_none(self) -> str:
        """Why there was no answer, where the source came to its end without one."""
        if not self._n_hop:
            return "the source came to its end before any push was answered"
        if why := self._failed or self._lost:
            return f"the source came to its end without an answer: {why}"
        return f"the source came to its end before {self._window_s:g} s of signal were there in one piece"

    def _answered(self, window: Rows, late: tuple[str, ...], before: Push | None) -> Push:
        """Name the material of a window: the answer that its rows get alone."""
        time_s = float(window.time_s[-1])
        truth = self.stream.truth_at(time_s)
        self.n_pushes += 1
        self._failed = self._limiting.wrong_rate(window)
        if self._failed:
            push = Push(None, FailureReason.RATE, self._failed, truth, time_s)
        else:
            push = Push(self._named(window, late), truth=truth, time_s=time_s)
            self._count(push)
        if before is None or _said(before) != _said(push):
            self._builder.end_capture(push)  # the history has changes only
        return push

    def _named(self, window: Rows, late: tuple[str, ...]) -> Decision:
        flags = int(np.bitwise_or.reduce(window.flags))
        told = {"gap": flags & SampleFlag.GAP_FILLED, "saturation": flags & SampleFlag.SATURATED}
        self._answer.reset()
        for warning in (*self.differences, *late, *(name for name, is_so in told.items() if is_so)):
            self._answer.warn(warning)
        self._answer.push(window.wrench)
        self._builder.begin_capture()
        self._builder.captured(window.wrench)
        return self._answer.decision()

    def _count(self, push: Push) -> None:
        if push.decision is not None:
            self.n_answered += 1
            self.knows_truth |= push.truth is not None
            self.n_right += bool(push.is_right)
            self.n_unknown += bool(push.decision.unknown)

    def summary(self) -> str:
        """Sum up all pushes so far in one line: how many answers, how many right where the truth is known."""
        n, failed = self.n_answered, self.n_pushes - self.n_answered
        synthetic = "SYNTHETIC: " if self.stream.info.synthetic else ""
        right = f", {self.n_right} right ({100 * self.n_right / n:.0f} %)" if self.knows_truth and n else ""
        refused = f"; {self.n_unknown} like no known material" if self.n_unknown else ""
        lost = f"; {failed} could not be captured" if failed else ""
        lost += f"; {self._lost}" if self._lost else ""
        return f"{synthetic}{counted(n, 'answer')}{right}{refused}{lost}"

    def _at_end(self, push: Push) -> bool:
        """Whether there was no push to name, because the source has no more rows."""
        return push.reason is FailureReason.SOURCE and self.stream.health().finished

    def _is_answer(self, decision: Decision) -> bool:
        """Whether a decision may be given before the end: sure at a moment that the rule looks at."""
        n_looks = self._moment(decision.n_seen)
        due, self._n_looks = n_looks > self._n_looks, n_looks
        return due and decision.sure

    def _moment(self, n_seen: int) -> int:
        """Count the moments that have passed at which the rule for early answers was calibrated."""
        return n_seen * N_CHECKPOINTS // self.model.n_samples

    def _take(self, step: Step, capture: Capture) -> Decision | None:
        self._builder.rows(step.block)
        if not len(step.rows):
            return None
        rows = self._tared(step.rows, capture.n_pre)
        self._answer.push(rows)
        self._builder.captured(rows)
        is_first = self._answer.n_seen == len(rows)
        for warning in step_warnings(capture, step, self.stream.lag_s(), is_first=is_first):
            self._answer.warn(warning)
        moment = self._moment(self._answer.n_seen)
        is_due, self._n_moments = moment > self._n_moments, moment
        return self._answer.decision() if is_due or self._grows or self._answer.is_complete else None

    def _tared(self, rows: NDArray[np.float64], n_pre: int) -> NDArray[np.float64]:
        """Take the rest off, as in the training: the first rows of a push hold all of it."""
        if not self._n_tare:
            return rows
        if not self._answer.n_seen:
            self._zero = rest_zero(rows[n_pre - self._n_tare : n_pre])
        return rows - self._zero

    def _finished(
        self, capture: Capture, decision: Decision | None, *, answered_early: bool, patient: bool
    ) -> Push:
        truth = truth_of(self.stream, capture)
        failed = capture.state is CaptureState.FAILED and not answered_early
        push = Push(decision, truth=truth, timing=capture.timing)
        push = Push(None, capture.reason, capture.text, truth) if failed else push
        at_end = self._at_end(push)
        self.n_pushes += not at_end
        self._count(push)
        # A replay that is over is no failure, and where nobody pushes there is nothing to tell: there was no push.
        nobody = push.reason is FailureReason.NO_TRIGGER
        state = "ended" if at_end else "failed" if failed else "complete"
        if not nobody and not at_end:
            self._builder.end_capture(push)
        if not (nobody and patient):
            self._show(state, push.decision, push.text)
        return push

    def _recording(self, capture: Capture, push: Push, motion: Motion | None) -> Recording | None:
        if capture.state is not CaptureState.COMPLETE or push.decision is None:
            return None
        facts = push_facts(push.truth, motion) | {"answer": push.decision.to_dict()}
        name = f"push_{utc_stamp()}_{self.n_pushes}"
        return capture.recording(push.truth, session=self.session, name=name, meta=facts)

    def _show(self, state: str, decision: Decision | None, hint: str = "") -> None:
        self._views.publish(
            self._builder.build(
                state,
                decision,
                hint=hint,
                lag_s=self.stream.lag_s(),
                counters=self.stream.health().counters,
                warnings=self._always,
                n_captures=self.n_answered,
                n_correct=self.n_right if self.knows_truth else None,
            )
        )


def trained_model(model: Identifier | str | os.PathLike[str]) -> Identifier:
    """Return a model, read where it is a file."""
    return model if isinstance(model, Identifier) else Identifier.load(model)


def _refuse_other_stream(model: Identifier, stream: Stream) -> None:
    checked_stream(stream)
    name, rate_hz = stream.info.name, stream.info.rate_hz
    if abs(rate_hz / model.rate_hz - 1) > 1e-3:
        problem = f"{name} delivers {rate_hz:g} Hz: train one at that rate, or set the sensor's"
        raise ValueError(f"the model is for {model.rate_hz:g} Hz, {problem}")
    if model.axes != stream.info.axes:
        raise ValueError(
            f"the model is for the axes {' '.join(model.axes)}; {name} has {' '.join(stream.info.axes)}"
        )


def _said(push: Push) -> object:
    if push.decision is None:
        return push.reason
    return None if push.decision.unknown else push.decision.label


def refuse_with_hop(**given: bool) -> None:
    """Refuse what is about pushes, where answers go on."""
    for name, is_given in given.items():
        if is_given:
            raise argument_error(ValueError, name, "is about pushes; with hop_s answers go on: leave it out")


def _hop_of(hop_s: float, rate_hz: float) -> int:
    """Return the samples from one answer to the next."""
    n_hop = round(finite_number("hop_s", hop_s, positive=True) * rate_hz)
    if n_hop < 1:
        raise argument_error(
            ValueError, "hop_s", f"={hop_s:g} is less than a sample: at least {1 / rate_hz:g}"
        )
    return n_hop
