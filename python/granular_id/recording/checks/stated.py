"""What is stated beside the samples: labels, sessions, axes, time and flags."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator

import numpy as np

from granular_id._text import counted, listed
from granular_id.recording.checks.measured import Measured
from granular_id.recording.checks.report import Finding, Severity
from granular_id.recording.clock import MAX_GAP_S
from granular_id.recording.columns import SESSION_NAMES
from granular_id.recording.recording import Recording, SampleFlag, places_of, single_values
from granular_id.recording.report import subject
from granular_id.recording.setup import Setup
from granular_id.recording.steps import recordings_cut

SLOWEST_RATE_HZ = 1.0  # below it the stamps are rather in milliseconds than in seconds
# Steps may spread (90 % less 10 % quantile) by this part of their median before it counts as jitter.
JITTER_TOLERANCE = 0.5
# Share of samples inside filled gaps from which on a reader is warned: high frequencies are lost there.
MANY_FILLED = 0.05
# A recording is far shorter below this part of the usual length, where this part of all last about that, within 5 %.
SHORT, MOST_EQUAL, NEARLY_EQUAL = 0.8, 0.8, 0.95
_WORDS = {
    SampleFlag.GAP_FILLED: "were interpolated inside gaps, where high frequencies are lost",
    SampleFlag.SATURATED: "were marked as saturated when they were recorded",
    SampleFlag.BAD_STATUS: "came with an error reported by the sensor",
    SampleFlag.TIME_REPAIRED: "were sorted or merged because their time ran back or stood still",
}


def check_labels(data: Measured) -> Iterator[Finding]:
    """Find recordings without a label, nothing to tell apart, and labels that read alike."""
    without = [i for i, r in enumerate(data.recordings) if r.label is None]
    if without:
        yield data.finding("error", "no-label", f"{subject(len(without))} no label", without)
    if len(data.labels) == 1:
        only = next(iter(data.labels))
        yield data.finding("error", "one-label", f"all recordings are {only!r}: nothing to tell apart")
    alike = places_of(map(_plain, data.labels))
    for same in (group for group in alike.values() if len(group) > 1):
        names = listed([repr(list(data.labels)[place]) for place in same])
        only = "case, blanks, hyphens, underscores or codes of accents only"
        message = f"{names} differ by {only}: name one material alike"
        yield data.finding("warning", "labels-alike", message)
    single = [group[0] for group in data.labels.values() if len(group) == 1]
    if single and len(data.labels) > 1:
        message = f"{counted(len(single), 'label')} with one recording only: nothing is left to test with"
        yield data.finding("warning", "single", message, single)


def _plain(label: str) -> str:
    """Return a label as people read it: an umlaut is one letter or two, as names of files on a Mac have it."""
    return re.sub(r"[\s_-]+", " ", unicodedata.normalize("NFKC", label)).strip().casefold()


def check_axes(data: Measured) -> Iterator[Finding]:
    """Find recordings whose axes are not those of most."""
    kinds = places_of(r.axes for r in data.recordings)
    if len(kinds) > 1:
        usual = max(kinds, key=lambda axes: len(kinds[axes]))
        other = sorted(i for axes, group in kinds.items() if axes != usual for i in group)
        message = f"{subject(len(other))} other axes than {' '.join(usual)}"
        yield data.finding("error", "axes-differ", message, other)


def check_sessions(data: Measured) -> Iterator[Finding]:
    """Find recordings without a session, all or each of one, and labels that have one session only, each its own."""
    without = [i for i, r in enumerate(data.recordings) if r.session is None]
    n_sessions = len({r.session for r in data.recordings})
    n_recorded = len(set(recordings_cut(data.recordings).tolist()))
    if len(without) == len(data.recordings):
        message = f"no recording says which session it is from: {_session_remedy(data)}"
        yield data.finding("warning", "no-session", message)
    elif n_recorded > 1 and not without and n_sessions == 1:
        message = (
            f"all recordings are of one session, so that none can be held out; else {_session_remedy(data)}"
        )
        yield data.finding("warning", "one-session", message)
    elif not without and n_sessions == n_recorded and not data.labels_of_one_session and _session_ways(data):
        message = (
            f"each recording is a session of its own, and a day shows nowhere; else {_session_remedy(data)}"
        )
        yield data.finding("warning", "own-sessions", message)
    elif without:
        some = f"{len(without)} of {len(data.recordings)} recordings"
        yield data.finding(
            "warning", "some-sessions", f"{some} do not say which session they are from", without
        )
    if data.labels_of_one_session:
        message = (
            f"{len(data.labels_of_one_session)} of {len(data.labels)} labels have one session each: what a "
            "classifier learns may be the session, and no evaluation can tell"
        )
        yield data.finding("warning", "session-is-label", message, labels=data.labels_of_one_session)


def _session_remedy(data: Measured) -> str:
    """Say where sessions stand, or may stand in general."""
    ways = _session_ways(data) or ["data convert --session column:NAME, folder or meta:NAME"]
    return f"keep together what was recorded together ({' or '.join(ways)})"


def _session_ways(data: Measured) -> list[str]:
    """Return where sessions stand: what reading saw, else an entry of the metadata, days, or files of several."""
    recordings, ways = data.recordings, [data.session_hint] if data.session_hint else []
    if not ways:
        stated = [dict(single_values(r.meta)) for r in recordings]
        names = [name for name in stated[0] if SESSION_NAMES.fullmatch(name.rpartition(".")[2])]
        values = {f"data convert --session meta:{name}": [one.get(name) for one in stated] for name in names}
        starts = [r.start_time for r in recordings]
        if None not in starts:
            values["evaluate --hold-out day"] = [int(start // 86400) for start in starts if start is not None]
        values["data convert --session file"] = [r.name.partition("[")[0] for r in recordings]
        ways = [way for way, each in values.items() if None not in each and 1 < len(set(each)) < len(each)]
    return ways


def check_setups(data: Measured) -> Iterator[Finding]:
    """Find what each label has of its own: a tool or another part of the set-up, a person or another text in `meta`."""
    stated = {i: _setup_of(data.recordings[i]) for group in data.witnesses.values() for i in group}
    of_labels = {}
    for name in next(iter(stated.values()), {}):
        values = {
            label: {stated[i].get(name) for i in group}.pop()
            for label, group in data.witnesses.items()
            if len({stated[i].get(name) for i in group}) == 1
        }
        one_each = len(set(values.values()) - {None}) == len(data.witnesses) > 1
        if one_each and any(_plain(str(value)) != _plain(label) for label, value in values.items()):
            of_labels[name] = values
    if of_labels:
        name, values = next(iter(of_labels.items()))
        examples = ", ".join(f"{value!r:.30} with {label}" for label, value in [*values.items()][:2])
        message = (
            f"each label has its own {listed([*of_labels])} ({name}: {examples}): what a classifier learns may be "
            "that, and no evaluation can tell; record each label with all of them"
        )
        yield data.finding("warning", "setup-is-label", message, names=[*of_labels])


def _setup_of(recording: Recording) -> dict[str, str | None]:
    """Return the set-up and the texts in the metadata; numbers there describe as a rule the material, as its grain."""
    found = dict(vars(Setup.of(recording.meta)))
    texts = {path: value for path, value in single_values(recording.meta) if isinstance(value, str)}
    return found | {path: text for path, text in texts.items() if path.rpartition(".")[2] not in found}


def check_rates(data: Measured) -> Iterator[Finding]:
    """Find rates that cannot be, or that differ."""
    recordings, paces = data.recordings, data.paces
    slow = [i for i, p in enumerate(paces) if p.median_s * SLOWEST_RATE_HZ > 1]
    if slow:
        message = f"{counted(len(slow))} with less than one sample per second: are the stamps in seconds?"
        yield data.finding("error", "slow", message, slow)
    rates = sorted({r.rate_hz for r in recordings if r.rate_hz is not None})
    if len(rates) > 1:
        usual = max(rates, key=lambda rate: sum(r.rate_hz == rate for r in recordings))
        other = [i for i, r in enumerate(recordings) if r.rate_hz not in (None, usual)]
        message = (
            f"{len(rates)} different rates, {rates[0]:g} to {rates[-1]:g} Hz; {len(other)} not at {usual:g}"
        )
        yield data.finding("warning", "rates-differ", message, other, rates_hz=rates)


def check_lengths(data: Measured) -> Iterator[Finding]:
    """Find few recordings that are far shorter than the others, which are about equal."""
    lengths = np.array([r.duration_s for r in data.recordings])
    usual = float(np.median(lengths))
    short, equal = np.flatnonzero(lengths < SHORT * usual), lengths >= NEARLY_EQUAL * usual
    if short.size and (equal & (lengths <= usual / NEARLY_EQUAL)).sum() >= MOST_EQUAL * lengths.size:
        worst = data.recordings[int(lengths.argmin())]
        whole = [one for one, is_equal in zip(data.recordings, equal.tolist(), strict=True) if is_equal]
        fewest = min(one.n_samples / one.rate_hz if one.rate_hz else one.duration_s for one in whole)
        message = (
            f"{counted(short.size)} far shorter than the usual {usual:.3g} s, the shortest is {worst.name!r} "
            f"({worst.duration_s:.3g} s): cut off? leave out the short ones "
            f"(data convert --duration-s {fewest:.9g} --on-error skip)"
        )
        yield data.finding("warning", "short", message, short.tolist())


def check_gaps(data: Measured) -> Iterator[Finding]:
    """Find steps in time that are far longer than the others of the recording."""
    gaps = {i: p.longest_s for i, p in enumerate(data.paces) if p.longest_s > p.limit_s}
    if gaps:
        worst = max(gaps, key=lambda i: gaps[i])
        message = (
            f"{subject(len(gaps))} gaps, the longest {gaps[worst]:.3g} s in {data.recordings[worst].name!r}"
        )
        long = sum(gap > MAX_GAP_S for gap in gaps.values())
        if long:
            split = f"split them (--split-gap-s {MAX_GAP_S:g})"
            message += f"; {long} above {MAX_GAP_S:g} s, which resampling refuses: {split}"
        yield data.finding("warning", "gaps", message, gaps, longest_s=gaps[worst])


def check_steps(data: Measured) -> Iterator[Finding]:
    """Find recordings whose steps in time are very uneven."""
    jittery = [i for i, pace in enumerate(data.paces) if pace.spread > JITTER_TOLERANCE]
    if jittery:
        median = float(np.median([data.paces[i].median_s for i in jittery]))
        mean = float(np.median([data.paces[i].mean_s for i in jittery]))
        message = (
            f"{counted(len(jittery))} with uneven steps (median {1e3 * median:.3g} ms, mean {1e3 * mean:.3g} ms): "
            f"above {0.5 / mean:.3g} Hz the resampled signal is made up"
        )
        yield data.finding("warning", "jitter", message, jittery, median_step_s=median, mean_step_s=mean)


def check_flags(data: Measured) -> Iterator[Finding]:
    """Count flagged samples, flag by flag: what earlier steps or the sensor itself stated about them."""
    total = sum(r.n_samples for r in data.recordings)
    for bit in SampleFlag:
        counts = {
            i: number
            for i, r in enumerate(data.recordings)
            if r.flags is not None and (number := int(np.count_nonzero(r.flags & bit)))
        }
        if not counts:
            continue
        samples = sum(counts.values())
        share = samples / total
        mild = share <= MANY_FILLED if bit is SampleFlag.GAP_FILLED else bit is SampleFlag.TIME_REPAIRED
        severity: Severity = "info" if mild else "warning"
        where = f"{counted(samples, 'sample')} in {counted(len(counts))}"
        message = f"{where} ({100 * share:.2g} %) {_WORDS[bit]}"
        code = str(bit.name).lower().replace("_", "-")
        yield data.finding(severity, code, message, counts, samples=samples, share=share)
