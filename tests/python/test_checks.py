"""Checks of arguments name the argument: in the message, and for the command line in an attribute."""

import math
import pickle

import numpy as np
import pytest

from granular_id import GranularIdError, _checks

REFUSED = [
    (lambda: _checks.real_number("x", True), TypeError, "x must be a number, got True"),
    (lambda: _checks.finite_number("x", math.inf), GranularIdError, "x must be finite, got inf"),
    (lambda: _checks.finite_number("x", 0, positive=True), GranularIdError, "x must be positive, got 0"),
    (lambda: _checks.finite_number("x", 3, most=2), GranularIdError, "x must be at most 2, got 3"),
    (lambda: _checks.finite_number("x", -1, least=0), GranularIdError, "x must not be negative, got -1"),
    (
        lambda: _checks.positive_number("x", math.nan),
        GranularIdError,
        "x must be positive and finite, got nan",
    ),
    (lambda: _checks.sampling_rate("x", 1e6), GranularIdError, "x must be at most 50000, got 1e+06"),
    (lambda: _checks.finite_number("x", -5, positive=True), GranularIdError, "x must be positive, got -5"),
    (lambda: _checks.whole_number("x", 0), GranularIdError, "x must be at least 1, got 0"),
    (lambda: _checks.whole_number("x", 1.0), TypeError, "x must be a whole number, got 1.0"),
    (lambda: _checks.named({"a": 1}, "x", "b"), GranularIdError, "x must be one of 'a', got 'b'"),
    (lambda: _checks.checked_flag("x", 1), TypeError, "x must be True or False, got 1"),
    (
        lambda: _checks.checked_text("", "x"),
        GranularIdError,
        "x is empty; give a text or leave it out (None)",
    ),
    (lambda: _checks.float_array("x", [1j]), TypeError, "x must hold real numbers, got complex128"),
    (lambda: _checks.as_floats([True], "x", "numbers"), TypeError, "x has dtype bool; wanted numbers"),
    (lambda: _checks.freeze(math.nan, "x"), GranularIdError, "x is nan; numbers must be finite"),
]


@pytest.mark.parametrize(("check", "kind", "message"), REFUSED, ids=[message for *_, message in REFUSED])
def test_errors_name_the_argument_and_hold_its_name(check, kind, message):
    with pytest.raises(kind) as caught:
        check()
    error = pickle.loads(pickle.dumps(caught.value))  # as from a process of joblib's
    assert (type(error), str(error).replace("bool_", "bool"), error.argument) == (kind, message, "x")


def test_good_values_come_back():
    assert _checks.real_number("x", 10**400) == math.inf
    assert _checks.finite_number("x", np.float32(0.5)) == 0.5
    assert _checks.float_array("x", [[1, 2]]).tolist() == [[1.0, 2.0]]
    assert _checks.freeze({"a": np.int64(3), "b": [None, True]}, "x") == {"a": 3, "b": (None, True)}
    values = np.arange(3.0)
    assert _checks.float_array("x", values) is values
