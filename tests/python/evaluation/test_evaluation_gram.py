"""GramBank: slices and sums of blocks equal products of features computed the long way."""

import threading

import numpy as np
import pytest
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.decomposition import PCA
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from evaluation_cases import flat
from granular_id.evaluation import features as gram_engine
from granular_id.evaluation.features import GramBank, plan_for
from granular_id.spaces import (
    HFMH,
    BlockUnion,
    PrincipalComponents,
    RangeNormalizer,
    RawHFMH,
    RawSignal,
    Tare,
    TimePermutation,
    feature_spaces,
)

TRAIN, TEST = np.array([0, 2, 3, 5, 8, 9, 11]), np.array([1, 4, 10])


@pytest.fixture(scope="module")
def pushes():
    # a large offset: products about the mean of all rows must not lose the small differences
    return 50.0 + np.random.default_rng(0).normal(size=(12, 60, 6))


class Flat(TransformerMixin, BaseEstimator):
    """A transformer of someone else that learns nothing, says so, and counts how often it is asked."""

    learns = False
    calls = 0

    def fit(self, X, y=None):
        return self

    def transform(self, X):
        Flat.calls += 1
        return flat(X)


def centred(gram_train, cross):
    """Products about the mean of the training rows: what no choice of origin changes."""
    means = gram_train.mean(axis=0)
    return (
        gram_train - means - means[:, None] + means.mean(),
        cross - means - cross.mean(axis=1, keepdims=True) + means.mean(),
    )


@pytest.mark.parametrize(
    "transformer",
    [
        RawHFMH(block_weights=(0.5, 3.0)),
        RawHFMH(block_weights="unit"),
        BlockUnion(
            [("norm", RangeNormalizer()), ("hfmh", HFMH()), ("raw", RawSignal())], block_weights="unit"
        ),
        make_pipeline(Tare(rate_hz=500.0, tare_s=0.02), RawHFMH(block_weights="unit")),
        make_pipeline(TimePermutation(random_state=3), RawHFMH()),
        Flat(),
        *(space.transformer for space in feature_spaces().values() if not space.learns),
    ],
    ids=repr,
)
def test_slices_equal_products_of_features_fitted_on_training_rows(pushes, transformer):
    plan = plan_for(transformer)
    found = centred(*GramBank(pushes).sliced(plan, TRAIN, TEST))
    fitted = transformer.fit(pushes[TRAIN])
    train, test = fitted.transform(pushes[TRAIN]), fitted.transform(pushes[TEST])
    train, test = train - train.mean(axis=0), test - train.mean(axis=0)
    for products, expected in zip(found, (train @ train.T, test @ train.T), strict=True):
        np.testing.assert_allclose(products, expected, atol=1e-9 * np.abs(expected).max())
    assert np.array_equal(found[0].shape, (7, 7))
    assert GramBank(pushes).n_features(plan) == train.shape[1]


@pytest.mark.parametrize("weights", [None, "unit"])
def test_components_equal_those_of_scikit_learn_up_to_sign(pushes, weights):
    union = RawHFMH(block_weights=weights)
    plan = plan_for(make_pipeline(union, PrincipalComponents(4)))
    scores = GramBank(pushes).components(plan, TRAIN, TEST)
    features = union.fit(pushes[TRAIN])
    pca = PCA(4, svd_solver="full").fit(features.transform(pushes[TRAIN]))
    for found, rows in zip(scores, (TRAIN, TEST), strict=True):
        expected = pca.transform(features.transform(pushes[rows]))
        signs = np.sign((found * expected).sum(axis=0))
        np.testing.assert_allclose(found * signs, expected, atol=1e-8 * np.abs(expected).max())
        assert not found.flags.writeable


def recorded(monkeypatch, owner, name, note):
    """Let a function of `owner` note its calls in the list that is returned."""
    calls, original = [], getattr(owner, name)

    def noting(*given):
        calls.append(note(*given))
        return original(*given)

    monkeypatch.setattr(owner, name, noting)
    return calls


def test_a_block_is_computed_once_for_all_spaces_that_hold_it(pushes, monkeypatch):
    made = recorded(monkeypatch, gram_engine, "features_of", lambda name, *rest: name)
    bank = GramBank(pushes)
    for transformer in (RawHFMH(), RawSignal(), HFMH(), HFMH(threads=1), RawHFMH(block_weights="unit")):
        bank.sliced(plan_for(transformer), TRAIN, TEST)
    assert made == ["raw", "hfmh"]
    bank.sliced(plan_for(HFMH(n_bins=10)), TRAIN, TEST)
    assert made == ["raw", "hfmh", "hfmh"]


def test_components_are_computed_once_per_partition(pushes, monkeypatch):
    fits = recorded(monkeypatch, PrincipalComponents, "fit_gram", lambda self, gram: len(gram))
    bank = GramBank(pushes)
    short = plan_for(make_pipeline(RawSignal(), PrincipalComponents(4)))
    longer = plan_for(make_pipeline(RawSignal(), PrincipalComponents(4), StandardScaler()))
    one, other = (bank.components(plan, TRAIN, TEST) for plan in (short, longer))
    assert one[0] is other[0]
    bank.components(short, TEST, TRAIN)
    bank.components(plan_for(make_pipeline(RawSignal(), PrincipalComponents(3))), TRAIN, TEST)
    bank.components(plan_for(make_pipeline(HFMH(), PrincipalComponents(4))), TRAIN, TEST)
    assert fits == [7, 3, 7, 7]


def test_threads_that_ask_at_once_share_one_computation(pushes):
    Flat.calls = 0
    bank, plan, started = GramBank(pushes), plan_for(Flat()), threading.Barrier(4)

    def ask():
        started.wait()
        bank.sliced(plan, TRAIN, TEST)

    threads = [threading.Thread(target=ask) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert Flat.calls == 1


def test_what_learns_from_features_has_no_plan():
    assert plan_for(HFMH(bin_range="auto")) is None
    assert plan_for(make_pipeline(RawSignal(), StandardScaler())) is None
    assert plan_for(make_pipeline(RawSignal(), StandardScaler(), PrincipalComponents(3))) is None
