"""The one check of documents that come from outside: JSON files, and the metadata that files carry.

A form is written in plain Python values, and looks like what it admits::

    {
        "name": str,  # an object with this entry; entries that no form names are not looked at
        "note?": str,  # an entry that may be missing
        "count": (int, None),  # a whole number, or null
        "format": "rule 1",  # this very text
        "kind": {"margin", "share"},  # one of these texts
        "recall": {EACH: float},  # an object whose every value is a finite number
        "interval": [float, float],  # a list of two
        "steps": [{"step": str}, ...],  # a list of any length
        "parameters": {},  # any object
    }
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

from granular_id._core import GranularIdError

EACH = "*"
"""In a form: every value of an object, whatever its name."""

_WORDS = {str: "text", int: "a whole number", float: "a finite number", bool: "true or false"}


def check_form(document: Any, form: Any, *, what: str = "the document", closed: bool = False) -> None:
    """Refuse a document of another form: the error names the place, what came, and what is wanted.

    Parameters
    ----------
    document : object
        As `json.loads` gives it.
    form : object
        As in the head of this module.
    what : str
        The document itself, in messages; places inside it are named by their path, as in ``steps[0].step``.
    closed : bool, default False
        Refuse entries that the form does not name.

    Raises
    ------
    TypeError
        A value of another type.
    ValueError
        A missing entry, an entry that is refused, another text than is wanted.
    """
    _check(document, form, "", what, closed)


def _check(value: Any, form: Any, path: str, what: str, closed: bool) -> None:
    place = path or what
    if isinstance(form, tuple):
        if value is not None:
            _check(value, form[0], path, what, closed)
    elif isinstance(form, dict):
        if not isinstance(value, Mapping):
            raise TypeError(f"{place} must be an object, got {value!r:.80}")
        _check_entries(value, form, path, what, closed)
    elif isinstance(form, list):
        endless = form[-1] is ...
        if not isinstance(value, list) or not (endless or len(value) == len(form)):
            raise TypeError(
                f"{place} must be a list{'' if endless else f' of {len(form)}'}, got {value!r:.80}"
            )
        for k, part in enumerate(value):
            _check(part, form[0] if endless else form[k], f"{path}[{k}]", what, closed)
    elif isinstance(form, (str, set)):
        wanted = sorted({form} if isinstance(form, str) else form)
        if value not in wanted:
            raise GranularIdError(f"{place} must be {' or '.join(map(repr, wanted))}, got {value!r:.80}")
    elif not _has_type(value, form):
        raise TypeError(f"{place} must be {_WORDS[form]}, got {value!r:.80}")


def _check_entries(
    value: Mapping[str, Any], form: dict[str, Any], path: str, what: str, closed: bool
) -> None:
    if EACH in form:
        for name, part in value.items():
            _check(part, form[EACH], f"{path}.{name}".lstrip("."), what, closed)
        return
    for entry, own in form.items():
        name = entry.removesuffix("?")
        if name in value:
            _check(value[name], own, f"{path}.{name}".lstrip("."), what, closed)
        elif name == entry:
            raise GranularIdError(f"{path or what} must hold {name!r}, got {sorted(value)!r:.80}")
    unknown = sorted(set(value) - {entry.removesuffix("?") for entry in form})
    if closed and form and unknown:
        raise GranularIdError(f"{path or what} must not hold {unknown[0]!r:.80}")


def _has_type(value: Any, form: type) -> bool:
    if form is float:
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
        return is_number and abs(value) <= sys.float_info.max  # false for NaN; huge integers are no floats
    return isinstance(value, form) and (form is bool or not isinstance(value, bool))
