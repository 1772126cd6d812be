"""Labels, sessions and pauses: what is refused as it may stand elsewhere, and what reports say of where it stands."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from granular_id._text import alternatives, counted, in_both, typed, verb
from granular_id.io.files import RecordingFileError
from granular_id.io.source import FileContent, FileSource, ReadFile, likeliest_first
from granular_id.recording import PAUSE_S, SESSION_MAY_BE, Made

_EXAMPLES = 3


def refuse_labels_of_table(made: Made, content: FileContent, source: FileSource) -> None:
    """Refuse a table of several recordings whose labels nothing states, but perhaps a column that is not read."""
    if source.label is not None or source.label_from is not None:
        return
    if ways := _ways_to_labels(made.may_be_labels, source):
        raise RecordingFileError(source.path, ways)
    if made.may_be_several and source.label_known is None:
        columns = ", ".join(repr(way["label"].removeprefix("column:")) for way in made.may_be_several)
        problem = f"{columns} may hold the labels of several recordings: pass "
        ways = alternatives(in_both(**way) for way in (*made.may_be_several, {"label": source.place_rule}))
        raise RecordingFileError(source.path, (problem, *ways))
    if made.may_be_ids:
        problem = f"{made.may_be_ids[0]!r:.60} counts stretches of rows, as recordings do: pass "
        place = f"column:{made.label_column}" if made.label_column else source.place_rule
        ways = alternatives([in_both(id=made.may_be_ids[0]), in_both(label=place)])
        raise RecordingFileError(source.path, (problem, *ways, " to read all of it as one"))
    if made.label_mend:
        problem = f"ids of recordings may hold their labels; if not, pass {in_both(label=source.place_rule)}"
        raise RecordingFileError(source.path, (problem, *content.in_python(made.label_mend)))


def refuse_labels_of_files(root: str | os.PathLike[str], reads: Sequence[ReadFile]) -> None:
    """Refuse files of one recording each that one column may label, where their places say nothing or one thing."""
    for read in reads:
        labels = {recording.label for recording in read.recordings}
        stated = read.source.label_known is not None or read.source.label_from is not None
        if stated or labels - {None, read.source.label_else}:
            return
    names = set(reads[0].may_be_labels).intersection(*(read.may_be_labels for read in reads))
    texts = {name: [text for read in reads for text in read.may_be_labels[name]] for name in sorted(names)}
    if ways := _ways_to_labels(texts, reads[0].source):
        raise RecordingFileError(root, ways)


def _ways_to_labels(texts: Mapping[str, Sequence[str]], source: FileSource) -> list[str]:
    """Say which columns may hold the labels: those with one value for several recordings, but not for all."""
    kinds = {f"column:{name}": set(each) for name, each in texts.items() if 1 < len(set(each)) < len(each)}
    if not kinds:
        return []
    names = ", ".join(repr(rule.removeprefix("column:")) for rule in kinds)
    problem = f"{names} may hold the labels, which are read from 'label' or 'material' (of arrays 'y'): pass "
    rules = likeliest_first({**kinds, source.place_rule: range(source.n_labels)})
    return [problem, *alternatives(in_both(label=rule) for rule in rules)]


def labels_of_one(reads: Sequence[ReadFile]) -> list[str]:
    """Say where most labels are of one recording only, and which folder, column or entry of meta may be the label."""
    recordings = [(recording, read.source) for read in reads for recording in read.recordings]
    counts = Counter(recording.label for recording, _ in recordings if recording.label is not None)
    single = [label for label, count in counts.items() if count == 1]
    if len(counts) < 2 or 2 * len(single) <= len(counts):
        return _labels_in_pairs(reads)
    values: dict[str, list[str | None]] = {
        "file": [source.name_label for _, source in recordings],
        "folder": [source.path.parent.name if "/" in source.name else None for _, source in recordings],
        "parent": [
            source.path.parent.parent.name if source.name.count("/") > 1 else None for _, source in recordings
        ],
    }
    for read in reads:
        for name, texts in read.may_be_labels.items():
            values.setdefault(f"column:{name}", []).extend(texts)
    for name in sorted(recordings[0][0].meta.keys() - {"read_as"}):
        values[f"meta:{name}"] = [
            text if isinstance(text := recording.meta.get(name), str) else None for recording, _ in recordings
        ]
    rules = likeliest_first(
        {
            rule: set(texts)
            for rule, texts in values.items()
            if None not in texts and len(texts) == len(recordings) and 1 < len(set(texts)) <= len(texts) / 2
        }
    )
    some = ", ".join(map(repr, single[:_EXAMPLES])) + ", ..." * (len(single) > _EXAMPLES)
    pass_one = (
        "".join(["pass ", *alternatives(in_both(label=rule) for rule in rules), "; or "]) if rules else ""
    )
    return [
        f"{len(single)} of {counted(len(counts), 'label')} have one recording only ({some}), and nothing to test with: "
        f"where they are no materials, {pass_one}name files after them, or list file and label in an index.csv"
    ]


def _labels_in_pairs(reads: Sequence[ReadFile]) -> list[str]:
    """Say where labels that places say are pairs of words of which each is in several: ``anna_rice``."""
    labels = {read.source.label_else for read in reads if read.source.label is None} - {None}
    split = [re.fullmatch(r"([^\W_]+)[\W_]+(.+)", str(label)) for label in labels]
    pairs = [(one[1], one[2]) for one in split if one is not None]
    firsts, seconds = (sorted({pair[i] for pair in pairs}) for i in (0, 1))
    if (
        len(pairs) < len(labels)
        or min(len(firsts), len(seconds)) < 2
        or len(pairs) < len(firsts) * len(seconds)
    ):
        return []
    return [
        f"labels are pairs of {', '.join(firsts[:_EXAMPLES])} and {', '.join(seconds[:_EXAMPLES])}, each a material; "
        "where one of the two is none (a person, a speed), list file and label in an index.csv"
    ]


def other_sessions(reads: Sequence[ReadFile]) -> str | None:
    """Say which column, array or folder may hold sessions, where none is known, or all have one, or each its own."""
    known = [recording.session for read in reads for recording in read.recordings]
    sources = [read.source for read in reads for _ in read.recordings]
    if 1 < len(set(known)) < len(known):
        return None
    values: dict[str, list[str]] = {}
    for read in reads:
        for name, texts in read.may_be_sessions.items():
            values.setdefault(f"column:{name}", []).extend(texts)
    folder = "parent" if all(source.label_place == "folder" for source in sources) else "folder"
    depth = 2 if folder == "parent" else 1
    if all(source.name.count("/") >= depth for source in sources):
        values[folder] = [source.name.split("/")[-1 - depth] for source in sources]
    rules = [
        rule
        for rule, texts in values.items()
        if len(texts) == len(known) and 1 < len(set(texts)) < len(texts)
    ]
    return SESSION_MAY_BE + " or ".join(typed(session=rule).strip("()") for rule in rules) if rules else None


def place_note(what: str, reads: Sequence[ReadFile], alone: bool) -> str | None:
    """Say where labels or sessions were taken from, with a few examples."""
    examples: dict[str, dict[str, str]] = {}
    for read in reads:
        for recording in read.recordings:
            text = getattr(recording, what)
            stated, other = getattr(read.source, what), getattr(read.source, f"{what}_else")
            place = getattr(read.source, f"{what}_place")
            known = stated is not None or (other is not None and other == text) or ":" in place
            if text is not None:
                of_place = examples.setdefault(place if known else "what the file says", {})
                of_place.setdefault(text, read.source.name)
    if not examples:
        return None if alone else f"{what}: not known"
    parts = []
    for place, texts in examples.items():
        some = ", ".join(f"{text!r:.40} of {name}" for text, name in list(texts.items())[:_EXAMPLES])
        parts.append(f"{place} ({some}{', ...' if len(texts) > _EXAMPLES else ''})")
    return f"{what}: {'; '.join(parts)}"


def alike_labels(reads: Sequence[ReadFile]) -> list[str]:
    """Say which labels differ in nothing but case and what stands between words."""
    labels = sorted({one.label for read in reads for one in read.recordings if one.label is not None})
    alike: dict[str, list[str]] = {}
    for label in labels:
        plain = re.sub(r"(?<=[^\W\d_])[\s_-]+(?=[^\W\d_])", " ", label.casefold())
        alike.setdefault(plain, []).append(label)
    several = [names for names in alike.values() if len(names) > 1]
    if not several:
        return []
    shown = "; ".join(", ".join(map(repr, names[:_EXAMPLES])) for names in several[:_EXAMPLES])
    return [f"labels that differ by case or blanks only are materials of their own: {shown}; call them alike"]


def pauses_in(reads: Sequence[ReadFile]) -> list[str]:
    """Say how recordings are made of the stretches between pauses, where several pushes may stand in one log."""
    stamps = [one.time_s for read in reads for one in read.recordings if one.time_s is not None]
    pauses = [float(np.diff(time_s).max(initial=0)) for time_s in stamps]
    long = [pause for pause in pauses if pause >= PAUSE_S]
    if not long:
        return []
    have = f"{counted(len(long))} {verb(len(long), 'has', 'have')} pauses of up to {max(long):.3g} s"
    return [
        f"{have}: .split(gap_s={PAUSE_S:g}) makes a recording of each stretch {typed(split_gap_s=PAUSE_S)}"
    ]
