"""WrenchBuffer against a naive twin over random use, and from many threads at once."""

import threading
from functools import partial

import numpy as np
from hypothesis import given, settings, strategies as st

from core_cases import at_once
from granular_id._core import WindowError, WrenchBuffer

CAPACITY = 12
PERIOD = 0.002


class Twin:
    """Keeps every row of one epoch in a list, in order; no row may wait."""

    def __init__(self):
        self.rows = []  # (instant, value)
        self.duplicates = self.late = self.non_finite = 0

    def push(self, instant, value):
        if not np.isfinite(value):
            self.non_finite += 1
        elif self.rows and instant <= self.rows[-1][0]:
            stored = [at for at, _ in self.rows[-CAPACITY:]]
            if instant in stored:
                self.duplicates += 1
            else:
                self.late += 1
        else:
            self.rows.append((instant, value))

    def missing(self):
        return [0, *(b - a - 1 for (a, _), (b, _) in zip(self.rows, self.rows[1:], strict=False))]

    def window(self, n):
        """Instants of a window that allows any gap, or None."""
        stored = dict(self.rows[-CAPACITY:])
        if not stored:
            return None
        last = self.rows[-1][0]
        instants = range(last - n + 1, last + 1)
        return None if instants[0] < min(stored) else [stored.get(at) for at in instants]


steps = st.one_of(
    st.tuples(st.just("row"), st.integers(1, 1), st.floats(-1e6, 1e6)),
    st.tuples(st.just("row"), st.integers(-3, 6), st.floats(-1e6, 1e6)),
    st.tuples(st.just("row"), st.integers(1, 2), st.sampled_from([np.nan, -np.inf])),
    st.tuples(st.just("block"), st.integers(1, 30), st.floats(-1e6, 1e6)),
    st.tuples(st.just("read"), st.one_of(st.none(), st.integers(1, 9)), st.none()),
    st.tuples(st.just("window"), st.integers(1, CAPACITY), st.none()),
)


@settings(deadline=None, max_examples=100)
@given(st.lists(steps, max_size=60))
def test_equals_a_naive_twin(use):
    buffer, twin = WrenchBuffer(CAPACITY * PERIOD), Twin()
    reader, place = buffer.reader(), 0
    newest = 100
    for what, number, value in use:
        if what == "row":
            instant = newest + number
            before = len(twin.rows)
            twin.push(instant, value)
            assert buffer.push(np.full(6, value), instant * PERIOD) == (len(twin.rows) > before)
        elif what == "block":
            instants = newest + 1 + np.arange(number)
            values = value + np.arange(number)
            for pair in zip(instants.tolist(), values.tolist(), strict=True):
                twin.push(*pair)
            assert buffer.push_block(np.repeat(values[:, None], 6, axis=1), instants * PERIOD) == number
        elif what == "read":
            block = reader.read(number)
            missed = max(0, len(twin.rows) - CAPACITY - place)
            begin = place + missed
            rows = twin.rows[begin : begin + (number or CAPACITY)]
            assert block.missed == missed
            np.testing.assert_array_equal(block.wrench[:, 3], [value for _, value in rows])
            np.testing.assert_array_equal(block.ticks, [2_000_000 * at for at, _ in rows])
            np.testing.assert_array_equal(block.missing_before, twin.missing()[begin : begin + len(rows)])
            place = begin + len(rows)
        else:
            wanted = twin.window(number)
            try:
                window = buffer.window(number, fill="nan", max_gap=100)
            except WindowError:
                assert wanted is None
            else:
                assert window.mask.tolist() == [value is not None for value in wanted]
                np.testing.assert_array_equal(window.wrench[:, 0], np.array(wanted, float))
        newest = twin.rows[-1][0] if twin.rows else newest
    stats = buffer.stats()
    assert stats["written"] == len(twin.rows)
    assert (stats["duplicates"], stats["late"]) == (twin.duplicates, twin.late)
    assert (stats["missing"], stats["non_finite"]) == (sum(twin.missing()), twin.non_finite)


def test_eight_threads_read_while_one_writes():
    n_blocks, n_rows = 400, 25
    buffer = WrenchBuffer(0.2)
    over = threading.Event()

    def write():
        for first in range(0, n_blocks * n_rows, n_rows):
            block = np.repeat(np.arange(first, first + n_rows, dtype=float)[:, None], 6, axis=1)
            assert buffer.push_block(block, block[:, 0] * PERIOD) == n_rows
        over.set()

    def read(number, reader):
        """Each row once and in order, or counted as missed."""
        n_read = n_missed = 0
        while True:
            last = over.is_set()
            block = reader.read(1 + 30 * number)
            n_missed += block.missed
            wanted = n_read + n_missed + np.arange(len(block))
            np.testing.assert_array_equal(block.wrench, np.repeat(wanted[:, None], 6, axis=1))
            n_read += len(block)
            if len(block) == 0 and last:
                return n_read + n_missed
            if len(block) == 0:
                reader.wait(0.01)
            window = buffer.window(10) if number % 2 and n_read + n_missed > 10 else None
            assert window is None or (np.diff(window.wrench[:, 5]) == 1).all()

    readers = [partial(read, number, buffer.reader()) for number in range(8)]
    assert at_once([write, *readers])[1:] == [n_blocks * n_rows] * 8


def test_eight_threads_share_one_reader():
    n_rows = 20_000
    buffer = WrenchBuffer(n_rows / 500)
    reader = buffer.reader()
    got = []

    def write():
        for k in range(0, n_rows, 50):
            buffer.push_block(np.full((50, 6), float(k)))

    def read():
        while sum(map(len, got)) < n_rows:
            block = reader.read(100)
            if len(block):
                got.append(block.ticks)
            else:
                reader.wait(0.001)

    at_once([write] + [read] * 8)
    np.testing.assert_array_equal(np.sort(np.concatenate(got)), np.arange(n_rows) * 2_000_000)


def test_eight_threads_push_into_one_buffer():
    n_rows = 1000
    buffer = WrenchBuffer(8 * n_rows / 500, reorder_depth=8)

    def write(number):
        for k in range(n_rows):
            buffer.push(np.full(6, float(number)), flags=k % 2)

    at_once([partial(write, number) for number in range(8)])
    stats = buffer.stats()
    assert (stats["written"], stats["gaps"], stats["late"]) == (8 * n_rows, 0, 0)
    values = buffer.window(8 * n_rows).wrench[:, 0]
    assert np.bincount(values.astype(int)).tolist() == [n_rows] * 8
