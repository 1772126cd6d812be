"""Units in which files state their values, and what one of each is in N, N m, s or Hz: the one table."""

from __future__ import annotations

import re

__all__ = ["NAMED", "factor"]

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
