"""What the checks of a data set found that spoils its evaluation: shown above the accuracies, or reason to refuse."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from granular_id._checks import argument_error
from granular_id.partitions import Partition
from granular_id.recording import CheckReport, Finding

_COPIES = {"duplicates", "near-duplicates"}
_CLOCKS = {"leak-clock", "leak-hour"}


def accepted_names(accept: str | Sequence[str]) -> tuple[str, ...]:
    """Return the findings that are known, by the names that ``data check`` prints."""
    names = (accept,) if isinstance(accept, str) else tuple(accept)
    for name in names:
        if not isinstance(name, str):
            wanted = f"must hold names as granular-id data check prints them, got {name!r}"
            raise argument_error(TypeError, "accept", wanted)
    return names


def spoiling(report: CheckReport, partitions: Sequence[Partition], n_rows: int) -> tuple[Finding, ...]:
    """Return the findings that spoil an evaluation: errors, and clocks that name the label.

    Of recordings that hold each other's samples only where one trains while the other is tested.
    """
    return tuple(
        finding
        for finding in report
        if (next(_apart(finding, partitions, n_rows), None) is not None)
        or (finding.code not in _COPIES and finding.severity == "error")
        or finding.code in _CLOCKS
    )


def refuse_copies(
    findings: Sequence[Finding],
    accepted: Sequence[str],
    partitions: Sequence[Partition],
    names: Sequence[str],
) -> None:
    """Refuse recordings that share samples on both sides of a split, unless that is accepted."""
    for finding in findings:
        pairs = set(_apart(finding, partitions, len(names)))
        if not pairs or finding.code in accepted:
            continue
        one, other = min(pairs)
        more = f", and {len(pairs) - 1} more such pairs" if len(pairs) > 1 else ""
        raise ValueError(
            f"{names[one]!r} and {names[other]!r} share samples, and one trains while the other is tested{more}: "
            f"leave one out, give both one session, or pass accept=('{finding.code}',)"
        )


def _apart(finding: Finding, partitions: Sequence[Partition], n_rows: int) -> Iterator[tuple[int, int]]:
    """Yield pairs of copies of which one trains while the other is tested."""
    if finding.code not in _COPIES:
        return
    for part in partitions:
        side = [0] * n_rows
        for row in part.train.tolist():
            side[row] = 1
        for row in part.test.tolist():
            side[row] = -1
        for one, other, *_ in finding.values["pairs"]:
            if side[one] * side[other] < 0:
                yield one, other
