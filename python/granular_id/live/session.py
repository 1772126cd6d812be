"""What every live session does beside its answers: compares the set-up, counts, warns and shows."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import whole_number
from granular_id._core import GranularIdError
from granular_id._text import counted
from granular_id.features import FeatureSpec
from granular_id.identifier import Identifier, StreamingIdentifier
from granular_id.live.capture import meta_of
from granular_id.live.limits import Limits
from granular_id.live.outcome import Push
from granular_id.live.recorder import utc_stamp
from granular_id.live.snapshot import SnapshotBuilder
from granular_id.live.stream import Stream, checked_stream
from granular_id.live.view import Views
from granular_id.recording import TARE_S, SampleFlag, Setup, refuse_or_list, samples_in

if TYPE_CHECKING:
    from granular_id.identifier import Decision

__all__ = ["Session"]

_REST = "rest"
"""What the metadata of recordings say that `Dataset.tare` has made."""

_SYNTHETIC_MODEL = (
    "the model was trained on SYNTHETIC recordings: its answers say nothing about real materials"
)


class Session(ABC):
    """A model and a stream that fit each other, and what came of it so far."""

    def __init__(
        self,
        stream: Stream,
        model: Identifier | str | os.PathLike[str],
        limits: Limits,
        *,
        views: Views | None,
        accept: str | Sequence[str],
        hop_s: float | None = None,
    ) -> None:
        self.model = model if isinstance(model, Identifier) else Identifier.load(model)
        _refuse_other_stream(self.model, stream)
        self.stream, self.session = stream, utc_stamp()
        self.differences: tuple[str, ...] = ()
        self.n_pushes = self.n_answered = self.n_right = self.n_unknown = 0
        self.knows_truth = False
        self._limits, self._accept = limits, accept
        self._views = Views([]) if views is None else views
        self._answer = StreamingIdentifier(self.model)
        self._always: tuple[str, ...] = ()
        info, spec = stream.info, self.model.spec
        self._builder = SnapshotBuilder(
            info.rate_hz,
            spec if isinstance(spec, FeatureSpec) else None,
            self.model.classes,
            n_samples=self.model.n_samples,
            source=info.name,
            synthetic=info.synthetic,
            max_lag_s=limits.max_lag_s,
            axes=info.axes,
            # Nobody states what the samples are in: they were taken for those of the training.
            units=tuple(now or of for now, of in zip(info.units, self.model.units, strict=True)),
            hop_s=hop_s,
        )

    def pushes(self, n: int | None = None) -> Iterator[Push]:
        """Name the material of one push after another, or at one hop after another.

        Parameters
        ----------
        n : int, optional
            Number of answers; default: on and on, until the source comes to its end, however long nobody pushes.

        Yields
        ------
        Push
            Those that could not be captured too, at hops those of another rate. Answers at hops have their
            `Push.time_s`.

        Raises
        ------
        CaptureError
            A failure after which no push may follow by itself: a limit of force or torque was passed; the robot
            refused, failed or could not be stopped; three of its pushes in a row failed; nobody delivers or, with `n`,
            moves; a signal ended it (see `granular_id.live.stop_on_signals`); the end of a source before `n` answers.
        TypeError, ValueError
            `n` is no whole number of at least 1.
        """
        return self._answers(None if n is None else whole_number("n", n))

    @abstractmethod
    def _answers(self, n: int | None) -> Iterator[Push]:
        """Yield one answer after another."""

    @property
    @abstractmethod
    def why_none(self) -> str:
        """Why there was no answer, where the source came to its end without one."""

    def summary(self) -> str:
        """Sum up all pushes so far in one line: how many answers, how many right where the truth is known."""
        n, failed = self.n_answered, self.n_pushes - self.n_answered
        synthetic = "SYNTHETIC: " if self.stream.info.synthetic else ""
        right = f", {self.n_right} right ({100 * self.n_right / n:.0f} %)" if self.knows_truth and n else ""
        refused = f"; {self.n_unknown} like no known material" if self.n_unknown else ""
        failures = f"; {failed} could not be captured" if failed else ""
        return f"{synthetic}{counted(n, 'answer')}{right}{refused}{failures}"

    def _compare(self, facts: dict[str, Any], rest_s: float | None) -> int:
        """Hold the set-up against that of the training; return how many samples at rest give the zero of each push."""
        info, model = self.stream.info, self.model
        meta = meta_of(info, facts)
        now = Setup.of(meta)
        # Recordings that are played again may be of several set-ups.
        each = [now.completed(one) for one in getattr(self.stream.source, "setups", ())] or [now]
        n_tare, each = _tare(model, each, rest_s)
        found = dict.fromkeys(
            difference for one in each for difference in model.requirements.differences(one, meta)
        )
        self.differences = refuse_or_list(found, self._accept, f"{info.name} has ")
        synthetic = (_SYNTHETIC_MODEL,) if model.synthetic and not info.synthetic else ()
        self._always = (*synthetic, *self.differences)
        return n_tare

    def _count(self, push: Push) -> None:
        if push.decision is not None:
            self.n_answered += 1
            self.knows_truth |= push.truth is not None
            self.n_right += bool(push.is_right)
            self.n_unknown += bool(push.decision.unknown)

    def _begin(self) -> None:
        """Begin an answer anew."""
        self._answer.reset()
        for difference in self.differences:
            self._answer.warn(difference)
        self._builder.begin_capture()

    def _warn_of(self, flags: NDArray[np.uint8]) -> None:
        for flag, name in ((SampleFlag.GAP_FILLED, "gap"), (SampleFlag.SATURATED, "saturation")):
            if (flags & flag).any():
                self._answer.warn(name)

    def _warn_of_lag(self) -> None:
        if self.stream.lag_s() > self._limits.max_lag_s:
            self._answer.warn("lag")

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


def _refuse_other_stream(model: Identifier, stream: Stream) -> None:
    checked_stream(stream)
    name, rate_hz = stream.info.name, stream.info.rate_hz
    if abs(rate_hz / model.rate_hz - 1) > 1e-3:
        problem = f"{name} delivers {rate_hz:g} Hz: train one at that rate, or set the sensor's"
        raise GranularIdError(f"the model is for {model.rate_hz:g} Hz, {problem}")
    if model.axes != stream.info.axes:
        raise GranularIdError(
            f"the model is for the axes {' '.join(model.axes)}; {name} has {' '.join(stream.info.axes)}"
        )


def _tare(model: Identifier, stream: Sequence[Setup], rest_s: float | None) -> tuple[int, list[Setup]]:
    """Return how many samples at rest give the zero of each push, 0 for none, and the set-ups with that zero."""
    # As many as in the training; where the model does not tell, all the rest there is, as `Dataset.tare` does.
    trained = model.trained
    if list(trained.get("setup", {}).get("tare", ())) != [_REST] or all(one.tare == _REST for one in stream):
        return 0, list(stream)
    if rest_s is None:  # there is no motion to come, and nothing to take for zero
        return 0, [replace(one, tare=one.tare or "none") for one in stream]
    steps = [step["parameters"] for step in trained.get("history", ()) if step["step"] == "tare"]
    stated = steps[-1].get("lead_s") if steps else None
    least_s, most_s = TARE_S
    lead_s = min(most_s, rest_s) if stated is None else stated
    if not (least_s if stated is None else 0) <= lead_s <= rest_s + 0.5 / model.rate_hz:
        raise GranularIdError(
            f"the model was trained on recordings tared by {stated or least_s:g} s of rest, and a push begins "
            f"{rest_s:g} s before its motion: train on recordings that keep the rest that they are tared by"
        )
    return samples_in("lead_s", lead_s, model.rate_hz), [replace(one, tare=_REST) for one in stream]
