"""What the checks of a data set found that spoils its evaluation: shown above the accuracies, or reason to refuse."""

from __future__ import annotations

from collections.abc import Sequence

from granular_id._checks import argument_error
from granular_id.recording import CheckReport, Dataset, Finding
from granular_id.splits import Folds

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


def spoiling(report: CheckReport, folds: Folds, data: Dataset) -> tuple[Finding, ...]:
    """Return the findings that spoil an evaluation: errors, and clocks that name the label.

    Of recordings that hold each other's samples only where one trains while the other is tested.
    """
    return tuple(
        finding
        for finding in report
        if _apart(finding, folds, len(data))
        or (finding.code not in _COPIES and finding.severity == "error")
        or finding.code in _CLOCKS
    )


def refuse_copies(findings: Sequence[Finding], accepted: Sequence[str], folds: Folds, data: Dataset) -> None:
    """Refuse recordings that share samples on both sides of a split, unless that is accepted."""
    apart = {
        finding.code: pairs
        for finding in findings
        if finding.code not in accepted and (pairs := _apart(finding, folds, len(data)))
    }
    if not apart:
        return
    every = set[tuple[int, int]]().union(*apart.values())
    one, other = min(every)
    more = f", and {len(every) - 1} more such pairs" if len(every) > 1 else ""
    raise ValueError(
        f"{data.names[one]!r} and {data.names[other]!r} share samples, and one trains while the other is tested{more}: "
        f"leave one out, give both one session, or pass accept={tuple(apart)!r}"
    )


def _apart(finding: Finding, folds: Folds, n_rows: int) -> set[tuple[int, int]]:
    """Pairs of copies of which one trains while the other is tested."""
    found = set[tuple[int, int]]()
    if finding.code not in _COPIES:
        return found
    for fold in folds:
        side = [0] * n_rows
        for rows, sign in ((fold.train, 1), (fold.test, -1)):
            for row in rows.tolist():
                side[row] = sign
        found |= {(one, other) for one, other, *_ in finding.values["pairs"] if side[one] * side[other] < 0}
    return found
