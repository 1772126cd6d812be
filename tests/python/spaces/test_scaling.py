"""Blocks of one weight, against scikit-learn's scaler; whitening within classes, against an eigendecomposition."""

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st
from sklearn.decomposition import PCA
from sklearn.linear_model import RidgeClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from granular_id.ecoc import ECOCClassifier
from granular_id.rica import RICA
from granular_id.spaces import BlockScaler, RawSignal, WithinClassWhitening, folded_back
from granular_id.spaces.scaling import whitened_grams
from multiband_cases import two_materials


def rows(n=20, n_columns=7, seed=0):
    rng = np.random.default_rng(seed)
    units = 10.0 ** rng.integers(-6, 6, n_columns)
    return rng.normal(size=(n, n_columns)) * units + rng.normal(size=n_columns)


@given(n=st.integers(2, 30), first=st.integers(1, 6), second=st.integers(1, 6), seed=st.integers(0, 99))
def test_scaler_is_a_standard_scaler_with_equal_blocks(n, first, second, seed):
    X = rows(n, first + second, seed)
    assume((X.std(axis=0) > 1e-9 * np.abs(X).max(axis=0)).all())  # else a column counts as constant
    scaled = BlockScaler({"first": first, "second": second}).fit_transform(X)
    weights = np.repeat([(2 * first) ** -0.5, (2 * second) ** -0.5], [first, second])
    np.testing.assert_allclose(scaled, StandardScaler().fit_transform(X) * weights, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose((scaled**2)[:, :first].sum(axis=1).mean(), 0.5)


def test_scaler_leaves_a_constant_column_out():
    X = rows(10, 5)
    X[:, 1] = 1e6 + np.arange(10) % 2 * 1e-6
    X[:, 4] = -3.0
    scaler = BlockScaler({"left": 3, "right": 1, "still": 1}).fit(X)
    assert scaler.factor_[[1, 4]].tolist() == [0.0, 0.0]
    np.testing.assert_allclose((scaler.transform(X) ** 2).mean(axis=0), [0.25, 0.0, 0.25, 0.5, 0.0])
    later = X.copy()
    later[:, 4] = 100.0
    np.testing.assert_array_equal(scaler.transform(later), scaler.transform(X))
    assert not BlockScaler().fit_transform(np.full((3, 4), 0.1)).any()


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
def test_whitening_is_the_inverse_square_root(n, n_columns, shrinkage, seed):
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
    plain = WithinClassWhitening(1e-2).fit(X, y).transform(X)
    wide = np.hstack([X, np.full((30, 50), 3.0)])
    np.testing.assert_allclose(
        WithinClassWhitening(1e-2).fit(wide, y).transform(wide)[:, :6], plain, rtol=1e-8
    )
    order = np.random.default_rng(0).permutation(30)
    shuffled = WithinClassWhitening(1e-2).fit(X[order], y[order])
    np.testing.assert_allclose(shuffled.transform(X), plain, rtol=1e-8)


@pytest.mark.parametrize("offset", [0.0, 1e6])
def test_whitening_without_variance_changes_nothing(offset):
    X = np.random.default_rng(0).normal(size=(4, 3)) + offset
    for times in (1, 3):
        whitening = WithinClassWhitening().fit(np.repeat(X, times, axis=0), np.repeat(list("abcd"), times))
        np.testing.assert_array_equal(whitening.transform(X), X)
        assert whitening.ridge_ == 0.0
    gram = X @ X.T
    for got, plain in zip(whitened_grams(gram, gram[:2], np.arange(4), 1e-3), (gram, gram[:2]), strict=True):
        np.testing.assert_array_equal(got, plain)


@pytest.mark.parametrize(
    "steps",
    [
        (),
        (BlockScaler({"a": 100, "b": 92}),),
        (BlockScaler({"a": 100, "b": 92}), WithinClassWhitening(0.1)),
        (StandardScaler(with_std=False),),
        (StandardScaler(with_mean=False),),
        (StandardScaler(), PCA(8, whiten=True)),
        (PCA(8), RICA(6, random_state=0)),
    ],
    ids=str,
)
@pytest.mark.parametrize("classifier", [ECOCClassifier(), RidgeClassifier()])
def test_folded_weights_give_the_same_scores(steps, classifier):
    X, y, _ = two_materials(n_each=9, n_samples=32)
    y = np.where(np.arange(len(y)) % 3 == 0, "peas", y)
    X[y == "rice", :, 1] += 0.2
    X[y == "peas", :, 4] += 5.0
    model = make_pipeline(RawSignal(), *steps, classifier).fit(X, y)
    coef, intercept = folded_back(model[1:-1], model[-1].coef_, model[-1].intercept_)
    scores = getattr(model[-1], "binary_scores", model[-1].decision_function)
    plain, features = RawSignal().fit_transform(X), model[:-1].transform(X)
    np.testing.assert_allclose(plain @ coef.T + intercept, scores(features), atol=1e-9)
    one, constant = folded_back(model[1:-1], model[-1].coef_[1], model[-1].intercept_[1])
    np.testing.assert_allclose(one, coef[1])
    assert constant == pytest.approx(intercept[1])
