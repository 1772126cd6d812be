"""Documents from outside: what a form admits, and what an error says of the place."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, make_dataclass
from typing import Any, TypeVar

import numpy as np
import pytest
from numpy.typing import NDArray

from granular_id._files import json_value
from granular_id._schema import EACH, check_form, form_of, from_json

FORM = {
    "format": "rule 1",
    "kind": {"margin", "share"},
    "note?": str,
    "count": (int, None),
    "exact": bool,
    "recall": {EACH: float},
    "interval": [float, float],
    "steps": [{"step": str, "parameters": {}}, ...],
}
GOOD = {
    "format": "rule 1",
    "kind": "share",
    "note": "",
    "count": 3,
    "exact": False,
    "recall": {"rice": 1, "salt": 0.5},
    "interval": [0.1, 0.9],
    "steps": [{"step": "align", "parameters": {"lead_s": 0.1}}],
    "more": [1],
}


def test_what_has_the_form_passes():
    check_form(json.loads(json.dumps(GOOD)), FORM)
    check_form({**GOOD, "count": None, "recall": {}, "steps": []}, FORM)
    check_form({name: value for name, value in GOOD.items() if name != "note"}, FORM)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"format": "rule 2"}, ValueError, "format must be 'rule 1', got 'rule 2'"),
        ({"kind": []}, ValueError, "kind must be 'margin' or 'share', got []"),
        ({"note": None}, TypeError, "note must be text, got None"),
        ({"count": True}, TypeError, "count must be a whole number, got True"),
        ({"exact": 1}, TypeError, "exact must be true or false, got 1"),
        ({"recall": []}, TypeError, "recall must be an object, got []"),
        ({"recall": {"rice": "1"}}, TypeError, "recall.rice must be a finite number, got '1'"),
        ({"interval": [0, float("nan")]}, TypeError, "interval[1] must be a finite number, got nan"),
        ({"interval": [0, 10**400]}, TypeError, f"interval[1] must be a finite number, got 1{'0' * 79}"),
        ({"interval": [0.1]}, TypeError, "interval must be a list of 2, got [0.1]"),
        ({"steps": {}}, TypeError, "steps must be a list, got {}"),
        ({"steps": [{"parameters": {}}]}, ValueError, "steps[0] must hold 'step', got ['parameters']"),
        ({"steps": [{"step": 1, "parameters": {}}]}, TypeError, "steps[0].step must be text, got 1"),
    ],
)
def test_another_form_is_refused_at_its_place(change, error, message):
    with pytest.raises(error, match=f"^{re.escape(message)}$"):
        check_form({**GOOD, **change}, FORM)


def test_the_document_itself_has_a_name():
    for document, closed, message in (
        (3, False, "must be an object, got 3$"),
        ({}, False, "must hold 'format', got"),
        (GOOD, True, "must not hold 'more'$"),
    ):
        with pytest.raises((TypeError, ValueError), match=f"^the rule {message}"):
            check_form(document, FORM, what="the rule", closed=closed)


@dataclass(frozen=True, eq=False)
class Part:
    names: tuple[str, ...]
    values: NDArray[np.float64]
    codes: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Whole:
    parts: tuple[Part, ...]
    other: Part | None
    shares: Mapping[str, float]
    settings: Mapping[str, Any]
    note: str = "none"


def test_a_dataclass_is_read_back_as_it_was():
    part = Part(("a", "b"), np.array([[0.1, 2.0]]), np.array([3, 4]))
    whole = Whole((part, part), None, {"rice": 0.5}, {"cutoff_hz": 23.0}, "some")
    saved = json.loads(json.dumps(json_value(whole)))
    again = from_json(Whole, saved)
    assert json_value(again) == json_value(whole) == saved
    assert again.parts[1].names == part.names
    assert [array.dtype for array in (again.parts[0].values, again.parts[0].codes)] == [np.float64, np.intp]
    del saved["note"]
    assert from_json(Whole, saved).note == "none"


def test_a_named_alias_is_what_it_stands_for():
    """As NDArray is from numpy 2.5 on; typing has them from Python 3.12 on."""
    aliases = pytest.importorskip("typing_extensions")
    kind = TypeVar("kind", bound=np.generic)
    named = aliases.TypeAliasType("named", np.ndarray[Any, np.dtype[kind]], type_params=(kind,))
    assert (form_of(named[np.float64]), form_of(named[np.intp] | None)) == (list, (list, None))
    holder = make_dataclass("Holder", [("values", named[np.float64])])
    assert from_json(holder, {"values": [1, 2]}).values.dtype == np.float64


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"parts": [{"names": [], "values": []}]}, r"parts\[0\] must hold 'codes'"),
        ({"parts": [{"names": [1], "values": [], "codes": []}]}, r"parts\[0\].names\[0\] must be text"),
        ({"parts": [{"names": [], "values": 1, "codes": []}]}, r"parts\[0\].values must be a list"),
        ({"parts": [{"names": [], "values": [], "codes": [0.5]}]}, "Cannot cast"),
        ({"other": 1}, "other must be an object"),
        ({"shares": {"rice": "much"}}, "shares.rice must be a finite number"),
    ],
)
def test_a_dataclass_is_not_made_of_another_form(change, message):
    good = {"parts": [], "other": None, "shares": {}, "settings": {}}
    from_json(Whole, good)
    with pytest.raises((TypeError, ValueError), match=message):
        from_json(Whole, {**good, **change})
