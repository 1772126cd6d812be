"""Every pair of methods on the same partitions, and how often each test is wrong."""

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


def compared(accuracies, n_train=550, n_test=132):
    """Compare on partitions of one size."""
    n = len(next(iter(accuracies.values())))
    return compare(accuracies, [n_train] * n, [n_test] * n, "random partitions")


def test_every_pair_with_the_same_figures_as_scipy():
    shares = some_accuracies()
    comparison = compared(shares)
    assert [(p.first, p.second) for p in comparison.pairs] == list(combinations(NAMES, 2))
    for pair in comparison.pairs:
        d = shares[pair.first] - shares[pair.second]
        scale = math.sqrt((1 / 20 + 132 / 550) * d.var(ddof=1))
        assert pair.difference == pytest.approx(d.mean())
        assert pair.corrected_p == pytest.approx(2 * stats.t.sf(abs(d.mean()) / scale, 19))
        untied = stats.mannwhitneyu(shares[pair.first], shares[pair.second]).pvalue
        assert pair.mann_whitney_p == pytest.approx(untied)
    adjusted = holm([p.corrected_p for p in comparison.pairs]).tolist()
    assert [p.holm_p for p in comparison.pairs] == adjusted


def test_partitions_of_different_size_count_by_their_mean():
    shares = some_accuracies(4)
    uneven = compare(shares, [40, 40, 41, 41], [11, 11, 10, 10], "random partitions")
    assert uneven.pairs == compared(shares, 40.5, 10.5).pairs


def test_table_marks_mann_whitney_and_explains_each_column():
    comparison = compared(some_accuracies())
    for words in (
        "on the same 20 partitions (random partitions)",
        "U test‡",
        "‡ Mann-Whitney, as in the paper: far too small",
        "Nadeau & Bengio 2003",
        "adjusted for 6 pairs",
    ):
        assert words in str(comparison)


def test_table_of_one_method_holds_it_against_each_other():
    comparison = compared(some_accuracies())
    of_one = comparison.table("dft").rows
    assert [row[:2] for row in of_one] == [("dft", "raw"), ("dft", "hfmh"), ("dft", "raw+hfmh")]
    assert all(row[2].startswith("+") for row in of_one)
    other = next(row for row in comparison.table().rows if row[:2] == ("raw", "dft"))
    assert (other[2].replace("-", "+"), other[3:]) == (of_one[0][2], of_one[0][3:])


@pytest.mark.parametrize(("n", "words"), [(1, "one partition"), (2, "two partitions")])
def test_halves_in_time_give_differences_and_say_why_nothing_else(n, words):
    comparison = compared({name: some_accuracies(n)[name] for name in ("raw", "dft")}, 340, 342)
    (pair,) = comparison.pairs
    assert math.isfinite(pair.difference)
    assert all(math.isnan(getattr(pair, name)) for name in ("mann_whitney_p", "corrected_p", "holm_p"))
    assert comparison.table().header == ("first", "second", "points")
    assert f"{words}: too few for p-values" in str(comparison)


def test_a_constant_difference_is_said_to_be_beyond_a_test():
    shares = {"a": np.linspace(0.5, 0.6, 5), "b": np.linspace(0.6, 0.7, 5), "c": np.linspace(0.5, 0.6, 5)}
    table = compared(shares, 40, 10).table()
    of_ab, of_ac, of_bc = table.rows
    assert of_ab[4:] == of_bc[4:] == ("-", "-")
    assert of_ac[4:] == ("1.000", "1.000")
    assert table.notes[-1].startswith("-: the same difference in every partition")


def test_what_cannot_be_compared_is_refused():
    with pytest.raises(ValueError, match="wanted at least 2 feature spaces to compare, got 'raw'"):
        compared({"raw": some_accuracies()["raw"]})
    with pytest.raises(ValueError, match=r"of must be one of .*, got 'none'"):
        compared(some_accuracies()).table("none")
