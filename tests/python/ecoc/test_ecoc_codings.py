"""Coding matrices, binary losses and decoding against their definitions; own matrices, refusals."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from ecoc_cases import MATRIX
from granular_id.ecoc import CODINGS, LOSSES, decode, design, onevsone

# The definitions, in plain Python: one number at a time.
DEFINITIONS = {
    "hinge": lambda z: max(0.0, 1 - z) / 2,
    "root": lambda z: (1 + math.sqrt(-z)) / 2 if z < 0 else (1 - math.sqrt(min(1, z))) / 2,
}


@pytest.mark.parametrize("n_classes", [2, 3, 4, 7])
def test_designs_are_those_of_their_names(n_classes):
    pairs = list(itertools.combinations(range(n_classes), 2))
    matrix = design("onevsone", n_classes)
    assert (matrix.shape, matrix.dtype) == ((n_classes, len(pairs)), np.int8)
    for learner, (low, high) in enumerate(pairs):
        expected = np.zeros(n_classes)
        expected[low], expected[high] = 1, -1
        np.testing.assert_array_equal(matrix[:, learner], expected)
    matrix = design("onevsall", n_classes)
    assert (matrix.shape, matrix.dtype) == ((n_classes, n_classes), np.int8)
    np.testing.assert_array_equal(matrix, 2 * np.eye(n_classes) - 1)


def test_too_many_pairs_are_refused():
    with pytest.raises(ValueError, match=r"='onevsone' needs 100,128 learners .* 'onevsall' needs 448"):
        design("onevsone", 448)
    assert design("onevsall", 448).shape == (448, 448)


@pytest.mark.parametrize(
    ("matrix", "kind", "message"),
    [
        (None, TypeError, "coding must be the name of a design or a matrix of -1, 0 and .1, got None"),
        ([["a", "b"]], TypeError, "name of a design or a matrix"),
        ([[1, [2]], [1]], TypeError, "name of a design or a matrix"),
        ("votes", ValueError, "coding must be one of 'onevsone', 'onevsall', got 'votes'"),
        ([1, -1, 0], ValueError, r"must have 3 rows, one per class, and a column per .* got shape \(3,\)"),
        (np.zeros((3, 0)), ValueError, r"got shape \(3, 0\)"),
        ([[1, 2], [-1, -1], [0, 1]], ValueError, r"-1, 0 and \+1 only"),
        ([[1, np.nan], [-1, -1], [0, 1]], ValueError, r"-1, 0 and \+1 only"),
        ([[1, 1], [-1, 0], [-1, 0]], ValueError, "column 1 must hold both"),
        ([[1], [-1], [0]], ValueError, "row 2 is all 0"),
        ([[1], [-1]], ValueError, r"coding must have 3 rows, one per class, .* got shape \(2, 1\)"),
        ([[1, 1], [1, 1], [-1, -1]], ValueError, "rows 0 and 1 are alike: .* never told apart"),
        ([[1, 1, 1], [-1, 0, -1], [0, -1, 0]], ValueError, "columns 0 and 2 are alike"),
        ([[1, 1, -1], [-1, 0, 1], [0, -1, 0]], ValueError, "columns 0 and 2 are alike: .* but for the sign"),
    ],
)
def test_bad_own_coding(matrix, kind, message):
    with pytest.raises(kind, match=message):
        design(matrix, 3)


def test_own_coding_is_kept():
    given_codes = [[1, 0.0], [-1, 1], [-1, -1]]
    matrix = design(given_codes, 3)
    assert matrix.dtype == np.int8
    np.testing.assert_array_equal(matrix, given_codes)


def test_every_loss_has_a_definition_here():
    assert set(DEFINITIONS) == set(LOSSES)


@pytest.mark.parametrize("name", LOSSES)
def test_definition_and_half_where_the_score_says_nothing(name):
    agreements = np.concatenate([np.linspace(-8, 8, 161), [0.0, 1.0, -1.0, 300.0, -300.0]])
    expected = [DEFINITIONS[name](z) for z in agreements]
    np.testing.assert_allclose(LOSSES[name](agreements), expected, rtol=1e-13, atol=1e-14)
    assert LOSSES[name](np.zeros(1)) == pytest.approx(0.5, abs=1e-15)


@pytest.mark.parametrize("name", LOSSES)
def test_finite_and_never_rising_up_to_a_million(name):
    agreements = np.concatenate([-np.logspace(6, -3, 400), [0.0], np.logspace(-3, 6, 400)])
    loss = LOSSES[name](agreements)
    assert np.isfinite(loss).all()
    assert (np.diff(loss) <= 0).all()
    assert (np.diff(loss[:400]) < 0).all()  # no ties among wrong answers, however wrong


@pytest.mark.parametrize("name", LOSSES)
def test_decode_is_minus_the_mean_loss(name):
    matrix = np.array([[1, 1, 0, 1], [-1, 0, 1, 1], [0, -1, -1, 1], [1, -1, 0, -1]])
    scores = np.random.default_rng(0).normal(scale=3.0, size=(50, 4))
    expected = np.zeros((50, 4))
    for i, k in np.ndindex(50, 4):
        costs = [DEFINITIONS[name](m * s) for m, s in zip(matrix[k], scores[i], strict=True) if m != 0]
        expected[i, k] = -sum(costs) / len(costs)
    np.testing.assert_allclose(decode(scores, matrix, name), expected, rtol=1e-12)


@settings(max_examples=30)
@given(
    n_classes=st.integers(2, 7),
    seed=st.integers(0, 1000),
    coding=st.sampled_from(sorted(CODINGS)),
    name=st.sampled_from(sorted(LOSSES)),
)
def test_a_row_alone_gives_the_bits_it_gives_in_a_batch(n_classes, seed, coding, name):
    matrix = design(coding, n_classes)
    scores = np.random.default_rng(seed).normal(scale=3.0, size=(17, matrix.shape[1]))
    rows = np.concatenate([decode(row[None], matrix, name) for row in scores])
    np.testing.assert_array_equal(rows, decode(scores, matrix, name))


@pytest.mark.parametrize("matrix", [onevsone(9), MATRIX])
def test_losses_are_added_in_the_order_of_the_learners(matrix):
    rng = np.random.default_rng(5)
    shape = (20, matrix.shape[1])
    scores = 10.0 ** rng.uniform(-8, 8, shape) * rng.choice([-1, 1], shape)
    expected = np.zeros((20, len(matrix)))
    for i, k in np.ndindex(expected.shape):
        total = 0.0
        for m, s in zip(matrix[k].tolist(), scores[i].tolist(), strict=True):
            if m != 0:
                total += DEFINITIONS["hinge"](m * s)
        expected[i, k] = -(total / np.count_nonzero(matrix[k]))
    np.testing.assert_array_equal(decode(scores, matrix), expected)


def test_two_hundred_classes_decode_by_their_pairs():
    """More pairs than are decoded at once."""
    matrix = onevsone(200)
    truth = np.random.default_rng(0).integers(0, 200, 30)
    scores = 2.0 * matrix[truth] + np.random.default_rng(1).normal(scale=0.5, size=(30, 19_900))
    values = decode(scores, matrix)
    np.testing.assert_array_equal(values.argmax(axis=1), truth)
    seen = matrix[7] != 0
    expected = -np.maximum(0, 1 - matrix[7, seen] * scores[:, seen]).mean(axis=1) / 2
    np.testing.assert_allclose(values[:, 7], expected, rtol=1e-12)


def test_ties_are_exact_so_that_the_first_class_wins():
    # A circle: 0 beats 1, 1 beats 2, 2 beats 0, all by as much.
    value = decode(np.array([[0.3, -0.3, 0.3]]), onevsone(3))
    assert len(set(value[0])) == 1
    assert value.argmax() == 0


def test_decode_refuses_an_unknown_loss():
    with pytest.raises(ValueError, match="loss must be one of 'hinge', 'root', got 'votes'"):
        decode(np.zeros((1, 3)), onevsone(3), "votes")
