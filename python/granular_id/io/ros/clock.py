"""The clock of messages: which stamps are taken, and the recording that they make."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id.io.options import LoadOptions
from granular_id.io.ros.wrench import Wrenches
from granular_id.io.source import FileContent, FileSource
from granular_id.io.stamped import SINCE_1970, stamped_recording

__all__ = ["recording_of"]


def recording_of(
    wrenches: Wrenches,
    log_ns: NDArray[np.int64] | None,
    source: FileSource,
    options: LoadOptions,
    about: Mapping[str, Any],
    place_of: Callable[[int], dict[str, Any]],
    notes: list[str],
) -> FileContent:
    """Make one recording of messages; what of `about` is empty is left out of its metadata.

    `log_ns` says when messages were logged: their order, and their clock where ``header.stamp`` was never set. None
    where nobody knows: messages are then in order, and without stamps a rate must be stated.
    """
    # As every player does; files may hold them otherwise.
    order = np.arange(len(wrenches.wrench)) if log_ns is None else np.argsort(log_ns, kind="stable")
    stamps_ns, clock = _stamps(wrenches, log_ns, notes)
    first_s, stamps = 0.0, None
    if stamps_ns is not None:
        # ns since 1970 do not fit float64: seconds from the first stamp do, rounded once
        first_ns = int(stamps_ns.min())
        first_s = first_ns / 10**9  # of integers, rounded once; 1e9 would round twice
        stamps = (stamps_ns[order] - first_ns) / 1e9
    recording, remarks = stamped_recording(
        wrenches.wrench[order],
        source,
        options,
        stamps=stamps,
        start_time=first_s if first_s > SINCE_1970 else None,
        meta={key: value for key, value in about.items() if value},
        locate=lambda i: {} if i is None else place_of(int(order[i])),
        clock=clock,
        time_unit="s",
    )
    if 0 != first_s <= SINCE_1970:
        remarks["first_stamp_s"] = first_s
    return FileContent([recording], [{"name": recording.name, **remarks}] if remarks else [], notes)


def _stamps(
    wrenches: Wrenches, log_ns: NDArray[np.int64] | None, notes: list[str]
) -> tuple[NDArray[np.int64] | None, str]:
    """Choose the clock: the sensor's own stamps where they were ever set, else when messages were logged."""
    stamps_ns = wrenches.stamps_ns
    jitter = "log times are taken, which jitter more than the sensor's clock"
    if stamps_ns is None:
        notes.append(f"messages without a header: {jitter}")
        return log_ns, "log time"
    if (len(stamps_ns) > 1 and (stamps_ns == stamps_ns[0]).all()) or not stamps_ns.any():
        if log_ns is None:
            return None, "stamps that change"
        notes.append(f"header.stamp never changes: {jitter}")
        return log_ns, "log time"
    return stamps_ns, "header.stamp"
