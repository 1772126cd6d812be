"""A snapshot as one event of the stream that the page reads."""

from __future__ import annotations

import base64
import json
import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from granular_id.live.wording import SYNTHETIC, figures_of, history_of, score_of, shown_of

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike

    from granular_id.live.snapshot import Snapshot

__all__ = ["event", "frame"]


def frame(snapshot: Snapshot, number: int) -> bytes:
    """Encode a snapshot.

    Traces are float32 in base64, axis by axis: written as decimal numbers they would be four times as long and
    take the interpreter lock for milliseconds, thirty times a second. What the page shows as a number is sent as a
    number, with all its digits.

    Parameters
    ----------
    snapshot : Snapshot
    number : int
        Of the snapshot, counted from 1.

    Returns
    -------
    bytes
        One event of type ``snapshot`` of a stream of server-sent events.
    """
    shown = shown_of(snapshot)
    times, losses = snapshot.ranking_history
    return event(
        "snapshot",
        {
            "number": number,
            "state": snapshot.state,
            "state_name": shown.state,
            "answer": asdict(shown.answer),
            "history": [entry._asdict() for entry in history_of(snapshot)],
            "figures": [[figure.name, figure.value, figure.alarm] for figure in figures_of(snapshot)],
            "score": score_of(snapshot),
            "warnings": list(shown.warnings),
            "source": snapshot.source,
            "synthetic": SYNTHETIC if snapshot.synthetic else "",
            "rate_hz": snapshot.rate_hz,
            "cutoff_hz": snapshot.cutoff_hz,
            "capture_s": snapshot.capture_s,
            "time_s": snapshot.time_s,
            "axes": list(snapshot.axes),
            "units": list(snapshot.units),
            "latest": _numbers(snapshot.latest),
            "age_s": _packed(snapshot.row_age_s),
            "wrench": _packed(snapshot.wrench.T),
            "residual": _packed(snapshot.residual.T),
            "bins": [[float(edges[0]), float(edges[-1])] for edges in snapshot.bin_edges],
            "counts": _packed(snapshot.counts),
            "classes": list(snapshot.classes),
            "history_s": _packed(times),
            "history_losses": _packed(losses.T),
            "ranking": []
            if shown.decision is None
            else [[name, *_numbers([loss])] for name, loss in shown.decision.ranking],
        },
    )


def event(kind: str, data: dict[str, Any]) -> bytes:
    """Encode one server-sent event; JSON has no line breaks of its own, so one ``data`` line holds it."""
    return f"event: {kind}\ndata: {json.dumps(data, allow_nan=False)}\n\n".encode()


def _numbers(values: Iterable[float]) -> list[float | None]:
    return [float(value) if math.isfinite(value) else None for value in values]


def _packed(values: ArrayLike) -> str:
    with np.errstate(over="ignore"):  # beyond float32 nothing is drawn
        return base64.b64encode(np.asarray(values).astype("<f4").tobytes()).decode()
