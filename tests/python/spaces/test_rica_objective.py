"""What RICA minimises, beside the formula written out, its differences, and MATLAB's numbers."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.optimize import check_grad

from granular_id.rica import CONTRASTS, Objective

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
    rows = np.mod(np.arange(1, 61) * 7, 13).reshape(12, 5, order="F") - 6.0
    start = np.mod(np.arange(1, 16) * 3, 7).reshape(5, 3, order="F") - 3.0
    objective = Objective(rows, alpha=1.0, contrast="logcosh", signs=np.ones(3))
    assert objective(start / np.linalg.norm(start, axis=0))[0] == pytest.approx(607.675284, abs=5e-7)


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
    value, _ = Objective(rows, **options)(units)
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


def evaluated(contrast, projections):
    slopes = projections.copy()
    return CONTRASTS[contrast](slopes, np.empty_like(slopes)), slopes


def test_logcosh_does_not_overflow_nor_lose_small_values():
    projections = np.array([[-1e300], [1e3], [-0.1], [0.0], [1e-4]])
    values, slopes = evaluated("logcosh", projections)
    assert values[0] == pytest.approx(1e300)
    np.testing.assert_allclose(slopes[:, 0], np.tanh(2 * projections[:, 0]), rtol=1e-11)
    small, _ = evaluated("logcosh", projections[1:])
    assert small[0] == pytest.approx(FORMULAS["logcosh"](projections[1:]).sum(), rel=1e-12)


def test_logcosh_over_many_rows():
    """Thousands of factors between 1 and 2 would overflow as one product."""
    projections = np.random.default_rng(0).normal(scale=0.01, size=(5001, 2))
    values, _ = evaluated("logcosh", projections)
    np.testing.assert_allclose(values, FORMULAS["logcosh"](projections).sum(axis=0), rtol=1e-9)


def test_rows_are_left_alone():
    rows = np.random.default_rng(0).normal(size=(9, 4))
    before = rows.copy()
    units = unit_columns(np.random.default_rng(1), 4, 2)
    Objective(rows, alpha=1.0, contrast="exp", signs=np.ones(2))(units)
    np.testing.assert_array_equal(rows, before)
