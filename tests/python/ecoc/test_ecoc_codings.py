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


@pytest.mark.parametrize("n_classes", [2, 3, 7])
def test_designs_are_those_of_their_names(n_classes):
    pairs = list(itertools.combinations(range(n_classes), 2))
    expected = np.zeros((n_classes, len(pairs)), np.int8)
    for learner, (low, high) in enumerate(pairs):
        expected[low, learner], expected[high, learner] = 1, -1
    np.testing.assert_array_equal(design("onevsone", n_classes), expected, strict=True)
    expected = 2 * np.eye(n_classes, dtype=np.int8) - 1
    np.testing.assert_array_equal(design("onevsall", n_classes), expected.astype(np.int8), strict=True)


def test_too_many_pairs_are_refused():
    with pytest.raises(ValueError, match=r"='onevsone' needs 100,128 learners .* 'onevsall' needs 448"):
        design("onevsone", 448)
    assert design("onevsall", 448).shape == (448, 448)


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        ([["a", "b"]], "must be an array of numbers"),
        ([[1, [2]], [1]], "must be an array of numbers"),
        (None, r"must have 3 rows, .* got shape \(\)"),
        ("votes", "must be one of 'onevsone', 'onevsall', got 'votes'"),
        (np.zeros((3, 0)), r"must have 3 rows, one per class, and a column per learner, got shape \(3, 0\)"),
        ([[1], [-1]], r"must have 3 rows, one per class, .* got shape \(2, 1\)"),
        ([[1, 2], [-1, -1], [0, 1]], r"must hold -1, 0 and \+1 only"),
        ([[1, np.nan], [-1, -1], [0, 1]], r"must hold -1, 0 and \+1 only"),
        ([[1, 1], [-1, 0], [-1, 0]], "column 1 must hold both"),
        ([[1], [-1], [0]], "row 2 is all 0"),
        ([[1, 1], [1, 1], [-1, -1]], "row 1 is like one before: these classes are never told apart"),
        ([[1, 1, -1], [-1, 0, 1], [0, -1, 0]], "column 2 is like one before: .* but for the sign"),
    ],
)
def test_coding_that_does_not_fit_is_refused(matrix, message):
    with pytest.raises(ValueError, match=f"coding {message}"):
        design(matrix, 3)


def test_own_coding_is_stored():
    own = [[1, 0.0], [-1, 1], [-1, -1]]
    np.testing.assert_array_equal(design(own, 3), np.array(own, np.int8), strict=True)


@pytest.mark.parametrize("name", LOSSES)
def test_losses_are_their_definitions_and_never_rise(name):
    agreements = np.concatenate([-np.logspace(6, -3, 400), [0.0], np.logspace(-3, 6, 400)])
    loss = LOSSES[name](agreements)
    expected = [DEFINITIONS[name](z) for z in agreements]
    np.testing.assert_allclose(loss, expected, rtol=1e-13, atol=1e-14)
    assert loss[400] == 0.5  # where the score says nothing
    assert (np.diff(loss) <= 0).all()
    assert (np.diff(loss[:400]) < 0).all()  # no ties among wrong answers, however wrong


@pytest.mark.parametrize("matrix", [onevsone(9), MATRIX])
@pytest.mark.parametrize("name", LOSSES)
def test_decode_adds_losses_in_the_order_of_the_learners(matrix, name):
    rng = np.random.default_rng(5)
    shape = (20, matrix.shape[1])
    scores = 10.0 ** rng.uniform(-8, 8, shape) * rng.choice([-1, 1], shape)
    expected = np.zeros((20, len(matrix)))
    for i, k in np.ndindex(expected.shape):
        total = 0.0
        for m, s in zip(matrix[k].tolist(), scores[i].tolist(), strict=True):
            if m != 0:
                total += DEFINITIONS[name](m * s)
        expected[i, k] = -(total / np.count_nonzero(matrix[k]))
    np.testing.assert_array_equal(decode(scores, matrix, name), expected)


@settings(max_examples=30)
@given(
    n_classes=st.integers(2, 7),
    seed=st.integers(0, 1000),
    coding=st.sampled_from(sorted(CODINGS)),
    name=st.sampled_from(sorted(LOSSES)),
)
def test_row_alone_gives_the_bits_it_gives_in_a_batch(n_classes, seed, coding, name):
    matrix = design(coding, n_classes)
    scores = np.random.default_rng(seed).normal(scale=3.0, size=(17, matrix.shape[1]))
    rows = np.concatenate([decode(row[None], matrix, name) for row in scores])
    np.testing.assert_array_equal(rows, decode(scores, matrix, name))


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
    (value,) = decode(np.array([[0.3, -0.3, 0.3]]), onevsone(3))
    assert len(set(value)) == 1
