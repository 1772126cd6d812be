"""Whitening within classes, against a plain eigendecomposition of the covariance."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from sklearn.svm import SVC

from granular_id.spaces import WithinClassWhitening
from granular_id.spaces.scaling import whitened_grams


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
    np.testing.assert_allclose(
        whitening.transform(new), new @ A, rtol=1e-6, atol=1e-7 * np.abs(new @ A).max()
    )
    assert len(whitening.components_) <= min(n - 3, n_columns)
    # Scalar products alone give the same, but for the factor.
    gram, cross = whitened_grams(X @ X.T, new @ X.T, y, shrinkage)
    plain = whitening.ridge_ * (X @ A) @ (X @ A).T
    np.testing.assert_allclose(gram, plain, rtol=1e-6, atol=1e-7 * np.abs(plain).max())
    np.testing.assert_allclose(
        cross, whitening.ridge_ * (new @ A) @ (X @ A).T, rtol=1e-6, atol=1e-7 * np.abs(plain).max()
    )


def test_weights_fold_by_the_same_transformation():
    X, y = labelled(40, 12)
    whitening = WithinClassWhitening(1e-2).fit(X, y)
    machine = SVC(kernel="linear").fit(whitening.transform(X), y)
    folded = whitening.transform(machine.coef_)
    np.testing.assert_allclose(X @ folded.T, whitening.transform(X) @ machine.coef_.T, rtol=1e-9, atol=1e-9)


def test_columns_without_variance_and_the_order_of_rows_change_nothing():
    X, y = labelled(30, 6)
    whitening = WithinClassWhitening(1e-2).fit(X, y)
    wider = np.hstack([X, np.full((30, 50), 3.0)])
    np.testing.assert_allclose(
        WithinClassWhitening(1e-2).fit(wider, y).transform(wider)[:, :6], whitening.transform(X), rtol=1e-8
    )
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


def test_labels_that_are_no_classes():
    X, _ = labelled(9, 3)
    with pytest.raises(ValueError, match="Unknown label type"):
        WithinClassWhitening().fit(X, np.linspace(0, 1, 9))
