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


PLANNED = {
    **{name: space for name, space in SPACES.items() if "own range" not in name or "histogram" in name},
    "permuted": make_pipeline(TimePermutation(3), RawHFMH(block_weights="unit")),
    "tared and permuted": make_pipeline(Tare(), make_pipeline(TimePermutation(), "passthrough", HFMH())),
    "union of a union": BlockUnion(
        [("both", RawHFMH()), ("tared", make_pipeline(Tare(), DFT()))], block_weights="unit"
    ),
}
# These learn their ranges.
for learning in ("raw+hfmh, weighted", "histogram", "union, weighted"):
    PLANNED.pop(learning)


@pytest.mark.parametrize("name", PLANNED)
def test_products_of_the_plan_are_those_of_the_space(name):
    X = recordings(n=7)
    plan = gram_plan(PLANNED[name])
    assert plan.after == ()
    assert not any(learns(block) for _, block in plan.blocks)
    np.testing.assert_allclose(
        gram_of_plan(plan, X), linear_gram(clone(PLANNED[name]).fit_transform(X)), rtol=1e-9
    )


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
    assert len(paper) == 10
    assert (
        len({block_key(block) for plan in paper for _, block in plan.blocks}) == 4
    )  # raw, normalised, HFMH, DFT
    assert gram_plan(feature_spaces(block_weights=(1, 0.5))["raw+dft"].transformer).block_weights == (
        1.0,
        0.5,
    )


def test_components_of_the_plan_are_those_of_the_pipeline():
    X, other = recordings(n=9), recordings(n=4, seed=1)
    pipeline = Pipeline(feature_spaces(tare_s=0.1)["pca"].transformer.steps).fit(X)
    plan = gram_plan(pipeline)
    (_, block), (pca,) = plan.blocks[0], plan.after
    rows, columns = clone(block).fit_transform(X), clone(block).fit(X).transform(other)
    scores = clone(pca).fit_gram(linear_gram(rows)).transform_gram(linear_gram(columns, rows))
    np.testing.assert_allclose(scores, pipeline.transform(other), rtol=1e-9, atol=1e-9)


def test_keys_are_equal_where_features_are():
    assert block_key(RawSignal(rate_hz=500.0, threads=2)) == block_key(RawSignal())
    assert block_key(DFT(rate_hz=500.0)) == block_key(DFT())
    assert block_key(RangeNormalizer(rate_hz=1)) == block_key(RangeNormalizer())
    assert block_key(HFMH(threads=1, cutoff_hz=23, n_bins=np.int64(100))) == block_key(HFMH())
    ranges = [[-1, 1], [-2, 2]]
    assert block_key(HFMH(bin_range=ranges)) == block_key(HFMH(bin_range=np.array(ranges, float)))
    assert block_key(clone(SPACES["union"])) == block_key(SPACES["union"])
    assert block_key(make_pipeline("passthrough", make_pipeline(Tare(), DFT()))) == block_key(
        make_pipeline(Tare(), DFT())
    )
    assert block_key(make_pipeline(RawSignal())) == block_key(RawSignal())


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
