"""One answer after another, as a loop over decisions."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

from granular_id._checks import whole_number
from granular_id.identifier import Identifier
from granular_id.live.identification import LiveIdentifier
from granular_id.live.outcome import CaptureError
from granular_id.live.robot import Robot
from granular_id.live.setup import setup_of
from granular_id.live.source import WrenchSource
from granular_id.live.stream import opened
from granular_id.live.trigger import Trigger

if TYPE_CHECKING:
    from granular_id.identifier import Decision

__all__ = ["identify"]


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

    Use it within `granular_id.live.stop_on_signals`, so that the robot is also stopped on SIGTERM and SIGHUP.

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
        raise ValueError(f"on_failure must be 'raise' or 'skip', got {on_failure!r}")
    n = None if n is None else whole_number("n", n)
    return _answers(
        source,
        model if isinstance(model, Identifier) else Identifier.load(model),
        n,
        (robot, trigger),
        early,
        on_failure,
        settings,
    )


def _answers(
    source: str | WrenchSource,
    model: Identifier,
    n: int | None,
    mover: tuple[str | Robot | None, str | Callable[[], Trigger]],
    early: bool,
    on_failure: str,
    settings: dict[str, Any],
) -> Iterator[Decision]:
    with opened(source) as stream, ExitStack() as stack:
        setup = setup_of(stream.source, *mover)
        if isinstance(mover[0], str):  # else the robot is the caller's
            stack.callback(setup.close)
        live = LiveIdentifier(stream, model, setup, early=early, **settings)
        for push in live.pushes(n):
            if push.decision is not None:
                yield push.decision
            elif push.reason is not None and on_failure == "raise":
                raise CaptureError(push.reason, push.text)
