"""RICA: what it minimises beside the formula, golden ends, starts, options, refusals."""

import joblib
import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.optimize import check_grad
from sklearn.exceptions import ConvergenceWarning
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from threadpoolctl import threadpool_info, threadpool_limits

from granular_id._parallel import single_threaded_blas
from granular_id.rica import CONTRASTS, RICA, Objective, _early_end

# Two known local ends of rica in MATLAB on these rows; random starts reach 192.709, 192.738, 194.717, 198.068.
GOLDEN_ROWS = np.mod(np.arange(1, 61) * 7, 13).reshape(12, 5, order="F") - 6.0
GOLDEN_START = np.mod(np.arange(1, 16) * 3, 7).reshape(5, 3, order="F") - 3.0


# --- What is minimised


FORMULAS = {
    "logcosh": lambda z: 0.5 * (np.logaddexp(2 * z, -2 * z) - np.log(2)),
    "exp": lambda z: -np.exp(-(z**2) / 2),
    "sqrt": lambda z: np.sqrt(z**2 + 1e-8),
}


def written_out(rows, units, *, alpha, contrast, signs):
    residual = rows @ units @ units.T - rows
    return alpha * np.sum(residual**2) + np.sum(FORMULAS[contrast](rows @ units) * signs)


def unit_columns(random, n_features, n_components):
    columns = random.normal(size=(n_features, n_components))
    return columns / np.linalg.norm(columns, axis=0)


def test_golden_start():
    objective = Objective(GOLDEN_ROWS, alpha=1.0, contrast="logcosh", signs=np.ones(3))
    units = GOLDEN_START / np.linalg.norm(GOLDEN_START, axis=0)
    assert objective(units)[0] == pytest.approx(607.675284, abs=5e-7)


@pytest.mark.parametrize("contrast", CONTRASTS)
@given(
    n_rows=st.integers(1, 30),
    n_features=st.integers(1, 12),
    n_components=st.integers(1, 15),
    alpha=st.floats(0, 100),
    scale=st.sampled_from([1e-3, 1.0, 1e3]),
    seed=st.integers(0, 1000),
)
def test_equals_the_formula(contrast, n_rows, n_features, n_components, alpha, scale, seed):
    """Few rows and many, few components and more than features: the fast forms and the residual agree."""
    random = np.random.default_rng(seed)
    rows = scale * random.normal(size=(n_rows, n_features))
    units = unit_columns(random, n_features, n_components)
    signs = random.choice([-1.0, 1.0], n_components)
    options = {"alpha": alpha, "contrast": contrast, "signs": signs}
    before = rows.copy()
    value, _ = Objective(rows, **options)(units)
    np.testing.assert_array_equal(rows, before)
    # What may be lost is measured against the terms that cancel, not against their difference.
    terms = 1 + alpha * np.sum(rows**2) * n_components + np.abs(rows @ units).sum()
    assert abs(value - written_out(rows, units, **options)) <= 1e-13 * n_rows * terms


@pytest.mark.parametrize("contrast", CONTRASTS)
@pytest.mark.parametrize(
    ("n_rows", "n_features", "n_components"), [(20, 6, 4), (5, 9, 4), (20, 3, 7), (1, 1, 1)]
)
def test_gradient_is_that_of_the_value(contrast, n_rows, n_features, n_components):
    random = np.random.default_rng(3)
    rows = random.normal(size=(n_rows, n_features))
    signs = random.choice([-1.0, 1.0], n_components)
    objective = Objective(rows, alpha=0.7, contrast=contrast, signs=signs)
    shape = (n_features, n_components)
    error = check_grad(
        lambda flat: objective(flat.reshape(shape))[0],
        lambda flat: objective(flat.reshape(shape))[1].ravel(),
        unit_columns(random, *shape).ravel(),
    )
    assert error < 2e-5 * n_rows


def logcosh(projections):
    slopes = projections.copy()
    return CONTRASTS["logcosh"](slopes, np.empty_like(slopes)), slopes


def test_logcosh_neither_overflows_nor_loses_small_values():
    projections = np.array([[-1e300], [1e3], [-0.1], [0.0], [1e-4]])
    values, slopes = logcosh(projections)
    assert values[0] == pytest.approx(1e300)
    np.testing.assert_allclose(slopes[:, 0], np.tanh(2 * projections[:, 0]), rtol=1e-11)
    formula = FORMULAS["logcosh"](projections[1:]).sum()
    assert logcosh(projections[1:])[0][0] == pytest.approx(formula, rel=1e-12)
    # Thousands of factors between 1 and 2 would overflow as one product.
    many = np.random.default_rng(0).normal(scale=0.01, size=(5001, 2))
    np.testing.assert_allclose(logcosh(many)[0], FORMULAS["logcosh"](many).sum(axis=0), rtol=1e-9)


