"""Scores of rows by learners that have not seen them."""

import numpy as np

from granular_id.ecoc import Task, onevsone
from granular_id.ecoc.posterior import KEPT, N_FOLDS, cross_fitted, folds_of
from posterior_cases import blobs


class TestFolds:
    NAMES = ("a", "b", "c")

    def folds(self, X, y, seed=0, counted=None):
        counted = np.arange(len(y)) if counted is None else counted
        return folds_of(X, Task(onevsone(3), y, None, counted, self.NAMES), seed)

    def test_classes_are_dealt_out_evenly(self):
        X, y = blobs(n_classes=3, per_class=13)
        folds = self.folds(X, y)
        for k in range(3):
            assert set(np.bincount(folds[y == k], minlength=N_FOLDS)) == {2, 3}
        assert set(np.bincount(folds)) == {7, 8}
        assert (folds != self.folds(X, y, seed=1)).any()

    def test_order_of_the_rows_does_not_matter(self):
        X, y = blobs(n_classes=3)
        order = np.random.default_rng(0).permutation(len(y))
        np.testing.assert_array_equal(self.folds(X[order], y[order]), self.folds(X, y)[order])

    def test_equal_rows_of_a_class_stay_together(self):
        X, y = blobs(n_classes=3, per_class=6)
        times = np.random.default_rng(0).integers(1, 4, len(y))
        repeated = self.folds(np.repeat(X, times, axis=0), np.repeat(y, times))
        np.testing.assert_array_equal(repeated, np.repeat(self.folds(X, y), times))

    def test_rows_that_do_not_count_are_as_good_as_absent(self):
        X, y = blobs(n_classes=3, per_class=6)
        counted = np.flatnonzero(np.arange(len(y)) % 4)
        folds = self.folds(X, y, counted=counted)
        np.testing.assert_array_equal(folds[counted], self.folds(X[counted], y[counted]))
        assert (np.delete(folds, counted) == -1).all()

    def test_every_row_is_scored_by_learners_that_do_not_know_it(self):
        folds = np.array([0, 1, 2, 0, -1, KEPT, 1])
        known = {}

        def fit_and_score(train, test):
            for row in test.tolist():
                known[row] = set(train.tolist())
            return np.full((len(test), 2), 7.0)

        scores = cross_fitted(fit_and_score, folds, 2)
        assert known == {0: {1, 2, 5, 6}, 3: {1, 2, 5, 6}, 1: {0, 2, 3, 5}, 6: {0, 2, 3, 5}} | {
            2: {0, 1, 3, 5, 6},
            5: {0, 1, 2, 3, 5, 6},  # the one row of its class
        }
        np.testing.assert_array_equal(scores, np.where(folds >= 0, 7.0, 0.0)[:, None] * np.ones(2))
