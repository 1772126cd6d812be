"""Columns of one scale and blocks of one weight, against scikit-learn's own scaler."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import assume, given, strategies as st
from sklearn.base import clone
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from granular_id.spaces import BlockScaler, learns, tell_blocks
from granular_id.spaces.best import BestClassifier


def rows(n=20, n_columns=7, seed=0):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, n_columns)) * 10.0 ** rng.integers(-6, 6, n_columns) + rng.normal(
        size=n_columns
    )


@given(n=st.integers(2, 30), first=st.integers(1, 6), second=st.integers(1, 6), seed=st.integers(0, 99))
def test_equal_to_a_standard_scaler_with_blocks_of_one_norm(n, first, second, seed):
    X = rows(n, first + second, seed)
    assume((X.std(axis=0) > 1e-9 * np.abs(X).max(axis=0)).all())  # else a column counts as constant
    scaled = BlockScaler([first, second]).fit_transform(X)
    weights = np.repeat([(2 * first) ** -0.5, (2 * second) ** -0.5], [first, second])
    np.testing.assert_allclose(scaled, StandardScaler().fit_transform(X) * weights, rtol=1e-9, atol=1e-12)
    squares = scaled**2
    np.testing.assert_allclose(squares[:, :first].sum(axis=1).mean(), 0.5)
    np.testing.assert_allclose(squares.sum(axis=1).mean(), 1.0)


def test_a_constant_column_is_left_out_and_its_block_shares_among_the_others():
    X = rows(10, 5)
    X[:, 1] = 1e6 + np.arange(10) % 2 * 1e-6
    X[:, 4] = -3.0
    scaler = BlockScaler({"left": 3, "right": 1, "still": 1}).fit(X)
    assert scaler.factor_[[1, 4]].tolist() == [0.0, 0.0]
    squares = (scaler.transform(X) ** 2).mean(axis=0)
    np.testing.assert_allclose(squares, [0.25, 0.0, 0.25, 0.5, 0.0])
    # A column that moves only later is still not listened to.
    later = X.copy()
    later[:, 4] = 100.0
    np.testing.assert_array_equal(scaler.transform(later), scaler.transform(X))


def test_all_rows_equal_give_zeros():
    assert not BlockScaler().fit_transform(np.full((3, 4), 0.1)).any()
    assert not BlockScaler().fit_transform([[1.0, 2.0]]).any()


def test_names_of_blocks_and_pandas_output():
    X = pd.DataFrame(rows(6, 3), columns=["a", "b", "c"])
    scaler = BlockScaler({"ab": 2, "c": 1}).set_output(transform="pandas").fit(X)
    assert scaler.transform(X).columns.tolist() == ["a", "b", "c"]
    assert scaler.block_slices_ == {"ab": slice(0, 2), "c": slice(2, 3)}
    assert list(BlockScaler((1, 2)).fit(X).block_slices_) == ["block0", "block1"]
    assert learns(make_pipeline(clone(scaler)))


@pytest.mark.parametrize(
    ("blocks", "kind", "message"),
    [
        ([3, 3], ValueError, r"add up to the 7 columns of X, got 6 \(block0 3, block1 3\)"),
        ([], ValueError, "add up to the 7 columns of X, got 0"),
        ({}, ValueError, "got 0"),
        ([7, 0], ValueError, "must be at least 1, got 0"),
        ([3.5, 3.5], TypeError, "must be a whole number"),
        ({1: 7}, TypeError, "got the name 1"),
        ("7", TypeError, "blocks must be None"),
        (7, TypeError, "blocks must be None"),
    ],
)
def test_blocks_that_do_not_fit(blocks, kind, message):
    with pytest.raises(kind, match=message):
        BlockScaler(blocks).fit(rows())


def test_beyond_float64():
    with pytest.raises(ValueError, match="spread is in the range of float64"):
        BlockScaler().fit([[1e308], [-1e308], [1e308]])
    scaler = BlockScaler().fit([[0.0], [1e-20]])
    with pytest.raises(ValueError, match="in reach of the training rows"):
        scaler.transform([[1e300]])


@pytest.mark.parametrize("kind", [BlockScaler, BestClassifier])
def test_the_text_keeps_the_order_of_blocks(kind):
    sizes = {"spectrum": 192, "coupling": 624, "b" * 40: 1, "a" * 40: 2}
    for estimator in (kind(blocks=sizes), kind().set_params(blocks=sizes)):
        again = eval(repr(estimator))
        assert list(again.blocks.items()) == list(clone(estimator).blocks.items()) == list(sizes.items())
        within = repr(make_pipeline(estimator))
        assert within.index("spectrum") < within.index("coupling") < within.index("bbb") < within.index("aaa")


def test_sizes_are_told_where_they_are_open():
    for scaler, blocks in ((BlockScaler(), {"left": 2, "right": 1}), (BlockScaler([3]), [3])):
        tell_blocks(scaler, {"left": 2, "right": 1})
        assert scaler.blocks == blocks