# --- The estimator


def sources(n_rows=2000, seed=0):
    """Three independent signals with long tails, and an orthogonal mixing."""
    random = np.random.default_rng(seed)
    mixing = np.linalg.qr(random.normal(size=(3, 3)))[0]
    return random.laplace(size=(n_rows, 3)) @ mixing, mixing


def fitted(*arguments, **options):
    return RICA(*arguments, **{"random_state": 0, **options}).fit(GOLDEN_ROWS)


def test_golden_end():
    rica = RICA(3, init=GOLDEN_START.T, tol=1e-10).fit(GOLDEN_ROWS)
    assert rica.objective_ == pytest.approx(194.5156, abs=5e-5)
    assert rica.converged_


def test_random_starts_end_in_known_minima():
    rica = fitted(3, n_init=40, tol=1e-10)
    for known in (192.709, 194.717, 198.068):
        assert np.abs(rica.objectives_ - known).min() < 1e-3
    assert rica.objectives_.min() == rica.objective_ == pytest.approx(192.709, abs=1e-3)


def test_start_k_is_the_same_however_many_there_are():
    np.testing.assert_array_equal(fitted(3, n_init=4).objectives_, fitted(3, n_init=9).objectives_[:4])


@pytest.mark.parametrize("backend", ["threading", "loky"])  # starts share memory: threads in both
def test_jobs_change_nothing(backend):
    alone = fitted(4, n_init=5)
    with joblib.parallel_config(backend=backend, n_jobs=2):
        together = fitted(4, n_init=5)
    np.testing.assert_array_equal(alone.components_, together.components_)
    np.testing.assert_array_equal(alone.objectives_, together.objectives_)


@pytest.mark.thread_unsafe(reason="sets the threads of BLAS")
@pytest.mark.parametrize("n_threads", [1, 2])
def test_threads_of_blas_change_nothing(n_threads):
    rows = np.random.default_rng(0).laplace(size=(500, 60))
    with threadpool_limits(n_threads, user_api="blas"):
        rica = RICA(40, random_state=1, tol=1e-3).fit(rows)
    with single_threaded_blas():
        alone = RICA(40, random_state=1, tol=1e-3).fit(rows)
    np.testing.assert_array_equal(rica.components_, alone.components_)


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


def test_finds_mixed_sources():
    rows, mixing = sources()
    rica = RICA(3, random_state=0).fit(rows)
    found = np.abs(rica.components_ @ mixing.T)
    np.testing.assert_allclose(found.max(axis=0), 1, atol=0.02)
    assert rica.converged_


def test_non_gaussianity_seeks_flat_signals():
    random = np.random.default_rng(0)
    rows = np.column_stack([random.uniform(-2, 2, 3000), random.laplace(size=3000)])
    for sign, source in ((-1, 0), (1, 1)):
        rica = RICA(1, alpha=0, non_gaussianity=[sign], random_state=0)
        assert np.abs(rica.fit(rows / rows.std(axis=0)).components_[0, source]) > 0.95
    both = RICA(2, non_gaussianity=[-1, 1], random_state=0).fit(rows / rows.std(axis=0))
    assert np.abs(np.diag(both.components_)).min() > 0.95
    np.testing.assert_array_equal(
        fitted(3, non_gaussianity=-1).components_, fitted(3, non_gaussianity=[-1] * 3).components_
    )


@pytest.mark.parametrize("contrast", ["logcosh", "exp", "sqrt"])
def test_components_are_unit_rows_and_transform_projects(contrast):
    rica = fitted(3, contrast=contrast)
    np.testing.assert_allclose(np.linalg.norm(rica.components_, axis=1), 1, rtol=1e-12)
    np.testing.assert_allclose(rica.transform(GOLDEN_ROWS), GOLDEN_ROWS @ rica.components_.T)
    formula = written_out(GOLDEN_ROWS, rica.components_.T, alpha=1.0, contrast=contrast, signs=np.ones(3))
    assert rica.objective_ == pytest.approx(formula, rel=1e-9)


def test_more_components_than_features_and_fewer_rows():
    assert fitted(8).components_.shape == (8, 5)
    assert fitted(8).transform(GOLDEN_ROWS[:2]).shape == (2, 8)
    assert fitted().components_.shape == (5, 5)
    wide = np.random.default_rng(0).normal(size=(6, 40))
    components = RICA(3, random_state=0).fit(wide).components_
    # What the rows do not span can only cost: the components stay within it.
    _, _, span = np.linalg.svd(wide, full_matrices=False)
    np.testing.assert_allclose(components @ span.T @ span, components, atol=0.02)


