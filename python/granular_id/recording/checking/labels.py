"""Labels: whether there are some, enough, and as many recordings of each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from granular_id._words import counted, verb
from granular_id.recording.checking.finding import Finding, found
from granular_id.recording.one import Recording


def by_label(recordings: Sequence[Recording]) -> dict[str, list[int]]:
    """Return the places of the recordings of each label, labels in order of first appearance."""
    groups: dict[str, list[int]] = {}
    for i, r in enumerate(recordings):
        if r.label is not None:
            groups.setdefault(r.label, []).append(i)
    return groups


def check_labels(recordings: Sequence[Recording]) -> Iterator[Finding]:
    """Find recordings without a label, sets with nothing to tell apart, and labels of unequal size."""
    without = [i for i, r in enumerate(recordings) if r.label is None]
    if without:
        message = f"{counted(len(without))} {verb(len(without), 'has', 'have')} no label"
        yield found("error", "no-label", message, recordings, without)
    groups = by_label(recordings)
    if len(groups) == 1:
        only = next(iter(groups))
        yield found("error", "one-label", f"all recordings are {only!r}: nothing to tell apart")
    single = [label for label, group in groups.items() if len(group) == 1]
    if single and len(groups) > 1:
        message = f"{counted(len(single), 'label')} with one recording only: nothing is left to test with"
        yield found("warning", "single", message, recordings, [groups[label][0] for label in single])
    sizes = [len(group) for group in groups.values()]
    if len(set(sizes)) > 1:
        message = f"between {min(sizes)} and {max(sizes)} recordings per label"
        yield found("info", "uneven", message, fewest=min(sizes), most=max(sizes))


def check_axes(recordings: Sequence[Recording]) -> Iterator[Finding]:
    """Find recordings whose axes are not those of most."""
    kinds: dict[tuple[str, ...], list[int]] = {}
    for i, r in enumerate(recordings):
        kinds.setdefault(r.axes, []).append(i)
    if len(kinds) > 1:
        usual = max(kinds, key=lambda axes: len(kinds[axes]))
        other = sorted(i for axes, group in kinds.items() if axes != usual for i in group)
        message = f"{counted(len(other))} {verb(len(other), 'has', 'have')} other axes than {' '.join(usual)}"
        yield found("error", "axes-differ", message, recordings, other)
