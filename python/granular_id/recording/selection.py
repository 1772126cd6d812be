"""Pick recordings out of a data set by label, session or place."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from granular_id.recording.one import Recording
from granular_id.recording.report import StepReport


def select_recordings(
    recordings: Sequence[Recording],
    labels: str | Sequence[str] | None,
    sessions: str | Sequence[str] | None,
    indices: ArrayLike | None,
) -> tuple[list[Recording], StepReport]:
    """Keep what meets every condition; see :meth:`Dataset.select`, which calls this."""
    kept = list(range(len(recordings))) if indices is None else _places(indices, len(recordings))
    parameters: dict[str, object] = {"indices": None if indices is None else "given"}
    for name, wanted in (("label", labels), ("session", sessions)):
        values = {wanted} if isinstance(wanted, str) else None if wanted is None else set(wanted)
        parameters[f"{name}s"] = None if values is None else sorted(values, key=str)
        if values is None:
            continue
        present = {getattr(r, name) for r in recordings}
        if not values <= present:
            missing, have = (", ".join(sorted(map(repr, some))) for some in (values - present, present))
            raise ValueError(f"{name}s: no recording has {missing}; there are {have}")
        kept = [i for i in kept if getattr(recordings[i], name) in values]
    if not kept:
        raise ValueError(
            "select() leaves no recording: no index is given, or the conditions exclude each other"
        )
    totals = {"recordings_before": len(recordings), "recordings_after": len(kept)}
    return [recordings[i] for i in kept], StepReport("select", parameters, totals)


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
