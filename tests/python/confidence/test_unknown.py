"""Refusal of unknown materials: the novelty score against its definition, and the share of known ones accepted."""

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest

from granular_id.confidence import Novelty, Parts, UnknownRule, held_out_parts, unknown_rule
from granular_id.confidence.novelty import blocks_in_time, limit, rotated, weights_of


def clouds(n_classes=4, n_each=40, n_features=6, seed=0, distance=4.0):
    rng = np.random.default_rng(seed)
    centres = distance * np.eye(n_features)[:n_classes]
    y = np.repeat(np.array(list("abcdef")[:n_classes]), n_each)
    return rng.normal(size=(len(y), n_features)) + np.repeat(centres, n_each, axis=0), y


def coded(**sizes):
    X, y = clouds(**sizes)
    return X, np.unique(y, return_inverse=True)[1]


def folds_of(codes, n_folds):
    fold = np.arange(len(codes)) % n_folds
    return [(np.flatnonzero(fold != k), np.flatnonzero(fold == k)) for k in range(n_folds)]


@pytest.mark.parametrize("n_features", [6, 300])
@pytest.mark.parametrize("n_named", [4, 2])
def test_novelty_follows_its_definition(n_features, n_named):
    s, codes = coded(n_features=n_features)
    means = np.array([s[codes == k].mean(axis=0) for k in range(4)])
    within = np.cov((s - means[codes]).T, bias=True)
    values, axes = np.linalg.eigh(within + 1e-3 * np.trace(within) * np.eye(n_features))
    A = (axes / np.sqrt(values)) @ axes.T
    V = np.linalg.svd((means - means.mean(axis=0)) @ A)[2][:3]
    new = np.random.default_rng(1).normal(size=(20, n_features))
    off = new[:, None] - means[None, :n_named]
    parts = Novelty.fit(s, codes, n_named).parts(new)
    np.testing.assert_allclose(parts.d, ((off @ A @ V.T) ** 2).sum(axis=2), rtol=1e-5)
    np.testing.assert_allclose(parts.e, (off**2).sum(axis=2), rtol=1e-5)
    np.testing.assert_allclose(parts.score((0.5, 2.0)), (0.5 * parts.d + 2 * parts.e).min(axis=1))


def test_novelty_of_rotated_rows_is_the_same():
    s, codes = coded(n_features=400)
    small = rotated(s)
    assert small.shape == (160, 160)
    both = (held_out_parts(x, codes, 4, folds_of(codes, 4)) for x in (s, small))
    for own, other in zip(*both, strict=True):
        np.testing.assert_allclose(own, other, rtol=1e-4)


def test_novelty_of_rows_without_spread_is_a_distance():
    s, codes = np.repeat(np.eye(3), 5, axis=0), np.repeat([0, 1, 2], 5)
    fitted = Novelty.fit(s, codes, 3)
    assert fitted.directions.shape == (2, 3)
    assert fitted.parts(s).d[0] == pytest.approx([0, 2, 2])
    rule = unknown_rule(("a", "b", "c"), held_out_parts(s, codes, 3, folds_of(codes, 5)), codes)
    assert (rule.weights, rule.threshold) == ((0.0, 0.0), 0.0)
    same = Novelty.fit(np.ones((6, 2)), np.repeat([0, 1], 3), 2)
    assert same.directions.shape == (0, 2)
    assert same.parts(np.ones((1, 2))).d.tolist() == [[0.0, 0.0]]


def test_weights_make_both_distances_alike():
    parts = Parts(np.array([[2.0, 9.0], [4.0, 9.0], [9.0, 6.0]]), np.full((3, 2), 0.6))
    assert weights_of(parts, np.array([0, 0, 1])) == pytest.approx((1 / 4, 0.3 / 0.6))


def parts_of(novelty):
    return Parts(np.array(novelty, dtype=float)[:, None], np.zeros((len(novelty), 1)))


