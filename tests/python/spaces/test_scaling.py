"""Blocks of one weight, against scikit-learn's scaler; whitening within classes, against an eigendecomposition."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import assume, given, settings, strategies as st
from sklearn.base import clone
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from granular_id.spaces import BestClassifier, BlockScaler, WithinClassWhitening, learns
from granular_id.spaces.scaling import whitened_grams

# --- BlockScaler


def rows(n=20, n_columns=7, seed=0):
    rng = np.random.default_rng(seed)
    units = 10.0 ** rng.integers(-6, 6, n_columns)
    return rng.normal(size=(n, n_columns)) * units + rng.normal(size=n_columns)


@given(n=st.integers(2, 30), first=st.integers(1, 6), second=st.integers(1, 6), seed=st.integers(0, 99))
def test_equal_to_a_standard_scaler_with_blocks_of_one_norm(n, first, second, seed):
    X = rows(n, first + second, seed)
    assume((X.std(axis=0) > 1e-9 * np.abs(X).max(axis=0)).all())  # else a column counts as constant
    scaled = BlockScaler([first, second]).fit_transform(X)
    weights = np.repeat([(2 * first) ** -0.5, (2 * second) ** -0.5], [first, second])
    np.testing.assert_allclose(scaled, StandardScaler().fit_transform(X) * weights, rtol=1e-9, atol=1e-12)
    squares = scaled**2
    np.testing.assert_allclose(squares[:, :first].sum(axis=1).mean(), 0.5)
    np.testing.assert_allclose(squares.sum(axis=1).mean(), 1.0)


def test_scaler_leaves_a_constant_column_out():
    X = rows(10, 5)
    X[:, 1] = 1e6 + np.arange(10) % 2 * 1e-6
    X[:, 4] = -3.0
    scaler = BlockScaler({"left": 3, "right": 1, "still": 1}).fit(X)
    assert scaler.factor_[[1, 4]].tolist() == [0.0, 0.0]
    squares = (scaler.transform(X) ** 2).mean(axis=0)
    np.testing.assert_allclose(squares, [0.25, 0.0, 0.25, 0.5, 0.0])
    # A column that moves only later is still not listened to.
    later = X.copy()
    later[:, 4] = 100.0
    np.testing.assert_array_equal(scaler.transform(later), scaler.transform(X))


def test_all_rows_equal_give_zeros():
    assert not BlockScaler().fit_transform(np.full((3, 4), 0.1)).any()
    assert not BlockScaler().fit_transform([[1.0, 2.0]]).any()


def test_names_of_blocks_and_pandas_output():
    X = pd.DataFrame(rows(6, 3), columns=["a", "b", "c"])
    scaler = BlockScaler({"ab": 2, "c": 1}).set_output(transform="pandas").fit(X)
    assert scaler.transform(X).columns.tolist() == ["a", "b", "c"]
    assert scaler.block_slices_ == {"ab": slice(0, 2), "c": slice(2, 3)}
    assert list(BlockScaler((1, 2)).fit(X).block_slices_) == ["block0", "block1"]
    assert learns(make_pipeline(clone(scaler)))


@pytest.mark.parametrize(
    ("blocks", "kind", "message"),
    [
        ([3, 3], ValueError, r"add up to the 7 columns of X, got 6 \(block0 3, block1 3\)"),
        ({}, ValueError, "add up to the 7 columns of X, got 0"),
        ([7, 0], ValueError, "must be at least 1, got 0"),
        ([3.5, 3.5], TypeError, "must be a whole number"),
        ({1: 7}, TypeError, "got the name 1"),
        ("7", TypeError, "blocks must be None"),
        (7, TypeError, "blocks must be None"),
    ],
)
def test_blocks_that_do_not_fit(blocks, kind, message):
    with pytest.raises(kind, match=message):
        BlockScaler(blocks).fit(rows())


def test_beyond_float64():
    with pytest.raises(ValueError, match="spread is in the range of float64"):
        BlockScaler().fit([[1e308], [-1e308], [1e308]])
    with pytest.raises(ValueError, match="in reach of the training rows"):
        BlockScaler().fit([[0.0], [1e-20]]).transform([[1e300]])


@pytest.mark.parametrize("kind", [BlockScaler, BestClassifier])
def test_the_text_keeps_the_order_of_blocks(kind):
    sizes = {"spectrum": 192, "coupling": 624, "b" * 40: 1, "a" * 40: 2}
    for estimator in (kind(blocks=sizes), kind().set_params(blocks=sizes)):
        again = eval(repr(estimator))
        assert list(again.blocks.items()) == list(clone(estimator).blocks.items()) == list(sizes.items())
        within = repr(make_pipeline(estimator))
        assert within.index("spectrum") < within.index("coupling") < within.index("bbb") < within.index("aaa")


# --- WithinClassWhitening


def twin(X, y, shrinkage):
    """(S + ridge I)^(-1/2) as a matrix."""
    within = X - np.array([X[y == label].mean(axis=0) for label in y])
    S = within.T @ within / len(X)
    values, vectors = np.linalg.eigh(S + shrinkage * np.trace(S) * np.eye(X.shape[1]))
    return (vectors * values**-0.5) @ vectors.T


def labelled(n, n_columns, seed=0, n_classes=3):
    rng = np.random.default_rng(seed)
    y = np.arange(n) % n_classes
    mix = rng.normal(size=(n_columns, n_columns)) * 3.0 ** -np.arange(n_columns)
    return rng.normal(size=(n, n_columns)) @ mix + y[:, None] * 0.1 + 5.0, y


@given(
    n=st.integers(5, 30),
    n_columns=st.integers(1, 40),
    shrinkage=st.sampled_from([1e-4, 1e-2, 1.0]),
    seed=st.integers(0, 99),
)
@settings(max_examples=40)
def test_equal_to_the_inverse_square_root(n, n_columns, shrinkage, seed):
    X, y = labelled(n, n_columns, seed)
    A = twin(X, y, shrinkage)
    whitening = WithinClassWhitening(shrinkage).fit(X, y)
    new = X[:3] + 1.0
    expected = new @ A
    np.testing.assert_allclose(whitening.transform(new), expected, 1e-6, 1e-7 * np.abs(expected).max())
    assert len(whitening.components_) <= min(n - 3, n_columns)
    # Scalar products alone give the same, but for the factor.
    gram, cross = whitened_grams(X @ X.T, new @ X.T, y, shrinkage)
    plain = whitening.ridge_ * (X @ A) @ (X @ A).T
    largest = np.abs(plain).max()
    np.testing.assert_allclose(gram, plain, rtol=1e-6, atol=1e-7 * largest)
    crossed = whitening.ridge_ * expected @ (X @ A).T
    np.testing.assert_allclose(cross, crossed, rtol=1e-6, atol=1e-7 * largest)


def test_whitening_ignores_constant_columns_and_row_order():
    X, y = labelled(30, 6)
    whitening = WithinClassWhitening(1e-2).fit(X, y)
    wide = np.hstack([X, np.full((30, 50), 3.0)])
    wider = WithinClassWhitening(1e-2).fit(wide, y)
    np.testing.assert_allclose(wider.transform(wide)[:, :6], whitening.transform(X), rtol=1e-8)
    order = np.random.default_rng(0).permutation(30)
    shuffled = WithinClassWhitening(1e-2).fit(X[order], y[order])
    np.testing.assert_allclose(shuffled.transform(X), whitening.transform(X), rtol=1e-8)


@pytest.mark.parametrize("offset", [0.0, 1e6])
def test_rows_that_do_not_vary_within_classes_stay_as_they_are(offset):
    X = np.random.default_rng(0).normal(size=(4, 3)) + offset
    alone = WithinClassWhitening().fit(X, list("abcd"))
    np.testing.assert_array_equal(alone.transform(X), X)
    twice = np.repeat(X, 3, axis=0)
    repeated = WithinClassWhitening().fit(twice, np.repeat(list("abcd"), 3))
    np.testing.assert_array_equal(repeated.transform(X), X)
    assert repeated.ridge_ == 0.0
    assert repeated.components_.shape == (0, 3)
    gram = X @ X.T
    got, cross = whitened_grams(gram, gram[:2], np.arange(4), 1e-3)
    np.testing.assert_array_equal(got, gram)
    np.testing.assert_array_equal(cross, gram[:2])


@pytest.mark.parametrize(
    ("shrinkage", "kind"), [(0, ValueError), (-1.0, ValueError), (np.nan, ValueError), ("a", TypeError)]
)
def test_shrinkage_out_of_range(shrinkage, kind):
    with pytest.raises(kind, match="shrinkage must be"):
        WithinClassWhitening(shrinkage).fit(*labelled(9, 3))
    with pytest.raises(ValueError, match="Unknown label type"):
        WithinClassWhitening().fit(labelled(9, 3)[0], np.linspace(0, 1, 9))
