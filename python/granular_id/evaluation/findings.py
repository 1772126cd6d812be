"""What the checks of a data set found that spoils its evaluation: shown above the accuracies, or reason to refuse."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from granular_id._checks import argument_error
from granular_id._text import counted
from granular_id.partitions import Partition
from granular_id.recording import CheckReport, Dataset, Finding, overlapping_windows

_COPIES = {"duplicates", "near-duplicates"}
_WINDOWS = "overlapping-windows"
_CLOCKS = {"leak-clock", "leak-hour"}


def accepted_names(accept: str | Sequence[str]) -> tuple[str, ...]:
    """Return the findings that are known, by the names that ``data check`` prints."""
    names = (accept,) if isinstance(accept, str) else tuple(accept)
    for name in names:
        if not isinstance(name, str):
            wanted = f"must hold names as granular-id data check prints them, got {name!r}"
            raise argument_error(TypeError, "accept", wanted)
    return names


def spoiling(report: CheckReport, partitions: Sequence[Partition], data: Dataset) -> tuple[Finding, ...]:
    """Return the findings that spoil an evaluation: errors, and clocks that name the label.

    Of recordings that hold each other's samples only where one trains while the other is tested.
    """
    n_rows = len(data)
    return tuple(
        finding
        for finding in (*report, *_windows_apart(data, partitions))
        if finding.code == _WINDOWS
        or next(_apart(finding, partitions, n_rows), None) is not None
        or (finding.code not in _COPIES and finding.severity == "error")
        or finding.code in _CLOCKS
    )


def _windows_apart(data: Dataset, partitions: Sequence[Partition]) -> Iterator[Finding]:
    """Tell of windows that share samples where one trains while the other is tested."""
    pairs = list(overlapping_windows(data.recordings))
    shared = sorted(set(_pairs_apart(pairs, partitions, len(data))))
    if shared:
        one, other = shared[0]
        rows = tuple(sorted({row for pair in shared for row in pair}))
        message = (
            f"{counted(len(shared), 'pair')} of windows share samples, and one trains while the other is tested, such "
            f"as {data.names[one]!r} and {data.names[other]!r}: cut windows that do not overlap"
        )
        yield Finding("error", _WINDOWS, message, tuple(data.names[row] for row in rows), rows, {})


def refuse_copies(
    findings: Sequence[Finding],
    accepted: Sequence[str],
    partitions: Sequence[Partition],
    names: Sequence[str],
) -> None:
    """Refuse recordings that share samples on both sides of a split, unless that is accepted."""
    apart = {
        finding.code: pairs
        for finding in findings
        if finding.code not in accepted and (pairs := set(_apart(finding, partitions, len(names))))
    }
    if not apart:
        return
    every = set[tuple[int, int]]().union(*apart.values())
    one, other = min(every)
    more = f", and {len(every) - 1} more such pairs" if len(every) > 1 else ""
    raise ValueError(
        f"{names[one]!r} and {names[other]!r} share samples, and one trains while the other is tested{more}: "
        f"leave one out, give both one session, or pass accept={tuple(apart)!r}"
    )


def _apart(finding: Finding, partitions: Sequence[Partition], n_rows: int) -> Iterator[tuple[int, int]]:
    """Yield pairs of copies of which one trains while the other is tested."""
    if finding.code in _COPIES:
        pairs = [(one, other) for one, other, *_ in finding.values["pairs"]]
        yield from _pairs_apart(pairs, partitions, n_rows)


def _pairs_apart(
    pairs: Sequence[tuple[int, int]], partitions: Sequence[Partition], n_rows: int
) -> Iterator[tuple[int, int]]:
    for part in partitions:
        side = [0] * n_rows
        for row in part.train.tolist():
            side[row] = 1
        for row in part.test.tolist():
            side[row] = -1
        for one, other in pairs:
            if side[one] * side[other] < 0:
                yield one, other