@pytest.mark.parametrize(("n", "place"), [(3, 3), (18, 18), (19, 19), (39, 38), (100, 96)])
def test_limit_is_an_order_statistic_or_the_largest(n, place):
    assert limit(parts_of(np.arange(1, n + 1)), (1.0, 0.0), 0.95) == place


def test_limit_without_sessions_is_that_of_blocks_in_time():
    novelty, blocks = np.arange(80), np.repeat([3, 1, 0, 2], 20)
    assert limit(parts_of(novelty), (1.0, 0.0), 0.95, blocks=blocks) == 79
    many = np.repeat(np.arange(8), 10)  # the eighth of nine
    assert limit(parts_of(novelty), (1.0, 0.0), 0.95, blocks=many) == 79
    assert limit(parts_of(novelty[:70]), (1.0, 0.0), 0.5, blocks=many[:70]) == 65
    blocks = blocks_in_time(np.array([5, 0, 3, 2, 1, 4]), np.array([0, 0, 0, 0, 1, 1]))
    assert blocks.tolist() == [3, 0, 2, 1, 0, 2]


def test_limit_is_lowered_by_what_fewer_rows_cost():
    of_folds = parts_of(np.arange(101)), parts_of(2 * np.arange(101))
    assert limit(parts_of(np.arange(1, 101)), (1.0, 0.0), 0.95, of_folds=of_folds) == 48
    assert limit(parts_of([1.0]), (1.0, 0.0), 0.95, of_folds=(parts_of([0.0]), parts_of([0.0]))) == 1


def test_rows_that_no_fold_holds_out_set_no_limit():
    s, codes = coded()
    test = np.r_[0:20, 40:60]
    folds = [(np.setdiff1d(np.arange(160), test), test)]
    rule = unknown_rule(tuple("abcd"), held_out_parts(s, codes, 4, folds), codes)
    assert rule.n_calibration == 40


def test_class_that_trains_in_no_row_of_a_fold_is_far():
    s, codes = coded()
    folds = [(np.setdiff1d(np.flatnonzero(codes < 3), test), test) for _, test in folds_of(codes, 4)]
    parts = held_out_parts(s, codes, 4, folds)
    assert (parts.d[:, 3] > 1e90).all()
    three = held_out_parts(s, np.minimum(codes, 2), 3, [(train, test) for train, test in folds])
    np.testing.assert_array_equal(parts.score((1.0, 0.3)), three.score((1.0, 0.3)))


def test_one_row_alone_is_decided_as_in_the_batch():
    s, codes = coded()
    parts = held_out_parts(s, codes, 4, folds_of(codes, 5))
    rule = unknown_rule(tuple("abcd"), parts, codes)
    assert [rule.knows(Parts(d, e)) for d, e in zip(*parts, strict=True)] == rule.knows(parts).tolist()
    assert isinstance(rule.knows(Parts(parts.d[0], parts.e[0])), bool)
    assert UnknownRule.from_dict(json.loads(json.dumps(rule.to_dict(), allow_nan=False))) == rule
    assert pickle.loads(pickle.dumps(rule)) == rule


GOOD = UnknownRule(("a", "b"), (1.0, 0.5), 3.0, 0.95, 50)


def test_promise_says_where_rows_are_too_few():
    rule = replace(GOOD, held_out="held-out sessions", n_calibration=12)
    assert rule.promise == "refused, with 5 % of recordings of the known ones (only 12, 19 are needed)"
    assert GOOD.promise.endswith(", within the sessions of the training only")


DAMAGED = [{"format": ""}, {"threshold": "3"}, {"n_calibration": True}, {"weights": [0.0, None]}, {"more": 1}]


@pytest.mark.parametrize("change", DAMAGED)
def test_damaged_rule_is_refused(change):
    with pytest.raises((ValueError, TypeError), match=next(iter(change))):
        UnknownRule.from_dict({**GOOD.to_dict(), **change})


def test_share_outside_0_to_1_is_refused():
    with pytest.raises(ValueError, match="share_known must lie between 0 and 1"):
        unknown_rule(("a", "b"), Parts(np.ones((2, 2)), np.ones((2, 2))), np.array([0, 1]), share_known=0.0)
