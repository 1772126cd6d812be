"""Numbers and labels as texts write them."""

import pytest

from granular_id._text import fixed, known_label, percent, points, whole_percent


@pytest.mark.parametrize(
    ("written", "text"),
    [
        (fixed(12.345, 1), "12.3"),
        (fixed(1e300, 1), "1e+300"),
        (fixed(10**400), "1.000e+400"),
        (fixed(1e-300, 300), "1e-300"),
        (percent(0.123), "12.3 %"),
        (percent(float("nan")), "-"),
        (points(1 - 0.9625), "3.8"),  # a last bit below 3.75, as 0.0375 is not
        (points(0.0375), "3.8"),
        (points(-1e-12), "0.0"),
        # neither the last error of a class nor its only hit is hidden
        (whole_percent(0.0), "0"),
        (whole_percent(0.2), "<1"),
        (whole_percent(99.7), ">99"),
        (whole_percent(100.0), "100"),
        (known_label("fine_sugar", ("rice", "fine sugar")), "fine sugar"),
        (known_label("red_clay", ("red clay", "red_clay")), "red_clay"),
        (known_label("oat_flakes", ("rice",)), "oat_flakes"),  # not known: as it was typed
    ],
)
def test_numbers_and_labels_as_texts_write_them(written, text):
    assert written == text
