"""Names of columns and fields, and units: the tables that say what each means.

====== ===================================================== =========================
column also                                                   unit, where it is named
====== ===================================================== =========================
fx     force_x, F_x, wrench.force.x                           N
tx     torque_x, moment_x, tau_x, Mx, wrench.torque.x         N m
time   t, timestamp, time_stamp, stamp, seconds, sec          s
flags                                                         (bits of ``SampleFlag``)
====== ===================================================== =========================

Likewise y and z. Case, blanks, ``_ . / -`` between the words and ``field.`` or a topic before ``wrench`` do not
matter. A unit may follow: ``Fx [N]``, ``tx (Nm)``, ``time_ms``. One that ``units`` does not know is refused; so is what
could mean two things (``T``: time, torque, temperature).

``actual_TCP_force_0`` to ``_5`` are what RTDE recorders of Universal Robots call fx to tz. Columns of tables may
also tell recordings apart, label them and state their rate. Other columns are left out, by name. Axes of other sensors
are the columns that somebody names; nothing is guessed of them.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

from granular_id.recording import AXES

# Units in which files state their values, and what one of each is in N, N m, s or Hz: the one table.

_INCH_M = 0.0254
_POUND_N = 4.4482216152605

_FACTORS: dict[str, dict[float, str]] = {
    "N": {1.0: "n newton newtons", 1e-3: "mn", 1e3: "kn", _POUND_N: "lbf", 9.80665: "kgf"},
    "N m": {
        1.0: "nm newtonmetre newtonmetres newtonmeter newtonmeters",
        1e-3: "mnm nmm",
        1e3: "knm",
        _POUND_N * _INCH_M: "lbfin",
    },
    "s": {
        1.0: "s sec secs second seconds",
        1e-3: "ms msec millisecond milliseconds",
        1e-6: "us usec \N{GREEK SMALL LETTER MU}s microsecond microseconds",
        1e-9: "ns nsec nanosecond nanoseconds",
    },
    "Hz": {1.0: "hz hertz", 1e3: "khz"},
}  # fmt: skip

TAKEN = {
    "N": "N, mN, kN, lbf or kgf (kilograms-force)",
    "N m": "N m, mN m, kN m, N mm or lbf in",
    "s": "s, ms, us or ns",
}
"""The units that messages name."""

_KNOWN = {
    quantity: {name: value for value, names in table.items() for name in names.split()}
    for quantity, table in _FACTORS.items()
}

NAMED = tuple(name for known in _KNOWN.values() for name in known)
"""How units of columns are written, in lower case without separators."""

_SEPARATORS = re.compile(r"[\s_.*\N{MIDDLE DOT}\N{DOT OPERATOR}-]+")


def factor(unit: str, wanted: str) -> float | None:
    """Return what one `unit` is in the unit that is wanted; None for one that is not known."""
    plain = _SEPARATORS.sub("", unit.strip().removeprefix("[").removesuffix("]"))
    if plain.startswith("M"):
        return None
    plain = plain.lower().replace("\N{MICRO SIGN}", "\N{GREEK SMALL LETTER MU}")
    return _KNOWN[wanted].get(plain)


TIME, FLAGS = "time", "flags"
RECORDING, LABEL, SESSION, RATE, MASK = "recording", "label", "session", "rate", "mask"

RATES = (
    "fs ratehz rate samplingrate samplerate samplingratehz sampleratehz samplingfrequency frequency freq hz"
)
MASKS = "mask masks valid validmask paddingmask padmask"
"""Names of rates, and of what tells which samples are padding, without case and separators."""

_KINDS = {
    RECORDING: "recording id name trial run episode",
    LABEL: "label material class",
    SESSION: "session",
    RATE: RATES,
    MASK: MASKS,
}
ABOUT = {
    name: what
    for what, names in _KINDS.items()
    for word in names.split()
    for name in (word, *(f"{word}{end}" for end in ("id", "index", "number") if what == RECORDING))
}
"""What a column of a table says about the recordings in it, by its name without case and separators."""

RESERVED = (TIME, FLAGS, RECORDING, LABEL, SESSION, RATE, MASK)

_WORDS = {
    **{word + axis: "f" + axis for axis in "xyz" for word in ("f", "force")},
    **{word + axis: "t" + axis for axis in "xyz" for word in ("t", "m", "tau", "torque", "moment")},
    **dict.fromkeys(("t", "time", "timestamp", "stamp", "seconds", "sec"), TIME),
    **{f"actualtcpforce{i}": axis for i, axis in enumerate(AXES)},
    "flags": FLAGS,
}

_OTHER_UNITS = (
    *("lb", "lbs", "ozf", "g", "gf", "kg", "v", "mv", "counts"),
    *("ncm", "lbin", "lbfft", "lbft", "ozin", "kgm", "kgfm"),
    *("\N{MICRO SIGN}s", "min", "h"),
)
"""Units besides those of ``units`` that may follow a name after ``_`` and must not be taken for a part of it."""

_LONGEST = 200
"""Characters of a name: a topic, a field and a unit have room, and no regular expression takes long."""

_COLUMN_SEPARATORS = r"[\s_./-]+"
_PATH = re.compile(r"(?:(?:.*/|field\.)?wrench[\s_./-]+|field\.)")
_IN_TWO = re.compile(r"(.*)secs?(?:onds)?\n\1n(?:ano)?secs?(?:onds)?", re.IGNORECASE)
_BRACKETED = re.compile(r"(.+?)\s*(?:\[([^][]*)\]|\(([^()]*)\))")
_TRAILING = re.compile(
    rf"(.+?){_COLUMN_SEPARATORS}("
    + "|".join(sorted({*_OTHER_UNITS, *NAMED}, key=len, reverse=True))
    + r"|n[\s_.*-]m)",
    re.IGNORECASE,
)


class ColumnError(ValueError):
    """A set of names that does not make a recording; `others` may be axes of another sensor."""

    def __init__(self, problem: str, index: int | None = None, others: Sequence[int] = ()) -> None:
        super().__init__(problem)
        self.problem = problem
        self.index = index
        self.others = others


@dataclass(frozen=True)
class _Meaning:
    axis: str | None
    unit: str | None = None

    @property
    def wanted(self) -> str | None:
        """The unit that the values must have; None where there is none to name."""
        if self.axis == TIME:
            return "s"
        return None if self.axis in (FLAGS, None) else "N" if self.axis[0] == "f" else "N m"

    @property
    def scale(self) -> float | None:
        """What one of the unit is in the unit wanted; None where the axis or the unit is not known."""
        if self.axis is None or self.unit is None:
            return None if self.axis is None else 1.0
        return None if self.wanted is None else factor(self.unit, self.wanted)


def axis_of(name: str) -> str | None:
    """Tell what a column holds: ``"fx"`` to ``"tz"``, ``"time"``, ``"flags"``, or None where that is not certain."""
    meaning = _meaning(name)
    return meaning.axis if meaning.scale == 1 else None


def split_unit(name: str) -> tuple[str | None, str | None]:
    """Return what a column holds as `axis_of` does, whatever its unit, and the unit that its name states."""
    meaning = _meaning(name)
    return meaning.axis, meaning.unit


def refusal(name: str) -> str:
    """Return why a name that ``axis_of`` does not know is refused, and what is wanted."""
    meaning, shown = _meaning(name), repr(name.strip()[:40])
    if meaning.axis is not None and meaning.unit is not None:
        wanted = "none" if meaning.wanted is None else f"{TAKEN[meaning.wanted]}; convert other values first"
        return f"the unit of column {shown} is {meaning.unit[:40]!r}; wanted {wanted}"
    if name.strip() == "T":
        return f"column {shown} may be time, torque or temperature; wanted a name that says which"
    also = "also force_x, wrench.force.x, 'Fx [N]'; mx, torque_x, moment_x; t, timestamp, time_s"
    return f"unknown column {shown}; wanted {', '.join(AXES)}, and optionally time (s) and flags ({also})"


def axes_among(names: Sequence[str], axes: Sequence[str]) -> list[tuple[int, str | None]]:
    """Find the columns that axes name, each with the unit that its name states.

    A column is named by all that it is called, in small or large letters (then nothing of it is a unit), or without its
    unit, or, for fx to tz, by another name of these.
    """
    words = [name.strip() for name in names]
    parted = [_parted(word) for word in words]
    meant = [_meaning(word).axis for word in words]
    picked: list[tuple[int, str | None]] = []
    for axis in axes:
        small = axis.lower()
        tiers = (
            [i for i, word in enumerate(words) if word == axis],
            [i for i, word in enumerate(words) if word.lower() == small],
            [i for i, (base, _) in enumerate(parted) if base.lower() == small],
            [i for i, meaning in enumerate(meant) if meaning == axis and axis in AXES],
        )
        places = next((places for places in tiers if places), [])
        if not places:
            raise ColumnError(f"axes: there is no column {axis!r}; there are {_listed(words)}")
        if len(places) > 1:
            both = " and ".join(repr(words[i]) for i in places[:2])
            problem = f"columns {both} may both be {axis!r}; wanted one of them in axes, as it is called"
            same = f"column {words[places[0]]!r} occurs twice"
            raise ColumnError(same if words[places[0]] == words[places[1]] else problem, places[1])
        (place,) = places
        picked.append((place, None if place in tiers[1] else parted[place][1]))
    twice = next((i for k, (i, _) in enumerate(picked) if i in [j for j, _ in picked[:k]]), None)
    if twice is not None:
        raise ColumnError(f"axes names column {words[twice]!r} twice", twice)
    return picked


def without_unit(name: str) -> str:
    """Return what a column is called before its unit."""
    return _parted(name.strip())[0]


def axes_shown(names: Sequence[str]) -> str:
    """Return the way out of a file without the six axes of a wrench: `names` are its columns of numbers."""
    bare = [without_unit(name) if name.endswith("]") else name for name in names]
    return f"for other axes pass axes={','.join(names if len(set(bare)) < len(bare) else bare)!r}"


def _parted(name: str) -> tuple[str, str | None]:
    """Part a name in what comes before its unit, and the unit."""
    bracketed = _BRACKETED.fullmatch(name) if len(name) <= _LONGEST else None
    if bracketed is not None:
        base, square, round_ = bracketed.groups()
        return base, (square if round_ is None else round_).strip() or None
    trailing = _TRAILING.fullmatch(name) if len(name) <= _LONGEST and _word(name) is None else None
    return (name, None) if trailing is None else (trailing[1], trailing[2])


def _listed(names: Sequence[str], most: int = 20) -> str:
    return ", ".join(name[:40] for name in names[:most]) + (", ..." if len(names) > most else "")


def columns_of(
    names: Sequence[str],
    *,
    label: str | None = None,
    session: str | None = None,
    axes: Sequence[str] | None = None,
    known: Mapping[str, str] | None = None,
) -> dict[str, int]:
    """Find the axes, and the time, flags and what tells recordings apart where they are there, among all columns.

    The axes are those named, or else the six of a wrench. What means none of these is left out, unless it may be one of
    the six, where none are named, or the time.
    """
    asked_for = {what: asked for what, asked in ((LABEL, label), (SESSION, session)) if asked is not None}
    _refuse_asked(names, asked_for, axes or ())
    refused = (TIME,) if axes is not None else (*AXES, TIME, FLAGS)
    found = {} if axes is None else _asked_axes(names, axes)
    chosen = set(found.values())
    others: list[int] = []
    for i, name in enumerate(names):
        if i in chosen:
            continue
        what = (known or {}).get(name) or _what_in_table(name)
        if asked_for.keys() & {what} or name in asked_for.values():
            what = next((meaning for meaning, asked in asked_for.items() if asked == name), None)
        elif axes is not None and what in AXES:
            what = None
        elif what is None and _meaning(name).axis in refused:
            raise ColumnError(refusal(name), i)
        if what is None:
            others.append(i)
            continue
        if what in found:
            raise ColumnError(_twice(names[found[what]], name, what), i)
        found[what] = i
    if TIME in found and RATE in found and "freq" in names[found[RATE]].lower():
        others.append(found.pop(RATE))  # of a vibration, say: stamps tell the rate
    whole = names[found[TIME]] if TIME in found else ""
    second = next((i for i in others if _IN_TWO.fullmatch(f"{whole}\n{names[i]}")), None)
    if second is not None:
        both = f"columns {whole!r} and {names[second]!r} are one time in two parts"
        raise ColumnError(f"{both}; wanted one column, sec + nanosec / 1e9", second)
    missing = [axis for axis in AXES if axes is None and axis not in found]
    unclear = next((i for i in others if names[i].strip() == "T"), None)
    if unclear is not None and (missing or TIME not in found):
        raise ColumnError(refusal(names[unclear]), unclear)
    if missing:
        problem = f"column {missing[0]!r} is missing"
        whole = (
            f"{refusal(names[others[0]])}; {problem}" if others else f"{problem}; wanted {', '.join(AXES)}"
        )
        may_be_axes = sorted([*others, *(found[axis] for axis in AXES if axis in found)])
        raise ColumnError(whole, others[0] if others else None, may_be_axes)
    _refuse_half_stated(names, found)
    return found


def _refuse_asked(names: Sequence[str], asked_for: Mapping[str, str], axes: Sequence[str]) -> None:
    """Refuse columns that are asked for and not there, and a session in what labels recordings or tells them apart."""
    for what, asked in asked_for.items():
        if asked not in names:
            raise ColumnError(f"{what}={asked!r} is no column of it; there are {_listed(names)}")
        if asked in axes:
            raise ColumnError(f"{what}={asked!r} is one of the axes; wanted another column")
        other = _what_in_table(asked)
        if what == SESSION and other not in (None, SESSION):
            raise ColumnError(f"session={asked!r} is the column of the {other}; wanted another one")


def _twice(first: str, second: str, what: str) -> str:
    if first.strip().lower() == second.strip().lower():
        return f"column {second!r} occurs twice"
    way_out = f", or {what}= with its name" if what in (LABEL, SESSION) else ""
    return f"columns {first!r} and {second!r} both mean {what}; wanted one of them{way_out}"


def _asked_axes(names: Sequence[str], axes: Sequence[str]) -> dict[str, int]:
    reserved = next((axis for axis in axes if axis in RESERVED), None)
    if reserved is not None:
        raise ColumnError(f"axes names {reserved!r}, which means something else in a table; wanted axes")
    return {axis: i for axis, (i, _) in zip(axes, axes_among(names, axes), strict=True)}


def _refuse_half_stated(names: Sequence[str], found: Mapping[str, int]) -> None:
    """Refuse a unit other than N or N m that only some of the forces, or of the torques, state."""
    for alike in (AXES[:3], AXES[3:]):
        columns = [found[axis] for axis in alike if axis in found]
        other = next((i for i in columns if _meaning(names[i]).scale not in (None, 1)), None)
        silent = next((i for i in columns if _meaning(names[i]).unit is None), None)
        if other is not None and silent is not None:
            unit = f"column {names[other]!r} states a unit and column {names[silent]!r} none"
            raise ColumnError(f"{unit}; wanted that of each", silent)


def _what_in_table(name: str) -> str | None:
    meaning = _meaning(name)
    if meaning.scale is not None:
        return meaning.axis
    plain = re.sub(_COLUMN_SEPARATORS, "", name.strip().lower())
    if plain not in ABOUT and meaning.unit is not None and factor(meaning.unit, "Hz") is not None:
        plain = re.sub(r"[^a-z]", "", plain).removesuffix(meaning.unit.lower())  # "fs [kHz]"
    return ABOUT.get(plain)


@lru_cache(maxsize=1024)  # every file of a folder has the same header
def _meaning(name: str) -> _Meaning:
    text = name.strip()
    if text == "T" or len(text) > _LONGEST:
        return _Meaning(None)
    bracketed = _BRACKETED.fullmatch(text)
    if bracketed is not None:
        base, square, round_ = bracketed.groups()
        return _Meaning(_word(base), (square if round_ is None else round_).strip())
    axis = _word(text)
    trailing = None if axis is not None else _TRAILING.fullmatch(text)
    return _Meaning(axis) if trailing is None else _Meaning(_word(trailing[1]), trailing[2])


def _word(text: str) -> str | None:
    text = text.lower()
    path = _PATH.match(text)
    return _WORDS.get(re.sub(_COLUMN_SEPARATORS, "", text[path.end() :] if path else text))
