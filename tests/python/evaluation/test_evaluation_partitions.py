"""Partitions: disjoint, stratified, exact counts, seeded; and clear errors."""

import re

import numpy as np
import pytest
from hypothesis import given, strategies as st

from granular_id.partitions import chronological_partitions, paper_partitions
from granular_id.splits import describe_order


@st.composite
def labelled(draw, smallest=2):
    counts = draw(st.lists(st.integers(smallest, 12), min_size=2, max_size=5))
    y = np.repeat([f"m{k}" for k in range(len(counts))], counts)
    shuffle = np.random.default_rng(draw(st.integers(0, 99))).permutation(y.size)
    return y[shuffle], min(counts)


@given(labelled(), st.data())
def test_paper_partitions_are_disjoint_stratified_and_exact(case, data):
    y, fewest = case
    train = data.draw(st.integers(1, fewest - 1))
    test = data.draw(st.integers(1, fewest - train))
    partitions = paper_partitions(y, n_partitions=3, train_per_class=train, test_per_class=test, seed=7)
    assert [p.index for p in partitions] == [0, 1, 2]
    for partition in partitions:
        assert not set(partition.train) & set(partition.test)
        assert (np.diff(partition.train) > 0).all()
        assert (np.diff(partition.test) > 0).all()
        for label in np.unique(y):
            assert (y[partition.train] == label).sum() == train
            assert (y[partition.test] == label).sum() == test


def test_same_seed_same_partitions_and_more_keep_the_earlier_ones():
    y = np.repeat(["a", "b", "c"], 20)
    few = paper_partitions(y, n_partitions=3, train_per_class=10, test_per_class=5, seed=4)
    many = paper_partitions(y, n_partitions=6, train_per_class=10, test_per_class=5, seed=4)
    other = paper_partitions(y, n_partitions=3, train_per_class=10, test_per_class=5, seed=5)
    for one, same, else_ in zip(few, many, other, strict=False):
        np.testing.assert_array_equal(one.train, same.train)
        np.testing.assert_array_equal(one.test, same.test)
        assert (one.train != else_.train).any()
    assert len({tuple(p.train) for p in many}) == 6


def test_every_recording_is_drawn_equally_often():
    y = np.repeat(["a", "b"], 10)
    partitions = paper_partitions(y, n_partitions=2000, train_per_class=5, test_per_class=2, seed=0)
    tested = np.bincount(np.concatenate([p.test for p in partitions]), minlength=20)
    # 2000 draws of 2 in 10: mean 400, SD 17.9; five SD either way.
    assert (abs(tested - 400) < 90).all()


@given(labelled(), st.integers(0, 99))
def test_chronological_halves_each_class_in_order(case, seed):
    y, _ = case
    order = np.random.default_rng(seed).permutation(y.size)
    when = np.argsort(order)
    forward, backward = chronological_partitions(y, order)
    assert sorted([*forward.train, *forward.test]) == list(range(y.size))
    np.testing.assert_array_equal(forward.train, backward.test)
    np.testing.assert_array_equal(forward.test, backward.train)
    for label in np.unique(y):
        early = when[forward.train[y[forward.train] == label]]
        late = when[forward.test[y[forward.test] == label]]
        assert early.max() < late.min()
        assert late.size - early.size in (0, 1)


@pytest.mark.parametrize(
    ("times", "note"),
    [
        ([3.0, 1.0, 2.0], "by start time"),
        ([5.0, 1.0, 1.0], "by start time"),  # the equal times are in different classes
        ([np.nan] * 3, "by file order: the recordings carry no start time"),
        ([0.0] * 3, "by file order: all recordings start at the same time, so their clocks say nothing"),
    ],
)
def test_where_the_order_comes_from(times, note):
    assert describe_order(times, ["a", "a", "b"], ["x", "y", "z"]) == note


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([1.0, np.nan, 2.0], "recording 'y' has no start time but 2 of 3 recordings have one"),
        ([1.0, 1.0, 2.0], "recordings 'x' and 'y' of class 'a' start at the same time"),
    ],
)
def test_no_order(times, message):
    with pytest.raises(ValueError, match=re.escape(message) + ": no order in time$"):
        describe_order(times, ["a", "a", "b"], ["x", "y", "z"])


@pytest.mark.parametrize("make", [paper_partitions, lambda y: chronological_partitions(y, np.arange(len(y)))])
@pytest.mark.parametrize(("y", "have"), [(["oat"] * 80, "only 'oat'"), ([], "none")])
def test_one_class_only(make, y, have):
    with pytest.raises(ValueError, match=f"at least 2 classes, got {have}"):
        make(np.array(y, dtype=str))


def test_too_few_recordings_names_class_has_and_wanted():
    y = np.repeat(["oat", "rice", "peas"], [80, 50, 61])
    with pytest.raises(ValueError, match="class") as caught:
        paper_partitions(y)
    assert str(caught.value) == (
        "class 'rice' has 50 recordings, wanted 62 (50 to train, 12 to test), and 1 more class has too few: "
        "pass train_per_class=40, test_per_class=10"
    )


def test_single_recording_cannot_be_halved():
    with pytest.raises(ValueError, match=r"class 'b' has 1 recording; .* at least 2"):
        chronological_partitions(["a", "a", "b"], [0, 1, 2])


@pytest.mark.parametrize("name", ["n_partitions", "train_per_class", "test_per_class"])
def test_counts_are_whole_and_positive(name):
    y = ["a"] * 99 + ["b"] * 99
    with pytest.raises(ValueError, match=f"{name} must be at least 1, got 0"):
        paper_partitions(y, **{name: 0})
    for value in (2.0, True, "3"):
        with pytest.raises(TypeError, match=f"{name} must be a whole number, got {re.escape(repr(value))}"):
            paper_partitions(y, **{name: value})
