"""Look a data set over for what would spoil an evaluation."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from statistics import median
from typing import Any, Literal

import numpy as np

from granular_id._core import AXES
from granular_id.recording.flags import SampleFlag
from granular_id.recording.one import Recording
from granular_id.recording.timing import largest_gap_s, median_step_s

_GAP_STEPS = 5.0
_LENGTH_SPREAD = 0.1
_SLOWEST_RATE_HZ = 1.0


@dataclass(frozen=True)
class Finding:
    """One thing worth knowing before results are believed.

    Attributes
    ----------
    severity : {"error", "warning", "info"}
        "error": an evaluation cannot run or would be wrong; "warning": it may mislead; "info": good to know.
    code : str
        Short fixed name of the check, for programs.
    message : str
        What was found, in words.
    recordings : tuple of str
        Names of the recordings concerned; empty when all are.
    """

    severity: Literal["error", "warning", "info"]
    code: str
    message: str
    recordings: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, ready for ``json.dumps``."""
        return {**asdict(self), "recordings": list(self.recordings)}

    def __str__(self) -> str:
        names = ", ".join(self.recordings[:3]) + (", ..." if len(self.recordings) > 3 else "")
        return f"{self.severity}: {self.message}" + (f" [{names}]" if names else "")


def check_recordings(recordings: Sequence[Recording]) -> list[Finding]:
    """Run all checks, worst findings first; see :meth:`Dataset.check`, which calls this."""
    checks = (_labels, _sessions, _rates, _gaps, _lengths, _axes, _duplicates, _flags)
    findings = [finding for check in checks for finding in check(recordings)]
    return sorted(findings, key=lambda finding: ("error", "warning", "info").index(finding.severity))


def _names(recordings: Sequence[Recording]) -> tuple[str, ...]:
    return tuple(r.name for r in recordings)


def _by_label(recordings: Sequence[Recording]) -> dict[str, list[Recording]]:
    groups: dict[str, list[Recording]] = {}
    for r in recordings:
        if r.label is not None:
            groups.setdefault(r.label, []).append(r)
    return groups


def _labels(recordings: Sequence[Recording]) -> Iterator[Finding]:
    without = [r for r in recordings if r.label is None]
    if without:
        yield Finding("error", "no-label", f"{len(without)} recordings have no label", _names(without))
    groups = _by_label(recordings)
    if len(groups) == 1:
        yield Finding(
            "error", "one-label", f"all recordings are {next(iter(groups))!r}: nothing to tell apart"
        )
    counts = {len(group) for group in groups.values()}
    if len(counts) > 1:
        yield Finding("info", "uneven", f"between {min(counts)} and {max(counts)} recordings per label")


def _sessions(recordings: Sequence[Recording]) -> Iterator[Finding]:
    without = [r for r in recordings if r.session is None]
    if len(without) == len(recordings):
        yield Finding(
            "warning", "no-session", "no recording says which session it is from: leakage cannot be judged"
        )
        return
    if without:
        message = f"{len(without)} of {len(recordings)} recordings do not say which session they are from"
        yield Finding("warning", "some-sessions", message, _names(without))
    groups = {label: {r.session for r in group} - {None} for label, group in _by_label(recordings).items()}
    alone = [label for label, sessions in groups.items() if len(sessions) == 1]
    if len(groups) > 1 and alone:
        shared = {frozenset(groups[label]) for label in alone}
        if len(shared) > 1:
            message = (
                f"{len(alone)} of {len(groups)} labels have one session each: label and session are mixed up"
            )
            yield Finding("warning", "session-is-label", message)


def _rates(recordings: Sequence[Recording]) -> Iterator[Finding]:
    irregular = [r for r in recordings if not r.is_uniform]
    if irregular:
        message = f"{len(irregular)} recordings are irregularly sampled: resample before extracting features"
        yield Finding("warning", "irregular", message, _names(irregular))
    rates = sorted({r.rate_hz for r in recordings if r.rate_hz is not None})
    if len(rates) > 1:
        yield Finding(
            "warning", "rates-differ", f"{len(rates)} different rates, {rates[0]:g} to {rates[-1]:g} Hz"
        )
    slow = [r for r in recordings if median_step_s(r) * _SLOWEST_RATE_HZ > 1]
    if slow:
        message = f"{len(slow)} recordings have less than one sample per second: are the stamps in seconds?"
        yield Finding("error", "slow", message, _names(slow))


def _gaps(recordings: Sequence[Recording]) -> Iterator[Finding]:
    gaps = [(r, largest_gap_s(r)) for r in recordings if not r.is_uniform]
    holed = [(r, gap) for r, gap in gaps if gap > _GAP_STEPS * median_step_s(r)]
    if holed:
        worst, gap = max(holed, key=lambda pair: pair[1])
        message = (
            f"{len(holed)} recordings have gaps of more than {_GAP_STEPS:g} median steps; the largest, "
            f"{gap:.3g} s, is in {worst.name!r}"
        )
        yield Finding("warning", "gaps", message, _names([r for r, _ in holed]))


def _lengths(recordings: Sequence[Recording]) -> Iterator[Finding]:
    lengths = {r.n_samples for r in recordings}
    if len(lengths) > 1:
        message = f"lengths differ, {min(lengths)} to {max(lengths)} samples: align before comparing"
        yield Finding("warning", "lengths-differ", message)
    typical = {label: median(r.duration_s for r in group) for label, group in _by_label(recordings).items()}
    if len(typical) > 1:
        middle = median(typical.values())
        for label, seconds in typical.items():
            if abs(seconds - middle) > _LENGTH_SPREAD * middle:
                message = (
                    f"recordings of {label!r} last {seconds:.3g} s, those of other labels {middle:.3g} s: "
                    "the length gives the label away"
                )
                yield Finding("warning", "length-tells-label", message)


def _axes(recordings: Sequence[Recording]) -> Iterator[Finding]:
    stuck = [(r, np.flatnonzero(np.ptp(r.wrench, axis=0) == 0)) for r in recordings if r.n_samples > 1]
    stuck = [(r, axes) for r, axes in stuck if len(axes)]
    if stuck:
        axes = sorted({int(i) for _, indices in stuck for i in indices})
        message = f"{len(stuck)} recordings have axes that never change ({', '.join(AXES[i] for i in axes)})"
        yield Finding("warning", "stuck-axis", message, _names([r for r, _ in stuck]))


def _duplicates(recordings: Sequence[Recording]) -> Iterator[Finding]:
    seen: dict[bytes, Recording] = {}
    twins: list[Recording] = []
    clash = False
    for r in recordings:
        digest = hashlib.blake2b(r.wrench.tobytes()).digest()
        if digest in seen:
            twins += [seen[digest], r]
            clash |= seen[digest].label != r.label
        seen.setdefault(digest, r)
    if twins:
        message = f"{len(twins) // 2} recordings hold exactly the samples of another one"
        if clash:
            message += ", some under a different label"
        yield Finding("error", "duplicates", message, _names(twins))


def _flags(recordings: Sequence[Recording]) -> Iterator[Finding]:
    for bit in SampleFlag:
        marked = [r for r in recordings if r.flags is not None and bool((r.flags & bit).any())]
        if marked:
            samples = sum(int((r.flags & bit > 0).sum()) for r in marked if r.flags is not None)
            name = str(bit.name).lower().replace("_", "-")
            message = f"{samples} samples in {len(marked)} recordings are marked {bit.name}"
            yield Finding("info", name, message, _names(marked))
