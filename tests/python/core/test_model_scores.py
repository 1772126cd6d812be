"""Scores, losses and labels of a model against plain numpy, bit for bit where a bit is promised."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import model_twin as twin
from effort import cases
from granular_id._core import FeatureSpec
from granular_id.ecoc import LOSSES, decode, onevsone
from model_cases import random_model
from model_twin import bits

specs = st.builds(
    FeatureSpec,
    raw=st.just(True),
    hfmh=st.booleans(),
    density=st.booleans(),
    outside=st.sampled_from(["drop", "clip"]),
    initial=st.sampled_from(["zero", "steady"]),
    n_bins=st.integers(1, 9),
    order=st.integers(1, 8),
) | st.builds(FeatureSpec, raw=st.just(False), n_bins=st.integers(1, 9))


def assert_same_bits(got, expected):
    np.testing.assert_array_equal(bits(got), bits(expected))


@settings(max_examples=cases(15))
@given(
    specs, st.integers(2, 5), st.integers(1, 30), st.integers(1, 8), st.integers(1, 9), st.integers(0, 2**32)
)
def test_scores_are_added_in_the_order_that_is_promised(spec, n_classes, n_samples, n_axes, n, seed):
    model = random_model(seed, n_classes, n_samples, n_axes, spec)
    wrench = np.random.default_rng(seed).normal(size=(n, n_samples, n_axes))
    assert_same_bits(model.scores(wrench), twin.scores(model, wrench))


def test_scores_any_batch_and_threads_have_the_same_bits():
    model = random_model(2, 4, 50, 6, FeatureSpec(n_bins=10))
    wrench = np.random.default_rng(3).normal(size=(101, 50, 6))
    scores = model.scores(wrench, threads=1)
    for threads in (2, 3, 64):
        assert_same_bits(model.scores(wrench, threads=threads), scores)
    for i in (0, 57, 100):
        assert_same_bits(model.scores(wrench[i]), scores[i : i + 1])
    assert_same_bits(model.scores(wrench[::-1])[::-1], scores)
    assert_same_bits(model.scores(np.asfortranarray(wrench)), scores)


def random_scores(rng, n, n_learners):
    scores = rng.normal(size=(n, n_learners)) * 10.0 ** rng.integers(-3, 4, size=(n, 1))
    scores[rng.random(scores.shape) < 0.1] = 0.0
    scores[rng.random(scores.shape) < 0.1] = 1.0
    return scores


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("coding", ["onevsone", "sparse", "dense"])
def test_losses_are_those_of_the_classifier(loss, coding):
    rng = np.random.default_rng(6)
    matrix = {
        "onevsone": onevsone(6),
        "sparse": np.array([[1, 0, -1, 1], [-1, 1, 0, 0], [0, -1, 1, -1]], np.int8),
        "dense": np.array([[1, 1, 1], [1, -1, 1], [-1, 1, -1], [-1, -1, -1]], np.int8),
    }[coding]
    model = random_model(7, len(matrix), 2, 1, FeatureSpec(hfmh=False), coding_matrix=matrix, loss=loss)
    scores = random_scores(rng, 300, matrix.shape[1])
    losses = model.losses(scores)
    np.testing.assert_array_equal(losses, -decode(scores, matrix, loss))
    np.testing.assert_array_equal(model.losses(scores[5]), losses[5:6])
