"""Pick recordings out of a data set by label, session, name, place or anything else, and axes out of them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence, Set
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from granular_id.recording.one import Recording
from granular_id.recording.report import StepReport


def select_recordings(
    recordings: Sequence[Recording],
    labels: str | Sequence[str] | None,
    sessions: str | Sequence[str] | None,
    indices: ArrayLike | None,
    *,
    names: str | Sequence[str] | None = None,
    where: Callable[[Recording], bool] | None = None,
    axes: Sequence[str] | None = None,
) -> tuple[list[Recording], StepReport]:
    """Keep what meets every condition; see :meth:`Dataset.select`, which calls this."""
    kept = list(range(len(recordings))) if indices is None else _places(indices, len(recordings))
    parameters: dict[str, object] = {"indices": None if indices is None else "given"}
    for name, wanted in (("label", labels), ("session", sessions), ("name", names)):
        values = None if wanted is None else set(_texts(wanted, f"{name}s"))
        parameters[f"{name}s"] = None if values is None else sorted(values, key=str)
        if values is None:
            continue
        present: set[str | None] = {getattr(r, name) for r in recordings}
        if not values <= present:
            raise ValueError(
                f"{name}s: no recording has {_some(values - present)}; there are {_some(present)}"
            )
        kept = [i for i in kept if getattr(recordings[i], name) in values]
    if where is not None:
        if not callable(where):
            raise TypeError(f"where must be callable, got {type(where).__name__}")
        parameters["where"] = "given"
        kept = [i for i in kept if where(recordings[i])]
    if not kept:
        raise ValueError(
            "select() leaves no recording: no index is given, or the conditions exclude each other"
        )
    chosen = [recordings[i] for i in kept]
    if axes is not None:
        if isinstance(axes, (str, Set)) or not len(columns := _texts(axes, "axes")):
            raise ValueError(f"axes={axes!r}; wanted a sequence of names like ['fx', 'fz']")
        parameters["axes"] = columns
        chosen = [_with_axes(recording, columns) for recording in chosen]
    totals = {"recordings_before": len(recordings), "recordings_after": len(kept)}
    return chosen, StepReport("select", parameters, totals)


def _texts(value: object, name: str) -> list[str]:
    """Return one text or several as a list; None stands for recordings without a label or session."""
    if isinstance(value, str):
        return [value]
    if isinstance(value, bytes) or not isinstance(value, Iterable):
        raise TypeError(f"{name} must be a str or a sequence of str, got {type(value).__name__}")
    texts = list(value)
    wrong = next((i for i, text in enumerate(texts) if not isinstance(text, (str, type(None)))), None)
    if wrong is not None:
        raise TypeError(f"{name}[{wrong}] must be a str, got {type(texts[wrong]).__name__}")
    return texts


def _some(values: Collection[str | None], most: int = 20) -> str:
    shown = sorted(map(repr, values))
    return ", ".join(shown[:most]) + (f" and {len(shown) - most} more" if len(shown) > most else "")


def _with_axes(recording: Recording, axes: Sequence[str]) -> Recording:
    missing = [axis for axis in axes if axis not in recording.axes]
    if missing:
        have = " ".join(recording.axes)
        raise ValueError(f"axes: recording {recording.name!r} has no axis {missing[0]!r}; it has {have}")
    columns = [recording.axes.index(axis) for axis in axes]
    return replace(recording, wrench=recording.wrench[:, columns], axes=tuple(axes))


def _places(indices: ArrayLike, n: int) -> list[int]:
    array = np.asarray(indices)
    if array.size == 0:
        return []
    if array.ndim != 1 or array.dtype.kind not in "iub":
        raise TypeError(
            f"indices has dtype {array.dtype} and shape {array.shape}; wanted a list of int, or a mask"
        )
    if array.dtype.kind == "b" and len(array) != n:
        raise ValueError(f"indices is a mask of {len(array)} for {n} recordings")
    try:
        return [int(i) for i in np.arange(n)[array]]
    except IndexError as error:
        raise IndexError(f"indices reach outside the {n} recordings: {error}") from error
