"""Coding matrices, binary losses, decoding."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from granular_id.ecoc.coding import DECODINGS, LOSSES, check_coding_matrix, decode, onevsone


@pytest.mark.parametrize("n_classes", [2, 3, 4, 11])
def test_onevsone(n_classes):
    matrix = onevsone(n_classes)
    assert matrix.shape == (n_classes, n_classes * (n_classes - 1) // 2)
    learner = 0
    for low in range(n_classes):
        for high in range(low + 1, n_classes):
            expected = np.zeros(n_classes)
            expected[low], expected[high] = 1, -1
            np.testing.assert_array_equal(matrix[:, learner], expected)
            learner += 1
    np.testing.assert_array_equal(check_coding_matrix(matrix), matrix)


def test_onevsone_needs_two_classes():
    with pytest.raises(ValueError, match="n_classes must be at least 2, got 1"):
        onevsone(1)


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        ([1, -1], r"shape \(n_classes >= 2, n_learners >= 1\), got shape \(2,\)"),
        (np.zeros((3, 0)), r"got shape \(3, 0\)"),
        ([[1, 2], [-1, -1]], r"-1, 0 and \+1 only"),
        ([[1, 0.5], [-1, -1]], r"-1, 0 and \+1 only"),
        ([[1, 1], [-1, 0]], "column 1 must hold both"),
        ([[1], [-1], [0]], "row 2 is all 0"),
    ],
)
def test_bad_coding_matrix(matrix, message):
    with pytest.raises(ValueError, match=message):
        check_coding_matrix(matrix)


# The definitions, in plain Python: one number at a time, with no care for large ones.
DEFINITIONS = {
    "hinge": lambda z: max(0.0, 1 - z) / 2,
    "hamming": lambda z: (1 - (z > 0) + (z < 0)) / 2,
    "linear": lambda z: (1 - z) / 2,
    "exponential": lambda z: math.exp(-z) / 2,
    "logit": lambda z: math.log(1 + math.exp(-z)) / (2 * math.log(2)),
    "binodeviance": lambda z: math.log(1 + math.exp(-2 * z)) / (2 * math.log(2)),
}


def test_every_loss_has_a_definition_here():
    assert set(DEFINITIONS) == set(LOSSES)


@pytest.mark.parametrize("name", LOSSES)
class TestLosses:
    def test_definition(self, name):
        scores = np.concatenate([np.linspace(-8, 8, 161), [0.0, 1.0, -1.0, 300.0, -300.0]])
        for code in (1, -1):
            expected = [DEFINITIONS[name](code * s) for s in scores]
            np.testing.assert_allclose(LOSSES[name](code, scores), expected, rtol=1e-13, atol=1e-14)

    def test_half_at_zero(self, name):
        assert LOSSES[name](1, np.zeros(1)) == pytest.approx(0.5, abs=1e-15)
        assert LOSSES[name](-1, np.zeros(1)) == pytest.approx(0.5, abs=1e-15)

    def test_finite_and_never_rising_up_to_a_million(self, name):
        scores = np.concatenate([-np.logspace(6, -3, 400), [0.0], np.logspace(-3, 6, 400)])
        loss = LOSSES[name](1, scores)
        assert np.isfinite(loss).all()
        assert (np.diff(loss) <= 0).all()
        np.testing.assert_array_equal(LOSSES[name](-1, -scores), loss)
        if name != "hamming":
            assert (np.diff(loss[:400]) < 0).all()  # no ties among wrong answers, however wrong


def test_no_exponential_overflows_in_a_sum():
    scores = np.full((1, 55), -1e6)
    assert np.isfinite(decode(scores, onevsone(11), "exponential")).all()


@pytest.mark.parametrize("name", LOSSES)
@pytest.mark.parametrize("decoding", DECODINGS)
def test_decode_is_minus_the_mean_loss(name, decoding):
    rng = np.random.default_rng(0)
    matrix = np.array([[1, 1, 0, 1], [-1, 0, 1, 1], [0, -1, -1, 1], [1, -1, 0, -1]])
    scores = rng.normal(scale=2.0, size=(50, 4))
    expected = np.zeros((50, 4))
    for i, k in np.ndindex(50, 4):
        costs = [DEFINITIONS[name](m * s) for m, s in zip(matrix[k], scores[i], strict=True) if m != 0]
        expected[i, k] = -sum(costs) / (len(costs) if decoding == "loss_weighted" else 4)
    np.testing.assert_allclose(decode(scores, matrix, name, decoding), expected, rtol=1e-12)


@settings(deadline=None, max_examples=50)
@given(
    n_classes=st.integers(2, 8),
    seed=st.integers(0, 1000),
    name=st.sampled_from(sorted(LOSSES)),
    decoding=st.sampled_from(sorted(DECODINGS)),
)
def test_a_row_alone_gives_the_bits_it_gives_in_a_batch(n_classes, seed, name, decoding):
    matrix = onevsone(n_classes)
    scores = np.random.default_rng(seed).normal(scale=3.0, size=(17, matrix.shape[1]))
    whole = decode(scores, matrix, name, decoding)
    rows = np.concatenate([decode(row[None], matrix, name, decoding) for row in scores])
    np.testing.assert_array_equal(rows, whole)


def test_ties_are_exact_so_that_the_first_class_wins():
    # A circle: 0 beats 1, 1 beats 2, 2 beats 0, all by as much.
    value = decode([[0.3, -0.3, 0.3]], onevsone(3))
    assert len(set(value[0])) == 1
    assert value.argmax() == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([[1.0, 2.0]], onevsone(3)), r"shape \(n, 3\), one column per learner, got shape \(1, 2\)"),
        (([1.0, 2.0, 3.0], onevsone(3)), r"got shape \(3,\)"),
        (([[1.0, np.nan, 3.0]], onevsone(3)), r"scores\[0, 1\] is nan"),
        (([[1.0, 1.0, 3.0]], onevsone(3), "votes"), "loss must be one of .* got 'votes'"),
        (([[1.0, 1.0, 3.0]], onevsone(3), "hinge", "mean"), "decoding must be one of .* got 'mean'"),
    ],
)
def test_bad_input_to_decode(arguments, message):
    with pytest.raises(ValueError, match=message):
        decode(*arguments)
