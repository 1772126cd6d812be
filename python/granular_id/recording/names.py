"""Names of columns and axes, and units: the tables that say what each means.

========== ===================================================== =========================
column     also                                                  unit, where it is named
========== ===================================================== =========================
fx         force_x, F_x, wrench.force.x                          N
tx         torque_x, moment_x, tau_x, Mx, wrench.torque.x        N m
time       t, timestamp, time_stamp, stamp, datetime, seconds    s
recording  trial, id
label      material, class
session
rate_hz    fs, sampling_rate                                     Hz
========== ===================================================== =========================

Likewise y and z. Case, blanks, ``_ . / -`` between the words and ``field.`` or a topic before ``wrench`` do not
matter. A unit may follow: ``Fx [N]``, ``tx (Nm)``, ``time_ms``. ``actual_TCP_force_0`` to ``_5`` are what recorders of
Universal Robots call fx to tz. All other columns are left out, and said. Axes of other sensors are those that somebody
names; nothing is guessed of them.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

from granular_id._core import AXES

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
    "Hz": "Hz or kHz",
}
"""The units that messages name."""

_KNOWN = {
    quantity: {name: value for value, names in table.items() for name in names.split()}
    for quantity, table in _FACTORS.items()
}
_OTHER_UNITS = frozenset(
    (
        *("g", "m/s2", "m/s^2", "deg/s", "rad/s", "\N{DEGREE SIGN}/s", "deg", "rad"),
        *("m", "mm", "m/s", "mm/s", "v", "mv", "degc", "\N{DEGREE SIGN}c", "%"),
    )
)
"""Units of other sensors that may stand in a line of units; of those of a wrench see `TAKEN`."""

_SEPARATORS = re.compile(r"[\s_.*\N{MIDDLE DOT}\N{DOT OPERATOR}-]+")


def factor(unit: str, wanted: str) -> float | None:
    """Return what one `unit` is in the unit that is wanted ("N", "N m", "s" or "Hz"); None for one not known."""
    plain = _SEPARATORS.sub("", unit.strip().removeprefix("[").removesuffix("]"))
    if plain.startswith("M"):
        return None
    plain = plain.lower().replace("\N{MICRO SIGN}", "\N{GREEK SMALL LETTER MU}")
    return _KNOWN[wanted].get(plain)


def unit_spelling(unit: str) -> str:
    """Spell a unit in one way: m/s^2 and m/s\N{SUPERSCRIPT TWO} as m/s2."""
    return re.sub(r"\s+", " ", unicodedata.normalize("NFKC", unit).replace("^", "")).strip()


def is_unit(text: str) -> bool:
    """Return True if a cell may be one of a line of units: a unit, or nothing at all."""
    plain = text.strip().strip("[]()")
    known = any(factor(plain, quantity) is not None for quantity in _KNOWN)
    return not plain or plain in ("-", "1") or known or plain.lower() in _OTHER_UNITS


TIME, RECORDING, LABEL, SESSION, RATE, FLAGS = (
    "time",
    "recording",
    "label",
    "session",
    "rate_hz",
    "sample_flags",
)
ABOUT = (TIME, RECORDING, LABEL, SESSION, RATE, FLAGS)
"""What a column may be besides an axis."""

TIMES = ("time", "t", "timestamp", "timestamps", "stamp", "ts", "datetime", "seconds", "sec", "secs")
"""Names of a clock without case and separators; of several that are there, the first one is it."""

_WORDS = {
    **{word + axis: "f" + axis for axis in "xyz" for word in ("f", "force")},
    **{word + axis: "t" + axis for axis in "xyz" for word in ("t", "m", "tau", "torque", "moment")},
    **{f"actualtcpforce{i}": axis for i, axis in enumerate(AXES)},
    **dict.fromkeys(TIMES, TIME),
    **{word + end: RECORDING for word in ("recording", "trial") for end in ("", "id")},
    "id": RECORDING,
    **dict.fromkeys(("label", "material", "class"), LABEL),
    **{"session": SESSION, "sessionid": SESSION},
    **dict.fromkeys(("ratehz", "fs", "samplingrate"), RATE),
    "sampleflags": FLAGS,
}

_LONGEST = 200
"""Characters of a name: a topic, a field and a unit have room, and no regular expression takes long."""

_BETWEEN = r"[\s_./-]+"
_PATH = re.compile(r"(?:(?:.*/|field\.)?wrench[\s_./-]+|field\.)")
_BRACKETED = re.compile(r"(.+?)\s*(?:\[([^][]*)\]|\(([^()]*)\))")
_TRAILING = re.compile(
    rf"(.+?){_BETWEEN}("
    + "|".join(sorted((name for known in _KNOWN.values() for name in known), key=len, reverse=True))
    + r"|n[\s_.*-]m|n[\s_.*-]mm)",
    re.IGNORECASE,
)
_IN_TWO = re.compile(r"(.*)secs?(?:onds)?\n\1n(?:ano)?secs?(?:onds)?", re.IGNORECASE)


class ColumnError(ValueError):
    """Names of columns that do not make a recording: the problem, and whether none of them is an axis."""

    def __init__(self, problem: str, *, no_wrench: bool = False) -> None:
        super().__init__(problem)
        self.no_wrench = no_wrench


class Meaning(NamedTuple):
    """What a column is, by its name; None where that is not known, and the unit that the name states."""

    what: str | None
    unit: str | None = None

    @property
    def quantity(self) -> str | None:
        """The unit that its values are wanted in; None where there is none."""
        return {TIME: "s", RATE: "Hz"}.get(self.what or "", _quantity(self.what))

    @property
    def scale(self) -> float | None:
        """What one of the stated unit is in the one wanted; None where that is not known."""
        if self.unit is None:
            return 1.0
        return None if self.quantity is None else factor(self.unit, self.quantity)


def _quantity(axis: str | None) -> str | None:
    return None if axis not in AXES else "N" if axis[0] == "f" else "N m"


@lru_cache(maxsize=1024)  # every file of a folder has the same header
def meaning_of(name: str) -> Meaning:
    """Say what a column of this name is."""
    text = name.strip()
    if text == "T" or len(text) > _LONGEST:  # time, torque or temperature
        return Meaning(None)
    bracketed = _BRACKETED.fullmatch(text)
    if bracketed is not None:
        base, square, round_ = bracketed.groups()
        return Meaning(_word(base), (square if round_ is None else round_).strip() or None)
    what = _word(text)
    trailing = None if what is not None else _TRAILING.fullmatch(text)
    return Meaning(what) if trailing is None else Meaning(_word(trailing[1]), trailing[2])


def _word(text: str) -> str | None:
    text = text.lower()
    path = _PATH.match(text)
    return _WORDS.get(_plain(text[path.end() :] if path else text))


def _plain(text: str) -> str:
    return re.sub(_BETWEEN, "", text.strip().lower())


def axis_of(name: str) -> str | None:
    """Return fx to tz for a column that is one of these in N or N m, else None."""
    meaning = meaning_of(name)
    return meaning.what if meaning.what in AXES and meaning.scale == 1 else None


@lru_cache(maxsize=1024)
def name_and_unit(name: str) -> tuple[str, str | None]:
    """Part a name in what comes before its unit, and the unit: ``wx [rad/s]``."""
    text = name.strip()
    found = _BRACKETED.fullmatch(text) if len(text) <= _LONGEST else None
    if found is not None:
        base, square, round_ = found.groups()
        return base, (square if round_ is None else round_).strip() or None
    trailing = _TRAILING.fullmatch(text) if len(text) <= _LONGEST and _word(text) is None else None
    return (text, None) if trailing is None else (trailing[1], trailing[2])


def columns_of(
    names: Sequence[str],
    axes: Sequence[str] | None = None,
    asked: Mapping[str, str | None] | None = None,
) -> dict[str, str]:
    """Find the columns that hold the axes, and the clock and what tells recordings apart where there are such.

    Parameters
    ----------
    names : sequence of str
        Names of all columns.
    axes : sequence of str, optional
        The axes wanted, in their order; by default fx fy fz tx ty tz.
    asked : mapping, optional
        Columns that somebody names: of the time, recording, label or session.

    Returns
    -------
    dict
        Names of columns by axis, and by `TIME`, `RECORDING`, `LABEL`, `SESSION`, `RATE`, `FLAGS`.
    """
    chosen = tuple((what, name) for what, name in (asked or {}).items() if name is not None)
    return dict(_columns_of(tuple(names), None if axes is None else tuple(axes), chosen))


@lru_cache(maxsize=256)
def _columns_of(
    names: tuple[str, ...], axes: tuple[str, ...] | None, asked: tuple[tuple[str, str], ...]
) -> Mapping[str, str]:
    twice = next((name for i, name in enumerate(names) if name in names[:i]), None)
    if twice is not None:
        raise ColumnError(f"column {twice!r:.60} occurs twice")
    found = {axis: _column_of(axis, names, axes is not None) for axis in axes or AXES}
    for what, name in asked:
        if name not in names:
            raise ColumnError(f"{what}={name!r:.60} is no column of it; there are {_listed(names)}")
        if name in found.values():
            raise ColumnError(f"{what}={name!r:.60} is one of the axes; wanted another column")
        found[what] = name
    taken = {name for what, name in found.items() if what != RECORDING}  # a column of labels may be it, too
    for what in ABOUT:
        places = [name for name in names if name not in taken and meaning_of(name).what == what]
        if what in found or not places:
            continue
        if what == TIME:
            places = sorted(places, key=_preference)[:1]
        if len(places) > 1:
            both = " and ".join(map(repr, places[:2]))
            raise ColumnError(f"columns {both} both mean {what}; name one of them: {_option(what)}")
        found[what] = places[0]
    return found


def _option(what: str) -> str:
    options = {RECORDING: "id='NAME'", LABEL: "label='column:NAME'", SESSION: "session='column:NAME'"}
    return options.get(what, "keep only one")


def _preference(name: str) -> int:
    plain = _plain(name_and_unit(name)[0])
    return TIMES.index(plain) if plain in TIMES else len(TIMES)


def nanoseconds_beside(time: str, names: Sequence[str]) -> str | None:
    """Return the column of nanoseconds that belongs to one of whole seconds, as ROS prints stamps."""
    return next((name for name in names if _IN_TWO.fullmatch(f"{time}\n{name}")), None)


def _column_of(axis: str, names: Sequence[str], is_named: bool) -> str:
    """Return the column that holds an axis: the one called so, or without its unit, or by another name of fx to tz."""
    small = axis.strip().lower()
    tiers = (
        [name for name in names if name.strip() == axis],
        [name for name in names if name.strip().lower() == small],
        [name for name in names if name_and_unit(name)[0].strip().lower() == small],
        [name for name in names if axis in AXES and meaning_of(name).what == axis],
    )
    for places in tiers:
        sound = [name for name in places if axis not in AXES or meaning_of(name).scale is not None]
        if len(sound) > 1:
            both = " and ".join(map(repr, sound[:2]))
            raise ColumnError(
                f"columns {both} may both be {axis!r}; pass axes= with the names of those wanted"
            )
        if sound:
            return sound[0]
    bad = next((name for places in tiers for name in places), None)
    if bad is not None:
        unit, quantity = meaning_of(bad).unit or "", _quantity(axis) or ""
        raise ColumnError(f"the unit of column {bad!r:.60} is {unit!r:.40}; wanted {TAKEN[quantity]}")
    if is_named:
        raise ColumnError(f"axes names {axis!r:.60}, which is no column of it; there are {_listed(names)}")
    some = any(meaning_of(name).what in AXES for name in names)
    also = "also force_x, wrench.force.x, 'Fx [N]'; mx, torque_x, moment_x"
    if some:
        raise ColumnError(
            f"column {axis!r} is missing; wanted {', '.join(AXES)} ({also}); there are {_listed(names)}"
        )
    problem = f"names none of {', '.join(AXES)} ({also}); there are {_listed(names)}"
    raise ColumnError(problem, no_wrench=True)


def _listed(names: Sequence[str], most: int = 20) -> str:
    return ", ".join(name[:40] for name in names[:most]) + (", ..." if len(names) > most else "")
