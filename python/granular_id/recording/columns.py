"""Columns: what their names and units mean, and tables with named columns as samples.

Case, blanks, ``_ . / -`` between the words and ``field.`` or a topic before ``wrench`` do not matter, and a unit may
follow: ``Fx [N]``, ``tx (Nm)``, ``time_ms``. All other columns are left out, and noted. Axes of other sensors are those
that somebody names; nothing is guessed of them. Tables are of pandas, polars or pyarrow, none of which is needed.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Mapping, Sequence, Set
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from granular_id._checks import FloatArray, WayOutError, argument_error, parts_of
from granular_id._core import AXES, GranularIdError
from granular_id._text import alternatives, in_both
from granular_id.recording.report import first_names

_INCH_M = 0.0254
_POUND_N = 4.4482216152605
_OUNCE_N = _POUND_N / 16
_KILOGRAM_N = 9.80665

_FACTORS: dict[str, dict[float, str]] = {
    "N": {1.0: "n newton newtons", 1e-3: "mn", 1e3: "kn", _POUND_N: "lbf", _OUNCE_N: "ozf", _KILOGRAM_N: "kgf"},
    "N m": {
        1.0: "nm newtonmetre newtonmetres newtonmeter newtonmeters",
        1e-2: "cnm ncm",
        1e-3: "mnm nmm",
        1e3: "knm",
        _POUND_N * _INCH_M: "lbfin inlbf lbin inlb inlbs",
        _POUND_N * _INCH_M * 12: "lbfft ftlbf lbft ftlb ftlbs",
        _OUNCE_N * _INCH_M: "ozfin inozf ozin inoz",
        _KILOGRAM_N: "kgfm",
        _KILOGRAM_N / 100: "kgfcm kgcm",
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
    "N": "N, mN, kN, lbf, ozf or kgf (kilograms-force)",
    "N m": "N m, mN m, cN m, kN m, N mm, lbf in, lbf ft, ozf in or kgf cm",
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


def same_unit(one: str, other: str) -> bool:
    """Whether two texts of units are of one unit: "Nm" and "N m", "m/s^2" and "m s-2"."""
    for quantity in ("N", "N m"):
        scales = [factor(unit, quantity) for unit in (one, other)]
        if None not in scales:
            return scales[0] == scales[1]
    return _plain_unit(one) == _plain_unit(other)


_BETWEEN_UNITS = " *.-^_()[]\N{MIDDLE DOT}\N{DOT OPERATOR}"
_SPELLINGS = {
    **dict.fromkeys(("m/s/s", "m/ss", "ms2"), "m/s2"),
    **dict.fromkeys(("\N{DEGREE SIGN}/s", "dps", "degs1"), "deg/s"),
    "rads1": "rad/s",
}


def _plain_unit(unit: str) -> str:
    """Leave out what stands between the parts of a unit, and spell it in one way."""
    plain = "".join(c for c in unicodedata.normalize("NFKC", unit) if c not in _BETWEEN_UNITS)
    return _SPELLINGS.get(plain, _SPELLINGS.get(plain.lower(), plain))


def is_unit(text: str) -> bool:
    """Return True if a cell may be one of a line of units: a unit, or nothing at all."""
    plain = text.strip().strip("[]()")
    known = any(factor(plain, quantity) is not None for quantity in _KNOWN)
    return not plain or plain in ("-", "1") or known or plain.lower() in _OTHER_UNITS


_PARTS = re.compile(
    r"([mck]?n|[mcu]?m|[mun]?s|k?hz|m?rad|deg[cs]?|dps|k?g|m?v|m?a|[mu]?t|[km]?pa|kgf|lbf|ozf|in|ft|min|h|gauss|bar|psi|"
    r"w|k|c|rpm|counts?|lsb)"
)
"""Units of which others are made."""


def is_known_unit(text: str) -> bool:
    """Return True if a unit, of any quantity, is made of those that are known: ``m/s2``."""
    return is_unit(text) or all(map(_PARTS.fullmatch, re.findall(r"[^\W\d_]+", text.lower())))


def units_by_axis(axes: Sequence[str], units: Sequence[str] | None) -> dict[str, str]:
    """Return the unit stated of each axis: of one for all, one an axis, or one for each of several equal runs."""
    if not units:
        return {}
    measured = [axis for axis in axes if meaning_of(axis).what != TIME]
    axes = axes if len(units) == len(axes) else measured
    run = len(axes) // len(units)
    if len(units) not in (1, len(axes)) and 3 * len(units) != len(axes):
        problem = f"has {len(units)} for {len(axes)} axes ({', '.join(axes)})"
        each = ",".join(f"unit of {axis}" for axis in axes)
        wanted = f"wanted one per axis, in this order ({each}), one for all, or one for each three (N,Nm)"
        raise argument_error(GranularIdError, "units", f"{problem}; {wanted}")
    return {axis: unit for i, axis in enumerate(axes) if (unit := units[i // run])}


TIME, NANOSECONDS, RECORDING, LABEL, SESSION = "time", "nanoseconds", "recording", "label", "session"
RATE, FLAGS = "rate_hz", "sample_flags"
ABOUT = (TIME, RECORDING, LABEL, SESSION, RATE, FLAGS)
"""What a column may be besides an axis; flags only in files that are written here: ``flags`` may be anything."""

LABEL_NAMES = re.compile(r"(y|labels?|materials?|targets?|class|classes|name)($|[_\d])", re.IGNORECASE)
"""Names of labels in files of others, for ways out only: people see what they type."""

TIMES = (
    "time",
    *["t", "timestamp", "timestamps", "stamp", "ts", "datetime", "seconds", "sec", "secs", "xvalue"],
    *["zeit", "tiempo", "temps", "tempo", "aika", "tid", "tijd", "czas"],
    *[
        "\N{CJK UNIFIED IDEOGRAPH-6642}\N{CJK UNIFIED IDEOGRAPH-9593}",
        "\N{CJK UNIFIED IDEOGRAPH-65F6}\N{CJK UNIFIED IDEOGRAPH-95F4}",
    ],
)
"""Names of a clock without case and separators; of several that are there, the first one is it."""

SCALED_UNITS = re.compile(
    r"N[\s_*.\N{MIDDLE DOT}-]?[mc]m|\b[mk]N\b|mN[\s_*.\N{MIDDLE DOT}-]?m|"
    r"\b(in|ft)?[\s_.-]?(lbs?|lbf|ozf?|kgf)[\s_.-]?(in|ft)?\b"
)
"""Units in a text that are other than N and N m."""

UNIT_NAMES = re.compile(r"(^|[\W_a-z])[Uu](nit|NIT)[sS]?($|[\W_])")
"""What states units is called so."""

SESSION_NAMES = re.compile(
    r"(.*[\W_])?(date|day|session|datum|tag|sitzung|jour|fecha|d[i\N{LATIN SMALL LETTER I WITH ACUTE}]a|giorno)"
    r"($|[\W_\d].*)",
    re.IGNORECASE,
)
"""Names of what may tell sessions apart in files of others, for ways out only."""

_TORQUES = ("t", "m", "tau", "torque", "moment", "drehmoment", "couple", "par", "momento")

_FORCES = ("f", "force", "kraft", "fuerza")

_WORDS = {
    **{word + f + axis: "f" + axis for axis in "xyz" for word in _FORCES for f in ("", "f")},
    **{word + t + axis: "t" + axis for axis in "xyz" for word in _TORQUES for t in ("", "t", "m")},
    **{f"actualtcpforce{i}": axis for i, axis in enumerate(AXES)},
    **dict.fromkeys(TIMES, TIME),
    **{word + end: RECORDING for word in ("recording", "trial") for end in ("", "id")},
    "id": RECORDING,
    **dict.fromkeys(("label", "material", "class"), LABEL),
    **{"session": SESSION, "sessionid": SESSION},
    **dict.fromkeys(("ratehz", "fs", "samplingrate"), RATE),
    "sampleflags": FLAGS,
}
_QUANTITIES = {**dict.fromkeys(AXES[:3], "N"), **dict.fromkeys(AXES[3:], "N m"), TIME: "s", RATE: "Hz"}
"""The unit in which values are wanted."""

_NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*")
_THOUSANDS = re.compile(r"\s*[+-]?\d{1,3}(,\d{3})+\.\d*\s*")
DECIMAL_COMMA = re.compile(r"\s*[+-]?\d+,\d+\s*")
_POINTS = re.compile(r"\s*[+-]?\d{1,3}(\.\d{3})+(,\d+)?\s*")
"""A number with points between thousands, where a comma is the decimal mark."""


_LONGEST = 200
"""Characters of a name: a topic, a field and a unit have room, and no regular expression takes long."""

_BETWEEN = re.compile(r"[\s_./-]+")
_PATH = re.compile(r"(?:(?:.*/|field\.)?wrench[\s_./-]+|field\.)")
_BRACKETED = re.compile(r"(.+?)\s*(?:\[([^][]*)\]|\(([^()]*)\))")
_TRAILING = re.compile(
    r"(.+?)[\s_./,-]+("
    + "|".join(sorted((name for known in _KNOWN.values() for name in known), key=len, reverse=True))
    + r"|(?:[mck]?n|kgf|lbf|ozf)[\s_.*\N{MIDDLE DOT}-](?:m|mm|cm|in|ft)|(?:in|ft)[\s_.*\N{MIDDLE DOT}-](?:lb|lbs|lbf))",
    re.IGNORECASE,
)
_IN_TWO = re.compile(r"(.*)secs?(?:onds)?\n\1n(?:ano)?secs?(?:onds)?", re.IGNORECASE)
"""Columns of whole seconds and of nanoseconds, as ROS prints stamps."""


class TableError(WayOutError):
    """Samples that make no recording: the problem, and the row and column of the table where it is."""

    def __init__(
        self,
        problem: str | Sequence[str],
        row: int | None = None,
        column: str | None = None,
        *,
        no_wrench: bool = False,  # the table holds none of the axes, and may be something else
        mend: str = "",  # methods of a data frame that make recordings of it
    ) -> None:
        super().__init__(*parts_of(problem))
        self.row, self.column, self.no_wrench, self.mend = row, column, no_wrench, mend


class Meaning(NamedTuple):
    """A name of a column without its unit, that unit, what the column is (None: not known), and what one unit is."""

    base: str
    unit: str | None = None
    what: str | None = None
    scale: float | None = 1.0  # in N, N m, s or Hz; None where the unit is none of those


@lru_cache(maxsize=1024)  # every file of a folder has the same header
def meaning_of(name: str) -> Meaning:
    """Say what a column of this name is: ``wx [rad/s]`` is ``wx`` in ``rad/s``."""
    base, unit = name.strip(), None
    if base.endswith("_") and _word(base) is None:  # Fx_N_, as MATLAB calls Fx (N)
        base = base[:-1]
    if len(base) > _LONGEST:
        return Meaning(base)
    if (found := _BRACKETED.fullmatch(base)) is not None:
        base, unit = found[1], (found[3] or found[2] or "").strip() or None
    elif _word(base) is None and (found := _TRAILING.fullmatch(base)) is not None:
        base, unit = found[1], found[2]
    what = None if name.strip() == "T" else _word(base)  # time, torque or temperature
    wanted = _QUANTITIES.get(what or "")
    scale = 1.0 if unit is None else None if wanted is None else factor(unit, wanted)
    return Meaning(base, unit, what, scale)


def _word(text: str) -> str | None:
    text = text.strip().lower()
    path = _PATH.match(text)
    whole = _WORDS.get(_BETWEEN.sub("", text[path.end() :] if path else text))
    last = _WORDS.get(re.split("[/.]", text)[-1])  # Model/FT/Fx, FTC.Fx
    return whole or (last if last in AXES or (last == TIME and "/" in text) else None)


def cell_text(value: Any) -> str:
    """Return a cell as text, 3 for 3.0; an empty one as ""."""
    is_plain = isinstance(value, (str, int, float)) or np.ndim(value) == 0  # a list is no NaN
    if value is None or (is_plain and value != value):  # noqa: PLR0124 (NaN)
        return ""
    return str(int(value)) if isinstance(value, float) and value.is_integer() else str(value).strip()


@lru_cache(maxsize=256)
def columns_of(
    names: tuple[str, ...],
    axes: tuple[str, ...] | None = None,
    named: tuple[tuple[str, str], ...] = (),
    stated: tuple[str, ...] = (),
) -> Mapping[str, str]:
    """Find columns: by axis (default fx fy fz tx ty tz), and by `ABOUT` and `NANOSECONDS`.

    `named` are columns by what they are; for what is `stated` elsewhere none is wanted.
    """
    twice = next((name for i, name in enumerate(names) if name in names[:i]), None)
    if twice is not None:
        raise TableError(f"column {twice!r:.60} occurs twice")
    found = {axis: _column_of(axis, names, is_named=axes is not None) for axis in axes or AXES}
    for what, name in named:
        if name not in names:
            raise TableError(f"{what}={name!r:.60} is no column of it; there are {_listed(names)}")
        if name in found.values():
            other = next(known for known, column in found.items() if column == name)
            taken_as = {RECORDING: "the column of ids", TIME: "the clock"}.get(other, "one of the axes")
            raise TableError(f"{what}={name!r:.60} is {taken_as}; wanted another column")
        found[what] = name
    taken = {name for what, name in found.items() if what != RECORDING}  # a column of labels may be it, too
    for what in ABOUT:
        places = [name for name in names if name not in taken and meaning_of(name).what == what]
        if what in found or what in stated or not places:
            continue
        if what == TIME and len(places) > 1:
            plain = [_BETWEEN.sub("", meaning_of(name).base.lower()) for name in places]
            ranks = [TIMES.index(one) if one in TIMES else len(TIMES) for one in plain]
            places = [places[ranks.index(min(ranks))]]
        if len(places) > 1:
            problem = f"columns {' and '.join(map(repr, places[:2]))} both mean {what}"
            if what not in (RECORDING, LABEL, SESSION):
                raise TableError(f"{problem}; keep only one")
            ways = [
                in_both(id=one) if what == RECORDING else in_both(**{what: f"column:{one}"}) for one in places
            ]
            raise TableError((f"{problem}; name one of them: ", *alternatives(ways)))
        found[what] = places[0]
    beside = [name for name in names if TIME in found and _IN_TWO.fullmatch(f"{found[TIME]}\n{name}")]
    return {**found, NANOSECONDS: beside[0]} if beside else found


def _column_of(axis: str, names: Sequence[str], *, is_named: bool) -> str:
    """Return the column that holds an axis: the one called so, or without its unit, or by another name of fx to tz."""
    small = axis.strip().lower()
    tiers = (
        [name for name in names if name.strip() == axis],
        [name for name in names if name.strip().lower() == small],
        [name for name in names if meaning_of(name).base.strip().lower() == small],
        [name for name in names if axis in AXES and meaning_of(name).what == axis],
    )
    for places in tiers:
        sound = [name for name in places if axis not in AXES or meaning_of(name).scale is not None]
        if len(sound) > 1:
            both = " and ".join(map(repr, sound[:2]))
            raise TableError(
                f"columns {both} may both be {axis!r}; pass axes= with the names of those wanted (--axes NAMES)"
            )
        if sound:
            return sound[0]
    bad = next((name for places in tiers for name in places), None)
    if bad is not None:
        unit, wanted = meaning_of(bad).unit or "", TAKEN[_QUANTITIES[axis]]
        raise TableError(f"the unit of column {bad!r:.60} is {unit!r:.40}; wanted {wanted}")
    if is_named:
        raise TableError(f"axes names {axis!r:.60}, which is no column of it; there are {_listed(names)}")
    some = any(meaning_of(name).what in AXES for name in names)
    missing = f"column {axis!r} is missing; wanted" if some else "names none of"
    also = "also force_x, wrench.force.x, 'Fx [N]'; mx, torque_x, moment_x"
    problem = f"{missing} {', '.join(AXES)} ({also}); there are {_listed(names)}"
    raise TableError(problem, no_wrench=not some)


def _listed(names: Sequence[str]) -> str:
    return first_names([name[:40] for name in names], 20)


def numbers_of(
    columns: Mapping[str, npt.NDArray[Any]],
    names: Sequence[str],
    *,
    clock: str | None = None,
    csv: Mapping[str, Any] | None = None,
) -> FloatArray:
    """Put columns side by side, read-only, empty cells as NaN; `csv`: options of ``pandas.read_csv`` that read them."""
    found = []
    for name in names:
        values = columns[name]
        if values.dtype.kind in "iuf":
            found.append(values)
            continue
        if values.ndim != 1 or values.dtype.kind not in "OUT":
            raise TableError(f"holds {values.dtype}; wanted numbers", column=name)
        cells = values.tolist()
        no_number = [
            row
            for row, cell in enumerate(cells)
            if isinstance(cell, bool) or not isinstance(cell, (int, float, type(None)))
        ]
        if no_number:
            texts = [row for row in no_number if _NUMBER.fullmatch(_plain_number(cells[row], csv)) is None]
            row = (texts or no_number)[0]
            several = {str(cells[one])[:40] for one in texts}
            raise _no_number(row, name, several, columns, names, clock, csv)
        found.append(np.array([np.nan if cell is None else cell for cell in cells], np.float64))
    whole = np.column_stack(found).astype(np.float64, copy=False)
    whole.flags.writeable = False
    return whole


def _no_number(
    row: int,
    name: str,
    several: Set[str],  # all texts of the column that are no numbers
    columns: Mapping[str, npt.NDArray[Any]],
    names: Sequence[str],
    clock: str | None,
    csv: Mapping[str, Any] | None,
) -> TableError:
    """Say what is wrong with a cell, and what reads it: options of pandas, or methods of its frames."""
    cell, beside = columns[name][row], {one: columns[one][row] for one in names}
    if isinstance(cell, (list, tuple, np.ndarray)):
        mend = f".explode({list(names)}).astype(dict.fromkeys({list(names)}, float))"
        return TableError("holds lists; wanted one number a row", row, name, mend=mend)
    text = str(cell)[:40]
    option: dict[str, Any] = {}
    if DECIMAL_COMMA.fullmatch(text):
        option = {"decimal": ","}
    elif _THOUSANDS.fullmatch(text):
        option = {"thousands": ","}
    elif _POINTS.fullmatch(text) and ("," in text or (csv or {}).get("decimal") == ","):
        option = {"decimal": ",", "thousands": "."}
    elif several == {text} and all(str(value).strip() == called for called, value in beside.items()):
        option = {"na_values": list(columns)}  # its names again
    elif several == {text} and all(value == cell for value in beside.values()):  # else it were empty in part
        option = {"na_values": text}
    why = "; if it stands for a missing sample" * (option.get("na_values") == text)
    if csv is not None and any(csv.get(key) != value for key, value in option.items()):
        return TableError((f"{text!r} is no number{why}: pass ", in_both(csv=option)), row, name)
    has_marks = bool(option.keys() & {"decimal", "thousands"})
    mend = mended(names, is_text=True, decimal=(csv or {}).get("decimal", "."))
    stamps = columns.get(clock or "")
    if stamps is not None and stamps.dtype.kind == "O" and _NUMBER.fullmatch(str(stamps[0])):
        rows = [float(str(stamp)) for stamp in stamps if _NUMBER.fullmatch(str(stamp))]
        anew = ANEW.format(name="recording", stamps=f"pandas.to_numeric(f[{clock!r}])") * bool(
            (np.diff(rows) < 0).any()
        )
        mend = NUMERIC_ROWS.format(clock=clock) + anew + mend
    return TableError(f"{text!r} is no number; wanted a number", row, name, mend=mend * (not has_marks))


NUMERIC_ROWS = ".pipe(lambda f: f[pandas.to_numeric(f[{clock!r}], errors='coerce').notna()])"
"""The method of a data frame that leaves out rows whose stamp is no number."""


ANEW = ".assign(**{{{name!r}: lambda f: ({stamps}.ffill().diff() < 0).cumsum()}})"
"""The method that begins a recording where stamps run back."""


def _plain_number(cell: Any, csv: Mapping[str, Any] | None) -> str:
    """Return a cell with the point that options of pandas make of it."""
    marks = csv or {}
    return str(cell).replace(marks.get("thousands") or "\0", "").replace(marks.get("decimal") or ".", ".")


def mended(names: Sequence[str], *, is_text: bool = False, decimal: str = ".", fill: bool = False) -> str:
    """Return the method of a data frame that empties rows which are no samples; a gap stays where they were."""
    numbers = ".apply(pandas.to_numeric, errors='coerce')" * is_text
    numbers = f".replace({decimal!r}, '.', regex=True)" * (decimal != ".") + numbers
    finite = ".replace([float('inf'), -float('inf')], float('nan'))"
    filled = ".interpolate()" * fill
    return f".pipe(lambda f: f.assign(**f[{list(names)}]{numbers}{finite}{filled}.dropna().reindex(f.index)))"


# Tables as samples.


def column_names(value: object, argument: str = "wrench") -> tuple[str, ...] | None:
    """Return the names of the columns of a table; None for arrays, and for tables whose columns are only numbered."""
    if isinstance(value, (np.ndarray, list, tuple)):
        return None
    # pyarrow keeps its arrays in columns
    columns = getattr(value, "column_names", getattr(value, "columns", None))
    found = value if isinstance(value, Mapping) else columns
    if isinstance(found, str) or not isinstance(found, Iterable):
        return None
    names = tuple(found)
    other = [name for name in names if not isinstance(name, str)]
    if not other:
        return names or None
    if all(isinstance(name, (int, np.integer)) for name in names):
        return None
    raise TypeError(f"{argument} has a column with the name {other[0]!r:.80}; wanted text")


def refuse_table(value: Any, argument: str) -> None:
    """Refuse a table with named columns where an array is wanted: its columns may be in another order."""
    if column_names(value, argument) is not None:
        came = f"is a {type(value).__name__} with named columns; wanted an array, whose columns have an order"
        raise argument_error(TypeError, argument, f"{came}: pass Dataset.from_frames(...), or .to_numpy()")


def refuse_tables(value: Any, argument: str) -> None:
    """Refuse tables with named columns, one or several, and recordings of several shapes, where an array is wanted."""
    refuse_table(value, argument)
    several = value if isinstance(value, (list, tuple)) else ()
    for i, one in enumerate(several):
        refuse_table(one, f"{argument}[{i}]")
    if several or (isinstance(value, np.ndarray) and value.dtype == object and value.ndim == 1):
        _refuse_ragged(value, argument)


def _refuse_ragged(recordings: Iterable[Any], argument: str) -> None:
    shapes = set()
    for one in recordings:
        if isinstance(one, np.ndarray):
            shapes.add(one.shape)
        elif isinstance(one, (list, tuple)) and one and isinstance(one[0], (list, tuple, np.ndarray)):
            shapes.add((len(one), len(one[0])))
    if len(shapes) > 1:
        low, *_, high = sorted(shapes)
        raise GranularIdError(
            f"{argument} must hold recordings of one shape, got {low} and {high}: cut them to one length, as "
            "Dataset.align(n_samples=...) and Dataset.windows(duration_s) do"
        )
