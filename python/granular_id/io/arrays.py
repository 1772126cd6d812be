"""The convention for arrays in files (NPZ, MATLAB, HDF5), and what to do with all that is stored otherwise.

Either ``X`` (recordings, samples, axes), or a list of (samples, axes), with ``y``, ``fs`` or ``rate_hz`` and perhaps
``session``, ``name``, ``lengths``, ``axes``, ``units`` and ``t`` (s; or, where no rate is known, ``timestamps``,
``t_ms`` ...); or one array (samples, axes) a recording, named as its label, with a number behind it if there are
several (``rice``, ``rice_2``, group ``rice/1``). Other arrays are chosen by name (``array=``). Nothing is guessed:
anything else is an error with the line that reads the file.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._text import alternatives, in_both
from granular_id.io.array_lines import SIGNAL, label_levels, without_number
from granular_id.io.files import RecordingFileError
from granular_id.io.leaves import BESIDE, MOST_DEEP, PLACE, Chain, Found, Leaf, Opening
from granular_id.io.remedy import MOST_LISTED, Remedy
from granular_id.io.source import NO_MATERIAL, SESSION_LIKE, FileContent, FileSource, LoadOptions
from granular_id.recording import (
    AXES,
    SESSION_NAMES,
    TIME,
    Setup,
    Table,
    TableError,
    cell_text,
    meaning_of,
    padded_by_zeros,
    refuse_units_unread,
    units_by_axis,
)

_KNOWN = {name for names in BESIDE.values() for name in names}
_SETUP = {one.name for one in fields(Setup)} - {"read_as"}
_MOST_TEXTS = 20
"""Texts of one array that may state units, of each axis and more."""

_CLOCK = re.compile(r"t|times?|time_?stamps?|stamps?", re.IGNORECASE)

_COLUMNS = re.compile(
    r"(axis|axes|channels?|columns?|cols?|headers?|fields?)([_ ]?(names?|labels?|order))?", re.IGNORECASE
)


def content_of(
    tree: Mapping[str, Any], source: FileSource, options: LoadOptions, how: Opening
) -> FileContent:
    """Read what a tree of names holds: mappings are groups or structs, lists are cells, `Leaf` are arrays.

    `how` says how the file is opened in Python, for errors.
    """
    reading = _Reading(tree, source, options, how)
    found, notes = reading.found()
    tables = [table for one in found for table in reading.tables(one)]
    reading.refuse_labels_unread(tables)
    reading.refuse_recordings_in_rows(found)
    reading.refuse_padding(found, tables)
    places = [
        f"{how.kind} {table.name}" if len(tables) > 1 else f"{how.kind} {found[0].path}" for table in tables
    ]

    def place(table: int, row: int | None) -> dict[str, Any]:
        return {"place": places[table] + ("" if row is None else f", sample {row}")}

    is_finite = all(np.isfinite(table.values).all() for table in tables if table.values is not None)
    mended = None if is_finite else reading.remedy.mended(found)  # now, as the file will be closed
    orders, texts = reading.order_notes(found), reading.texts_of_one(tables)
    content = FileContent(tables, notes=notes, orders=orders, place=place, may_be_labels=texts)
    content.may_be_sessions = reading.days_beside(found, tables)
    return content if mended is None else replace(content, in_python=mended)


class _Reading:
    def __init__(
        self,
        tree: Mapping[str, Any],
        source: FileSource,
        options: LoadOptions,
        how: Opening,
        *,
        offers: bool = True,
    ) -> None:
        self._tree, self._source, self._options, self._how, self._offers = tree, source, options, how, offers
        self._leaves = list(_leaves(tree, "", ()))
        self._clocks: dict[int, list[tuple[str, Leaf, str | None]]] = {}
        self._axes = options.axes or source.axes or AXES
        self.remedy = Remedy(self._leaves, source, options, how)

    def found(self) -> tuple[list[Found], list[str]]:
        """Return the arrays of samples, and notes on what is left out."""
        tree, wanted = self._tree, self._options.array
        self._refuse_units_unread()
        why_none = (
            "holds no recordings by the convention: X (recordings, samples, axes) with y and fs, or an array a "
            "recording named as its label"
        )
        if wanted is not None:  # with or without the groups around it
            named = [
                one
                for one in self._leaves
                if one.path == wanted or f"/{PLACE.sub('', one.path)}".endswith(f"/{wanted}")
            ]
            found = [one for one in named if len(one.leaf.shape) in (2, 3)]
            if not found:
                raise self.fault(f"array={wanted!r:.60} names no array of samples (2 or 3 dimensions)")
            self._refuse_left_out([one for one in named if one not in found], found)
            found = self._in_groups(found)
        elif "X" in tree:
            why_none, node = "X is no array (recordings, samples, axes)", tree["X"]
            if isinstance(node, Leaf):
                found = [Found("X", node, (tree,))] if len(node.shape) in (2, 3) else []
            else:
                found = [Found(f"X[{i}]", leaf, (tree,)) for i, leaf in enumerate(_cells(node))]
        elif not any(one.leaf.is_numbers and len(one.leaf.shape) > 2 for one in self._leaves):
            found = self._labelled()
        else:  # of samples of several recordings in one array names are no labels
            found = []
        if not found:
            raise self.fault(why_none)
        used = {one.path.partition("/")[0].partition("[")[0] for one in found}
        clock, *_ = self._clock_beside(found[0])
        others = [
            name
            for name, node in tree.items()
            if name not in used
            and name.lower() not in _KNOWN
            and name.lower() not in _SETUP
            and not name.startswith("_")
            and node is not clock
        ]
        self._refuse_axes_unread(found[0])
        return found, [f"{self._how.kind}s that are not read: {', '.join(others)[:200]}"] if others else []

    def _refuse_units_unread(self) -> None:
        """Refuse units under another name, of arrays, attributes and fields."""
        if not self._offers:
            return
        n_axes = len(self._axes)
        holders = [one for one in self._leaves if one.leaf.is_numbers and n_axes in one.leaf.shape[-2:]]
        silent = [one for one in holders if self._about("units", one) is None]
        places = {id(place): place for one in silent for place in (one.leaf.about, *one.chain)}
        named = [
            (name, leaf)
            for place in places.values()
            for name, leaf in place.items()
            if name.lower() not in _KNOWN and isinstance(leaf, Leaf) and leaf.is_text
            if np.size(leaf.values) < _MOST_TEXTS
        ]
        texts = {name: ",".join(text or "" for text in _texts(leaf)) for name, leaf in named}
        wanted = self._options.units or self._source.units
        is_of_six = bool(silent) and self._about("axes", silent[0]) is None
        try:
            of_axes = units_by_axis(self._axes, wanted) if is_of_six else {}
            refuse_units_unread(texts, of_axes, is_stated=bool(wanted))
        except TableError as error:
            raise RecordingFileError(self._source.path, error.parts) from error

    def _refuse_axes_unread(self, one: Found) -> None:
        """Refuse an array whose columns are not fx to tz, as something beside it says that is not called `axes`."""
        if self._options.axes or self._source.axes or self._about("axes", one) is not None:
            return
        width = one.leaf.shape[-1]
        for name, leaf in (item for place in (one.leaf.about, *one.chain) for item in place.items()):
            texts = _texts(leaf) if isinstance(leaf, Leaf) and leaf.is_text else []
            texts = [part.strip() for part in (texts[0] or "").split(",")] if len(texts) == 1 else texts
            meanings = [meaning_of(text or "") for text in texts]
            known = [one.what or text for one, text in zip(meanings, texts, strict=True)]
            units = [one.unit or "" for one in meanings]
            is_scaled = any(one.unit and one.scale != 1.0 for one in meanings)
            are_axes = set(known) == set(AXES) or _COLUMNS.fullmatch(name)
            is_other = known != list(AXES) or (is_scaled and self._options.units is None)
            if are_axes and len(set(known) - {None}) == len(known) == width and is_other:
                problem = f"{name!r:.60} names the columns, which are read from 'axes' only; pass "
                way = {"axes": ",".join(map(str, known))} | ({"units": ",".join(units)} if is_scaled else {})
                raise RecordingFileError(self._source.path, (problem, in_both(**way)))

    def _refuse_left_out(self, others: Sequence[Found], found: Sequence[Found]) -> None:
        """Refuse arrays that hold no samples at places that differ by their numbers only from those that do."""
        places = {re.sub(r"\d+", "", one.path) for one in found}
        lost = next((one for one in others if re.sub(r"\d+", "", one.path) in places), None)
        if lost is not None:
            problem = (
                f"{lost.path} has the shape {lost.leaf.shape}, and {found[0].path} {found[0].leaf.shape}"
            )
            raise self.fault(f"{problem}; wanted samples of each recording")

    def _in_groups(self, found: list[Found]) -> list[Found]:
        """Name arrays by the groups that differ, where nothing else says the label: rice in rice/1/wrench."""
        levels = label_levels([one.path for one in found])
        if not levels or self._options.label is not None or self._about("y", found[0]) is not None:
            return found
        if len(levels) > 1:
            both = " or ".join(repr(names[0]) for names in levels)
            raise self.fault(f"groups lie in each other: {both} may be a material")
        own, place = self._source.label or self._source.label_else, self._source.label_place
        if own is not None and {own} != set(levels[0]):
            both = f"its groups are called {levels[0][0]!r:.60}, and its {place} {own!r:.60}"
            way = in_both(label="file" if "file" in place else "folder")
            raise self.fault(f"{both}: either may be the label; pass ", way)
        return [replace(one, label=name) for one, name in zip(found, levels[0], strict=True)]

    def _labelled(self) -> list[Found]:
        """Return arrays that are named as their labels, with a number behind; or the only one, without a label."""
        found: list[Found] = []
        for name, node in self._tree.items():
            if name.lower() in _KNOWN:
                continue
            if isinstance(node, Leaf) and node.is_numbers and len(node.shape) == 2:
                found.append(Found(name, node, (self._tree,), without_number(name)))
            elif isinstance(node, Mapping):
                inner = [(key, leaf) for key, leaf in node.items() if key.lower() not in _KNOWN]
                if not inner or not all(
                    isinstance(leaf, Leaf) and len(leaf.shape) == 2 and re.search(r"\d$", key)
                    for key, leaf in inner
                ):
                    return []
                found += [Found(f"{name}/{key}", leaf, (node, self._tree), name) for key, leaf in inner]
            elif cells := _cells(node):
                found += [Found(f"{name}[{i}]", leaf, (self._tree,), name) for i, leaf in enumerate(cells)]
        labels = {one.label for one in found}
        for one in found:
            axes = self._about("axes", one)
            if one.leaf.shape[1:] != (len(self._axes if axes is None else _texts(axes)),):
                return []
        signals = any(SIGNAL.search(str(label)) for label in labels)
        counted = all(str(label).lower() in NO_MATERIAL for label in labels)
        if len(found) == 1 or (counted and not signals):
            return [replace(one, label=None) for one in found]
        if signals or all(SESSION_LIKE.fullmatch(str(label)) for label in labels):
            return []
        known = self._source.label_else or self._source.label
        if self._source.label is None and known is not None and len(labels) == 1 and labels != {known}:
            both = f"its arrays are called {labels.pop()!r:.60}, and its {self._source.label_place} {known!r:.60}"
            ways = alternatives([in_both(label="folder"), in_both(label="file")])
            raise self.fault(f"{both}: either may be the label; say so by ", *ways)
        return found

    def tables(self, one: Found) -> list[Table]:
        """Return a table for each recording of an array, with what stands beside it."""
        shape = one.leaf.shape
        n = shape[0] if len(shape) == 3 else 1
        cell = re.fullmatch(r".*\[(\d+)\]", one.path)
        at = int(cell[1]) if cell is not None and one.chain[0] is self._tree else None
        of_all = (
            sum(other.path.startswith(one.path[: one.path.index("[")] + "[") for other in self._leaves)
            if at is not None
            else n
        )
        axes, units = self._about("axes", one), self._about("units", one)
        names = None if axes is None else tuple(text or "" for text in _texts(axes))
        try:
            stated = None if units is None else [text or "" for text in _texts(units)]
            if stated is not None and len(stated) == 1:  # as units= is typed: N,N,N,Nm,Nm,Nm
                stated = [unit.strip() for unit in stated[0].split(",")]
            known_units = units_by_axis(names or self._axes, stated)
        except ValueError as error:
            raise self.fault(str(error), offers=False) from error
        values = one.leaf.read()
        if not one.leaf.is_numbers:
            raise self.fault(f"{one.path} holds {values.dtype}; wanted numbers")
        label = self._each("y", one, of_all, self._options.label)
        session = self._each("session", one, of_all, self._options.session)
        called, rates, lengths = (self._each(what, one, of_all) for what in ("name", "rate_hz", "lengths"))
        stamps, called_clock, time_unit = self._clock_beside(one)
        clock = None if stamps is None else np.squeeze(stamps.read())  # of all recordings, or a row for each
        clock = None if clock is None or clock.ndim == 0 else clock
        self._refuse_order(values, one, label)
        width = values.shape[-1]
        if names is not None and len(names) in set(shape) - {width}:  # in another order
            raise self.fault(f"{one.path} {values.shape} has {width} columns; axes has {len(names)} names")
        if names is None and width not in (len(AXES), len(self._axes)):
            raise self.fault(
                f"{one.path} {values.shape} has {width} columns without names; pass axes= with a name for each (--axes)"
            )
        known_units |= {called_clock: time_unit} if time_unit else {}
        several = sum(len(other.leaf.shape) == 2 for other in self._leaves) > 1
        only = f"{self._source.name}[{one.path}]" if several and len(shape) == 2 else self._source.name
        rate_hint = self.remedy.rate_beside if clock is None and not any(rates) else None
        tables = []
        for i in range(n):
            k = i if at is None else at
            samples = values[i] if len(shape) == 3 else values
            text = lengths[k]
            length = None if text is None else int(text) if text.isdecimal() else 0
            if length is not None and not 0 < length <= len(samples):
                problem = f"lengths[{k}] is {text}, and {one.path} has {len(samples)} samples"
                raise self.fault(problem, offers=False)
            tables.append(
                Table(
                    name=called[k] or (f"{self._source.name}[{i}]" if n > 1 else only),
                    values=samples[:length],
                    axes=names,
                    units=known_units,
                    rate_hz=self._rate(rates[k]),
                    stamps=None if clock is None else (clock[i] if clock.ndim > 1 else clock)[:length],
                    label=label[k] or one.label,
                    session=session[k],
                    clock=called_clock,
                    rate_hint=rate_hint,
                    meta=self._setup_beside(one),
                )
            )
        return tables

    def refuse_labels_unread(self, tables: Sequence[Table]) -> None:
        """Refuse arrays whose labels nothing says, but perhaps an array, field or attribute that is not read."""
        stated = self._source.label is not None or self._options.label is not None
        if not self._offers or stated:
            return
        if any(table.label for table in tables):
            if len({table.label for table in tables}) == 1 < len(tables) and self.remedy.has_labels(
                len(tables)
            ):
                raise self.fault(
                    f"all recordings have the label {tables[0].label!r:.60}, and others stand beside them"
                )
            return
        every = [rule or "" for rule, _ in self.remedy.label_rules(self._options, self._tables_by)]
        rules = [rule for rule in every if rule.startswith("column:")]
        if rules and (len(tables) > 1 or self._source.label_known is None):
            names = ", ".join(repr(rule.removeprefix("column:")) for rule in rules)
            raise self.fault(f"{names:.200} may be the labels, which are read from 'y' only")

    def refuse_recordings_in_rows(self, found: Sequence[Found]) -> None:
        """Refuse one array of samples beside which whole numbers, a value a row, change in stretches."""
        if len(found) > 1 or len(found[0].leaf.shape) != 2 or self._options.array is not None:
            return
        n, counts = found[0].leaf.shape[0], []
        for one in self._leaves:
            is_short = (
                one.leaf.values.dtype.kind in "iu"
                and one.leaf.shape[1:] == ()
                and np.size(one.leaf.values) > 1
            )
            ends = one.leaf.read() if is_short and np.size(one.leaf.values) < n / 5 else np.array([0])
            if ends[-1] == n and ends[0] > 0 and (np.diff(ends) > 0).all():
                problem = (
                    f"{one.path} holds where recordings end, which {found[0].path} holds below each other"
                )
                raise RecordingFileError(self._source.path, (problem, *self.remedy.split_at(found, one)))
            is_id = (
                one.leaf.values.dtype.kind in "iu"
                and one.name.lower() not in _KNOWN
                and one.leaf.shape == (n,)
            )
            n_changes = np.count_nonzero(np.diff(one.leaf.read())) if is_id else 0
            if 0 < n_changes < n / 5 and len(np.unique(one.leaf.read())) == n_changes + 1:
                counts.append(one)
        if counts and (lines := self.remedy.apart(found, counts[0])):
            problem = (
                f"{counts[0].path} may count recordings, of which {found[0].path} holds the samples in rows"
            )
            parts = (f"{problem}; if not, pass ", in_both(array=found[0].path), *lines)
            raise RecordingFileError(self._source.path, parts)

    def refuse_padding(self, found: Sequence[Found], tables: Sequence[Table]) -> None:
        """Refuse recordings of one array that end in rows of zeros, and do not begin with any."""
        if self._options.array is not None or all(len(one.leaf.shape) == 2 for one in found):
            return
        n_padded = padded_by_zeros([table.values for table in tables if table.values is not None])
        if not n_padded:
            return
        mend = ".pipe(lambda f: f.loc[f.any(axis=1)[::-1].cummax()])"
        insist = in_both(array=found[0].path)
        problem = (
            f"{n_padded} of {len(tables)} recordings of {found[0].path} end in rows of zeros, as what is padded; how "
            f"many samples each has is read from 'lengths'; {insist} reads zeros as samples"
        )
        raise RecordingFileError(self._source.path, (problem, *self.remedy.mended(found)(mend)))

    def days_beside(self, found: Sequence[Found], tables: Sequence[Table]) -> dict[str, list[str]]:
        """Return what is called like days beside the recordings, with a text for each, where no session is known."""
        if any(table.session for table in tables):
            return {}
        beside = {name for place in (found[0].leaf.about, *found[0].chain) for name in place}
        n_each, texts = len(tables) // len(found), dict[str, list[str]]()
        for name in sorted(filter(SESSION_NAMES.fullmatch, beside)):
            with suppress(RecordingFileError):
                rule = f"column:{name}"
                texts[name] = [
                    text or "" for one in found for text in self._each("session", one, n_each, rule)
                ]
        return texts

    def texts_of_one(self, tables: Sequence[Table]) -> dict[str, list[str]]:
        """Return the texts beside the only recording of a file that has no label."""
        if len(tables) > 1 or tables[0].label is not None:
            return {}
        texts = [one for one in self._leaves if one.leaf.is_text and one.leaf.read().size == 1]
        return {one.name: [_texts(one.leaf)[0] or ""] for one in texts if one.name.lower() not in _KNOWN}

    def order_notes(self, found: Sequence[Found]) -> list[str]:
        """Say what each axis of an array was taken as, where its shape fits another order too."""
        notes = []
        for one in found:
            *others, n_axes = one.leaf.shape
            if n_axes in others:
                places = ("recordings", "samples")[-len(others) :]
                taken = ", ".join(f"{n} {what}" for n, what in zip(others, places, strict=True))
                notes.append(f"{one.path} {one.leaf.shape} is read as {taken}, {n_axes} axes")
        return notes[:1]

    def _refuse_order(self, values: NDArray[Any], one: Found, label: Sequence[str | None]) -> None:
        """Refuse three dimensions of which nobody says the order: more recordings than samples, and no labels."""
        if values.ndim != 3 or self._options.array is not None or any(label):
            return
        if values.shape[0] > values.shape[1]:
            if self.remedy.has_labels(values.shape[1]):
                raise self.fault(
                    f"{one.path} {values.shape} has more recordings than samples, and labels for these"
                )
            order = f"{one.path} {values.shape} would be {values.shape[0]} recordings of {values.shape[1]} samples"
            raise self.fault(f"{order}; if that is so, pass ", in_both(array=one.path))

    def _setup_beside(self, one: Found) -> dict[str, str]:
        """Return what stands beside an array of what it was recorded with, as `Setup` calls it: frame, tool, serial."""
        found: dict[str, str] = {}
        for place in (one.leaf.about, *one.chain):
            for name, leaf in place.items():
                if name.lower() in _SETUP and isinstance(leaf, Leaf) and np.prod(leaf.shape) == 1:
                    found.setdefault(name.lower(), _texts(leaf)[0] or "")
        return {name: text for name, text in found.items() if text}

    def _clock_beside(self, one: Found) -> tuple[Leaf | None, str, str | None]:
        """Return the stamps beside an array, what errors call them, and what they count where their name says so.

        Where no rate is known, it is also what is called like a clock and is as long as the samples.
        """
        known, called = self._about("t", one), f"clock (t) beside {one.path}"
        if known is not None or self._options.rate_hz or self._about("rate_hz", one) is not None:
            return known, called, None
        shapes = (
            one.leaf.shape[:-1],
            one.leaf.shape[-2:-1],
            (1, one.leaf.shape[-2]),
            (one.leaf.shape[-2], 1),
        )
        for place in (one.leaf.about, *one.chain):
            if id(place) not in self._clocks:
                self._clocks[id(place)] = _clocks_in(place)
            for name, leaf, unit in self._clocks[id(place)]:
                if leaf.shape in shapes:
                    return leaf, f"clock ({name}) beside {one.path}", unit
        return None, called, None

    def _about(self, what: str, one: Found) -> Leaf | None:
        """Return what stands beside an array: its attributes, its group, the groups around."""
        names = BESIDE[what]
        for place in (one.leaf.about, *one.chain):
            found = {
                key: node
                for key, node in place.items()
                if key.lower() in names and isinstance(node, Leaf) and node is not one.leaf
                if what != "t" or node.is_numbers
            }
            if len(found) > 1 and len({tuple(_texts(node)) for node in found.values()}) > 1:
                raise self.fault(f"{' and '.join(found)} say two things; wanted one of them", offers=False)
            if found:
                return next(iter(found.values()))
        return None

    def _rate(self, text: str | None) -> float | None:
        try:
            rate = None if text is None else float(text)
        except ValueError:
            rate = np.nan
        if rate is not None and not 0 < rate < np.inf:
            raise self.fault(f"fs is {text!r:.40}; wanted a rate above 0 in Hz", offers=False)
        return rate

    def _each(self, what: str, one: Found, n: int, rule: str | None = None) -> list[str | None]:
        """Return a text for each of n recordings; one that stands for all is repeated."""
        if rule is not None and rule.startswith("column:"):
            called = rule.removeprefix("column:")
            beside = (place[called] for place in (one.leaf.about, *one.chain) if called in place)
            leaf = next(beside, None) or next((two.leaf for two in self._leaves if two.path == called), None)
            if not isinstance(leaf, Leaf):
                raise self.fault(f"{rule!r:.60} is not there, as an array of texts or numbers")
        else:
            leaf = self._about(what, one)
        if leaf is None:
            return [None] * n
        texts = _texts(leaf)
        if len(texts) == 1 and (leaf.values.ndim == 0 or n == 1 or what not in ("y", "lengths")):
            return texts * n
        if what == "y" and n == 1 and self._offers and one.leaf.shape[:1] == (len(texts),):
            ids = [
                other
                for other in self._leaves
                if other.leaf.values.dtype.kind in "iu" and other.leaf.shape == (len(texts),)
                if other.leaf is not leaf and len(np.unique(other.leaf.read())) < len(texts) / 2
            ]
            if ids:
                problem = f"y has a value for each sample of {one.path}, which holds recordings in rows"
                raise RecordingFileError(self._source.path, [problem, *self.remedy.apart([one], ids[0])])
        if len(texts) != n:
            problem = (
                f"{rule or what} has {len(texts)} values, and {one.path} {one.leaf.shape} {n} recordings"
            )
            raise self.fault(problem)
        return texts

    def fault(self, problem: str, *way_out: str, offers: bool = True) -> RecordingFileError:
        """Return an error that lists the arrays, and says how to read them where another way may help."""
        shown = [f"{one.path[:60]} {one.leaf.shape}" for one in self._leaves if one.leaf.shape]
        more = len(shown) - MOST_LISTED
        listed = ", ".join(shown[:MOST_LISTED]) + (f" and {more} more" if more > 0 else "")
        whole = [problem, *way_out, f"; it holds {listed or 'no arrays'}"]
        if offers and self._offers:
            whole += self.remedy.way_out(self._tables_by)
        no_wrench = not any(len(one.leaf.shape) > 1 for one in self._leaves)
        return RecordingFileError(self._source.path, whole, no_wrench=no_wrench)

    def _tables_by(self, options: LoadOptions) -> list[Table]:
        """Read the file with other options, for a way out."""
        again = _Reading(self._tree, self._source, options, self._how, offers=False)
        tables = [table for one in again.found()[0] for table in again.tables(one)]
        return [replace(table, label=table.label or self._source.label) for table in tables]


def _clocks_in(place: Mapping[str, Any]) -> list[tuple[str, Leaf, str | None]]:
    """Return what is called like a clock in a group, or among attributes, with the unit in its name."""
    numbers = [(name, node) for name, node in place.items() if isinstance(node, Leaf) and node.is_numbers]
    meanings = [(name, leaf, meaning_of(name)) for name, leaf in numbers]
    return [
        (name, leaf, meaning.unit)
        for name, leaf, meaning in meanings
        if meaning.what == TIME and _CLOCK.fullmatch(meaning.base)
    ]


def _leaves(node: Any, path: str, chain: Chain, depth: int = 0) -> Iterator[Found]:
    """Yield all arrays below a node."""
    if depth > MOST_DEEP:
        return
    if isinstance(node, Leaf):
        yield Found(path, node, chain)
    elif isinstance(node, Mapping):
        for key, inner in node.items():
            yield from _leaves(inner, f"{path}/{key}" if path else str(key), (node, *chain), depth + 1)
    elif isinstance(node, list):
        for i, inner in enumerate(node):
            yield from _leaves(inner, f"{path}[{i}]", chain, depth + 1)


def _cells(node: Any) -> list[Leaf]:
    """Return the arrays of a list of such; none where it holds something else."""
    if not isinstance(node, list) or not node:
        return []
    return (
        node if all(isinstance(one, Leaf) and one.is_numbers and len(one.shape) == 2 for one in node) else []
    )


def _texts(leaf: Leaf) -> list[str | None]:
    """Return the values of an array as texts, numbers too: 3 for 3.0; empty ones as None."""
    values = leaf.read()
    if values.dtype.kind == "S":
        values = np.char.decode(values, "utf-8", "replace")
    texts = (
        value.decode("utf-8", "replace") if isinstance(value, bytes) else value
        for value in values.ravel().tolist()
    )
    return [cell_text(text) or None for text in texts]
