"""``Requirements``: the axes, rate, set-up and length that a trained model wants, with the rest ahead of the motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import WayOutError
from granular_id._core import GranularIdError
from granular_id._text import counted, typed, verb
from granular_id.recording import (
    PAUSE_S,
    Dataset,
    Difference,
    Setup,
    refuse_or_list,
    setup_differences,
    setups_in,
    unit_differences,
)


@dataclass(frozen=True)
class Requirements:
    """What the recordings of a training had in common, and those that a model names must have.

    `setup` holds values of the training as `values_in` gives them. `lead_s` is the rest ahead of the trigger, where all
    had the same; without it `at_first` says that they began at their first sample, or were windows.
    """

    n_samples: int
    rate_hz: float
    axes: tuple[str, ...]
    units: tuple[str, ...]
    setup: Mapping[str, Sequence[str]]
    lead_s: float | None
    at_first: bool

    def differences(self, setup: Setup, meta: Mapping[str, Any]) -> list[Difference]:
        """Compare a set-up, and units in metadata, with those of the training."""
        units = dict(zip(self.axes, self.units, strict=True))
        return [*unit_differences(units, meta), *setup_differences(self.setup, setup)]

    def check(self, data: Dataset, accept: str | Sequence[str] = ()) -> tuple[str, ...]:
        """Refuse other axes, rates and set-ups but for what is in `accept`; return what else differs, each once."""
        for recording in data:
            if recording.axes != self.axes:
                way_out = (f": call .select(axes={list(self.axes)}) ", typed(axes=self.axes))
                raise WayOutError(
                    f"recording {recording.name!r} has the axes {' '.join(recording.axes)}; the model was trained on "
                    f"{' '.join(self.axes)}",
                    *(way_out if set(recording.axes) >= set(self.axes) else ()),
                )
            if recording.rate_hz != self.rate_hz:
                own = recording.rate_hz
                came = "is sampled irregularly" if own is None else f"has {own:g} Hz"
                came += f", the model was trained at {self.rate_hz:g} Hz"
                call, options = f".resample({self.rate_hz:g})", {"resample_hz": self.rate_hz}
                longest = 0.0 if own is not None else float(np.diff(recording.times()).max(initial=0))
                if longest >= PAUSE_S:
                    came += f", and has pauses of up to {longest:.3g} s"
                    call, options = f".split(gap_s={PAUSE_S:g}){call}", {"split_gap_s": PAUSE_S, **options}
                problem = f"recording {recording.name!r} {came}; nothing is resampled unasked: call {call} "
                raise WayOutError(problem, typed(**options))
        found: dict[str, None] = {}
        for recording, setup in zip(data, setups_in(data), strict=True):
            differences = self.differences(setup, recording.meta)
            where = f"recording {recording.name!r} has "
            found.update(dict.fromkeys(refuse_or_list(differences, accept, where)))
        return tuple(found)

    def crop(self, data: Dataset, *, over_all: bool = True) -> Dataset:
        """Crop recordings of the rate and axes to the length, from the first sample or the trigger less the lead on.

        Those of the length stay as they are, and longer ones begin as in the training. `over_all` says whether answers
        over all of a recording would do, too.
        """
        n, rate_hz = self.n_samples, self.rate_hz
        lengths = [recording.n_samples for recording in data]
        if set(lengths) == {n}:
            return data
        short = [recording for recording in data if recording.n_samples < n]
        if short:
            skip = (f": call .align({n}, on_short='skip') ", typed(duration_s=n / rate_hz, on_error="skip"))
            raise WayOutError(
                f"recording {short[0].name!r} has {short[0].n_samples} samples "
                f"({short[0].n_samples / rate_hz:g} s), the model takes {n} ({n / rate_hz:g} s); {len(short)} of "
                f"{counted(len(data))} {verb(len(short), 'is', 'are')} shorter",
                *(skip if len(short) < len(data) else ()),
            )
        if self._begins_at_first:
            cropped = data.align(n)
            step = replace(cropped.history[-1], notes=["begins at the first sample, as in the training"])
            return Dataset(cropped.recordings, [*data.history, step])
        if self.lead_s is None:
            longer = next(recording for recording in data if recording.n_samples > n)
            over = ", or answer over all of it (--hop-s, .predict_over(recording))"
            raise WayOutError(
                f"recording {longer.name!r} has {longer.n_samples} samples, the model takes {n}, and does not know how "
                f"much rest comes before the motion: crop recordings as those of the training, Dataset.align({n}) from "
                "the first sample on ",
                typed(duration_s=n / rate_hz),
                over * over_all,
            )
        start = round(self.lead_s * rate_hz)
        begun = [replace(r, trigger_index=start) if r.n_samples == n else r for r in data]
        return Dataset(begun, data.history).align(n, trigger="recorded", lead_s=self.lead_s)

    def starts(
        self,
        names: Sequence[str],
        lengths: NDArray[np.int64],
        triggers: NDArray[np.int64],
    ) -> NDArray[np.int64]:
        """Return the sample at which `crop` has each of n recordings begin by itself; -1: left out, or no trigger."""
        n = self.n_samples
        starts = np.zeros(len(lengths), np.int64)
        from_trigger = (lengths > n) & (not self._begins_at_first)
        if from_trigger.any():
            if self.lead_s is None:
                first = int(from_trigger.argmax())
                raise GranularIdError(
                    f"recording {names[first]!r} has {lengths[first]} samples; the model does not know how much rest "
                    f"comes before the motion, and wants {n} of each: call .align on the recordings"
                )
            begun = np.where(triggers >= 0, triggers - round(self.lead_s * self.rate_hz), -1)
            starts = np.where(from_trigger, begun, starts)
        fits: NDArray[np.int64] = np.where((starts >= 0) & (starts + n <= lengths), starts, -1)
        return fits

    @property
    def _begins_at_first(self) -> bool:
        return self.lead_s is None and self.at_first
