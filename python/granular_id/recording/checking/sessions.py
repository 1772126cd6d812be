"""Sessions: whether they are known, and whether a label can be told from its session."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from granular_id.recording.checking.finding import Finding, found
from granular_id.recording.checking.labels import by_label
from granular_id.recording.one import Recording


def check_sessions(recordings: Sequence[Recording]) -> Iterator[Finding]:
    """Find recordings without a session, and labels that have one session only, each its own."""
    without = [i for i, r in enumerate(recordings) if r.session is None]
    if len(without) == len(recordings):
        message = "no recording says which session it is from: keep together what was recorded together"
        yield found("warning", "no-session", message)
        return
    if without:
        message = f"{len(without)} of {len(recordings)} recordings do not say which session they are from"
        yield found("warning", "some-sessions", message, recordings, without)
    groups = {
        label: frozenset({recordings[i].session for i in group} - {None})
        for label, group in by_label(recordings).items()
    }
    alone = [label for label, sessions in groups.items() if len(sessions) == 1]
    if len(groups) > 1 and len({groups[label] for label in alone}) > 1:
        message = (
            f"{len(alone)} of {len(groups)} labels have one session each: what a classifier learns may be the "
            "session, and no evaluation can tell"
        )
        yield found("warning", "session-is-label", message, labels=alone)
