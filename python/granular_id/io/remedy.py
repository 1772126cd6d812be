"""The ways out of refusals of arrays: options that were tried, or lines of Python."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from granular_id._text import RATE, alternatives, in_both
from granular_id.io.array_lines import NO_LABELS, SIGNAL, ArrayLines, Call, label_levels, runs_of, stem_of
from granular_id.io.files import RecordingFileError
from granular_id.io.leaves import BESIDE, PLACE, Found
from granular_id.io.source import LoadOptions, likeliest_first
from granular_id.recording import AXES, LABEL_NAMES, Table

MOST_LISTED = 8

_FORCES = re.compile(r"wrench|force|torque|(^|[\W_])ft($|[\W_\d])", re.IGNORECASE)
"""Names of arrays that are offered first."""

_OWN = "what the file says"


class Remedy(ArrayLines):
    """What reads a file that does not keep the convention."""

    def way_out(self, read: Callable[[LoadOptions], Sequence[Table]]) -> list[str]:
        """Return what is passed, or the lines, with a semicolon before; nothing where no array may hold samples.

        `read` reads the file with other options: none is offered that fails.
        """
        if (options := self._options(read)) or not self._arrays:
            return options or self._lines()
        if self._how.by_reference and any("[" in one.path for one in self._arrays):
            return ["; save it with -v7, of which Python reads cells and structs"]
        return self._lines() or [
            "; Dataset.from_arrays(X, y, rate_hz=RATE) reads samples in the order X (recordings, samples, 6), and with "
            "axes=, a name a column, those of another sensor"
        ]

    def mended(self, found: Sequence[Found]) -> Callable[[str], list[str]]:
        """Return what gives the lines that read arrays as tables, each mended by methods of a data frame."""
        if self._how.by_reference and "[" in found[0].path:
            return lambda _mend: []
        named = runs_of([one.label for one in found]) if any(one.label for one in found) else ""
        call = next(iter(self._listed(found)), None) or Call(self._list_of(found))
        _ = self._rate  # while the file is open

        def lines(mend: str) -> list[str]:
            frames = f"[pandas.DataFrame(one, columns={self._known}){mend} for one in {call.X}]"
            return self._each_file([call._replace(X=frames, y=call.y or named, is_frames=True)])

        return lines

    def apart(self, found: Sequence[Found], counted: Found) -> list[str]:
        """Return the lines that read one array as a table of the recordings that another counts, a row each."""
        size = found[0].leaf.shape[0]
        mend = f".assign(recording=numpy.ravel({self._how.item(counted)})"
        label = next((one for one in self._labels if one.leaf.shape == (size,)), None)
        mend += ")" if label is None else f", label={self._how.label(label)})"
        return self.mended(found)(mend)

    def split_at(self, found: Sequence[Found], ends: Found) -> list[str]:
        """Return the lines that split one array behind the recordings whose ends another holds."""
        X = f"numpy.split({self._how.item(found[0])}, {self._how.item(ends)}[:-1])"
        y = self._label_beside(len(ends.leaf.read()))
        return self._each_file([Call(X, y, is_beside=bool(y))])

    def _options(self, read: Callable[[LoadOptions], Sequence[Table]]) -> list[str]:
        """Return the options that read arrays, the labels beside them, and what else is missing."""
        with_time = self._with_time() if self._given.axes is None else []
        timed = ("time", *AXES)
        tried = self._tried(self._given, read)  # only labels or a rate may not be known
        if tried and all(map(all, tried)):
            return ["; pass ", *alternatives(in_both(**way) for way, _ in tried)]
        ways: dict[str, list[tuple[dict[str, Any], str | None]]] = {}
        for one in sorted([*self._in_order, *with_time], key=lambda one: not _FORCES.search(one.name)):
            name = PLACE.sub("", one.name)
            if name not in ways and len(ways) < MOST_LISTED:
                axes = timed if one in with_time else self._given.axes
                tried = self._tried(replace(self._given, array=name, axes=axes), read)
                ways |= {name: tried} if tried else {}
        known = {tried[0][1] for tried in ways.values()} - {None}
        names = [one.path for one in self._in_order if one.name in ways]
        n_labels = any(self._label_beside(n) for one in self._in_order for n in one.leaf.shape[1:-1])
        counted = len(ways) > len({stem_of(name) for name in ways})
        of_names = len(label_levels(names, own=True)) > len(label_levels(names)) or (not known and n_labels)
        has_y = any(one.name.lower() in BESIDE["y"] for one in self._every)
        if len(known) > 1 or counted or (of_names and not has_y and known <= {_OWN}):
            return []  # each has other labels beside it, or is named as its label, or the labels count another axis
        offered = [
            ({"array": name} if self._given.array is None else {}) | way
            for name, tried in ways.items()
            for way, _ in tried
        ]
        return (
            ["; pass ", *alternatives(in_both(**way) for way in offered)] if offered and all(offered) else []
        )

    def _with_time(self) -> list[Found]:
        """Return the arrays whose first column rises from sample to sample, and has the axes behind it."""
        arrays = [one for one in self._arrays if one.leaf.shape[-1] == len(self._known) + 1]
        return [one for one in arrays if (np.diff(one.leaf.read()[..., 0], axis=-1) > 0).all()]

    def _tried(
        self, options: LoadOptions, read: Callable[[LoadOptions], Sequence[Table]]
    ) -> list[tuple[dict[str, Any], str | None]]:
        """Return what is passed beside an array, and where its labels are known from, for each that may hold them."""
        found = []
        for rule, tables in self.label_rules(options, read):
            way: dict[str, Any] = {}
            if options.axes is not None and options.axes != self._given.axes:
                way["axes"] = ",".join(options.axes)
            elif options.rate_hz is None and any(
                one.rate_hz is None and one.stamps is None for one in tables
            ):
                way["rate_hz"] = RATE if (own := self.rate_beside) is None else own[1]
            if rule is not None and self._given.label is None:
                way["label"] = rule
            known = rule or self._source.label_known or all(table.label for table in tables)
            found.append((way, (rule or _OWN) if known else None))
        return found

    def label_rules(
        self, options: LoadOptions, read: Callable[[LoadOptions], Sequence[Table]]
    ) -> list[tuple[str | None, Sequence[Table]]]:
        """Return the values of `label` by which a file can be read, and what it gives; None: as it is without.

        Arrays, fields and attributes are taken for labels by their names, else texts of which some are the same.
        """
        about = {key: leaf for one in self._every for key, leaf in one.leaf.about.items()}
        leaves = [(one.name, one.path, one.leaf) for one in self._labels]
        leaves += [(key, key, leaf) for key, leaf in about.items() if key.lower() not in NO_LABELS]
        plain = list[tuple[str | None, Sequence[Table]]]()
        found = dict[str, tuple[str, Sequence[Table]]]()

        def tables_by(rule: str | None) -> Sequence[Table]:
            try:
                return read(replace(options, label=rule))
            except RecordingFileError:
                return ()

        if tables := tables_by(options.label):
            plain = [(options.label, tables)]
        if options.label is not None or (tables and all(table.label for table in tables)):
            return plain
        for name, path, leaf in leaves:
            if name in found or not (leaf.is_text or LABEL_NAMES.match(name)):
                continue
            rules = [f"column:{name}", *([f"column:{path}"] if path != name and "[" not in path else [])]
            rule, tables = next(((rule, got) for rule in rules if (got := tables_by(rule))), ("", ()))
            labels = {table.label for table in tables}
            is_called = LABEL_NAMES.match(name) is not None and not (
                leaf.is_numbers and 2 < len(labels) == len(tables)
            )
            is_signal = all(SIGNAL.search(str(label)) for label in labels)
            if (
                tables
                and not is_signal
                and None not in labels
                and (is_called or 1 < len(labels) < len(tables))
            ):
                found[name] = (rule, tables)
        named = [name for name in found if LABEL_NAMES.match(name)] or found
        kinds: dict[str, Collection[Any]] = {name: {one.label for one in found[name][1]} for name in named}
        if plain and found and named is found and self._source.label_known is not None:
            place = self._source.place_rule
            found[place], kinds[place] = (place, plain[0][1]), range(self._source.n_labels)
        return [found[name] for name in likeliest_first(kinds)] or plain
