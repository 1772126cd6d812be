"""RICA: what it minimises beside the formula, golden ends, refusals."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.optimize import check_grad
from sklearn.exceptions import ConvergenceWarning
from threadpoolctl import threadpool_info, threadpool_limits

from granular_id._parallel import single_threaded_blas
from granular_id.rica import RICA, descend, objective

# A known local end of rica in MATLAB on these rows; random starts reach 192.709, 192.738, 194.717, 198.068.
GOLDEN_ROWS = np.mod(np.arange(1, 61) * 7, 13).reshape(12, 5, order="F") - 6.0
GOLDEN_START = np.mod(np.arange(1, 16) * 3, 7).reshape(5, 3, order="F") - 3.0


def written_out(rows, units, alpha):
    residual = rows @ units @ units.T - rows
    contrast = 0.5 * (np.logaddexp(2 * rows @ units, -2 * rows @ units) - np.log(2))
    return alpha * np.sum(residual**2) + contrast.sum()


def unit_columns(random, n_features, n_components):
    columns = random.normal(size=(n_features, n_components))
    return columns / np.linalg.norm(columns, axis=0)


def test_golden_start_has_matlabs_objective():
    units = GOLDEN_START / np.linalg.norm(GOLDEN_START, axis=0)
    assert objective(GOLDEN_ROWS, units, 1.0)[0] == pytest.approx(607.675284, abs=5e-7)


def test_golden_start_ends_where_matlab_ends():
    end = descend(GOLDEN_ROWS, GOLDEN_START, 1.0, 1000, tolerance=1e-10)
    assert end.fun == pytest.approx(194.5156, abs=5e-5)


def test_random_starts_end_in_known_minima():
    ends = np.array([RICA(3, random_state=seed).fit(GOLDEN_ROWS).objective_ for seed in range(40)])
    for known in (192.709, 194.717, 198.068):
        assert np.abs(ends - known).min() < 1e-2
    assert ends.min() == pytest.approx(192.709, abs=1e-2)


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
    assert objective(rows, units, alpha)[0] == pytest.approx(written_out(rows, units, alpha), rel=1e-9)


@pytest.mark.parametrize(
    ("n_rows", "n_features", "n_components"), [(20, 6, 4), (5, 9, 4), (20, 3, 7), (1, 1, 1)]
)
def test_gradient_is_that_of_the_value(n_rows, n_features, n_components):
    random = np.random.default_rng(3)
    rows = random.normal(size=(n_rows, n_features))
    shape = (n_features, n_components)
    error = check_grad(
        lambda flat: objective(rows, flat.reshape(shape), 0.7)[0],
        lambda flat: objective(rows, flat.reshape(shape), 0.7)[1].ravel(),
        unit_columns(random, *shape).ravel(),
    )
    assert error < 2e-5 * n_rows


def test_mixed_sources_are_found():
    random = np.random.default_rng(0)
    mixing = np.linalg.qr(random.normal(size=(3, 3)))[0]
    rica = RICA(3, random_state=0).fit(random.laplace(size=(2000, 3)) @ mixing)
    np.testing.assert_allclose(np.abs(rica.components_ @ mixing.T).max(axis=0), 1, atol=0.02)


@pytest.mark.thread_unsafe(reason="sets the threads of BLAS")
@pytest.mark.parametrize("n_threads", [1, 2])
def test_threads_of_blas_change_nothing(n_threads):
    rows = np.random.default_rng(0).laplace(size=(100, 60))
    rica = RICA(40, random_state=1, max_iter=5)
    with pytest.warns(ConvergenceWarning), threadpool_limits(n_threads, user_api="blas"):
        components = rica.fit(rows).components_
    with pytest.warns(ConvergenceWarning), single_threaded_blas():
        np.testing.assert_array_equal(components, rica.fit(rows).components_)


@pytest.mark.thread_unsafe(reason="sets the threads of BLAS")
def test_one_thread_of_blas_ends_with_the_last_block():
    def threads():
        return [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]

    with threadpool_limits(2, user_api="blas"):
        before = threads()
        outer, inner = single_threaded_blas(), single_threaded_blas()
        outer.__enter__()
        inner.__enter__()
        outer.__exit__(None, None, None)
        assert set(threads()) == {1}
        inner.__exit__(None, None, None)
        assert threads() == before


@pytest.mark.filterwarnings("ignore:RICA reached max_iter:sklearn.exceptions.ConvergenceWarning")
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6, 1e60])
def test_components_are_unit_rows_and_transform_projects(scale):
    rica = RICA(8, random_state=0, max_iter=20).fit(GOLDEN_ROWS * scale)
    assert np.isfinite(rica.objective_)
    np.testing.assert_allclose(np.linalg.norm(rica.components_, axis=1), 1, rtol=1e-12)
    np.testing.assert_array_equal(rica.transform(GOLDEN_ROWS), GOLDEN_ROWS @ rica.components_.T)


def test_a_search_cut_short_warns():
    with pytest.warns(ConvergenceWarning, match=r"reached max_iter \(2\)"):
        assert RICA(3, max_iter=2, random_state=0).fit(GOLDEN_ROWS).n_iter_ == 2


def test_names_are_numbered():
    assert list(RICA(3).fit(GOLDEN_ROWS).get_feature_names_out()) == ["rica00", "rica01", "rica02"]
    names = RICA(101, random_state=0).fit(GOLDEN_ROWS).get_feature_names_out()
    assert list(names)[::50] == ["rica000", "rica050", "rica100"]


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"n_components": 0}, ValueError, "n_components must be at least 1, got 0"),
        ({"max_iter": True}, TypeError, "max_iter must be a whole number, got True"),
        ({"alpha": -1.0}, ValueError, "alpha must not be negative, got -1"),
        ({"alpha": 10**400}, ValueError, "alpha must be finite, got inf"),
    ],
)
def test_bad_parameters_are_refused(options, error, message):
    with pytest.raises(error, match=message):
        RICA(**{"n_components": 3, **options}).fit(GOLDEN_ROWS)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (np.where(np.eye(12, 5) > 0, np.nan, GOLDEN_ROWS), "Input X contains NaN"),
        (GOLDEN_ROWS[0], "Expected 2D array"),
        (np.zeros((4, 3)), r"every feature is zero \(n_samples = 4\)"),
        (GOLDEN_ROWS * 1e100, r"X is too large \(up to 6e\+100\)"),
    ],
)
def test_bad_rows_are_refused(rows, message):
    with pytest.raises(ValueError, match=message):
        RICA(2).fit(rows)
