"""Binary losses and decoding against their definitions."""

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from granular_id.ecoc.codings import design, onevsone
from granular_id.ecoc.decoding import DECODINGS, LOSSES, SCORE_RANGES, decode, fitting_loss

# The definitions, in plain Python: one number at a time, with no care for large ones.
DEFINITIONS = {
    "hinge": lambda z: max(0.0, 1 - z) / 2,
    "hamming": lambda z: (1 - (z > 0) + (z < 0)) / 2,
    "root": lambda z: (1 + math.sqrt(-z)) / 2 if z < 0 else (1 - math.sqrt(min(1, z))) / 2,
    "linear": lambda z: (1 - z) / 2,
    "exponential": lambda z: math.exp(-z) / 2,
    "logit": lambda z: math.log(1 + math.exp(-z)) / (2 * math.log(2)),
    "binodeviance": lambda z: math.log(1 + math.exp(-2 * z)) / (2 * math.log(2)),
}
# Of scores in [0, 1]: code and score.
UNIT_DEFINITIONS = {"quadratic": lambda m, s: (1 - m * (2 * s - 1)) ** 2 / 2}


def cost(name, m, s):
    return UNIT_DEFINITIONS[name](m, s) if name in UNIT_DEFINITIONS else DEFINITIONS[name](m * s)


def scores_for(name, seed, shape):
    rng = np.random.default_rng(seed)
    return rng.uniform(size=shape) if name in UNIT_DEFINITIONS else rng.normal(scale=3.0, size=shape)


def test_every_loss_has_a_definition_here():
    assert set(DEFINITIONS) | set(UNIT_DEFINITIONS) == set(LOSSES)
    assert {name for name, loss in LOSSES.items() if loss.scores == "unit"} == set(UNIT_DEFINITIONS)
    assert {loss.scores for loss in LOSSES.values()} == set(SCORE_RANGES)


@pytest.mark.parametrize("name", LOSSES)
@pytest.mark.parametrize("code", [1, -1])
def test_definition_and_half_where_the_score_says_nothing(name, code):
    wide = np.concatenate([np.linspace(-8, 8, 161), [0.0, 1.0, -1.0, 300.0, -300.0]])
    unit = name in UNIT_DEFINITIONS
    scores = np.linspace(0, 1, 101) if unit else wide
    expected = [cost(name, code, s) for s in scores]
    np.testing.assert_allclose(LOSSES[name](code, scores), expected, rtol=1e-13, atol=1e-14)
    assert LOSSES[name](code, np.full(1, 0.5 * unit)) == pytest.approx(0.5, abs=1e-15)


@pytest.mark.parametrize("name", DEFINITIONS)
def test_finite_and_never_rising_up_to_a_million(name):
    scores = np.concatenate([-np.logspace(6, -3, 400), [0.0], np.logspace(-3, 6, 400)])
    loss = LOSSES[name](1, scores)
    assert np.isfinite(loss).all()
    assert (np.diff(loss) <= 0).all()
    np.testing.assert_array_equal(LOSSES[name](-1, -scores), loss)
    if name != "hamming":
        assert (np.diff(loss[:400]) < 0).all()  # no ties among wrong answers, however wrong
    assert np.isfinite(decode(np.full((1, 55), -1e6), onevsone(11), name)).all()


class TestFittingLoss:
    def test_auto(self):
        found = {scores: fitting_loss("auto", scores).name for scores in ("real", "unit", None)}
        assert found == {"real": "hinge", "unit": "quadratic", None: "hinge"}

    @pytest.mark.parametrize("name", LOSSES)
    def test_fits_one_range_only(self, name):
        assert fitting_loss(name, None) is fitting_loss(name, LOSSES[name].scores) is LOSSES[name]
        other, fitting = (
            ("unit", "'quadratic'") if LOSSES[name].scores == "real" else ("real", "'hinge', 'ha")
        )
        with pytest.raises(ValueError, match=f"loss='{name}' does not fit the learners: .* one of {fitting}"):
            fitting_loss(name, other)

    @pytest.mark.parametrize("name", ["votes", None])
    def test_unknown(self, name):
        with pytest.raises(ValueError, match=r"loss must be one of 'auto', 'hinge', .*'quadratic', got"):
            fitting_loss(name, "real")


@pytest.mark.parametrize("name", LOSSES)
@pytest.mark.parametrize("decoding", DECODINGS)
def test_decode_is_minus_the_mean_loss(name, decoding):
    matrix = np.array([[1, 1, 0, 1], [-1, 0, 1, 1], [0, -1, -1, 1], [1, -1, 0, -1]])
    scores = scores_for(name, 0, (50, 4))
    expected = np.zeros((50, 4))
    for i, k in np.ndindex(50, 4):
        costs = [cost(name, m, s) for m, s in zip(matrix[k], scores[i], strict=True) if m != 0]
        expected[i, k] = -sum(costs) / (len(costs) if decoding == "loss_weighted" else 4)
    np.testing.assert_allclose(decode(scores, matrix, name, decoding), expected, rtol=1e-12)


@settings(max_examples=30)
@given(
    n_classes=st.integers(2, 7),
    seed=st.integers(0, 1000),
    coding=st.sampled_from(["onevsone", "onevsall", "ternarycomplete"]),
    name=st.sampled_from(sorted(LOSSES)),
    decoding=st.sampled_from(sorted(DECODINGS)),
)
def test_a_row_alone_gives_the_bits_it_gives_in_a_batch(n_classes, seed, coding, name, decoding):
    matrix = design(coding, n_classes, np.random.default_rng(seed))
    scores = scores_for(name, seed, (17, matrix.shape[1]))
    whole = decode(scores, matrix, name, decoding)
    rows = np.concatenate([decode(row[None], matrix, name, decoding) for row in scores])
    np.testing.assert_array_equal(rows, whole)


def test_losses_are_added_in_the_order_of_the_learners():
    rng = np.random.default_rng(5)
    matrix = design("sparserandom", 9, rng)
    shape = (20, matrix.shape[1])
    scores = 10.0 ** rng.uniform(-8, 8, shape) * rng.choice([-1, 1], shape)
    expected = np.zeros((20, 9))
    for i, k in np.ndindex(20, 9):
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
    value = decode([[0.3, -0.3, 0.3]], onevsone(3))
    assert len(set(value[0])) == 1
    assert value.argmax() == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([[1.0, 2.0]], onevsone(3)), r"shape \(n, 3\), one column per learner, got shape \(1, 2\)"),
        (([1.0, 2.0, 3.0], onevsone(3)), r"got shape \(3,\)"),
        (([[0.1, 0.2, 1.01]], onevsone(3), "quadratic"), r"must be in \[0, 1\] .*: scores\[0, 2\] is 1.01"),
        (([[0.1, -0.01, 0.3]], onevsone(3), "quadratic"), r"scores\[0, 1\] is -0.01"),
        (([[1.0, np.nan, 3.0]], onevsone(3)), r"scores\[0, 1\] is nan"),
        (([[1.0, 1.0, 3.0]], onevsone(3), "votes"), "loss must be one of .* got 'votes'"),
        (([[1.0, 1.0, 3.0]], onevsone(3), "hinge", "mean"), "decoding must be one of .* got 'mean'"),
    ],
)
def test_bad_input_to_decode(arguments, message):
    with pytest.raises(ValueError, match=message):
        decode(*arguments)
