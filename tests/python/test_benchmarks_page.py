"""docs/benchmarks.md and the tables of README.md are what the stored figures give."""

import importlib
import sys
from pathlib import Path

import pytest

BENCHES = Path(__file__).resolve().parents[2] / "benches"


@pytest.fixture(scope="module")
def page():
    sys.path.insert(0, str(BENCHES))
    yield importlib.import_module("page")
    sys.path.remove(str(BENCHES))
    del sys.modules["page"]


def test_pages_hold_the_stored_figures(page):
    for path, text in page.written().items():
        assert path.read_text(encoding="utf-8") == text, f"{path.name}: run python benches/page.py"


@pytest.mark.parametrize(
    ("value", "n", "shown"), [(9.996, 3, "10.0"), (1234.5, 3, "1,230"), (0.0499, 2, "0.050")]
)
def test_numbers_are_written_out_to_their_significant_digits(page, value, n, shown):
    assert page.digits(value, n) == shown


def test_a_figure_that_changes_is_seen_on_both(page):
    results, accuracy, counts = page.stored()
    before = (
        page.page(results, accuracy, counts),
        page.readme(page.README.read_text("utf-8"), results, accuracy),
    )
    _, microseconds = page.widest(results)
    microseconds["granular_id, 1 thread"] = 98765.0
    after = page.page(results, accuracy, counts), page.readme(before[1], results, accuracy)
    assert all("98,800" in new and "98,800" not in old for new, old in zip(after, before, strict=True))
