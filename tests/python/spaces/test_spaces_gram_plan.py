"""Spaces taken apart: scalar products of the blocks add up to those of the space."""

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.decomposition import PCA
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import StandardScaler

from granular_id.gram import linear_gram
from granular_id.spaces import (
    DFT,
    HFMH,
    BlockUnion,
    PrincipalComponents,
    RangeNormalizer,
    RawHFMH,
    RawHistogram,
    RawSignal,
    Tare,
    TimePermutation,
    block_key,
    feature_spaces,
    gram_plan,
    learns,
    unit_weight,
)
from spaces_cases import SPACES, recordings


def gram_of_plan(plan, X):
    """What an evaluation does, all rows training."""
    grams = [linear_gram(clone(block).fit_transform(X)) for _, block in plan.blocks]
    if plan.block_weights == "unit":
        weights = [unit_weight(np.sqrt(np.diag(gram))) for gram in grams]
    else:
        weights = plan.block_weights or [1.0] * len(grams)
    return sum(weight**2 * gram for weight, gram in zip(weights, grams, strict=True))


LEARNING = {"hfmh, own range", "raw+hfmh, weighted", "histogram", "union, weighted"}
PERMUTED = make_pipeline(TimePermutation(), "passthrough", HFMH())
UNIONS = [("both", RawHFMH()), ("tared", make_pipeline(Tare(), DFT()))]
PLANNED = {
    **{name: space for name, space in SPACES.items() if name not in LEARNING},
    "permuted": make_pipeline(TimePermutation(3), RawHFMH(block_weights="unit")),
    "tared and permuted": make_pipeline(Tare(), PERMUTED),
    "union of a union": BlockUnion(UNIONS, block_weights="unit"),
}


@pytest.mark.parametrize("name", PLANNED)
def test_products_of_the_plan_are_those_of_the_space(name):
    X = recordings(n=7)
    plan = gram_plan(PLANNED[name])
    assert plan.after == ()
    assert not any(learns(block) for _, block in plan.blocks)
    expected = linear_gram(clone(PLANNED[name]).fit_transform(X))
    np.testing.assert_allclose(gram_of_plan(plan, X), expected, rtol=1e-9)


@pytest.mark.parametrize(
    "transformer",
    [
        HFMH(bin_range="auto"),
        RawHistogram(),
        RawHFMH(bin_range="auto", block_weights="unit"),
        SPACES["union, weighted"],
        make_pipeline(RawSignal(), PCA(3)),
        make_pipeline(RawSignal(), StandardScaler(), PrincipalComponents()),
        make_pipeline(TimePermutation(None), RawHFMH()),
        make_pipeline(Tare()),
        make_pipeline(PrincipalComponents()),
        StandardScaler(),
    ],
)
def test_what_does_not_come_apart(transformer):
    assert gram_plan(transformer) is None


def test_plans_of_the_paper():
    plans = {name: gram_plan(space.transformer) for name, space in feature_spaces(tare_s=0.1).items()}
    assert [name for name, plan in plans.items() if plan is None] == ["raw-histogram", "multiband", "best"]
    assert [type(step).__name__ for step in plans["pca+rica"].after] == ["PrincipalComponents", "RICA"]
    assert [type(step).__name__ for step in plans["pca"].after] == ["PrincipalComponents"]
    paper = [plans[name] for name, space in feature_spaces().items() if space.paper_accuracy and plans[name]]
    keys = {block_key(block) for plan in paper for _, block in plan.blocks}
    assert (len(paper), len(keys)) == (10, 4)  # raw, normalised, HFMH, DFT
    weighted = feature_spaces(block_weights=(1, 0.5))["raw+dft"].transformer
    assert gram_plan(weighted).block_weights == (1.0, 0.5)


def test_components_of_the_plan_are_those_of_the_pipeline():
    X, other = recordings(n=9), recordings(n=4, seed=1)
    pipeline = Pipeline(feature_spaces(tare_s=0.1)["pca"].transformer.steps).fit(X)
    plan = gram_plan(pipeline)
    (_, block), (pca,) = plan.blocks[0], plan.after
    rows, columns = clone(block).fit_transform(X), clone(block).fit(X).transform(other)
    scores = clone(pca).fit_gram(linear_gram(rows)).transform_gram(linear_gram(columns, rows))
    np.testing.assert_allclose(scores, pipeline.transform(other), rtol=1e-9, atol=1e-9)


RANGES = [[-1, 1], [-2, 2]]


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (RawSignal(rate_hz=500.0, threads=2), RawSignal()),
        (DFT(rate_hz=500.0), DFT()),
        (RangeNormalizer(rate_hz=1), RangeNormalizer()),
        (HFMH(threads=1, cutoff_hz=23, n_bins=np.int64(100)), HFMH()),
        (HFMH(bin_range=RANGES), HFMH(bin_range=np.array(RANGES, float))),
        (clone(SPACES["union"]), SPACES["union"]),
        (make_pipeline("passthrough", make_pipeline(Tare(), DFT())), make_pipeline(Tare(), DFT())),
        (make_pipeline(RawSignal()), RawSignal()),
    ],
)
def test_keys_are_equal_where_features_are(one, other):
    assert block_key(one) == block_key(other)


def test_keys_differ_where_features_do():
    different = [
        *SPACES.values(),
        HFMH(cutoff_hz=23.5),
        HFMH(rate_hz=100.0),
        HFMH(density=True),
        DFT("log_magnitude"),
        RawHFMH(block_weights=(1, 2)),
        make_pipeline(Tare(), RawSignal()),
        make_pipeline(Tare(0.2), RawSignal()),
        make_pipeline(TimePermutation(), RawSignal()),
        make_pipeline(TimePermutation(1), RawSignal()),
        make_pipeline(TimePermutation(np.random.RandomState(0)), RawSignal()),
        make_pipeline(TimePermutation(np.random.RandomState(0)), RawSignal()),
    ]
    assert len({block_key(transformer) for transformer in different}) == len(different)
