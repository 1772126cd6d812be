"""Large arrays, looked through and reordered in pieces, and columns side by side, against numpy alone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from hypothesis.extra import numpy as hnp

from effort import cases
from granular_id._checks import all_finite
from granular_id._core import interleave
from granular_id.io.arrays.shapes import row_major

N = 300_001  # float64: three pieces, the last one short


@pytest.mark.parametrize("place", [0, 131_071, 131_072, N - 1])
@pytest.mark.parametrize("bad", [np.nan, -np.inf])
def test_one_value_that_is_not_finite_is_found_wherever_it_stands(place, bad):
    values = np.zeros(N)
    assert all_finite(values)
    values[place] = bad
    assert not all_finite(values)
    assert not all_finite(values[::-1])


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 0, 2), (2, 0, 1), (0, 2, 1)])
@pytest.mark.parametrize("shape", [(21, 203, 6), (20_001, 35, 2), (1, 7, 3), (3, 1, 1)])
def test_any_order_of_axes_becomes_row_major_without_changing_a_value(order, shape):
    block = np.arange(np.prod(shape), dtype=float).reshape([shape[i] for i in order])
    block = block.transpose(np.argsort(order))
    turned = row_major(block)
    assert block.shape == shape
    assert turned.flags.c_contiguous
    assert turned is block or not block.flags.c_contiguous
    np.testing.assert_array_equal(turned, block)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=cases(25))
@given(hnp.arrays(float, hnp.array_shapes(min_dims=2, max_dims=2, max_side=300)), st.integers(0, 3))
def test_columns_side_by_side_are_the_bits_that_numpy_stacks(columns, more):
    room = np.full((columns.shape[1] + more, len(columns)), 7.0)
    finite = interleave(list(columns), room[more:])
    assert room[more:].tobytes() == np.stack(list(columns), axis=1).tobytes()
    assert finite == np.isfinite(columns).all()
    assert (room[:more] == 7.0).all()


@pytest.mark.parametrize(
    ("columns", "out", "error", "problem"),
    [
        ([np.zeros(3), np.zeros(2)], np.zeros((3, 2)), ValueError, "columns must hold 3 values, got 2"),
        ([np.zeros(3)], np.zeros((3, 2)), ValueError, r"out must have shape \(3, 1\), got \(3, 2\)"),
        ([np.zeros(3, "f4")], np.zeros((3, 1)), TypeError, "1-D array of float64, got .*float32"),
        ([[1.0]], np.zeros((1, 1)), TypeError, "1-D array of float64, got "),
        ([np.zeros(6)[::2]], np.zeros((3, 1)), ValueError, "columns must be contiguous"),
        ([np.zeros(3)], np.zeros((3, 2))[:, :1], ValueError, "out must be C-contiguous"),
    ],
)
def test_what_cannot_stand_side_by_side_is_named(columns, out, error, problem):
    with pytest.raises(error, match=problem):
        interleave(columns, out)


def test_columns_are_not_read_where_they_are_written():
    samples = np.zeros((3, 1))
    with pytest.raises(ValueError, match="out must not overlap columns"):
        interleave([samples[:, 0]], samples)
    samples.flags.writeable = False
    with pytest.raises(ValueError, match="out must be writable"):
        interleave([np.zeros(3)], samples)
