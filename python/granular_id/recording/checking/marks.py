"""Samples that carry a flag: what earlier steps or the sensor itself said about them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from granular_id._words import counted
from granular_id.recording.checking.finding import Finding, Severity, found
from granular_id.recording.flags import SampleFlag
from granular_id.recording.one import Recording

MANY_FILLED = 0.05
"""Share of samples inside filled gaps from which on a reader is warned: high frequencies are lost there."""

_WORDS = {
    SampleFlag.GAP_FILLED: "were interpolated inside gaps, where high frequencies are lost",
    SampleFlag.SATURATED: "were marked as saturated when they were recorded",
    SampleFlag.BAD_STATUS: "came with an error reported by the sensor",
    SampleFlag.TIME_REPAIRED: "were sorted or merged because their time ran back or stood still",
}


def check_flags(recordings: Sequence[Recording]) -> Iterator[Finding]:
    """Count flagged samples, flag by flag; see `docs/checks.md` for which of them warn."""
    total = sum(r.n_samples for r in recordings)
    flagged = [(i, r.flags) for i, r in enumerate(recordings) if r.flags is not None]
    for bit in SampleFlag:
        counts = {i: int(np.count_nonzero(flags & bit)) for i, flags in flagged}
        places = [i for i, number in counts.items() if number]
        if not places:
            continue
        samples = sum(counts.values())
        share = samples / total
        worrying = (
            share > MANY_FILLED if bit is SampleFlag.GAP_FILLED else bit is not SampleFlag.TIME_REPAIRED
        )
        message = (
            f"{counted(samples, 'sample')} in {counted(len(places))} ({100 * share:.2g} %) {_WORDS[bit]}"
        )
        code = str(bit.name).lower().replace("_", "-")
        severity: Severity = "warning" if worrying else "info"
        yield found(severity, code, message, recordings, places, samples=samples, share=share)
