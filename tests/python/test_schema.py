"""Documents from outside: what a form admits, and what an error says of the place."""

import json
import re

import pytest

from granular_id._schema import EACH, check_form

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
