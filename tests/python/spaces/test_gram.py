"""Scalar products, and learners trained on them."""

import tracemalloc

import numpy as np
import pytest

from granular_id import gram as gram_module
from granular_id.ecoc import ECOCClassifier, Task, onevsone
from granular_id.ecoc.learners import fit_dual
from granular_id.gram import linear_gram


def rows(n=30, n_columns=700, seed=0):
    return np.random.default_rng(seed).normal(size=(n, n_columns))


@pytest.mark.parametrize("block_bytes", [1, 30_000, 10**9])
def test_products_in_blocks_of_any_size(monkeypatch, block_bytes):
    monkeypatch.setattr(gram_module, "_BLOCK_BYTES", block_bytes)
    X, Y = rows(), rows(17, seed=1)
    for center in (None, X.mean(axis=0)):
        moved_x, moved_y = (rows - (0 if center is None else center) for rows in (X, Y))
        close = {"rtol": 1e-12, "atol": 1e-11}
        np.testing.assert_allclose(linear_gram(X, center=center), moved_x @ moved_x.T, **close)
        np.testing.assert_allclose(linear_gram(X, Y, center=center), moved_x @ moved_y.T, **close)


def test_symmetric_to_the_last_bit():
    gram = linear_gram(rows(61, 3000))
    np.testing.assert_array_equal(gram, gram.T)


def test_makes_no_copy_of_the_rows():
    X = rows(50, 40_000)
    tracemalloc.start()
    try:
        linear_gram(X, center=X[0])
        assert tracemalloc.get_traced_memory()[1] < 0.25 * X.nbytes
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"X": [1.0, 2.0]}, r"X must have shape \(n >= 1, D >= 1\), got shape \(2,\)"),
        ({"X": np.zeros((0, 3))}, r"got shape \(0, 3\)"),
        ({"Y": np.zeros((2, 4))}, "Y must have 3 columns as X has, got 4"),
        ({"center": np.zeros(2)}, r"center must have shape \(3,\), got shape \(2,\)"),
        ({"X": [[1.0, np.nan]]}, "no NaN, no inf"),
        ({"X": [[1e200, 1e200]]}, "range of float64"),
    ],
)
def test_bad_input(arguments, message):
    with pytest.raises(ValueError, match=message):
        linear_gram(**{"X": np.zeros((2, 3)), **arguments})


def fitted(gram, index, matrix):
    return fit_dual(gram, Task.of(matrix, index, None, range(len(matrix))), cost=1.0)


def test_learners_of_any_coding_matrix():
    X = rows(60, 5)
    index = np.arange(60) % 4
    matrix = np.array([[1, 1], [1, -1], [-1, 0], [-1, -1]], dtype=np.int8)
    learned = fitted(linear_gram(X), index, matrix)
    assert learned.dual_coef.shape == (2, 60)
    assert (learned.dual_coef[1, index == 2] == 0).all()
    for learner in range(2):
        seen = matrix[index, learner] != 0
        binary = fitted(linear_gram(X[seen]), (matrix[index[seen], learner] < 0).astype(int), onevsone(2))
        np.testing.assert_allclose(
            learned.scores(linear_gram(X))[:, learner],
            binary.scores(linear_gram(X, X[seen]))[:, 0],
            atol=1e-9,
        )


def test_pairs_from_one_call_of_libsvm_and_from_one_each_are_the_same_learners():
    gram, index = linear_gram(rows(48, 300)), np.arange(48) % 3
    at_once, one_by_one = fitted(gram, index, onevsone(3)), fitted(gram, index, onevsone(3)[:, ::-1])
    np.testing.assert_allclose(at_once.dual_coef, one_by_one.dual_coef[::-1], rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(at_once.intercept, one_by_one.intercept[::-1], rtol=1e-8, atol=1e-10)
    assert at_once.alpha_at_bound == one_by_one.alpha_at_bound


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sample_weight": [1, 0, 1, 0, 1, 0]}, "y holds one class only"),
        ({"sample_weight": [1, 1]}, r"sample_weight must have shape \(6,\), one per row, got shape \(2,\)"),
        ({"gram": np.ones((6, 5))}, r"gram must be square, .* got shape \(6, 5\)"),
        ({"gram": np.arange(36.0).reshape(6, 6)}, "gram must be symmetric"),
    ],
)
def test_bad_input_to_fit_gram(change, message):
    with pytest.raises(ValueError, match=message):
        ECOCClassifier().fit_gram(**({"gram": linear_gram(rows(6, 9)), "y": [0, 1, 0, 1, 0, 1]} | change))
