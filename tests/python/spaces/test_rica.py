"""RICA: what it minimises beside the formula, golden ends, refusals."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.optimize import check_grad
from sklearn.exceptions import ConvergenceWarning
from threadpoolctl import threadpool_limits

from granular_id._parallel import single_threaded_blas
from granular_id.rica import RICA, descend, objective

# A known local end of rica in MATLAB on these rows; random starts reach 192.709, 192.738, 194.717, 198.068.
GOLDEN_ROWS = np.mod(np.arange(1, 61) * 7, 13).reshape(12, 5, order="F") - 6.0
GOLDEN_START = np.mod(np.arange(1, 16) * 3, 7).reshape(5, 3, order="F") - 3.0


def at(rows, units, alpha):
    return objective(rows, rows.T @ rows, units, alpha)


def unit_columns(random, n_features, n_components):
    columns = random.normal(size=(n_features, n_components))
    return columns / np.linalg.norm(columns, axis=0)


def test_golden_start_and_end_are_matlabs():
    units = GOLDEN_START / np.linalg.norm(GOLDEN_START, axis=0)
    assert at(GOLDEN_ROWS, units, 1.0)[0] == pytest.approx(607.675284, abs=5e-7)
    end = descend(GOLDEN_ROWS, GOLDEN_START, 1.0, 1000, tolerance=1e-10)
    assert end.fun == pytest.approx(194.5156, abs=5e-5)


@given(
    n_rows=st.integers(1, 30),
    n_features=st.integers(1, 12),
    n_components=st.integers(1, 15),
    alpha=st.floats(0, 100),
    scale=st.sampled_from([1e-3, 1.0, 1e3]),
    seed=st.integers(0, 1000),
)
def test_objective_equals_the_formula(n_rows, n_features, n_components, alpha, scale, seed):
    random = np.random.default_rng(seed)
    rows = scale * random.normal(size=(n_rows, n_features))
    units = unit_columns(random, n_features, n_components)
    residual = rows @ units @ units.T - rows
    contrast = 0.5 * (np.logaddexp(2 * rows @ units, -2 * rows @ units) - np.log(2))
    expected = alpha * np.sum(residual**2) + contrast.sum()
    # Sums over X' X round in proportion to the norm of X, those of the contrast to their number.
    rounding = 1e-13 * (alpha * np.sum(rows**2) + n_rows * n_components)
    assert at(rows, units, alpha)[0] == pytest.approx(expected, rel=1e-9, abs=rounding)


@pytest.mark.parametrize(
    ("n_rows", "n_features", "n_components"), [(20, 6, 4), (5, 9, 4), (20, 3, 7), (1, 1, 1)]
)
def test_gradient_is_that_of_the_value(n_rows, n_features, n_components):
    random = np.random.default_rng(3)
    rows = random.normal(size=(n_rows, n_features))
    shape = (n_features, n_components)
    error = check_grad(
        lambda flat: at(rows, flat.reshape(shape), 0.7)[0],
        lambda flat: at(rows, flat.reshape(shape), 0.7)[1].ravel(),
        unit_columns(random, *shape).ravel(),
    )
    assert error < 2e-5 * n_rows


@pytest.mark.thread_unsafe(reason="sets the threads of BLAS")
@pytest.mark.parametrize("n_threads", [1, 2])
def test_threads_of_blas_change_nothing(n_threads):
    rows = np.random.default_rng(0).laplace(size=(100, 60))
    rica = RICA(40, random_state=1, max_iter=5)
    with pytest.warns(ConvergenceWarning), threadpool_limits(n_threads, user_api="blas"):
        components = rica.fit(rows).components_
    with pytest.warns(ConvergenceWarning), single_threaded_blas():
        np.testing.assert_array_equal(components, rica.fit(rows).components_)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_components_are_unit_rows_that_transform_projects_on(scale):
    rica = RICA(3, random_state=0).fit(GOLDEN_ROWS * scale)
    np.testing.assert_allclose(np.linalg.norm(rica.components_, axis=1), 1, rtol=1e-12)
    np.testing.assert_array_equal(rica.transform(GOLDEN_ROWS), GOLDEN_ROWS @ rica.components_.T)


def test_search_cut_short_warns():
    with pytest.warns(ConvergenceWarning, match=r"reached max_iter \(2\)"):
        assert RICA(3, max_iter=2, random_state=0).fit(GOLDEN_ROWS).n_iter_ == 2


def test_names_are_numbered():
    names = RICA(101, random_state=0).fit(GOLDEN_ROWS).get_feature_names_out()
    assert list(names)[::50] == ["rica000", "rica050", "rica100"]
