"""Names of columns and fields: the one table that says what each means.

====== ===================================================== =========================
column also                                                   unit, where it is named
====== ===================================================== =========================
fx     force_x, F_x, wrench.force.x                           N
tx     torque_x, moment_x, tau_x, Mx, wrench.torque.x         N m
time   t, timestamp, time_stamp, stamp, seconds, sec          s
flags                                                         (bits of ``SampleFlag``)
====== ===================================================== =========================

Likewise y and z. Case, blanks, ``_ . / -`` between the words and ``field.`` or a topic before ``wrench`` do not
matter. A unit may follow: ``Fx [N]``, ``tx (Nm)``, ``time_s``. One that is not N, N m or s is refused, as nothing
is scaled on the strength of a name; so is what could mean two things (``T``: time, torque, temperature; ``ts``).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

from granular_id.io.units import NAMED, factor
from granular_id.recording import AXES

__all__ = ["FLAGS", "TIME", "ColumnError", "axis_of", "columns_of", "refusal", "split_unit"]

TIME, FLAGS = "time", "flags"

_WORDS = {
    **{word + axis: "f" + axis for axis in "xyz" for word in ("f", "force")},
    **{word + axis: "t" + axis for axis in "xyz" for word in ("t", "m", "tau", "torque", "moment")},
    **dict.fromkeys(("t", "time", "timestamp", "stamp", "seconds", "sec"), TIME),
    "flags": FLAGS,
}

_OTHER_UNITS = (
    *("lb", "lbs", "ozf", "g", "gf", "kg", "v", "mv", "counts"),
    *("knm", "ncm", "lbin", "lbfft", "lbft", "ozin", "kgm", "kgfm"),
    *("\N{MICRO SIGN}s", "min", "h"),
)
"""Units besides those of ``units`` that may follow a name after ``_`` and must not be taken for a part of it."""

_LONGEST = 200
"""Characters of a name: a topic, a field and a unit have room, and no regular expression takes long."""

_NAMED = 9
"""Columns to leave out that an error names."""

_SEPARATORS = r"[\s_./-]+"
_PATH = re.compile(r"(?:(?:.*/|field\.)?wrench[\s_./-]+|field\.)")
_BRACKETED = re.compile(r"(.+?)\s*(?:\[([^][]*)\]|\(([^()]*)\))")
_TRAILING = re.compile(
    rf"(.+?){_SEPARATORS}("
    + "|".join(sorted({*_OTHER_UNITS, *NAMED}, key=len, reverse=True))
    + r"|n[\s_.*-]m)",
    re.IGNORECASE,
)


class ColumnError(ValueError):
    """A set of names that does not make a recording.

    Attributes
    ----------
    problem : str
    index : int or None
        Which name is at fault, from 0; None where one is missing.
    """

    def __init__(self, problem: str, index: int | None = None) -> None:
        super().__init__(problem)
        self.problem = problem
        self.index = index


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
    def holds(self) -> bool:
        """Whether the axis is known and the unit, if there is one, is right."""
        if self.axis is None or self.unit is None:
            return self.axis is not None
        return self.wanted is not None and factor(self.unit, self.wanted) == 1


def axis_of(name: str) -> str | None:
    """Tell what a column holds: ``"fx"`` to ``"tz"``, ``"time"``, ``"flags"``, or None where that is not certain.

    Parameters
    ----------
    name : str
        Name of a column or field, in any case.

    Examples
    --------
    >>> from granular_id.io.columns import axis_of
    >>> [axis_of(name) for name in ("Fx [N]", "wrench.torque.z", "M_y", "time_s", "fx_mN", "temperature")]
    ['fx', 'tz', 'ty', 'time', None, None]
    """
    meaning = _meaning(name)
    return meaning.axis if meaning.holds else None


def split_unit(name: str) -> tuple[str | None, str | None]:
    """Return what a column holds as `axis_of` does, whatever its unit, and the unit that its name states.

    Examples
    --------
    >>> from granular_id.io.columns import split_unit
    >>> split_unit("Fx [mN]"), split_unit("time_ms"), split_unit("tz")
    (('fx', 'mN'), ('time', 'ms'), ('tz', None))
    """
    meaning = _meaning(name)
    return meaning.axis, meaning.unit


def refusal(name: str) -> str:
    """Return why a name that ``axis_of`` does not know is refused, and what is wanted."""
    meaning, shown = _meaning(name), repr(name.strip()[:40])
    if meaning.axis is not None and meaning.unit is not None:
        wanted = "none" if meaning.wanted is None else f"{meaning.wanted}: convert the values first"
        return f"the unit of column {shown} is {meaning.unit[:40]!r}; wanted {wanted}"
    if name.strip() == "T":
        return f"column {shown} may be time, torque or temperature; wanted a name that says which"
    also = "also force_x, wrench.force.x, 'Fx [N]'; mx, torque_x, moment_x; t, timestamp, time_s"
    return f"unknown column {shown}; wanted {', '.join(AXES)}, and optionally time (s) and flags ({also})"


def columns_of(names: Sequence[str]) -> dict[str, int]:
    """Find the six axes, and time and flags where they are there, among the names of all columns.

    Parameters
    ----------
    names : sequence of str

    Returns
    -------
    dict
        From ``"fx"`` ... ``"tz"``, ``"time"``, ``"flags"`` to the index of the name.

    Raises
    ------
    ColumnError
        A name that is not known, two that mean the same, or an axis that is missing.

    Examples
    --------
    >>> from granular_id.io.columns import columns_of
    >>> columns_of(["t", "Fx", "Fy", "Fz", "Mx", "My", "Mz"])["tx"]
    4
    """
    found: dict[str, int] = {}
    for i, name in enumerate(names):
        axis = axis_of(name)
        if axis is None:
            raise ColumnError(refusal(name) + _way_round(names, name), i)
        if axis in found:
            first = names[found[axis]]
            same = first.strip().lower() == name.strip().lower()
            problem = (
                f"column {name!r} occurs twice"
                if same
                else f"columns {first!r} and {name!r} both mean {axis}; wanted one of them"
            )
            raise ColumnError(problem, i)
        found[axis] = i
    missing = [axis for axis in AXES if axis not in found]
    if missing:
        raise ColumnError(f"column {missing[0]!r} is missing; wanted {', '.join(AXES)}")
    return found


def _way_round(names: Sequence[str], unknown: str) -> str:
    """Say what to do about a column that is not known, where that can be told."""
    if re.fullmatch(r"[-+\d.eE]+|#.*", unknown.strip()):
        return "; line 1 names the columns"
    known = unknown.strip() == "T" or _meaning(unknown).axis is not None
    if known or not set(AXES) <= {axis_of(name) for name in names}:
        return ""
    others = [repr(n.strip()[:40]) for n in names if n != unknown and _meaning(n).axis is None]
    also = f", and without {', '.join(others[:_NAMED])}" + (", ..." if len(others) > _NAMED else "")
    pandas = "" if unknown.strip() else " (pandas: to_csv(file, index=False))"
    return f"; write the file without it{pandas}{also if others else ''}"


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
    return _WORDS.get(re.sub(_SEPARATORS, "", text[path.end() :] if path else text))
