"""The learners are optimal, and depend on nothing but the rows: proved by the conditions of optimality."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from sklearn.exceptions import ConvergenceWarning
from sklearn.svm import SVC

from granular_id.ecoc import ECOCClassifier, svm
from granular_id.ecoc.svm import solve_binary
from granular_id.gram import linear_gram


def problem(seed, n_rows, n_features, distance=0.5):
    rng = np.random.default_rng(seed)
    targets = np.where(np.arange(n_rows) % 2 == 0, 1.0, -1.0)
    X = rng.standard_normal((n_rows, n_features)) + distance * targets[:, None]
    return X, targets


def worst_violation(gram, targets, upper, solution):
    """How far a solution is from optimal: in multipliers relative to the largest, in functional margins."""
    alpha = solution.dual_coef * targets
    tiny = 1e-9 * max(alpha.max(), 1e-300)
    margin = targets * (gram @ solution.dual_coef + solution.intercept)
    feasible = max(-alpha.min(), (alpha - upper).max(), abs(solution.dual_coef.sum())) / alpha.max()
    below, above = alpha < upper - tiny, alpha > tiny
    slack = max(np.max(1 - margin, where=below, initial=0.0), np.max(margin - 1, where=above, initial=0.0))
    return max(feasible, slack)


@settings(max_examples=60)
@given(
    seed=st.integers(0, 10_000),
    n_rows=st.integers(2, 40),
    n_features=st.integers(1, 60),
    distance=st.sampled_from([0.0, 0.2, 1.0]),
    C=st.sampled_from([1e-3, 1.0, 30.0]),
    scale=st.sampled_from([1e-6, 1.0, 1e8]),
    offset=st.sampled_from([0.0, 100.0]),
    weighted=st.booleans(),
)
def test_conditions_of_optimality(seed, n_rows, n_features, distance, C, scale, offset, weighted):
    X, targets = problem(seed, n_rows, n_features, distance)
    weights = np.random.default_rng(seed).uniform(0.1, 3.0, n_rows) if weighted else np.ones(n_rows)
    X = (X + offset) * scale
    gram = linear_gram(X)
    # The cost is in units of the rows: the same problem at each scale.
    upper = C * weights / scale**2
    assert worst_violation(gram, targets, upper, solve_binary(gram, targets, upper)) < 2e-5


@pytest.mark.parametrize("n_features", [3, 400])
def test_exact_where_libsvm_is_not(n_features):
    X, targets = problem(3, 60, n_features)
    gram = linear_gram(X)
    ours = solve_binary(gram, targets, np.ones(60))
    loose = SVC(kernel="precomputed").fit(gram, targets)
    assert worst_violation(gram, targets, np.ones(60), ours) < 1e-11
    np.testing.assert_allclose(
        gram @ ours.dual_coef + ours.intercept, loose.decision_function(gram), atol=5e-3
    )


def kinds_of_rows():
    rng = np.random.default_rng(11)
    y = np.repeat(np.arange(4), 15)
    noise = rng.standard_normal((60, 600))
    walk = np.cumsum(rng.standard_normal((60, 600)), axis=1) / 20
    shift = np.cumsum(rng.standard_normal((4, 600)), axis=1)[y] / 40
    return {"noise": (noise, y), "walk": (walk, y), "separate walk": (walk + shift, y)}


ROWS = kinds_of_rows()


@pytest.mark.parametrize("kind", ROWS)
def test_origin_order_and_offset_do_not_matter(kind):
    X, y = ROWS[kind]
    expected = ECOCClassifier().fit(X, y).binary_scores(X)
    close = {"rtol": 1e-6, "atol": 1e-8}
    order = np.random.default_rng(0).permutation(len(y))
    np.testing.assert_allclose(ECOCClassifier().fit(X[order], y[order]).binary_scores(X), expected, **close)
    for center in (None, X[0], X.mean(axis=0)):
        gram = linear_gram(X, center=center)
        scores = ECOCClassifier().fit_gram(gram, y).binary_scores_gram(gram)
        np.testing.assert_allclose(scores, expected, **close)
    for deviations in (10.0, 1e5):
        moved = X + deviations * X.std()
        scores = ECOCClassifier().fit(moved, y).binary_scores(moved)
        np.testing.assert_allclose(scores, expected, rtol=1e-5, atol=1e-6)


def test_a_class_whose_weights_are_all_zero_is_absent():
    X, y = ROWS["noise"]
    clf = ECOCClassifier().fit(X, y, sample_weight=(y != 1).astype(float))
    without = ECOCClassifier().fit(X[y != 1], y[y != 1])
    np.testing.assert_array_equal(clf.classes_, [0, 2, 3])
    np.testing.assert_allclose(clf.binary_scores(X), without.binary_scores(X), rtol=1e-7, atol=1e-9)


def test_share_of_multipliers_at_the_bound():
    X, y = ROWS["noise"]
    clf = ECOCClassifier(C=1e-6).fit(X, y)
    assert clf.alpha_at_bound_ == 1.0
    assert ECOCClassifier().fit(X, y).alpha_at_bound_ == 0.0


def test_equal_rows_of_both_classes_do_not_hang_nor_fail():
    clf = ECOCClassifier().fit(np.ones((6, 2)), [0, 0, 0, 0, 1, 1])
    np.testing.assert_array_equal(clf.predict(np.ones((2, 2))), [0, 0])


def test_repetitions_are_one_row_of_their_common_weight(monkeypatch):
    X, targets = problem(2, 40, 5, distance=0.4)
    times = np.random.default_rng(1).integers(1, 4, 40)
    again = np.repeat(np.arange(40), times)
    weighted = solve_binary(linear_gram(X), targets, times.astype(float))
    ones = np.ones(len(again))
    gram = linear_gram(X[again])
    repeated = solve_binary(gram, targets[again], ones)
    # The way out when libsvm's split of multipliers among equal rows leads to no exact solution.
    monkeypatch.setattr(svm, "_active_set_solution", first_call_fails(svm._active_set_solution))
    merged = solve_binary(gram, targets[again], ones)
    for solution in (repeated, merged):
        np.testing.assert_allclose(
            solution.dual_coef @ X[again], weighted.dual_coef @ X, rtol=1e-7, atol=1e-9
        )
        assert solution.intercept == pytest.approx(weighted.intercept, abs=1e-8)
    np.testing.assert_allclose(np.bincount(again, merged.dual_coef), weighted.dual_coef, rtol=1e-7, atol=1e-9)
    assert worst_violation(gram, targets[again], ones, merged) < 1e-8
    assert merged.at_bound == np.count_nonzero(np.abs(merged.dual_coef) >= 1 - 1e-12) > 0


def first_call_fails(solve):
    n_rows = []

    def of_fewer_rows_only(gram, *arguments):
        n_rows.append(len(gram))
        return None if len(gram) == n_rows[0] else solve(gram, *arguments)

    return of_fewer_rows_only


def test_giving_up_is_a_warning_that_names_the_classes(monkeypatch):
    monkeypatch.setattr(svm, "_MAX_STEPS", 2)
    monkeypatch.setattr(svm, "_MAX_STEPS_GUESS", 2)
    X, targets = problem(0, 60, 3, distance=0.1)
    with pytest.warns(ConvergenceWarning, match="'rice' against 'sand' did not converge"):
        ECOCClassifier().fit(X, np.where(targets > 0, "rice", "sand"))


def test_a_useless_guess_changes_nothing():
    X, targets = problem(1, 40, 80)
    gram = linear_gram(X)
    alone = solve_binary(gram, targets, np.ones(40))
    for guess in (np.zeros(40), np.ones(40), np.random.default_rng(0).uniform(size=40)):
        guided = solve_binary(gram, targets, np.ones(40), guess=guess)
        np.testing.assert_allclose(guided.dual_coef, alone.dual_coef, rtol=1e-9, atol=1e-12)


def test_the_tighter_tolerance_may_be_out_of_reach(monkeypatch):
    monkeypatch.setattr(svm, "_MAX_STEPS", 3000)
    X, targets = problem(13, 26, 5, distance=0.0)
    gram, upper = linear_gram(X), np.full(26, 3.0)
    solution = solve_binary(gram, targets, upper)
    assert solution.converged
    assert 1e-6 < worst_violation(gram, targets, upper, solution) < 1e-3
