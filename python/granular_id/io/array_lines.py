"""Lines of Python that read arrays which do not keep the convention, with what stands beside them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import groupby, permutations
from typing import NamedTuple

import numpy as np

from granular_id._text import RATE
from granular_id.io.leaves import BESIDE, PLACE, Found, Leaf, Opening, indexed
from granular_id.io.source import NO_MATERIAL, SESSION_LIKE, FileSource, LoadOptions, likeliest_first
from granular_id.io.ways_out import PART_NAMES, in_python_each, paths_line, places_of
from granular_id.recording import AXES, LABEL, LABEL_NAMES, RECORDING, TIME, meaning_of

_RATES = re.compile(r"fs|((sampl(e|ing)|control)_?)?(rate|freq(uency)?)(_?hz)?", re.IGNORECASE)
_PERIODS = re.compile(r"(?:dt|time_?step|(?:sampl(?:e|ing)_?)?(?:period|interval))(?:_(m?)s)?", re.IGNORECASE)
"""Names of rates, and of the time between samples, for ways out only: people see what they type."""

SIGNAL = re.compile(
    r"wrench|force|torque|filtered|arr_\d|^x$|(^|[\W_])(raw|ft|data|signals?|samples?|sensor)[\W_\d]*$",
    re.IGNORECASE,
)
"""Names of arrays that are no materials."""

NO_LABELS = ("axes", "units", "session", "name")

_LAST_PLACE = re.compile(r"\[\d+\]$")

_COUNTED = re.compile(r"(.*?)[\s_.-]*\d+")


class Call(NamedTuple):
    """A call that makes a data set of what a file holds: samples and labels of it, and what that assumes."""

    X: str
    y: str = ""
    why: str = ""
    n: int | None = None  # recordings, where it is 1 of every such file
    is_frames: bool = False
    is_timed: bool = False  # the frames have a clock
    is_beside: bool = False  # labels stand beside the samples
    sessions: str = ""
    units: tuple[Found, ...] = ()  # of its parts, where these state their own


class ArrayLines:
    """The arrays of a file, and the lines that read them; `axes` are those that are stated of it."""

    def __init__(
        self,
        leaves: Sequence[Found],
        source: FileSource,
        options: LoadOptions,
        how: Opening,
    ) -> None:
        self._every, self._source, self._how, self._given = leaves, source, how, options
        self._arrays = [one for one in leaves if one.leaf.is_numbers and len(one.leaf.shape) in (2, 3)]
        axes = None if options.axes or source.axes else self._stated("axes")
        names = [] if axes is None else _words(axes)
        is_of_axes = names and any(len(names) in one.leaf.shape for one in self._arrays)
        self._own_axes = axes if is_of_axes else None
        self._known = list(options.axes or source.axes or (names if is_of_axes else AXES))
        self._in_order = [one for one in self._arrays if one.leaf.shape[-1] == len(self._known)]

    def _beside(self, what: str, one: Found) -> Found | None:
        """Return what is called so beside an array: its attribute, or what its group or one around it holds."""
        for key, leaf in one.leaf.about.items():
            if key.lower() in BESIDE[what]:
                return Found(f"{one.path}/{key}", leaf, one.chain)
        near = (node for place in one.chain for key, node in place.items() if key.lower() in BESIDE[what])
        node = next((node for node in near if isinstance(node, Leaf) and node is not one.leaf), None)
        return next((other for other in self._every if other.leaf is node), None)

    def _stated(self, what: str) -> Found | None:
        """Return what is stated beside the arrays; nothing where it is not the same of all."""
        found = [one for array in self._arrays if (one := self._beside(what, array)) is not None]
        return found[0] if found and len({tuple(_words(one)) for one in found}) == 1 else None

    def _units(self, own: Sequence[Found]) -> str:
        """Return the units of the axes that the file states."""
        if self._given.units is not None:
            return f", units={','.join(self._given.units)!r}"
        one = self._stated("units")
        every = own if one is None else [one]
        texts = [self._how.label(two) + ".astype(str)" * (two.leaf.values.dtype.kind == "S") for two in every]
        joined = f"[{', '.join(f'*{text}' for text in texts)}]" if len(texts) > 1 else "".join(texts)
        return f", units=','.join({joined})" if texts else ""

    def _axes(self) -> str:
        """Return the names of the columns, where they are stated."""
        if self._own_axes is not None:
            return f", axes=','.join({self._how.label(self._own_axes)})"
        return "" if self._given.axes is None else f", axes={','.join(self._given.axes)!r}"

    @cached_property
    def _labels(self) -> list[Found]:
        """Arrays that may hold labels: by their names, else texts of which some are the same."""
        texts: dict[str, list[str]] = {}
        for one in self._every:
            if one.leaf.is_text:
                texts.setdefault(one.name, []).extend(map(str, np.ravel(one.leaf.read()).tolist()))
        given = column_in(self._given.label)
        if given:
            return [one for one in self._every if given in (one.name, one.path)]
        one_each = self._source.n_alike > 1 and self._source.label_known is None  # a text of each file
        like_labels = {
            name
            for name, every in texts.items()
            if 1 < len(set(every)) < len(every) or (one_each and len(every) == 1)
        }
        return [
            one
            for one in self._every
            if one.name.lower() not in NO_LABELS
            and (LABEL_NAMES.match(one.name) or one.name in like_labels)
            and not all(SIGNAL.search(text) for text in texts.get(one.name, [""]))
            and one not in self._in_order
        ]

    def _lines(self) -> list[str]:
        """Return the line for what is there; of several readings all."""
        every, calls, same = self._labels, list[Call](), dict[str, list[Found]]()
        named = [one for one in every if LABEL_NAMES.match(one.name)]
        for one in named or every:  # y_train and y_test are the labels of parts
            same.setdefault(one.name.partition("_")[0] if named else one.name, []).append(one)
        kinds = {
            name: {str(text) for one in each for text in np.ravel(one.leaf.read())}
            for name, each in same.items()
        }
        for name in likeliest_first(kinds) or [""]:
            self._labels = same.get(name, [])
            found = (
                self._as_table()
                or self._of_parts()
                or self._flat()
                or self._turned()
                or self._listed(self._arrays)
            )
            why = f"{name!r} holds the labels" * (len(same) > 1)
            calls += [one._replace(why=one.why or why * one.is_beside) for one in found]
        self._labels = every
        labelled = [one for one in calls if one.is_beside]
        return self._each_file(list(dict.fromkeys(labelled or calls)))

    def _each_file(self, calls: Sequence[Call]) -> list[str]:
        """Return the line for each call: of a folder it reads all files like this one, labelled by their places."""
        places = places_of(self._source)
        if not places:
            opened = f"f = {self._how.line.format(repr(str(self._source.path)))}"
            return _only_you(in_python_each([opened], [(self._text(one, one.y), one.why) for one in calls]))
        opened = f"files = [{self._how.line.format('path')} for path in paths]"
        endings = []
        for one in calls:
            for place in places[: 1 if one.y else None]:
                n = "" if one.n == 1 else f" * len({one.X})"
                y = one.y or (place.label and f"[{place.label}]{n}")
                sessions = "" if place.session is None or one.sessions else f"sessions=[{place.session}]{n}"
                whys = [one.why, "" if one.y else place.why]
                each = self._text(one, ", ".join(filter(None, (y, sessions))))
                call = f"Dataset([r for path, f in zip(paths, files) for r in {each}])"
                endings.append((call, " and ".join(filter(None, whys))))
        return _only_you(in_python_each([paths_line(self._source), opened], endings))

    def _text(self, one: Call, y: str) -> str:
        """Return the call of a method of `Dataset`."""
        words = ("from_frames" if one.is_frames else "from_arrays", f"{one.X}{', ' * bool(y)}{y}")
        rate = f", sessions={one.sessions}" * bool(one.sessions) + f", rate_hz={self._rate}" * (
            not one.is_timed
        )
        about = ("" if one.is_frames else self._axes()) + self._units(one.units)
        return f"Dataset.{words[0]}({words[1]}{rate}{about})"

    @cached_property
    def _rate(self) -> str:
        if self._given.rate_hz is not None:
            return f"{self._given.rate_hz:g}"
        one = self._rate_leaf
        if one is None:
            return RATE
        text, period = f"float(numpy.ravel({self._how.item(one)})[0])", _PERIODS.fullmatch(one.name)
        return text if period is None else f"{1000 if period[1] else 1} / {text}"

    @cached_property
    def rate_beside(self) -> tuple[str, float] | None:
        """Return the name and the value of what is called like a rate, or like the time between samples."""
        one = self._rate_leaf
        value = 0.0 if one is None else float(np.ravel(one.leaf.read())[0])
        if one is None or not 0 < value < np.inf:
            return None
        period = _PERIODS.fullmatch(one.name)
        return one.name, value if period is None else (1000 if period[1] else 1) / value

    @cached_property
    def _rate_leaf(self) -> Found | None:
        """Return the number that is called like a rate."""
        about = [
            Found(f"{one.path}/{key}", leaf, one.chain)
            for one in self._arrays
            for key, leaf in one.leaf.about.items()
        ]
        every = [one for one in [*about, *self._every] if one.leaf.is_numbers]
        named = [one for names in (_RATES, _PERIODS) for one in every if names.fullmatch(one.name)]
        return next((one for one in named if np.size(one.leaf.read())), None)

    def _list_of(self, arrays: Sequence[Found]) -> str:
        """Return the list of all recordings in arrays of two or three dimensions."""
        turned = [".T" * (one.leaf.shape[-1] != len(self._known)) for one in arrays]
        items = [("*" * (len(one.leaf.shape) == 3)) + self._how.item(one) for one in arrays]
        return f"[{', '.join(map(str.__add__, items, turned))}]"

    def has_labels(self, n: int) -> bool:
        """Whether an array may hold the labels of n recordings."""
        return bool(self._label_beside(n))

    def _label_beside(self, n: int) -> str:
        """Return the labels of n recordings in one array; of flags (n, labels) the places."""
        for one in self._labels:
            shape = one.leaf.shape
            if max(shape, default=1) == np.prod(shape) == n and "[" not in one.path:
                return self._how.label(one)
            is_flags = len(shape) == 2 and shape[0] == n and one.leaf.values.dtype.kind in "iufb"
            if is_flags and (one.leaf.read().sum(1) == 1).all():
                return f"{self._how.item(one)}.argmax(1)"
        return ""

    def _as_table(self) -> list[Call]:
        """Put arrays of a value a sample side by side, of which one tells recordings apart: an id, or a label."""
        groups: dict[str, dict[str, Found]] = {}
        for one in self._every:
            if len(one.leaf.shape) == 1 and (what := meaning_of(one.name).what) is not None:
                groups.setdefault(one.parent, {})[what] = one
        for inner in groups.values():
            lengths = {one.leaf.shape for one in inner.values()}
            if set(AXES) <= inner.keys() and {RECORDING, LABEL} & inner.keys() and len(lengths) == 1:
                columns = ", ".join(f"{one.name!r}: {self._how.label(one)}" for one in inner.values())
                table = f"pandas.DataFrame({{{columns}}})"
                return [Call(table, is_frames=True, is_timed=TIME in inner, is_beside=LABEL in inner)]
        return []

    def _of_parts(self) -> list[Call]:
        """Join what each recording has in parts: vectors of the axes, or forces and torques."""
        groups: dict[str, dict[str, Found]] = {}
        for one in self._every:
            if one.leaf.is_numbers and one.leaf.shape:
                groups.setdefault(one.parent, {})[one.name.lower()] = one
        whole = {place: joined for place, inner in groups.items() if (joined := self._joined(place, inner))}
        if not whole:
            return []
        X, n, is_timed = next(iter(whole.values()))
        y, days = self._label_beside(n or 1), ""
        units: tuple[Found, ...] = ()
        is_beside = bool(y)
        if list(whole) != [""]:
            if self._how.is_flat:
                return []
            loop, y, is_beside = self._loop(list(whole))
            X = f"[{X} {loop}]"
        else:
            days, units = self._sessions(n or 1), self._own_units(self._pair(groups[""]))
            X, n = (f"[{X}]", 1) if n is None else (X, n)
        return [Call(X, y, "", n, "{" in X, is_timed, is_beside, days, units)]

    def _pair(self, inner: Mapping[str, Found]) -> list[Found]:
        """Return forces and torques, arrays of three columns each."""
        threes = {name: one for name, one in inner.items() if one.leaf.shape[-1:] == (3,)}
        return [one for names in PART_NAMES for one in [threes[name] for name in names if name in threes][:1]]

    def _own_units(self, pair: Sequence[Found]) -> tuple[Found, ...]:
        """Return the unit that each of a pair states of itself."""
        units = [one for part in pair if (one := self._beside("units", part)) is not None]
        return tuple(units) if len(units) == len(pair) and all(len(_words(one)) == 1 for one in units) else ()

    def _joined(self, place: str, inner: Mapping[str, Found]) -> tuple[str, int | None, bool] | None:
        """Return the expression that joins the parts of a group, of how many recordings, and whether it has a clock."""
        item = self._how.item
        vectors = {
            what: one
            for one in inner.values()
            if max(one.leaf.shape) == np.prod(one.leaf.shape)
            and (what := meaning_of(one.name).what) is not None
        }
        if set(AXES) <= vectors.keys():
            named = [vectors[what] for what in (TIME, *AXES) if what in vectors]
            columns = ", ".join(f"{one.name!r}: numpy.ravel({item(one, place)})" for one in named)
            return f"{{{columns}}}", None, TIME in vectors
        pair = self._pair(inner)
        shapes = {one.leaf.shape for one in pair}
        if (
            len(pair) < len(PART_NAMES)
            or len(shapes) > 1
            or pair[0] not in self._arrays
            or pair[0].leaf.shape[-1] != 3
        ):
            return None
        n = pair[0].leaf.shape[0] if len(pair[0].leaf.shape) == 3 else None
        joined = f"numpy.concatenate([{', '.join(item(one, place) for one in pair)}], axis=-1)"
        clock = next((inner[name] for name in BESIDE["t"] if name in inner), None)
        is_clock = clock is not None and n is None and np.prod(clock.leaf.shape) == pair[0].leaf.shape[0]
        if clock is not None and is_clock and self._rate == RATE:
            axes = f"zip({' '.join(AXES)!r}.split(), {joined}.T)"
            return f"{{'time': numpy.ravel({item(clock, place)}), **dict({axes})}}", None, True
        return joined, n, False

    def _loop(self, places: Sequence[str], array: Found | None = None) -> tuple[str, str, bool]:
        """Return the loop over groups, or structs, in which each is r, their labels, and whether these lie in them.

        Those that hold no samples in `array`, or no label, are left out.
        """
        base = _LAST_PLACE.sub("", places[0])
        own = next((one for one in self._labels if one.parent == places[0]), None)
        empty = {
            one.parent for one in self._labels if own and one.name == own.name and not np.prod(one.leaf.shape)
        }
        if all(_LAST_PLACE.sub("", place) == base for place in places) and base != places[0]:
            loop = f"for r in f{''.join(map(indexed, base.split('/')))}"
            every = {
                one.parent for one in self._every if one.parent and _LAST_PLACE.sub("", one.parent) == base
            }
            conditions = []
            if array is not None and every - set(places):
                axis = array.leaf.shape.index(len(self._known))
                conditions += [
                    f"numpy.shape({self._how.item(array, places[0])})[{axis}:{axis + 1}] == ({len(self._known)},)"
                ]
            if own is not None and empty:
                conditions += [f"numpy.size({self._how.item(own, places[0])})"]
            loop += f" if {' and '.join(conditions)}" * bool(conditions)
        else:
            items = [f"f{''.join(map(indexed, place.split('/')))}" for place in places if place not in empty]
            loop = f"for r in [{', '.join(items)}]"
        if own is not None:
            return loop, f"[{self._how.label(own, places[0])} {loop}]", True
        names = self._levels(places)
        return loop, runs_of(names[0]) if names else "", False

    def _levels(self, paths: Sequence[str]) -> list[list[str]]:
        """Return what names of arrays or groups may say of labels; nothing of one in each of several files."""
        is_known = len(paths) == 1 and (self._source.label_known is not None or self._source.n_alike > 1)
        return [] if is_known else label_levels(paths, own=True)

    def _sessions(self, n: int) -> str:
        """Return the sessions that stand beside n recordings in one array, or one of all."""
        one = self._beside("session", self._arrays[0]) if self._arrays else None
        size = 0 if one is None or "[" in one.path else np.size(one.leaf.read())
        if one is None or size not in (1, n):
            return ""
        return self._how.label(one) if size == n else f"list({self._how.label(one)}) * {n}"

    def _days(self, place: str, loop: str) -> str:
        """Return the sessions that stand beside the samples in each group of a loop, where options name them."""
        given = column_in(self._given.session) or "session"
        one = next(
            (one for one in self._every if one.parent == place and given in (one.name, one.path)), None
        )
        return "" if one is None else f"[{self._how.label(one, place)} {loop}]"

    def _flat(self) -> list[Call]:
        """Shape rows of one recording each, (n, samples * axes), where a label stands for each."""
        n_axes = len(self._known)
        one = next((one for one in self._arrays if len(one.leaf.shape) == 2), None)
        if one is None or len(self._arrays) > 1 or one.leaf.shape[1] % n_axes or one.leaf.shape[1] == n_axes:
            return []
        n, item = one.leaf.shape[0], self._how.item(one)
        if n < 2 or not (y := self._label_beside(n)):
            return []
        first, second = self._known[:2]
        readings = {
            f"{item}.reshape(len({item}), {n_axes}, -1).transpose(0, 2, 1)": f"all {first}, then all {second}",
            f"{item}.reshape(len({item}), -1, {n_axes})": f"sample after sample, each of {n_axes} axes",
        }
        days = self._sessions(n)
        return [
            Call(X, y, f"a row holds {how}", is_beside=True, sessions=days) for X, how in readings.items()
        ]

    def _turned(self) -> list[Call]:
        """Bring recordings first and axes last: recordings are as many as labels, else the shorter of the two."""
        one = next((one for one in self._arrays if len(one.leaf.shape) == 3), None)
        if (
            one is None
            or len(self._known) not in one.leaf.shape
            or len({one.name for one in self._arrays}) > 1
        ):
            return []
        shape, usual = one.leaf.shape, (0, 1, 2)
        orders = [order for order in permutations(usual) if shape[order[-1]] == len(self._known)]
        ways = [(order, y) for order in orders if (y := self._label_beside(shape[order[0]]))]
        if ways and ways[0][0] == usual:
            ways = ways if len(ways) > 1 else []  # in which case it is no other order
        elif not ways:
            best = min(orders, key=lambda order: (-order[-1], shape[order[0]]))
            ways = [(best, "")] if best != usual else []
        return [
            Call(
                f"{self._how.item(one)}.transpose{order}",
                y,
                f"axis {order[0]} counts recordings and axis {order[-1]} the forces" * (len(ways) > 1),
                is_beside=bool(y),
                sessions=self._sessions(shape[order[0]]),
            )
            for order, y in ways
        ]

    def _listed(self, every: Sequence[Found]) -> list[Call]:
        """List arrays with what their groups, or their names, may say of them."""
        arrays = [one for one in every if len(self._known) in one.leaf.shape]
        if not arrays:
            return []
        counts = [one.leaf.shape[0] if len(one.leaf.shape) == 3 else 1 for one in arrays]
        X, places = self._list_of(arrays), [one.parent for one in arrays]
        is_one_each = set(counts) == {1} and len({one.name for one in arrays}) == 1 < len(set(places))
        if is_one_each and not self._how.is_flat:
            loop, y, is_beside = self._loop(places, arrays[0])
            if is_beside:
                turned = ".T" * (arrays[0].leaf.shape[-1] != len(self._known))
                X, days = (
                    f"[{self._how.item(arrays[0], places[0])}{turned} {loop}]",
                    self._days(places[0], loop),
                )
                why = "those without samples or a label may be left out" * (" if " in loop)
                return [Call(X, y, why, sessions=days, is_beside=True)]
        days = self._sessions(sum(counts))
        beside = [self._label_beside_of(one, n) for one, n in zip(arrays, counts, strict=True)]
        y = f"[{', '.join('*' + y for y in beside)}]" if all(beside) else self._label_beside(sum(counts))
        levels = [] if y else self._levels([one.path for one in arrays])
        if not levels:
            return [Call(X, y, "", sum(counts), is_beside=bool(y), sessions=days)]
        labels = [[name for name, n in zip(names, counts, strict=True) for _ in range(n)] for names in levels]
        return [Call(X, runs_of(names), f"{names[0]!r} is a material", sessions=days) for names in labels]

    def _label_beside_of(self, one: Found, n: int) -> str:
        """Return the labels beside one array of several: y_train of X_train."""
        ending = one.name.partition("_")[2]
        near = [
            two for two in self._labels if two.parent == one.parent and two.name.partition("_")[2] == ending
        ]
        fits = [two for two in near if np.prod(two.leaf.shape) == n]
        return self._how.label(fits[0]) if fits and (ending or n > 1) else ""


def _only_you(ways: list[str]) -> list[str]:
    """Say ahead of several readings that no file says which is right."""
    return (
        ["; more than one reading fits, and only you know which is right", *ways] if len(ways) > 1 else ways
    )


def label_levels(paths: Sequence[str], *, own: bool = False) -> list[list[str]]:
    """Return what may be labels of arrays at these paths: the names at each level that differ, and do not count.

    `own`: the name of the array itself is the last level.
    """
    split = [PLACE.sub("", path).split("/")[: None if own else -1] for path in paths]
    levels = []
    for names in zip(*split, strict=False):
        stems = [stem_of(name) for name in names]
        alike = len(set(stems)) == 1 and (len(paths) > 1 or "" in stems)
        if not alike and "" not in stems and not any(map(SIGNAL.search, stems)):
            levels += [stems] if not all(map(SESSION_LIKE.fullmatch, stems)) else []
    return levels


def stem_of(name: str) -> str:
    """Return what a name says without its number; nothing where it only counts."""
    stem = without_number(name)
    return "" if stem.isdecimal() or stem.lower() in NO_MATERIAL else stem


def column_in(rule: str | None) -> str:
    """Return the name in ``column:NAME``."""
    return (rule or "").partition("column:")[2]


def runs_of(labels: Sequence[str | None]) -> str:
    """Write labels short: ``['rice'] * 12 + ['oats'] * 12``."""
    parts = [(label, len(list(same))) for label, same in groupby(labels)]
    if all(n == 1 for _, n in parts):
        return repr(list(labels))
    return " + ".join(f"[{label!r}]" + f" * {n}" * (n > 1) for label, n in parts)


def without_number(name: str) -> str:
    """Return a name without the number at its end."""
    found = _COUNTED.fullmatch(name)
    return name if found is None or not found[1] else found[1]


def _words(one: Found) -> list[str]:
    return [str(text) for text in np.ravel(one.leaf.read())]
