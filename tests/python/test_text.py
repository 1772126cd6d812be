"""Numbers, plurals, lists and shares as texts write them."""

from __future__ import annotations

import pytest

from granular_id._text import counted, fixed, known_label, listed, percent, short, verb, whole_percent


@pytest.mark.parametrize(
    ("written", "text"),
    [
        (counted(1), "1 recording"),
        (counted(3, "label"), "3 labels"),
        (fixed(12.345, 1), "12.3"),
        (fixed(1e300, 1), "1e+300"),
        (fixed(10**400), "1.000e+400"),
        (fixed(1e-300, 300), "1e-300"),
        (fixed(float("nan"), 1), "nan"),
        (listed([]), ""),
        (listed(["a"]), "a"),
        (listed(["a", "b", "c"]), "a, b and c"),
        (verb(1, "has", "have"), "has"),
        (verb(2, "has", "have"), "have"),
        (percent(0.123), "12.3 %"),
        (percent(None), "-"),
        (percent(float("nan")), "-"),
        (short("sunflower seeds"), "sunflower seeds"),
        (short("sunflower seeds, roasted and salted", 20), "sunflower …nd salted"),
        # neither the last error of a class nor its only hit is hidden
        *[
            (whole_percent(value), text)
            for value, text in [(0.0, "0"), (0.2, "<1"), (87.5, "88"), (99.7, ">99"), (100.0, "100")]
        ],
    ],
)
def test_words_and_numbers(written, text):
    assert written == text


LABELS = ("fine sugar", "rice", "red_clay", "red clay")


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("rice", "rice"),
        ("fine sugar", "fine sugar"),
        ("fine_sugar", "fine sugar"),
        ("red_clay", "red_clay"),
        ("red clay", "red clay"),
        ("oat_flakes", "oat_flakes"),  # not known: as it was typed
    ],
)
def test_a_known_label_may_be_typed_with_underscores(typed, meant):
    assert known_label(typed, LABELS) == meant