def test_standardize_equals_scaling_first():
    rows, _ = sources(200)
    rows = rows * [1e-3, 1.0, 1e4] + [5.0, -2.0, 1e5]
    inside = RICA(2, standardize=True, random_state=0).fit(rows)
    outside = make_pipeline(StandardScaler(), RICA(2, random_state=0)).fit(rows)
    np.testing.assert_allclose(inside.transform(rows), outside.transform(rows), rtol=1e-6, atol=1e-9)
    assert inside.objective_ == pytest.approx(outside[-1].objective_)


def test_constant_features():
    with_constant = np.insert(sources(200)[0], 1, 7.5, axis=1)
    scaled = RICA(3, standardize=True, random_state=0).fit(with_constant)
    np.testing.assert_array_equal((with_constant - scaled.mean_)[:, 1] / scaled.scale_[1], 0)
    assert np.isfinite(scaled.transform(with_constant)).all()
    # Not centred without standardize: the constant is a signal like any other.
    for rows in (with_constant, np.ones((5, 3))):
        assert np.isfinite(RICA(3, random_state=0).fit(rows).objective_)


# At 1e60 rounding ends the search on some processors.
@pytest.mark.filterwarnings("ignore:RICA stopped:sklearn.exceptions.ConvergenceWarning")
@pytest.mark.parametrize("scale", [1e-6, 1e6, 1e60])
def test_scale_of_the_input_does_no_harm(scale):
    rica = RICA(3, random_state=0).fit(sources()[0] * scale)
    assert np.isfinite(rica.components_).all()
    assert np.isfinite(rica.objective_)
    np.testing.assert_allclose(np.linalg.norm(rica.components_, axis=1), 1)


def test_why_the_search_ended():
    with pytest.warns(ConvergenceWarning, match=r"reached max_iter \(2\)"):
        rica = fitted(3, max_iter=2)
    assert (rica.converged_, rica.n_iter_) == (False, 2)
    assert fitted(3).converged_  # in silence: pytest makes errors of warnings
    assert fitted(3, tol=1e-2).n_iter_ < fitted(3, tol=1e-9).n_iter_
    assert fitted(3, tol=0, gtol=10).n_iter_ < fitted(3, tol=0, gtol=1e-3).n_iter_
    # Whether rounding ends a search before tol = 0 does depends on the machine.
    assert "after 70 iterations where rounding hides any descent" in _early_end(70, status=2)


def test_names_are_numbered():
    assert list(fitted(3).get_feature_names_out()) == ["rica00", "rica01", "rica02"]
    assert list(fitted(101).get_feature_names_out())[::50] == ["rica000", "rica050", "rica100"]


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"n_components": 0}, ValueError, "n_components must be at least 1, got 0"),
        ({"n_init": True}, TypeError, "n_init must be a whole number, got True"),
        ({"alpha": -1.0}, ValueError, "alpha must not be negative, got -1"),
        ({"alpha": 10**400}, ValueError, "alpha must be finite, got inf"),
        ({"tol": float("inf")}, ValueError, "tol must be finite, got inf"),
        ({"gtol": "small"}, TypeError, "gtol must be a number, got 'small'"),
        ({"contrast": "cube"}, ValueError, "contrast must be one of 'logcosh', 'exp', 'sqrt', got 'cube'"),
        ({"standardize": "yes"}, TypeError, "standardize must be True or False, got 'yes'"),
        ({"non_gaussianity": [1, 0, 1]}, ValueError, "non_gaussianity must hold 1 and -1 only"),
        ({"non_gaussianity": [1, -1]}, ValueError, "non_gaussianity must be one number or 3"),
        ({"init": np.ones((5, 3))}, ValueError, r"init must have shape \(3, 5\).*got \(5, 3\)"),
        ({"init": np.zeros((3, 5))}, ValueError, "init must hold finite vectors, none of them zero"),
        ({"init": np.ones((3, 5)), "n_init": 2}, ValueError, "n_init must be 1 where init says"),
        ({"init": "here"}, ValueError, "init must be an array of numbers"),
    ],
)
def test_bad_parameters(options, error, message):
    with pytest.raises(error, match=message):
        RICA(**{"n_components": 3, **options}).fit(GOLDEN_ROWS)


@pytest.mark.parametrize(
    ("rows", "standardize", "message"),
    [
        (np.where(np.eye(12, 5) > 0, np.nan, GOLDEN_ROWS), False, "Input X contains NaN"),
        (GOLDEN_ROWS[0], False, "Expected 2D array"),
        (np.zeros((4, 3)), False, r"every feature is zero \(n_samples = 4\)"),
        (np.ones((5, 3)), True, r"every feature is constant \(n_samples = 5\)"),
        (GOLDEN_ROWS * 1e100, False, r"X is too large \(up to 6e\+100\)"),
        (GOLDEN_ROWS * 1e200, True, "X is too large to standardize"),
    ],
)
def test_bad_rows(rows, standardize, message):
    with pytest.raises(ValueError, match=message):
        RICA(2, standardize=standardize).fit(rows)
