"""WrenchBuffer in many threads at once; `tests/core/buffer_model.rs` holds it to a naive twin over random use."""

import threading
from functools import partial

import numpy as np

from core_cases import at_once
from granular_id._core import WrenchBuffer

PERIOD = 0.002


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
