"""Principal components through scalar products, against those of scikit-learn."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from sklearn.decomposition import PCA
from sklearn.exceptions import NotFittedError

from granular_id.gram import linear_gram
from granular_id.spaces import PrincipalComponents


def walk(n, n_columns, seed=0):
    """Smooth rows about a large common offset, as raw recordings are."""
    rng = np.random.default_rng(seed)
    return np.cumsum(rng.normal(size=(n, n_columns)), axis=1) + 100.0


def same_up_to_sign(got, wanted):
    signs = np.sign((got * wanted).sum(axis=0))
    np.testing.assert_allclose(got * signs, wanted, rtol=0, atol=1e-8 * np.abs(wanted).max())


@given(
    n=st.integers(2, 30),
    n_columns=st.integers(1, 60),
    n_components=st.integers(1, 40),
    seed=st.integers(0, 99),
)
@settings(max_examples=40)
def test_equal_to_scikit_learn_up_to_sign(n, n_columns, n_components, seed):
    X, other = walk(n, n_columns, seed), walk(4, n_columns, seed + 1000)
    kept = min(n_components, n - 1, n_columns)
    ours = PrincipalComponents(n_components).fit(X)
    theirs = PCA(kept, svd_solver="full").fit(X)
    assert ours.n_components_ == kept
    same_up_to_sign(ours.transform(X), theirs.transform(X))
    signs = np.sign((ours.components_ * theirs.components_).sum(axis=1))
    np.testing.assert_allclose(ours.components_ * signs[:, None], theirs.components_, atol=1e-6)
    np.testing.assert_allclose(ours.transform(other) * signs, theirs.transform(other), rtol=1e-6, atol=1e-5)
    np.testing.assert_allclose(ours.mean_, theirs.mean_)
    for name in ("explained_variance_", "explained_variance_ratio_", "singular_values_"):
        own, wanted = getattr(ours, name), getattr(theirs, name)
        np.testing.assert_allclose(own, wanted, rtol=1e-8, atol=1e-14 * wanted[0], err_msg=name)


@given(n=st.integers(2, 30), n_columns=st.integers(1, 60), seed=st.integers(0, 99))
@settings(max_examples=40)
@pytest.mark.parametrize("origin", ["zero", "mean of all rows"])
def test_both_ways_give_the_same_scores_and_signs(origin, n, n_columns, seed):
    every = walk(n + 5, n_columns, seed)
    X, other = every[:n], every[n:]
    center = None if origin == "zero" else every.mean(axis=0)
    rows = PrincipalComponents(10).fit(X)
    products = PrincipalComponents(10).fit_gram(linear_gram(X, center=center))
    kept = products.n_components_
    assert kept == rows.n_components_
    scale = np.abs(rows.transform(X)).max()
    for one in (X, other):
        scores = products.transform_gram(linear_gram(one, X, center=center))
        np.testing.assert_allclose(scores, rows.transform(one), rtol=1e-6, atol=1e-6 * scale)
    # Products about a far origin lose the digits that the distance takes.
    variance = rows.explained_variance_
    np.testing.assert_allclose(products.explained_variance_, variance, rtol=1e-8, atol=1e-10 * variance[0])


def test_the_largest_score_of_each_component_is_positive():
    X = walk(20, 50)
    pca = PrincipalComponents(8).fit(X)
    scores = pca.transform(X)
    assert (scores[np.abs(scores).argmax(axis=0), np.arange(8)] > 0).all()
    two = PrincipalComponents().fit_transform([[1.0, 2.0], [3.0, 5.0]])  # both scores are equally large
    np.testing.assert_allclose(two, [[np.sqrt(13) / 2], [-np.sqrt(13) / 2]])


def test_no_more_components_than_the_rows_have():
    X = walk(3, 50)
    repeated = np.concatenate([X, X, X])
    pca = PrincipalComponents(100).fit(repeated)
    assert pca.n_components_ == 2
    assert pca.transform(repeated).shape == (9, 2)
    np.testing.assert_allclose(pca.explained_variance_ratio_.sum(), 1.0)
    assert PrincipalComponents(100).fit_gram(linear_gram(repeated)).n_components_ == 2
    four = PrincipalComponents().fit(walk(30, 4))
    assert four.get_feature_names_out().tolist() == ["pca_00", "pca_01", "pca_02", "pca_03"]


def test_an_offset_does_not_make_components():
    rng = np.random.default_rng(0)
    X = rng.normal(size=(12, 1)) @ rng.normal(size=(1, 30)) + 1e6
    assert PrincipalComponents().fit_gram(linear_gram(X)).n_components_ == 1


def test_products_that_are_symmetric_up_to_rounding_are_welcome():
    gram = linear_gram(walk(6, 20))
    gram[0, 1] *= 1 + 1e-15
    assert not np.array_equal(gram, gram.T)
    assert PrincipalComponents().fit_gram(gram).n_components_ == 5


@pytest.mark.parametrize("n_components", [0, 2.5, True, None])
def test_bad_number_of_components(n_components):
    pca = PrincipalComponents(n_components)
    for fit in (pca.fit, pca.fit_gram):
        with pytest.raises((TypeError, ValueError), match=f"n_components must be .* got {n_components}"):
            fit(np.eye(5))


@pytest.mark.parametrize(
    ("method", "given", "message"),
    [
        ("fit", np.full((6, 9), 0.1), "X must vary: all rows are equal"),
        ("fit", np.zeros((6, 9)), "X must vary: all rows are equal"),
        ("fit", [[1.0, np.nan], [2.0, 3.0]], "NaN"),
        ("fit", [[1.0, 2.0]], "1 sample"),
        ("fit", [[1e200, 0.0], [-1e200, 1.0]], "range of float64"),
        ("fit_gram", np.full((6, 6), 0.1), "X must vary: all rows are equal"),
        ("fit_gram", np.ones((2, 3)), r"gram must have shape \(n, n\) with n >= 2, got"),
        ("fit_gram", np.ones(4), r"gram must have shape \(n, n\)"),
        ("fit_gram", np.ones((1, 1)), r"gram must have shape \(n, n\)"),
        ("fit_gram", [[1.0, np.nan], [np.nan, 1.0]], "gram must be finite"),
        ("fit_gram", [[1.0, 0.5], [0.4, 1.0]], "gram must be symmetric: element"),
        ("transform_gram", np.ones((2, 3)), r"cross must have shape \(m, 4\)"),
        ("transform_gram", np.full((2, 4), np.inf), "cross must be finite"),
    ],
)
def test_bad_rows_and_products(method, given, message):
    pca = PrincipalComponents().fit_gram(np.eye(4))
    with pytest.raises(ValueError, match=message):
        getattr(pca, method)(given)


def test_what_was_fitted_on_products_knows_no_columns():
    X = walk(6, 9)
    pca = PrincipalComponents()
    for asked in (pca.transform, pca.transform_gram):
        with pytest.raises(NotFittedError):
            asked(X)
    pca.fit(X).fit_gram(X @ X.T)
    assert not hasattr(pca, "components_")
    with pytest.raises(ValueError, match="fitted on scalar products: use transform_gram"):
        pca.transform(X)
    assert len(pca.get_feature_names_out(["anything"])) == 5
    assert pca.learns
