"""Recordings as a model takes them: its axes, its rate, its length, with its rest before the motion."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

from granular_id import _core
from granular_id._words import counted, verb
from granular_id.identifier.about import axes_of, begins_at_first, lead_of
from granular_id.recording import Dataset, Setup
from granular_id.recording.setup import Difference, other_units, other_values, settled, setups_in

__all__ = ["Begin", "comparison", "fitted", "refuse_others"]

Begin = Literal["auto", "first", "trigger"]

_AS_TRAINED = "begins at the first sample, as in the training"


def refuse_others(data: Dataset, core: _core.Model, accept: str | Sequence[str] = ()) -> tuple[str, ...]:
    """Refuse recordings of other axes, another rate or another set-up than a model was trained on.

    Parameters
    ----------
    data : Dataset
    core : granular_id._core.Model
    accept : str or sequence of str
        What of the set-up may differ though it is refused otherwise, see `Setup`.

    Returns
    -------
    tuple of str
        What else is not as in the training, by name, each once.

    Raises
    ------
    ValueError
        Naming the first such recording, and the step that helps.
    """
    axes, rate_hz = axes_of(core), core.rate_hz
    for recording in data:
        if recording.axes != axes:
            help_ = f": call .select(axes={list(axes)})" if set(recording.axes) >= set(axes) else ""
            raise ValueError(
                f"recording {recording.name!r} has the axes {' '.join(recording.axes)}; the model was trained on "
                f"{' '.join(axes)}{help_}"
            )
        if recording.rate_hz != rate_hz:
            came = "is sampled irregularly" if recording.rate_hz is None else f"has {recording.rate_hz:g} Hz"
            raise ValueError(
                f"recording {recording.name!r} {came}, the model was trained at {rate_hz:g} Hz; nothing is resampled "
                f"unasked: call .resample({rate_hz:g})"
            )
    compared = comparison(core)
    told: dict[str, None] = {}
    for recording, setup in zip(data, setups_in(data), strict=True):
        found = settled(compared(setup, recording.meta), accept, f"recording {recording.name!r} has ")
        told.update(dict.fromkeys(found))
    return tuple(told)


def comparison(core: _core.Model) -> Callable[[Setup, Mapping[str, Any]], list[Difference]]:
    """Return what compares a set-up, and units in metadata, with those that a model was trained with."""
    trained = json.loads(core.metadata["trained"]).get("setup", {})
    units = dict(zip(axes_of(core), json.loads(core.metadata["units"]), strict=True))
    return lambda setup, meta: [*other_units(units, meta), *other_values(trained, setup)]


def fitted(
    data: Dataset,
    core: _core.Model,
    *,
    begin_at: Begin = "auto",
    lead_s: float | None = None,
    on_short: Literal["raise", "skip"] = "raise",
) -> Dataset:
    """Crop recordings to the length of a model.

    Parameters
    ----------
    data : Dataset
        Of the rate and axes of the model, see `refuse_others`.
    core : granular_id._core.Model
    begin_at : {"auto", "first", "trigger"}, default "auto"
        Where to begin: at the first sample; at the trigger, less the lead; or, automatically, at the first sample
        of recordings that have the length already, and of longer ones as in the training: at the trigger where all
        had the same lead, else at the first sample where that is how they were cropped.
    lead_s : float, optional
        Seconds kept ahead of the trigger. Default: as in the recordings of the training, where all had the same.
    on_short : {"raise", "skip"}
        What to do with a recording that is too short, or longer and without trigger: refuse, or leave it out.

    Returns
    -------
    Dataset
        The same one where every recording has the length already; else ``history[-1]`` says what was cropped.

    Raises
    ------
    ValueError
        A recording is too short, has no trigger or too little rest before it; or `lead_s` is neither stated nor known.
    """
    n, rate_hz = core.n_samples, core.rate_hz
    lengths = [recording.n_samples for recording in data]
    if begin_at == "auto" and set(lengths) == {n}:
        return data
    short = [recording for recording in data if recording.n_samples < n]
    if short and on_short == "raise":
        raise ValueError(
            f"recording {short[0].name!r} has {short[0].n_samples} samples ({short[0].n_samples / rate_hz:g} s), the "
            f"model takes {n} ({n / rate_hz:g} s); {len(short)} of {counted(len(data))} "
            f"{verb(len(short), 'is', 'are')} shorter: pass "
            "on_short='skip' to leave such recordings out"
        )
    if begin_at == "first" or (begin_at == "auto" and max(lengths) <= n):
        return data.align(n, on_short=on_short)
    if begin_at == "auto" and lead_s is None and begins_at_first(core):
        *before, step = (cropped := data.align(n, on_short=on_short)).history
        return Dataset(cropped.recordings, [*before, replace(step, notes=[_AS_TRAINED])])
    lead = lead_of(core) if lead_s is None else lead_s
    if lead is None:
        longer = next((r for r in data if r.n_samples > n), data[0])
        raise ValueError(
            f"recording {longer.name!r} has {longer.n_samples} samples, the model takes {n}, and does not know how "
            "much rest comes before the motion: state lead_s, or pass begin_at='first'"
        )
    marked = data
    if begin_at == "auto":
        start = round(lead * rate_hz)
        recordings = [replace(r, trigger_index=start) if r.n_samples <= n else r for r in data]
        marked = Dataset(recordings, data.history)
    return marked.align(n, trigger="recorded", lead_s=lead, on_short=on_short, on_missing=on_short)
