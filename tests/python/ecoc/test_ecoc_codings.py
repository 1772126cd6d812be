"""Coding matrices: every design against its definition, own matrices, refusals."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from granular_id.ecoc import codings
from granular_id.ecoc.codings import (
    CODINGS,
    best_random,
    check_coding_matrix,
    design,
    own_coding,
    smallest_distance,
)

# Learners for K = 2..11, written out by hand from the formulas.
COUNTS = {
    "onevsone": [1, 3, 6, 10, 15, 21, 28, 36, 45, 55],
    "onevsall": [2, 3, 4, 5, 6, 7, 8, 9, 10, 11],
    "ordinal": [1, 2, 3, 4, 5, 6, 7, 8, 9, 10],
    "binarycomplete": [1, 3, 7, 15, 31, 63, 127, 255, 511, 1023],
    "ternarycomplete": [1, 6, 25, 90, 301, 966, 3025, 9330, 28501, 86526],
    # 10 log2 K and 15 log2 K rounded up; below as many as there are different columns.
    "denserandom": [1, 3, 7, 15, 26, 29, 30, 32, 34, 35],
    "sparserandom": [1, 6, 25, 35, 39, 43, 45, 48, 50, 52],
}


def seeded(seed=0):
    return np.random.default_rng(seed)


def all_columns(n_classes, codes):
    """Every column with both signs, once for the two that differ in sign only; plain and slow."""
    both = [c for c in itertools.product(codes, repeat=n_classes) if 1 in c and -1 in c]
    return {max(column, tuple(-m for m in column)) for column in both}


def up_to_sign(matrix):
    columns = {tuple(column) for column in matrix.T.tolist()}
    return {max(column, tuple(-m for m in column)) for column in columns}


def plain_distance(matrix):
    """Smallest half sum of |m_al| |m_bl| |m_al - m_bl| over pairs of rows."""
    wide = matrix.astype(int)
    return min(
        sum(abs(p) * abs(q) * abs(p - q) for p, q in zip(a, b, strict=True)) / 2
        for a, b in itertools.combinations(wide.tolist(), 2)
    )


@pytest.mark.usefixtures("few_draws")
@pytest.mark.parametrize("name", CODINGS)
def test_number_of_learners(name):
    for n_classes, n_learners in enumerate(COUNTS[name][:8], start=2):
        matrix = design(name, n_classes, seeded())
        assert matrix.shape == (n_classes, n_learners)
        assert matrix.dtype == np.int8
        np.testing.assert_array_equal(check_coding_matrix(matrix), matrix)
        if (name, n_classes) != ("onevsall", 2):  # two classes: each against all others is the same twice
            assert len(up_to_sign(matrix)) == n_learners
    for n_classes, n_learners in enumerate(COUNTS[name], start=2):
        assert CODINGS[name].n_learners(n_classes) == n_learners


@pytest.mark.parametrize("n_classes", [2, 3, 4, 7])
def test_simple_designs(n_classes):
    pairs = design("onevsone", n_classes, seeded())
    for learner, (low, high) in enumerate(itertools.combinations(range(n_classes), 2)):
        expected = np.zeros(n_classes)
        expected[low], expected[high] = 1, -1
        np.testing.assert_array_equal(pairs[:, learner], expected)
    for a, b in itertools.product(range(n_classes), repeat=2):
        assert design("onevsall", n_classes, seeded())[a, b] == (1 if a == b else -1)
    for k, cut in itertools.product(range(n_classes), range(n_classes - 1)):
        assert design("ordinal", n_classes, seeded())[k, cut] == (1 if k > cut else -1)


@pytest.mark.parametrize(("name", "codes"), [("binarycomplete", (1, -1)), ("ternarycomplete", (1, 0, -1))])
@pytest.mark.parametrize("n_classes", [2, 3, 5])
def test_complete_designs_hold_every_column_once(n_classes, name, codes):
    assert up_to_sign(design(name, n_classes, seeded())) == all_columns(n_classes, codes)


@pytest.mark.usefixtures("few_draws")
@settings(max_examples=40)
@given(st.integers(2, 14), st.integers(0, 2**32), st.sampled_from(["denserandom", "sparserandom"]))
def test_random_columns_are_usable_and_different(n_classes, seed, name):
    matrix = design(name, n_classes, seeded(seed))
    np.testing.assert_array_equal(matrix, design(name, n_classes, seeded(seed)))
    assert set(np.unique(matrix)) <= ({-1, 1} if name == "denserandom" else {-1, 0, 1})
    # Own matrices with a column of one sign, or columns that are alike, would be refused.
    np.testing.assert_array_equal(own_coding(matrix, n_classes), matrix)


class TestRandomDesigns:
    @pytest.mark.parametrize("zeros", [False, True])
    def test_entries_have_their_probabilities(self, monkeypatch, zeros):
        monkeypatch.setattr(codings, "_DRAWS", 1)
        entries = np.concatenate([best_random(30, 50, seeded(s), zeros=zeros).ravel() for s in range(40)])
        shares = [np.mean(entries == m) for m in (-1, 0, 1)]
        np.testing.assert_allclose(shares, [0.25, 0.5, 0.25] if zeros else [0.5, 0, 0.5], atol=0.01)

    @pytest.mark.parametrize("zeros", [False, True])
    def test_distance_is_that_of_the_closest_rows(self, zeros):
        drawn = seeded(1).choice([-1, 0, 1] if zeros else [-1, 1], size=(20, 13, 6)).astype(np.int8)
        np.testing.assert_array_equal(smallest_distance(drawn), [plain_distance(one.T) for one in drawn])

    def test_more_draws_find_rows_farther_apart(self, monkeypatch):
        assert codings._DRAWS == 10_000
        best = plain_distance(design("denserandom", 11, seeded()))
        monkeypatch.setattr(codings, "_DRAWS", 1)
        single = [plain_distance(design("denserandom", 11, seeded(seed))) for seed in range(50)]
        assert best > max(single)

    @pytest.mark.parametrize("block", [1, 10_000, 10**9])
    def test_the_best_of_all_blocks_is_kept(self, monkeypatch, block):
        monkeypatch.setattr(codings, "_DRAWS", 40)
        monkeypatch.setattr(codings, "_BLOCK_ENTRIES", block)
        seen = []

        def watched(columns):
            seen.extend(smallest_distance(columns).tolist())
            return np.array(seen[-len(columns) :])

        monkeypatch.setattr(codings, "smallest_distance", watched)
        matrix = design("denserandom", 11, seeded())
        assert len(seen) == 40
        assert plain_distance(matrix) == max(seen)


@pytest.mark.parametrize(
    ("name", "n_classes", "message"),
    [
        *((name, 1, "n_classes must be at least 2, got 1") for name in CODINGS),
        ("ternarycomplete", 12, r"\(3\^K - 2\^\(K\+1\) \+ 1\) / 2 = 261,625 learners for K = 12 classes"),
        ("binarycomplete", 18, r"2\^\(K-1\) - 1 = 131,071 learners for K = 18 classes, more than 100,000"),
        ("binarycomplete", 200, r"= 8.03e\+59 learners for K = 200 classes, .*'denserandom' needs 77"),
        ("onevsone", 448, "= 100,128 learners for K = 448"),
        ("binarycomplete", 20_000, "learners for K = 20000"),
    ],
)
def test_too_few_classes_and_too_many_learners(name, n_classes, message):
    with pytest.raises(ValueError, match=message):
        design(name, n_classes, seeded())


@pytest.mark.parametrize(
    ("matrix", "kind", "message"),
    [
        (None, TypeError, "coding must be the name of a design or a matrix of -1, 0 and .1, got None"),
        ([["a", "b"]], TypeError, "name of a design or a matrix"),
        ([[1, [2]], [1]], TypeError, "name of a design or a matrix"),
        ("votes", ValueError, "coding must be one of 'onevsone', .*, got 'votes'"),
        ([1, -1, 0], ValueError, r"shape \(n_classes >= 2, n_learners >= 1\), got shape \(3,\)"),
        (np.zeros((3, 0)), ValueError, r"got shape \(3, 0\)"),
        ([[1, 2], [-1, -1], [0, 1]], ValueError, r"-1, 0 and \+1 only"),
        ([[1, np.nan], [-1, -1], [0, 1]], ValueError, r"-1, 0 and \+1 only"),
        ([[1, 1], [-1, 0], [-1, 0]], ValueError, "column 1 must hold both"),
        ([[1], [-1], [0]], ValueError, "row 2 is all 0"),
        ([[1], [-1]], ValueError, r"coding must have 3 rows, one per class, got shape \(2, 1\)"),
        ([[1, 1], [1, 1], [-1, -1]], ValueError, "rows 0 and 1 are alike: .* never told apart"),
        ([[1, 1, 1], [-1, 0, -1], [0, -1, 0]], ValueError, "columns 0 and 2 are alike"),
        ([[1, 1, -1], [-1, 0, 1], [0, -1, 0]], ValueError, "columns 0 and 2 are alike: .* but for the sign"),
    ],
)
def test_bad_own_coding(matrix, kind, message):
    with pytest.raises(kind, match=message):
        design(matrix, 3, seeded())


def test_own_coding_is_kept():
    given_codes = [[1, 0.0], [-1, 1], [-1, -1]]
    matrix = design(given_codes, 3, seeded())
    assert matrix.dtype == np.int8
    np.testing.assert_array_equal(matrix, given_codes)
