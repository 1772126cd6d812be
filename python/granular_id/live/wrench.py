"""What is done to a wrench as it comes: it is held against limits, and tared by the rest before the motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from granular_id._checks import argument_error, positive_number
from granular_id._text import fixed
from granular_id.live.rows import BlockLike, Rows
from granular_id.live.source import SourceInfo
from granular_id.recording import AXES, TARE_S, Setup, lead_samples

if TYPE_CHECKING:
    from granular_id.identifier import Identifier

__all__ = ["WrenchLimits", "live_tare"]

_REST = "rest"
"""What the metadata of recordings say that `Dataset.tare` has made."""


class WrenchLimits:
    """How large force and torque may be: lengths of (fx, fy, fz) and (tx, ty, tz), as the sensor tells them.

    None is no limit. One that the sensor cannot tell, because an axis ends before, is refused.
    """

    def __init__(
        self, max_force_n: float | None, max_torque_n_m: float | None, info: SourceInfo | None
    ) -> None:
        self._parts = [
            (name, unit, columns, _limit(argument, value, unit, columns, info))
            for argument, value, name, unit, columns in (
                ("max_force_n", max_force_n, "force", "N", slice(0, 3)),
                ("max_torque_n_m", max_torque_n_m, "torque", "N m", slice(3, 6)),
            )
            if value is not None
        ]

    @property
    def are_given(self) -> bool:
        """Whether there is any."""
        return bool(self._parts)

    def beyond(self, rows: BlockLike | Rows) -> str:
        """Say which is the first of these rows beyond a limit, and by which value; empty where none is."""
        first, said = len(rows), ""
        for name, unit, columns, limit in self._parts:
            with np.errstate(over="ignore"):  # infinity is beyond, too
                size = np.linalg.norm(rows.wrench[:, columns], axis=1)
            over = np.flatnonzero(~(size <= limit))
            if len(over) and over[0] < first:
                first = int(over[0])
                when = f"at {fixed(rows.time_s[first], 3)} s of the sensor's time"
                said = f"{name} of {size[first]:.4g} {unit} {when}, the limit is {limit:g} {unit}"
        return said


def _limit(argument: str, value: float, unit: str, columns: slice, info: SourceInfo | None) -> float:
    limit, axes = positive_number(argument, value), AXES[columns]
    if info is not None and info.axes[columns] != axes:
        problem = f"needs {' '.join(axes)}; {info.name} has {' '.join(info.axes)}: leave it out"
        raise argument_error(ValueError, argument, problem)
    ends = () if info is None or info.full_scale is None else info.full_scale[columns]
    if ends and limit > min(ends):
        axis = axes[ends.index(min(ends))]
        problem = f"is {limit:g} {unit}, but the sensor's {axis} ends at {min(ends):g}: give at most that"
        raise argument_error(ValueError, argument, problem)
    return limit


def live_tare(model: Identifier, stream: Sequence[Setup], rest_s: float | None) -> tuple[int, list[Setup]]:
    """Return how many samples at rest give the zero of each push, 0 for none, and the set-ups with that zero.

    Pushes are tared where the recordings of the training were, unless those of the stream are already. As many
    samples are taken as there; where the model does not tell, all the rest there is, as `Dataset.tare` does.
    `rest_s` comes before the motion; None: there is no motion to come, and nothing to take for zero.
    """
    trained = model.trained
    if list(trained.get("setup", {}).get("tare", ())) != [_REST] or all(one.tare == _REST for one in stream):
        return 0, list(stream)
    if rest_s is None:
        return 0, [replace(one, tare=one.tare or "none") for one in stream]
    steps = [step["parameters"] for step in trained.get("history", ()) if step["step"] == "tare"]
    stated = steps[-1].get("lead_s") if steps else None
    least_s, most_s = TARE_S
    lead_s = min(most_s, rest_s) if stated is None else stated
    if not (least_s if stated is None else 0) <= lead_s <= rest_s + 0.5 / model.rate_hz:
        raise ValueError(
            f"the model was trained on recordings tared by {stated or least_s:g} s of rest, and a push begins "
            f"{rest_s:g} s before its motion: train on recordings that keep the rest that they are tared by"
        )
    return lead_samples(lead_s, model.rate_hz), [replace(one, tare=_REST) for one in stream]
