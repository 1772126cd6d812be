"""Rows of any number of axes between a source and its readers: none lost, none twice, what is gone is counted."""

import threading

import numpy as np
import pytest

from granular_id._core import WrenchBuffer
from granular_id.live.channels import ChannelBuffer, buffer_for

RATE = 100.0


def buffer(seconds=10.0, n_axes=3):
    return ChannelBuffer(seconds, rate_hz=RATE, n_axes=n_axes)


def rows(first, n, n_axes=3):
    return np.arange(first, first + n)[:, None] + np.zeros(n_axes)


def told(block):
    return (block.wrench[:, 0].tolist(), block.missing_before.tolist(), block.epoch, block.missed)


def test_the_core_keeps_rows_of_six():
    assert isinstance(buffer_for(1.0, RATE, 6), WrenchBuffer)
    assert isinstance(buffer_for(1.0, RATE, 9), ChannelBuffer)


@pytest.mark.parametrize("kind", ["core", "channels"])
def test_rows_gaps_and_epochs_are_read_as_from_the_buffer_of_the_core(kind):
    one = WrenchBuffer(10.0, rate_hz=RATE) if kind == "core" else buffer(n_axes=6)
    reader, late = one.reader(), one.reader(from_oldest=True)
    assert len(reader.read()) == 0
    one.push_block(rows(0, 3, 6), np.arange(3) / RATE)
    one.push_block(rows(5, 2, 6), (5 + np.arange(2)) / RATE)  # two are missing
    one.new_epoch()
    one.push_block(rows(0, 2, 6), np.arange(2) / RATE)
    for each in (reader, late):
        assert told(each.read()) == ([0, 1, 2, 5, 6], [0, 0, 0, 2, 0], 0, 0)
        assert told(each.read()) == ([0, 1], [0, 0], 1, 0)
        assert told(each.read())[0] == []
        assert not each.wait(0.001)
    stats = one.stats()
    assert [stats[name] for name in ("written", "gaps", "missing", "epochs")] == [7, 1, 2, 1]


def test_what_is_overwritten_is_counted():
    one = buffer(seconds=0.1)  # ten rows
    reader = one.reader()
    for first in range(0, 40, 5):
        one.push_block(rows(first, 5))
    block = reader.read()
    assert block.missed + len(block) == 40
    assert len(block) >= 10
    assert block.wrench[-1, 0] == 39


def test_rows_without_times_come_one_period_after_another():
    one = buffer()
    reader = one.reader()
    one.push(np.zeros(3))
    one.push_block(rows(1, 2), flags=[0, 1])
    block = reader.read()
    assert block.time_s.tolist() == pytest.approx([0.0, 0.01, 0.02])
    assert block.flags.tolist() == [0, 0, 1]
    assert one.lag_s() < 5.0


def test_a_reader_in_another_thread_loses_nothing():
    one = buffer()
    reader, got = one.reader(), []

    def read():
        while len(got) < 500:
            reader.wait(0.5)
            got.extend(reader.read().wrench[:, 0].tolist())

    thread = threading.Thread(target=read)
    thread.start()
    for first in range(0, 500, 4):
        one.push_block(rows(first, 4))
    thread.join(10)
    assert got == list(range(500))


@pytest.mark.parametrize(
    ("wrench", "t", "said"),
    [
        (np.zeros((2, 4)), None, r"shape \(n, 3\), got \(2, 4\)"),
        (np.full((1, 3), np.nan), None, "finite"),
        (np.zeros((2, 3)), [0.1, 0.1], "ascend"),
    ],
)
def test_rows_that_cannot_be_are_refused(wrench, t, said):
    with pytest.raises(ValueError, match=said):
        buffer().push_block(wrench, t)
