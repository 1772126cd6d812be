"""Extraction, streams and buffers in many threads at once: each gets its own result, and others run meanwhile."""

import sys
import threading
import time
from functools import partial

import numpy as np
import pytest

import features_twin as twin
from core_cases import N_THREADS, at_once
from granular_id import StreamingExtractor
from granular_id._core import WrenchBuffer
from granular_id.features import FeatureSpec, extract_features


def extracted_again_and_again(wrench, wanted, n, **options):
    """How many numbers differ from what is wanted."""
    return sum(twin.differing_bits(extract_features(wrench, **options), wanted) for _ in range(n))


def test_different_batches_at_once():
    rng = np.random.default_rng(31)
    jobs = []
    for n in range(N_THREADS):
        wrench = rng.standard_normal((5 + 3 * n, 100 + 31 * n, (6, 6, 3, 13)[n % 4]))
        options = {"n_bins": 10 + n, "order": 1 + n, "outside": ("drop", "clip")[n % 2]}
        wanted = twin.features(wrench, **options)
        jobs.append(partial(extracted_again_and_again, wrench, wanted, 10, threads=1 + n % 4, **options))
    assert at_once(jobs) == [0] * N_THREADS


def test_output_written_by_two_threads_is_refused_or_whole():
    wrench = np.random.default_rng(34).standard_normal((200, 400, 6))
    wanted = extract_features(wrench)
    out = np.empty_like(wanted)

    def refused():
        try:
            extract_features(wrench, out=out, threads=2)
        except ValueError as error:
            return "out must" in str(error)
        return False

    results = at_once([lambda: sum(refused() for _ in range(5))] * 4)
    assert sum(results) < 20
    assert twin.differing_bits(out, wanted) == 0


def test_one_stream_of_many_threads_takes_each_row_once():
    stream, row = StreamingExtractor(FeatureSpec()), np.linspace(-1.0, 1.0, 6)
    taken = at_once([lambda: sum(iter(partial(stream.push, row), 0))] * N_THREADS)
    assert sum(taken) == 1600
    assert twin.differing_bits(stream.features(), extract_features(np.tile(row, (1600, 1)))) == 0


def test_errors_stay_with_their_thread():
    good = np.random.default_rng(35).standard_normal((20, 100, 6))
    bad = good.copy()
    bad[7, 50, 2] = np.nan
    well = partial(extracted_again_and_again, good, twin.features(good), 10, threads=2)

    def ill():
        for _ in range(10):
            with pytest.raises(ValueError, match="recording 7, sample 50, axis 2"):
                extract_features(bad, threads=2)
        return 0

    assert at_once([well, ill] * 4) == [0] * 8


def test_threads_share_one_buffer_and_one_reader():
    n_rows = 20_000
    buffer = WrenchBuffer(n_rows / 500)
    reader = buffer.reader()
    got = []

    def write():
        for k in range(n_rows // 100):
            buffer.push(np.full(6, float(k)))
            buffer.push_block(np.full((49, 6), float(k)))

    def read():
        while sum(map(len, got)) < n_rows:
            block = reader.read(100)
            if len(block):
                got.append(block.ticks)
            else:
                reader.wait(0.001)

    at_once([write] * 2 + [read] * 8)
    np.testing.assert_array_equal(np.sort(np.concatenate(got)), np.arange(n_rows) * 2_000_000)
    assert buffer.stats()["written"] == n_rows


@pytest.fixture
def ticks_during():
    """How often a thread runs while a function does; it never takes the interpreter lock by force."""
    ticks, stop = [], threading.Event()

    def run():
        while not stop.is_set():
            ticks.append(None)
            time.sleep(0)

    def during(function):
        before = len(ticks)
        function()
        return len(ticks) - before

    interval, thread = sys.getswitchinterval(), threading.Thread(target=run)
    sys.setswitchinterval(1000)
    thread.start()
    while not ticks:
        time.sleep(0)
    yield during
    stop.set()
    thread.join()
    sys.setswitchinterval(interval)


@pytest.mark.thread_unsafe(reason="sets the switch interval of the interpreter")
@pytest.mark.skipif(not getattr(sys, "_is_gil_enabled", lambda: True)(), reason="there is no lock to release")
@pytest.mark.parametrize(
    ("shape", "threads"), [((200, 400, 6), 1), ((200, 400, 6), 2), ((80_000, 6), None)], ids=str
)
def test_the_interpreter_lock_is_released_during_long_work(shape, threads, ticks_during):
    wrench = np.random.default_rng(36).standard_normal(shape)
    wanted = extract_features(wrench)
    out = np.empty_like(wanted)
    # What holds the lock keeps the ticker from running: else a tick would prove nothing.
    assert ticks_during(lambda: [n * n for n in range(200_000)]) == 0
    # A busy machine may not run the ticker while the lock is free: then once more.
    extract = partial(extract_features, wrench, threads=threads, out=out)
    assert any(ticks_during(extract) for _ in range(500))
    assert twin.differing_bits(out, wanted) == 0
    wrench[-1, -1] = np.inf
    with pytest.raises(ValueError, match="must be finite, got inf"):
        extract()
