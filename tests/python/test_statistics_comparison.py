"""Every pair of methods on the same partitions, and how often each test is wrong."""

import json
import math
from itertools import combinations

import numpy as np
import pytest
from scipy import stats

from granular_id.evaluation.compare import compare
from granular_id.statistics import holm

NAMES = ("raw", "hfmh", "raw+hfmh", "dft")


def some_accuracies(n=20, seed=0):
    rng = np.random.default_rng(seed)
    return {name: rng.integers(100, 110, n) / 132 + 0.02 * k for k, name in enumerate(NAMES)}


def test_every_pair_with_the_same_figures_as_scipy():
    shares = some_accuracies()
    comparison = compare(NAMES, shares, n_train=550, n_test=132, protocol="paper")
    assert [(p.first, p.second) for p in comparison.pairs] == list(combinations(NAMES, 2))
    for pair in comparison.pairs:
        d = shares[pair.first] - shares[pair.second]
        scale = math.sqrt((1 / 20 + 132 / 550) * d.var(ddof=1))
        student = stats.t(19, d.mean(), scale)
        assert pair.difference == pytest.approx(d.mean())
        assert pair.corrected_p == pytest.approx(2 * stats.t.sf(abs(d.mean()) / scale, 19))
        assert (pair.worse, pair.better) == pytest.approx((student.cdf(-0.01), student.sf(0.01)))
        assert pair.equivalent == pytest.approx(student.cdf(0.01) - student.cdf(-0.01))
        untied = stats.mannwhitneyu(shares[pair.first], shares[pair.second]).pvalue
        assert pair.mann_whitney_p == pytest.approx(untied)
    adjusted = holm([p.corrected_p for p in comparison.pairs]).tolist()
    assert [p.holm_p for p in comparison.pairs] == adjusted
    assert comparison.means["dft"] == pytest.approx(shares["dft"].mean())
    low, high = comparison.intervals["raw"]
    reach = stats.t.ppf(0.975, 19) * math.sqrt((1 / 20 + 132 / 550) * shares["raw"].var(ddof=1))
    assert (low, high) == pytest.approx((shares["raw"].mean() - reach, shares["raw"].mean() + reach))


def test_a_pair_can_be_asked_for_in_either_direction():
    comparison = compare(NAMES, some_accuracies(), 550, 132)
    forth, back = comparison.pair("raw", "dft"), comparison.pair("dft", "raw")
    assert (back.first, back.second, back.difference) == ("dft", "raw", -forth.difference)
    assert (back.worse, back.equivalent, back.better) == (forth.better, forth.equivalent, forth.worse)
    assert (back.corrected_p, back.holm_p) == (forth.corrected_p, forth.holm_p)


def test_partitions_of_different_size_count_by_their_mean():
    shares = some_accuracies(4)
    uneven = compare(NAMES, shares, [40, 40, 41, 41], [11, 11, 10, 10])
    assert uneven.pairs == compare(NAMES, shares, 40.5, 10.5).pairs


def test_table_marks_mann_whitney_and_explains_each_column():
    comparison = compare(NAMES, some_accuracies(), 550, 132, drawn="random partitions")
    for words in (
        "on the same 20 partitions (random partitions)",
        "U test‡",
        "‡ Mann-Whitney, as in the paper: far too small",
        "Nadeau & Bengio 2003",
        "adjusted for 6 pairs",
        "equal (within 1 %)",
    ):
        assert words in str(comparison)
    of_one = comparison.table("dft").rows
    assert [row[:2] for row in of_one] == [("dft", "raw"), ("dft", "hfmh"), ("dft", "raw+hfmh")]
    assert all(row[2].startswith("+") for row in of_one)


@pytest.mark.parametrize(("n", "words"), [(1, "one partition"), (2, "two partitions")])
def test_halves_in_time_give_differences_and_say_why_nothing_else(n, words):
    comparison = compare(["raw", "dft"], some_accuracies(n), 340, 342, protocol="chronological")
    (pair,) = comparison.pairs
    assert not comparison.testable
    assert math.isfinite(pair.difference)
    figures = ("mann_whitney_p", "corrected_p", "holm_p", "worse", "equivalent", "better")
    assert all(math.isnan(getattr(pair, name)) for name in figures)
    assert all(map(math.isnan, comparison.intervals["raw"]))
    assert comparison.table().header == ("first", "second", "points")
    assert f"{words}: too few for p-values" in str(comparison)


def test_a_constant_difference_is_said_to_be_beyond_a_test():
    shares = {"a": np.linspace(0.5, 0.6, 5), "b": np.linspace(0.6, 0.7, 5), "c": np.linspace(0.5, 0.6, 5)}
    comparison = compare(["a", "b", "c"], shares, 40, 10)
    assert math.isnan(comparison.pair("a", "b").corrected_p)
    assert comparison.pair("a", "c").corrected_p == 1.0
    assert comparison.pair("a", "c").equivalent == 1.0
    assert comparison.why_not.startswith("a and b, b and c: the same difference in every partition")
    row = next(row for row in comparison.table().rows if row[:2] == ("a", "b"))
    assert row[4:] == ("-",) * 5


def test_to_dict_is_json_with_none_for_what_cannot_be_said():
    content = compare(["raw", "dft"], some_accuracies(2), 10, 10).to_dict()
    again = json.loads(json.dumps(content, allow_nan=False))
    assert again == content
    assert again["pairs"][0]["corrected_p"] is None
    assert again["intervals"]["raw"] == [None, None]


def test_what_cannot_be_compared_is_refused():
    with pytest.raises(ValueError, match="names must hold at least 2 methods"):
        compare(["raw"], some_accuracies(), 550, 132)
    comparison = compare(NAMES, some_accuracies(), 550, 132)
    for names in (("raw", "none"), ("raw", "raw")):
        with pytest.raises(
            ValueError, match=r"first and second must be two of 'raw', 'hfmh', 'raw\+hfmh', 'dft'"
        ):
            comparison.pair(*names)
    with pytest.raises(ValueError, match=r"of must be one of .*, got 'none'"):
        comparison.table("none")
